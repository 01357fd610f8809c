"""Fusion of the magnetometer: comparison with the known field, checks, alignment and timeout.

On the ground the magnetometer corrects every state except roll, pitch and their gyroscope biases, and the
declination is fused while the vehicle is at rest. At 1.5 m above ground, field, bias and heading are reset;
then the magnetometer may correct every state. While the field is disturbed or inconsistent, the magnetometer
corrects only field and bias. After 7 s of rejections the fusion stops and the variances of field and bias
are reset, which widens the gate; the fusion starts again with the first sample inside the gate. Without GNSS
or at rest, the field is reset instead.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.fusion import HORIZON_S, RESET_TIMEOUT_S, Fusion
from vehicle_sim.estimator.kalman import Kalman
from vehicle_sim.estimator.kalman_loops import EARTH_FIELD, GYRO_BIAS, MAG_BIAS, SIZE, TILT
from vehicle_sim.frames import rotate, rotate_back, wrap_pi
from vehicle_sim.magnetic_field import INCLINATION_RAD, STRENGTH_GAUSS, field_ned_gauss
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SAMPLE_TIMEOUT_S = 1.0
ANOMALY_HEIGHT_M = 1.5
"""Height above ground at which magnetic anomalies of the ground no longer disturb the field."""
CONSISTENCY_S = 0.66 + HORIZON_S
"""Time constant of the smoothed heading error; in PX4 a sample every 0.07 s has the weight 0.1."""
UNDISTURBED_S = 1.0
"""The fusion starts again only when the field has not been disturbed for this time."""
FIELD_CHANGE_GAUSS = 0.01
"""A reset keeps an estimated field that differs from the known field by less than this."""
FIELD_SMOOTHING = 0.1
"""Weight of a new sample in the smoothed field, which a reset uses."""
MAX_TEST_RATIO = 2.0
"""Upper limit of the test ratio in ESTIMATOR_STATUS."""
TYPE_HEADING, TYPE_NONE = 1, 5
"""Values of EKF2_MAG_TYPE: the magnetometer corrects only the heading; the magnetometer is not used."""
STRENGTH_CHECK, INCLINATION_CHECK = 1, 2
"""Bits of EKF2_MAG_CHECK."""
GOOD_HEADING_AFTER_S = 1.0
"""`heading_good_for_control` becomes true this long after the alignment in flight."""
DECLINATION_VARIANCE_RAD2 = 0.5
"""PX4 uses this value as the variance. With this variance, the standard deviation of the field's east
component matches PX4's log."""


class Magnetometer:
    """Magnetometer fusion of N vehicles.

    Args:
        count: N.
        kalman: the filter.
        fusion: flags of the filter.
    """

    def __init__(self, count: int, kalman: Kalman, fusion: Fusion) -> None:
        self._kalman, self._fusion = kalman, fusion
        self.test_ratio = np.zeros(count)
        """(N,) innovation divided by gate, for the axis with the largest ratio."""
        self._field_ned = np.zeros((count, 3))
        self._declination_rad = np.zeros(count)
        self._variance = np.ones(count)
        self._gate = np.ones(count)
        self._heading_noise_rad = np.ones(count)
        self._max_strength_error_gauss = np.full(count, np.inf)
        self._max_inclination_error_rad = np.full(count, np.inf)
        self._disturbed_at_s = np.full(count, -math.inf)
        self._type = np.zeros(count, dtype=np.int64)
        self._accel_limit_m_s2 = np.full(count, np.inf)
        self._smoothed_frd = np.zeros((count, 3))
        self._heading_error_rad = np.zeros(count)
        self._received_at_s = np.full(count, -math.inf)
        self._fused_at_s = np.full(count, -math.inf)
        self._heading_observable = np.zeros(count, dtype=np.bool_)
        self._aligned_at_s = np.full(count, -math.inf)
        self._heading_resets = np.zeros(count, dtype=np.int64)
        """(N,) `Fusion.heading_reset_counter` at the last check of the heading."""
        self._sensitivity = np.zeros((count, 3, SIZE))
        self._sensitivity[:, range(3), range(MAG_BIAS, SIZE)] = 1.0
        self._correctable = np.ones((count, SIZE))

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads EKF2_MAG_* and EKF2_HEAD_NOISE of vehicle `i`."""
        value = parameters.finite_value
        self._declination_rad[i] = math.radians(value("EKF2_MAG_DECL"))
        self._field_ned[i] = field_ned_gauss(self._declination_rad[i])
        self._variance[i] = max(value("EKF2_MAG_NOISE"), 0.01) ** 2
        self._gate[i] = max(value("EKF2_MAG_GATE"), 1.0)
        self._heading_noise_rad[i] = max(value("EKF2_HEAD_NOISE"), 0.01)
        checks = int(parameters.get("EKF2_MAG_CHECK"))
        self._max_strength_error_gauss[i] = value("EKF2_MAG_CHK_STR") if checks & STRENGTH_CHECK else math.inf
        max_error_rad = math.radians(value("EKF2_MAG_CHK_INC"))
        self._max_inclination_error_rad[i] = max_error_rad if checks & INCLINATION_CHECK else math.inf
        self._type[i] = int(parameters.get("EKF2_MAG_TYPE"))
        self._accel_limit_m_s2[i] = value("EKF2_MAG_ACCLIM")

    def align(self, i: int, now_s: float, level_field: FloatArray) -> float:
        """Initializes vehicle `i`; returns the heading [rad] from a field (3,) in the levelled body frame."""
        kalman, fusion = self._kalman, self._fusion
        kalman.earth_field[i] = self._field_ned[i]
        self._fused_at_s[i] = self._received_at_s[i] = now_s
        self._heading_error_rad[i] = 0.0
        fusion.mag[i] = fusion.mag_hdg[i] = self._type[i] != TYPE_NONE
        fusion.mag_heading_consistent[i] = True
        fusion.heading_good_for_control[i] = not fusion.mag[i]
        return self._declination_rad[i] - math.atan2(level_field[1], level_field[0])

    def stop_without_samples(self, now_s: float, horizontal_accel_m_s2: FloatArray) -> None:
        """Stops the fusion of magnetometers that send no data, and updates which vehicles accelerate enough
        to observe the heading by GNSS.

        Args:
            now_s: time since boot.
            horizontal_accel_m_s2: (N, 2) north and east.
        """
        timed_out = (now_s - self._received_at_s > SAMPLE_TIMEOUT_S) | (self._type == TYPE_NONE)
        self._stop(timed_out & self._fusion.mag)
        accel_m_s2 = np.hypot(horizontal_accel_m_s2[:, 0], horizontal_accel_m_s2[:, 1])
        np.greater(accel_m_s2, self._accel_limit_m_s2, out=self._heading_observable)

    def _stop(self, mask: BoolArray) -> None:
        fusion = self._fusion
        if mask.any():
            self._kalman.reset_field_covariance(mask)
            for flag in (
                fusion.mag,
                fusion.mag_3d,
                fusion.mag_hdg,
                fusion.mag_dec,
                fusion.mag_aligned_in_flight,
            ):
                flag &= ~mask
            fusion.heading_good_for_control |= mask

    def fuse(
        self,
        now_s: float,
        interval_s: float,
        measured_frd: FloatArray,
        fresh: BoolArray,
        above_anomalies: BoolArray,
    ) -> None:
        """Fuses one sample (N, 3) [gauss] of the vehicles in `fresh`."""
        fusion = self._fusion
        self._received_at_s[fresh] = now_s
        measured = np.where(fresh[:, None], measured_frd, self._smoothed_frd)
        self._smoothed_frd += FIELD_SMOOTHING * (measured - self._smoothed_frd)
        disturbed = self._is_disturbed(measured)
        np.copyto(fusion.mag_field_disturbed, disturbed, where=fresh)
        self._check_heading(interval_s, measured, fresh)
        self._choose_states(fresh)
        aligning = fresh & fusion.mag & above_anomalies & fusion.in_air & ~fusion.mag_aligned_in_flight
        if aligning.any():
            self.reset_field(aligning, now_s)
        self._disturbed_at_s[fresh & disturbed] = now_s
        starting = fresh & ~fusion.mag & (now_s - self._disturbed_at_s > UNDISTURBED_S)
        starting &= self._type != TYPE_NONE
        accepted = self._fuse_axes(measured, (fresh & fusion.mag & ~aligning) | starting)
        self._fused_at_s[accepted] = now_s
        fusion.mag |= accepted
        failing = fresh & fusion.mag & (now_s - self._fused_at_s > RESET_TIMEOUT_S + HORIZON_S)
        if failing.any():
            reset_allowed = ~(fusion.gnss_pos | fusion.gnss_vel) | fusion.vehicle_at_rest
            self.reset_field(failing & reset_allowed, now_s)
            self._stop(failing & ~reset_allowed)
        settled = fusion.mag_aligned_in_flight & (now_s - self._aligned_at_s > GOOD_HEADING_AFTER_S)
        corrects_heading = fusion.mag_hdg | fusion.mag_3d
        np.copyto(fusion.heading_good_for_control, settled | ~corrects_heading, where=fresh)

    def _is_disturbed(self, measured: FloatArray) -> BoolArray:
        """(N,) vehicles whose field has a wrong strength or inclination (EKF2_MAG_CHECK)."""
        strength_gauss = np.sqrt((measured**2).sum(axis=1))
        disturbed = np.abs(strength_gauss - STRENGTH_GAUSS) > self._max_strength_error_gauss
        if np.isfinite(self._max_inclination_error_rad).any():
            field_ned = rotate(self._kalman.matrix, measured)
            inclination = np.arctan2(field_ned[:, 2], np.hypot(field_ned[:, 0], field_ned[:, 1]))
            disturbed |= np.abs(inclination - INCLINATION_RAD) > self._max_inclination_error_rad
        return disturbed

    def _check_heading(self, interval_s: float, measured: FloatArray, fresh: BoolArray) -> None:
        """Updates whether the heading from the field, without the estimated bias, is consistent with the
        estimate's heading."""
        kalman, fusion = self._kalman, self._fusion
        field_ned = rotate(kalman.matrix, measured - kalman.mag_bias)
        declination = np.arctan2(kalman.earth_field[:, 1], kalman.earth_field[:, 0])
        heading_error = wrap_pi(declination - np.arctan2(field_ned[:, 1], field_ned[:, 0]))
        weight = 1.0 - math.exp(-interval_s / CONSISTENCY_S)
        self._heading_error_rad[fusion.heading_reset_counter != self._heading_resets] = 0.0
        self._heading_resets[:] = fusion.heading_reset_counter
        self._heading_error_rad += np.where(fresh, weight, 0.0) * (heading_error - self._heading_error_rad)
        small_error = np.abs(self._heading_error_rad) < self._heading_noise_rad
        observable = self._heading_observable | ~fusion.in_air
        consistent = small_error & (observable | fusion.mag_heading_consistent)
        np.copyto(fusion.mag_heading_consistent, consistent, where=fresh)

    def _choose_states(self, fresh: BoolArray) -> None:
        """Updates which states the magnetometer may correct."""
        fusion = self._fusion
        gnss_aided = fusion.gnss_pos | fusion.gnss_vel
        consistent = (fusion.mag_heading_consistent | ~gnss_aided) & ~fusion.mag_field_disturbed & fusion.mag
        corrects_all = consistent & fusion.mag_aligned_in_flight & (self._type != TYPE_HEADING)
        np.copyto(fusion.mag_3d, corrects_all, where=fresh)
        np.copyto(fusion.mag_hdg, consistent & ~corrects_all, where=fresh)
        np.copyto(fusion.mag_dec, fusion.mag & (~gnss_aided | fusion.vehicle_at_rest), where=fresh)

    def reset_field(self, mask: BoolArray, now_s: float) -> None:
        """Resets the heading, and an estimated field that differs from the known field.

        Without a heading reset, the bias becomes the difference between the measured and the known field.
        """
        kalman, fusion = self._kalman, self._fusion
        heading_reset = mask & (fusion.mag_hdg | fusion.mag_3d)
        squared_change = ((kalman.earth_field - self._field_ned) ** 2).sum(axis=1)
        field_resets = mask & (squared_change > FIELD_CHANGE_GAUSS**2)
        kalman.earth_field[field_resets] = self._field_ned[field_resets]
        bias = self._smoothed_frd - rotate_back(kalman.matrix, self._field_ned)
        bias[heading_reset] = 0.0
        bias_resets = heading_reset | field_resets
        kalman.mag_bias[bias_resets] = bias[bias_resets]
        kalman.reset_field_covariance(field_resets, bias_resets)
        if heading_reset.any():
            field_ned = rotate(kalman.matrix, self._smoothed_frd)
            heading_error = wrap_pi(self._declination_rad - np.arctan2(field_ned[:, 1], field_ned[:, 0]))
            kalman.reset_heading(heading_reset, heading_error, self._heading_noise_rad**2)
            fusion.heading_reset_counter += heading_reset
            fusion.mag_heading_consistent |= heading_reset
        self._heading_error_rad[heading_reset] = 0.0
        self._fused_at_s[mask] = now_s
        aligned = mask & fusion.in_air
        fusion.mag_aligned_in_flight |= aligned
        self._aligned_at_s[aligned] = now_s

    def _fuse_axes(self, measured: FloatArray, used: BoolArray) -> BoolArray:
        """Fuses all three axes or none; returns the vehicles whose sample was accepted."""
        kalman, fusion = self._kalman, self._fusion
        ned_to_frd = kalman.matrix.transpose(0, 2, 1)
        north, east, down = kalman.earth_field.T
        zero = np.zeros_like(north)
        field_cross = np.stack([zero, -down, east, down, zero, -north, -east, north, zero], axis=1)
        tilt_sensitivity = ned_to_frd @ field_cross.reshape(-1, 3, 3)
        innovation = measured - rotate_back(kalman.matrix, kalman.earth_field) - kalman.mag_bias
        sensitivity = self._sensitivity
        sensitivity[:, :, TILT : TILT + 3] = tilt_sensitivity
        sensitivity[:, :, EARTH_FIELD : EARTH_FIELD + 3] = ned_to_frd
        cross_covariance, innovation_covariance = kalman.measurement_covariances(sensitivity, self._variance)
        sigma = np.sqrt(np.einsum("nii->ni", innovation_covariance))
        test_ratio = (np.abs(innovation) / sigma).max(axis=1) / self._gate
        np.copyto(self.test_ratio, np.minimum(test_ratio, MAX_TEST_RATIO), where=used)
        accepted = used & (test_ratio <= 1.0)
        if not accepted.any():
            return accepted
        correctable = self._correctable
        correctable[:, :EARTH_FIELD] = (fusion.mag_3d | fusion.mag_hdg)[:, None]
        for first in (TILT, GYRO_BIAS):
            correctable[:, first : first + 2] = fusion.mag_3d[:, None]
        accepted_rows = accepted[:, None]
        kalman.fuse_measurements(
            cross_covariance,
            innovation_covariance,
            np.where(accepted_rows, innovation, 0.0),
            correctable * accepted_rows,
        )
        if fusion.mag_dec.any():
            self._fuse_declination(accepted & fusion.mag_dec)
        return accepted

    def _fuse_declination(self, mask: BoolArray) -> None:
        """Fuses the declination, because the field's horizontal direction is observable only in flight with
        GNSS."""
        kalman = self._kalman
        north, east = kalman.earth_field[:, 0], kalman.earth_field[:, 1]
        horizontal_squared = np.maximum(north**2 + east**2, 1e-6)
        sensitivity = np.zeros((len(mask), 1, SIZE))
        sensitivity[:, 0, EARTH_FIELD] = -east / horizontal_squared
        sensitivity[:, 0, EARTH_FIELD + 1] = north / horizontal_squared
        heading_error = np.where(mask, wrap_pi(self._declination_rad - np.arctan2(east, north)), 0.0)
        cross_covariance, innovation_covariance = kalman.measurement_covariances(
            sensitivity, np.full(len(mask), DECLINATION_VARIANCE_RAD2)
        )
        kalman.fuse_measurements(
            cross_covariance, innovation_covariance, heading_error[:, None], self._correctable * mask[:, None]
        )
