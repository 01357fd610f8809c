"""Fusion of the barometer; while GNSS height is fused, the filter estimates the barometer's bias.

The filter rejects an altitude outside EKF2_BARO_GATE. After 5 s of rejections the barometer is marked faulty
until the next start if another height source works; if the barometer is the only height source, the filter
resets the height to the barometer's.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.fusion import HEIGHT_TIMEOUT_S, HORIZON_S, Fusion
from vehicle_sim.estimator.kalman import Kalman
from vehicle_sim.estimator.kalman_loops import POSITION, VELOCITY
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import SensorState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

BIAS_NOISE_M_SQRT_S = 0.125
"""Process noise of the bias. In recordings of PX4, 10 % to 12 % of the bias error is corrected per second."""
BIAS_GATE = 3.0
"""An innovation corrects the bias only if it is smaller than this number of standard deviations."""
SAMPLE_TIMEOUT_S = 0.4
SMOOTHING_FACTOR = 0.2
"""Weight of a new sample in the smoothed height; a reset uses the smoothed height."""
MAX_TEST_RATIO = 2.0
"""Upper limit of the test ratio in ESTIMATOR_STATUS."""
_RESET_VELOCITY_VARIANCE = 10.0


class Barometer:
    """Barometer fusion of N vehicles.

    Args:
        count: N.
        kalman: the filter.
        fusion: flags of the filter.
    """

    def __init__(self, count: int, kalman: Kalman, fusion: Fusion) -> None:
        self._kalman, self._fusion = kalman, fusion
        self.bias_m = np.zeros(count)
        """(N,) bias: pressure altitude minus altitude above the local origin."""
        self.test_ratio = np.zeros(count)
        """(N,) absolute innovation, divided by the gate and by the standard deviation of the innovation."""
        self.below_sigma = np.zeros(count)
        """(N,) barometer's height minus estimated height, divided by the standard deviation of the
        innovation."""
        self._alt_sum_m = np.zeros(count)
        self._sample_count = np.zeros(count, dtype=np.int64)
        """(N,) number of samples in `_alt_sum_m`."""
        self._smooth_alt_m = np.zeros(count)
        self._variance = np.ones(count)
        self._gate = np.ones(count)
        self._is_enabled = np.ones(count, dtype=np.bool_)
        self._received_at_s = np.full(count, -math.inf)
        self._fused_at_s = np.full(count, -math.inf)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads EKF2_BARO_* of vehicle `i`."""
        self._variance[i] = max(parameters.finite_value("EKF2_BARO_NOISE"), 0.01) ** 2
        self._gate[i] = max(parameters.finite_value("EKF2_BARO_GATE"), 1.0)
        self._is_enabled[i] = parameters.get("EKF2_BARO_CTRL") != 0

    def align(self, i: int, now_s: float, alt_m: float) -> None:
        """Initializes vehicle `i` at height zero with this pressure altitude."""
        self.bias_m[i] = self._smooth_alt_m[i] = alt_m
        self.test_ratio[i] = self.below_sigma[i] = self._alt_sum_m[i] = 0.0
        self._sample_count[i] = 0
        self._fused_at_s[i] = now_s
        self._fusion.baro_hgt[i] = self._is_enabled[i]
        self._fusion.height_fused_at_s[i] = now_s

    def stop_without_samples(self, now_s: float) -> None:
        """Stops the fusion of barometers without recent samples."""
        self._fusion.baro_hgt &= (now_s - self._received_at_s <= SAMPLE_TIMEOUT_S) & self._is_enabled

    def add(self, sensors: SensorState) -> None:
        """Adds new samples (`baro_fresh`) to the sums for the next mean."""
        self._alt_sum_m += np.where(sensors.baro_fresh, sensors.baro_alt_amsl_m, 0.0)
        self._sample_count += sensors.baro_fresh

    def fuse(self, now_s: float, interval_s: float, ready: BoolArray) -> None:
        """Fuses the means of the samples since the last call."""
        kalman, fusion = self._kalman, self._fusion
        fresh = (self._sample_count > 0) & ready
        self._received_at_s[fresh] = now_s
        alt_m = np.where(fresh, self._alt_sum_m / np.maximum(self._sample_count, 1), self._smooth_alt_m)
        self._alt_sum_m.fill(0.0)
        self._sample_count.fill(0)
        self._smooth_alt_m += SMOOTHING_FACTOR * (alt_m - self._smooth_alt_m)
        self.bias_m += fusion.height_shift_m
        fusion.height_shift_m.fill(0.0)
        down = kalman.position[:, 2]
        starting = fresh & self._is_enabled & ~fusion.baro_hgt & ~fusion.baro_fault
        if starting.any():
            np.copyto(self.bias_m, self._smooth_alt_m + down, where=starting)
            self._fused_at_s[starting] = now_s
            fusion.baro_hgt |= starting
        bias_gain = BIAS_NOISE_M_SQRT_S * math.sqrt(interval_s) / np.sqrt(self._variance)
        variance = self._variance * (1.0 + bias_gain)
        innovation = np.where(fresh, self.bias_m - alt_m - down, 0.0)
        sigma = np.sqrt(kalman.variance(POSITION + 2) + variance)
        normalized = innovation / sigma
        np.copyto(self.test_ratio, np.minimum(np.abs(normalized) / self._gate, MAX_TEST_RATIO), where=fresh)
        np.copyto(self.below_sigma, -normalized, where=fresh)
        in_use = fresh & fusion.baro_hgt
        corrects_bias = in_use & fusion.gps_hgt & (np.abs(normalized) < BIAS_GATE)
        self.bias_m -= np.where(corrects_bias, bias_gain, 0.0) * innovation
        accepted = in_use & (np.abs(normalized) <= self._gate)
        kalman.fuse(POSITION + 2, np.where(accepted, innovation, 0.0), np.where(accepted, variance, np.inf))
        self._fused_at_s[accepted] = now_s
        fusion.height_fused_at_s[accepted] = now_s
        self._handle_timeouts(now_s, in_use)

    def _handle_timeouts(self, now_s: float, in_use: BoolArray) -> None:
        kalman, fusion = self._kalman, self._fusion
        is_only_source = ~fusion.gps_hgt
        reset_due = in_use & is_only_source & fusion.height_reset_due(now_s)
        failing = in_use & ~reset_due & (now_s - self._fused_at_s > HEIGHT_TIMEOUT_S + HORIZON_S)
        if reset_due.any():
            kalman.reset_state(reset_due, POSITION + 2, self.bias_m - self._smooth_alt_m, self._variance)
            kalman.reset_state(
                reset_due & ~fusion.gnss_vel,
                VELOCITY + 2,
                0.0,
                np.full(len(reset_due), _RESET_VELOCITY_VARIANCE),
            )
            fusion.z_reset_counter += reset_due
            fusion.vz_reset_counter += reset_due & ~fusion.gnss_vel
            self._fused_at_s[reset_due] = now_s
            fusion.height_fused_at_s[reset_due] = now_s
            fusion.accel_good_at_s[reset_due] = now_s
        if failing.any():
            fusion.baro_hgt &= ~failing
            other_source_works = now_s - fusion.height_fused_at_s < HEIGHT_TIMEOUT_S
            fusion.baro_fault |= failing & other_source_works
