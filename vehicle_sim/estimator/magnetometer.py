"""The magnetometer in the filter: three axes against the known field, its checks, and when it is dropped.

On the ground it only turns the heading. Once 1.5 m above it, field and bias are set anew and the heading by
them; from then on it may correct every state. A disturbed or contradicting field loses its say in attitude;
one that was refused for 7 s is dropped, and taken again where it agrees once.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.fusion import HORIZON_S, RESET_TIMEOUT_S, Fusion
from vehicle_sim.estimator.kalman import FIELD, MAG_BIAS, SIZE, TILT, YAW, Kalman
from vehicle_sim.frames import rotate, rotate_back, wrap_pi
from vehicle_sim.magnetic_field import INCLINATION_RAD, STRENGTH_GAUSS, field_ned_gauss
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SILENT_S = 1.0
ABOVE_ANOMALIES_M = 1.5
CONSISTENCY_S = 0.85
"""Time constant of the heading's smoothed innovation; the recorded flag falls after 0.4 s."""
SMOOTHING = 0.1
"""Share of a new sample in the field that a reset goes to."""
LARGEST_RATIO = 2.0
NEVER_TYPE = 5
"""EKF2_MAG_TYPE: the magnetometer is not used."""
HEADING_TYPE = 1
STRENGTH_CHECK = 1
"""Bit of EKF2_MAG_CHECK."""
CONTROL_AFTER_S = 1.0
"""So long after its alignment in flight a heading by the magnetometer is good for control."""
DECLINATION_NOISE_RAD = 0.5
START_SHARE = 0.9
"""Part of EKF2_MAG_CHK_INC that a dropped magnetometer must keep to start again: recorded, 17 degrees off
starts and 19.6 never does."""


class Magnetometer:
    """The magnetometer aiding of N vehicles.

    Args:
        count: N.
        kalman: the filter.
        fusion: its flags.
    """

    def __init__(self, count: int, kalman: Kalman, fusion: Fusion) -> None:
        self._kalman, self._fusion = kalman, fusion
        self.ratio = np.zeros(count)
        """(N,) innovation over gate of the worst axis."""
        self._field_ned = np.zeros((count, 3))
        self._declination_rad = np.zeros(count)
        self._variance = np.ones(count)
        self._gate = np.ones(count)
        self._heading_noise_rad = np.ones(count)
        self._strength_gauss = np.full(count, np.inf)
        self._inclination_rad = np.full(count, np.inf)
        self._kind = np.zeros(count, dtype=np.int64)
        self._accel_limit_m_s2 = np.full(count, np.inf)
        self._smooth = np.zeros((count, 3))
        self._heading_off_rad = np.zeros(count)
        self._heard_at_s = np.full(count, -math.inf)
        self._fused_at_s = np.full(count, -math.inf)
        self._observed = np.zeros(count, dtype=np.bool_)
        self._aligned_at_s = np.full(count, -math.inf)
        self._resets = np.zeros(count, dtype=np.int64)
        self._sensitivity = np.zeros((count, 3, SIZE))
        self._sensitivity[:, range(3), range(MAG_BIAS, SIZE)] = 1.0
        self._learns = np.ones((count, SIZE))

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read EKF2_MAG_* and EKF2_HEAD_NOISE of vehicle `i`."""
        value = parameters.usable
        self._declination_rad[i] = math.radians(value("EKF2_MAG_DECL"))
        self._field_ned[i] = field_ned_gauss(self._declination_rad[i])
        self._variance[i] = max(value("EKF2_MAG_NOISE"), 0.01) ** 2
        self._gate[i] = max(value("EKF2_MAG_GATE"), 1.0)
        self._heading_noise_rad[i] = max(value("EKF2_HEAD_NOISE"), 0.01)
        checks = int(parameters.get("EKF2_MAG_CHECK"))
        self._inclination_rad[i] = START_SHARE * math.radians(value("EKF2_MAG_CHK_INC"))
        self._strength_gauss[i] = value("EKF2_MAG_CHK_STR") if checks & STRENGTH_CHECK else math.inf
        self._kind[i] = int(parameters.get("EKF2_MAG_TYPE"))
        self._accel_limit_m_s2[i] = value("EKF2_MAG_ACCLIM")

    def align(self, i: int, now_s: float, level_field: FloatArray) -> float:
        """Start of vehicle `i`: the heading (rad) by a field (3,) seen in a level frame along the nose."""
        kalman, fusion = self._kalman, self._fusion
        kalman.field[i] = self._field_ned[i]
        self._fused_at_s[i] = self._heard_at_s[i] = now_s
        self._heading_off_rad[i] = 0.0
        fusion.mag[i] = fusion.mag_hdg[i] = self._kind[i] != NEVER_TYPE
        fusion.mag_heading_consistent[i] = True
        fusion.heading_good_for_control[i] = not fusion.mag[i]
        return self._declination_rad[i] - math.atan2(level_field[1], level_field[0])

    def watch(self, now_s: float, level_accel_m_s2: FloatArray) -> None:
        """Stop what is silent, note who accelerates (N, 2) enough for GNSS to show the heading."""
        silent = (now_s - self._heard_at_s > SILENT_S) | (self._kind == NEVER_TYPE)
        self._stop(silent & self._fusion.mag)
        level = np.hypot(level_accel_m_s2[:, 0], level_accel_m_s2[:, 1])
        np.greater(level, self._accel_limit_m_s2, out=self._observed)

    def _stop(self, who: BoolArray) -> None:
        fusion = self._fusion
        if who.any():
            for flag in (
                fusion.mag,
                fusion.mag_3d,
                fusion.mag_hdg,
                fusion.mag_dec,
                fusion.mag_aligned_in_flight,
            ):
                flag &= ~who
            fusion.heading_good_for_control |= who

    def fuse(
        self, now_s: float, interval_s: float, measured_frd: FloatArray, fresh: BoolArray, high: BoolArray
    ) -> None:
        """Take one sample (N, 3) [gauss] of those in `fresh`; `high`: (N,) clear of the ground."""
        fusion = self._fusion
        self._heard_at_s[fresh] = now_s
        measured = np.where(fresh[:, None], measured_frd, self._smooth)
        self._smooth += SMOOTHING * (measured - self._smooth)
        disturbed = np.abs(np.sqrt((measured**2).sum(axis=1)) - STRENGTH_GAUSS) > self._strength_gauss
        np.copyto(fusion.mag_field_disturbed, disturbed, where=fresh)
        self._judge_heading(interval_s, measured, fresh)
        self._choose(fresh)
        align = fresh & fusion.mag & high & fusion.in_air & ~fusion.mag_aligned_in_flight
        if align.any():
            self._renew(align, now_s)
        taken = self._fuse_axes(measured, fresh & fusion.mag & ~align)
        self._fused_at_s[taken] = now_s
        self._restart(now_s, fresh & ~fusion.mag & ~disturbed, measured)
        self._stop(fusion.mag & fresh & (now_s - self._fused_at_s > RESET_TIMEOUT_S + HORIZON_S))
        settled = fusion.mag_aligned_in_flight & (now_s - self._aligned_at_s > CONTROL_AFTER_S)
        turned = fusion.mag_hdg | fusion.mag_3d
        np.copyto(fusion.heading_good_for_control, settled | ~turned, where=fresh)

    def _restart(self, now_s: float, idle: BoolArray, measured: FloatArray) -> None:
        """Begin anew where the field's inclination is right: it and the bias, not the heading."""
        kalman, fusion = self._kalman, self._fusion
        if not idle.any():
            return
        seen = rotate(kalman.matrix, measured)
        inclination = np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1]))
        who = idle & (np.abs(inclination - INCLINATION_RAD) < self._inclination_rad)
        who &= self._kind != NEVER_TYPE
        if who.any():
            kalman.forget_field(who)
            kalman.field[who] = self._field_ned[who]
            kalman.mag_bias[who] = (measured - rotate_back(kalman.matrix, self._field_ned))[who]
            self._fused_at_s[who] = now_s
            fusion.mag |= who

    def _judge_heading(self, interval_s: float, measured: FloatArray, fresh: BoolArray) -> None:
        """Whether the field's heading, less the bias learned, goes on agreeing with the estimate's."""
        kalman, fusion = self._kalman, self._fusion
        seen = rotate(kalman.matrix, measured - kalman.mag_bias)
        declination = np.arctan2(kalman.field[:, 1], kalman.field[:, 0])
        off = wrap_pi(declination - np.arctan2(seen[:, 1], seen[:, 0]))
        share = 1.0 - math.exp(-interval_s / CONSISTENCY_S)
        self._heading_off_rad[fusion.heading_reset_counter != self._resets] = 0.0
        self._resets[:] = fusion.heading_reset_counter
        self._heading_off_rad += np.where(fresh, share, 0.0) * (off - self._heading_off_rad)
        near = np.abs(self._heading_off_rad) < self._heading_noise_rad
        observed = self._observed | ~fusion.in_air
        np.copyto(
            fusion.mag_heading_consistent, near & (observed | fusion.mag_heading_consistent), where=fresh
        )

    def _choose(self, fresh: BoolArray) -> None:
        """Which part of the field may correct what."""
        fusion = self._fusion
        level = fusion.gnss_pos | fusion.gnss_vel
        agrees = (fusion.mag_heading_consistent | ~level) & ~fusion.mag_field_disturbed & fusion.mag
        full = agrees & fusion.mag_aligned_in_flight & (self._kind != HEADING_TYPE)
        np.copyto(fusion.mag_3d, full, where=fresh)
        np.copyto(fusion.mag_hdg, agrees & ~full, where=fresh)
        np.copyto(fusion.mag_dec, fusion.mag & ~level, where=fresh)

    def _renew(self, who: BoolArray, now_s: float) -> None:
        """Field and bias anew; the heading too where the field may correct it."""
        kalman, fusion = self._kalman, self._fusion
        turned = who & (fusion.mag_hdg | fusion.mag_3d)
        kalman.forget_field(who)
        kalman.field[who] = self._field_ned[who]
        kalman.mag_bias[turned] = 0.0
        absorbed = self._smooth - rotate_back(kalman.matrix, self._field_ned)
        kalman.mag_bias[who & ~turned] = absorbed[who & ~turned]
        if turned.any():
            seen = rotate(kalman.matrix, self._smooth)
            off = wrap_pi(self._declination_rad - np.arctan2(seen[:, 1], seen[:, 0]))
            kalman.reset_heading(turned, off, self._heading_noise_rad**2)
            fusion.heading_reset_counter += turned
        self._heading_off_rad[who] = 0.0
        self._fused_at_s[who] = now_s
        fusion.mag_aligned_in_flight |= who
        self._aligned_at_s[who] = now_s

    def _fuse_axes(self, measured: FloatArray, used: BoolArray) -> BoolArray:
        """Take three axes, all or none; who was believed."""
        kalman, fusion = self._kalman, self._fusion
        back = kalman.matrix.transpose(0, 2, 1)
        north, east, down = kalman.field.T
        zero = np.zeros_like(north)
        crossed = np.stack([zero, -down, east, down, zero, -north, -east, north, zero], axis=1)
        turned = back @ crossed.reshape(-1, 3, 3)
        innovation = measured - rotate_back(kalman.matrix, kalman.field) - kalman.mag_bias
        sensitivity = self._sensitivity
        sensitivity[:, :, TILT : TILT + 3] = turned
        sensitivity[:, :, FIELD : FIELD + 3] = back
        seen, total = kalman.sight(sensitivity, self._variance)
        sigma = np.sqrt(np.einsum("nii->ni", total))
        worst = (np.abs(innovation) / sigma).max(axis=1) / self._gate
        np.copyto(self.ratio, np.minimum(worst, LARGEST_RATIO), where=used)
        taken = used & (worst <= 1.0)
        if not taken.any():
            return taken
        learns = self._learns
        learns[:, :FIELD] = fusion.mag_3d[:, None]
        learns[:, YAW] = fusion.mag_3d | fusion.mag_hdg
        counts = taken[:, None]
        kalman.fuse_seen(seen, total, np.where(counts, innovation, 0.0), learns * counts)
        if fusion.mag_dec.any():
            self._fuse_declination(taken & fusion.mag_dec)
        return taken

    def _fuse_declination(self, who: BoolArray) -> None:
        """Without GNSS nothing else keeps the field from turning."""
        kalman = self._kalman
        north, east = kalman.field[:, 0], kalman.field[:, 1]
        squared = np.maximum(north**2 + east**2, 1e-6)
        sensitivity = np.zeros((len(who), 1, SIZE))
        sensitivity[:, 0, FIELD], sensitivity[:, 0, FIELD + 1] = -east / squared, north / squared
        off = np.where(who, wrap_pi(self._declination_rad - np.arctan2(east, north)), 0.0)
        seen, total = kalman.sight(sensitivity, np.full(len(who), DECLINATION_NOISE_RAD**2))
        kalman.fuse_seen(seen, total, off[:, None], self._learns * who[:, None])
