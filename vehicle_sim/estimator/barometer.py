"""The barometer in the filter: beside GNSS height its offset is learned slowly, alone it is the reference.

A height outside EKF2_BARO_GATE is refused; refused for 5 s while another height source works, the barometer
is faulty for the rest of the flight. Where it is the only one, the height is reset to it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.fusion import HEIGHT_TIMEOUT_S, HORIZON_S, Fusion
from vehicle_sim.estimator.kalman import POSITION, VELOCITY, Kalman
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import SensorState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

BIAS_NOISE_M_SQRT_S = 0.125
"""How fast the offset may change; the recorded offset follows a ramp by 0.1 to 0.12 of its lag a second."""
BIAS_GATE = 3.0
SILENT_S = 0.4
SMOOTHING = 0.2
"""Share of a new sample in the height that a reset goes to."""
LARGEST_RATIO = 2.0
_GIVEN_UP_VARIANCE = 10.0


class Barometer:
    """The barometer aiding of N vehicles.

    Args:
        count: N.
        kalman: the filter.
        fusion: its flags.
    """

    def __init__(self, count: int, kalman: Kalman, fusion: Fusion) -> None:
        self._kalman, self._fusion = kalman, fusion
        self.bias_m = np.zeros(count)
        """(N,) pressure altitude less the height above the local origin."""
        self.ratio = np.zeros(count)
        """(N,) innovation over gate."""
        self.falling = np.zeros(count)
        """(N,) how far the estimate lies below the barometer, over the innovation's sigma."""
        self._smooth_m = np.zeros(count)
        self._variance = np.ones(count)
        self._gate = np.ones(count)
        self._used = np.ones(count, dtype=np.bool_)
        self._heard_at_s = np.full(count, -math.inf)
        self._fused_at_s = np.full(count, -math.inf)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read EKF2_BARO_* of vehicle `i`."""
        self._variance[i] = max(parameters.usable("EKF2_BARO_NOISE"), 0.01) ** 2
        self._gate[i] = max(parameters.usable("EKF2_BARO_GATE"), 1.0)
        self._used[i] = parameters.get("EKF2_BARO_CTRL") != 0

    def align(self, i: int, now_s: float, alt_m: float) -> None:
        """Vehicle `i` begins at height zero with this pressure altitude."""
        self.bias_m[i] = self._smooth_m[i] = alt_m
        self.ratio[i] = self.falling[i] = 0.0
        self._fused_at_s[i] = now_s
        self._fusion.baro_hgt[i] = self._used[i]
        self._fusion.height_fused_at_s[i] = now_s

    def watch(self, now_s: float) -> None:
        """A barometer that says nothing is no more used."""
        self._fusion.baro_hgt &= (now_s - self._heard_at_s <= SILENT_S) & self._used

    def fuse(self, now_s: float, interval_s: float, sensors: SensorState, ready: BoolArray) -> None:
        """Take the newest samples of those whose `baro_fresh` says so."""
        kalman, fusion = self._kalman, self._fusion
        fresh = sensors.baro_fresh & ready
        self._heard_at_s[fresh] = now_s
        alt_m = np.where(fresh, sensors.baro_alt_amsl_m, self._smooth_m)
        self._smooth_m += SMOOTHING * (alt_m - self._smooth_m)
        self.bias_m += fusion.height_shift_m
        fusion.height_shift_m.fill(0.0)
        down = kalman.position[:, 2]
        starts = fresh & self._used & ~fusion.baro_hgt & ~fusion.baro_fault
        if starts.any():
            np.copyto(self.bias_m, self._smooth_m + down, where=starts)
            self._fused_at_s[starts] = now_s
            fusion.baro_hgt |= starts
        learned = BIAS_NOISE_M_SQRT_S * math.sqrt(interval_s) / np.sqrt(self._variance)
        variance = self._variance * (1.0 + learned)
        innovation = np.where(fresh, self.bias_m - alt_m - down, 0.0)
        sigma = np.sqrt(kalman.variance(POSITION + 2) + variance)
        over = innovation / sigma
        np.copyto(self.ratio, np.minimum(np.abs(over) / self._gate, LARGEST_RATIO), where=fresh)
        np.copyto(self.falling, -over, where=fresh)
        using = fresh & fusion.baro_hgt
        followed = using & fusion.gps_hgt & (np.abs(over) < BIAS_GATE)
        self.bias_m -= np.where(followed, learned, 0.0) * innovation
        taken = using & (np.abs(over) <= self._gate)
        kalman.fuse(POSITION + 2, np.where(taken, innovation, 0.0), np.where(taken, variance, np.inf))
        self._fused_at_s[taken] = now_s
        fusion.height_fused_at_s[taken] = now_s
        self._give_up(now_s, using)

    def _give_up(self, now_s: float, using: BoolArray) -> None:
        kalman, fusion = self._kalman, self._fusion
        alone = ~fusion.gps_hgt
        due = using & alone & fusion.height_reset_due(now_s)
        failing = using & ~due & (now_s - self._fused_at_s > HEIGHT_TIMEOUT_S + HORIZON_S)
        if due.any():
            kalman.reset_one(due, POSITION + 2, self.bias_m - self._smooth_m, self._variance)
            kalman.reset_one(due & ~fusion.gnss_vel, VELOCITY + 2, 0.0, np.full(len(due), _GIVEN_UP_VARIANCE))
            fusion.z_reset_counter += due
            fusion.vz_reset_counter += due & ~fusion.gnss_vel
            self._fused_at_s[due] = now_s
            fusion.height_fused_at_s[due] = now_s
            fusion.accel_good_at_s[due] = now_s
        if failing.any():
            fusion.baro_hgt &= ~failing
            others_work = now_s - fusion.height_fused_at_s < HEIGHT_TIMEOUT_S
            fusion.baro_fault |= failing & others_work
