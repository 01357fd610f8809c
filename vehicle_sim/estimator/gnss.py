"""Fusion of GNSS: PX4's quality checks (EKF2_REQ_*), gates, timeouts and resets.

Fixes are first used after the checks have passed for EKF2_REQ_GPS_H, and after any failure, also before the
first use, for at least one second.
Position and velocity are each rejected as a whole if one axis is outside its gate. The estimate is reset to
the fix after 7 s of rejected velocity and position, or after 14 s of rejected position alone. Fusion stops
after 7 s without a good fix.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.fusion import HEIGHT_TIMEOUT_S, HORIZON_S, RESET_TIMEOUT_S, Fusion
from vehicle_sim.estimator.kalman import Kalman
from vehicle_sim.estimator.kalman_loops import POSITION, UNUSED, VELOCITY
from vehicle_sim.estimator.yaw_estimator import MAX_HEADING_SIGMA_RAD, YawEstimator
from vehicle_sim.frames import wrap_pi, yaw_of
from vehicle_sim.geodesy import to_local
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import EstimateState, SensorState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

POSITION_BIT, HEIGHT_BIT, VELOCITY_BIT = 1, 2, 4
"""Bits of EKF2_GPS_CTRL."""
RECHECK_S = 1.0 + HORIZON_S
"""Time for which the checks must have passed after a failure."""
FIX_TIMEOUT_S = 1.0
"""The GNSS height is not used after this time without a fix."""
YAW_RESET_AFTER_S = 1.0 + HORIZON_S
MAX_YAW_ERROR_RAD = math.radians(25.0)
"""The heading is reset if velocities are rejected for YAW_RESET_AFTER_S and the heading differs from the yaw
estimator's heading by more than MAX_YAW_ERROR_RAD."""
POSITION_RESET_S = 2.0 * RESET_TIMEOUT_S + HORIZON_S
VERTICAL_NOISE_FACTOR = 1.5
"""Vertical noise relative to horizontal noise, for GNSS velocity and the minimum noise of GNSS position."""
MAX_TEST_RATIO = 2.0
"""Upper limit of the test ratios in ESTIMATOR_STATUS."""
_CHECKS = {"EKF2_REQ_NSATS": 1, "EKF2_REQ_PDOP": 2, "EKF2_REQ_EPH": 4, "EKF2_REQ_EPV": 8, "EKF2_REQ_SACC": 16}
"""Limits, each with its bit in EKF2_GPS_CHECK."""


class Gnss:
    """GNSS fusion of N vehicles.

    Args:
        count: N.
        kalman: the filter.
        fusion: flags of the filter.
        yaw_estimator: estimates headings from the velocities.
    """

    def __init__(self, count: int, kalman: Kalman, fusion: Fusion, yaw_estimator: YawEstimator) -> None:
        self._kalman, self._fusion, self._yaw_estimator = kalman, fusion, yaw_estimator
        self.test_ratio = np.zeros((count, 3))
        """(N, 3) innovation divided by gate, for velocity, position and height."""
        self.below_sigma = np.zeros(count)
        """(N,) how far the estimate is below GNSS height or vertical velocity, in standard deviations of the
        innovation."""
        self._fused_bits = np.zeros(count, dtype=np.int64)
        """(N,) EKF2_GPS_CTRL."""
        self._limits = np.zeros((count, len(_CHECKS)))
        self._first_required_s = np.zeros(count)
        self._failed_since_start = np.zeros(count, dtype=np.bool_)
        self.first_fix_late = np.zeros(count, dtype=np.bool_)
        """(N,) whether the newest fix set the local origin, after earlier fixes had failed the checks."""
        self._noise = np.zeros((count, 2))
        self._gates = np.ones((count, 2))
        """(N, 2) for position and velocity, as in `_noise`."""
        self._max_noise_m = np.full(count, np.inf)
        self._passed_once = np.zeros(count, dtype=np.bool_)
        self._received_at_s = np.full(count, -math.inf)
        self._failed_at_s = np.zeros(count)
        self._passed_at_s = np.full(count, -math.inf)
        self._first_passed_at_s = np.zeros(count)
        """(N,) time of the first fix that passed, after FIX_TIMEOUT_S without one."""
        self.position_at_s = np.full(count, -math.inf)
        """(N,) time when a position was last fused."""
        self.velocity_at_s = np.full(count, -math.inf)
        self._height_at_s = np.full(count, -math.inf)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads EKF2_GPS_* and EKF2_REQ_* of vehicle `i`."""
        value = parameters.finite_value
        self._fused_bits[i] = int(parameters.get("EKF2_GPS_CTRL"))
        checks = int(parameters.get("EKF2_GPS_CHECK"))
        for k, (name, bit) in enumerate(_CHECKS.items()):
            self._limits[i, k] = value(name) if checks & bit else (0.0 if k == 0 else math.inf)
        self._first_required_s[i] = value("EKF2_REQ_GPS_H")
        self._noise[i] = value("EKF2_GPS_P_NOISE"), value("EKF2_GPS_V_NOISE")
        self._gates[i] = max(value("EKF2_GPS_P_GATE"), 1.0), max(value("EKF2_GPS_V_GATE"), 1.0)
        self._max_noise_m[i] = max(value("EKF2_NOAID_NOISE"), 0.01)

    def stop_without_samples(self, now_s: float) -> None:
        """Stops the fusion of receivers without a good fix; called a few times per second."""
        fusion = self._fusion
        np.copyto(fusion.gps_receiving, now_s - self._received_at_s <= FIX_TIMEOUT_S)
        fusion.gps_hgt &= fusion.gps_receiving
        stale = now_s - self._passed_at_s > RESET_TIMEOUT_S + HORIZON_S
        for flag in (fusion.gnss_pos, fusion.gnss_vel, fusion.gps_hgt):
            flag &= ~stale

    def fuse(self, now_s: float, sensors: SensorState, state: EstimateState, ready: BoolArray) -> BoolArray:
        """Fuses the newest fixes.

        Args:
            now_s: time since boot.
            sensors: `gps_fresh` marks the receivers with a new fix.
            state: the estimates; the first good fix sets their local origin.
            ready: (N,) vehicles with a known attitude.

        Returns:
            (N,) vehicles that were aided.
        """
        fresh = sensors.gps_fresh & ready & (self._fused_bits != 0)
        self._received_at_s[fresh] = now_s
        passed = self._check(now_s, sensors, fresh)
        no_origin = passed & np.isnan(state.origin_lat_deg)
        np.logical_and(no_origin, self._failed_since_start, out=self.first_fix_late)
        if no_origin.any():
            state.origin_lat_deg[no_origin] = sensors.gps_lat_deg[no_origin]
            state.origin_lon_deg[no_origin] = sensors.gps_lon_deg[no_origin]
            state.origin_alt_amsl_m[no_origin] = sensors.gps_alt_amsl_m[no_origin]
        position = self._local_position(sensors, state, passed)
        velocity = np.where(passed[:, None], sensors.gps_velocity_ned_m_s, 0.0)
        return self._fuse(now_s, sensors, passed, position, velocity)

    def _check(self, now_s: float, sensors: SensorState, fresh: BoolArray) -> BoolArray:
        satellites, pdop, eph, epv, speed_accuracy = self._limits.T
        good = (
            fresh
            & (sensors.gps_fix_type >= 3)
            & (sensors.gps_satellites >= satellites)
            & (np.hypot(sensors.gps_hdop, sensors.gps_vdop) <= pdop)
            & (sensors.gps_horizontal_accuracy_m <= eph)
            & (sensors.gps_vertical_accuracy_m <= epv)
            & (sensors.gps_speed_accuracy_m_s <= speed_accuracy)
        )
        np.copyto(self._fusion.gps_quality_bad, ~good, where=fresh)
        failed = fresh & ~good
        self._failed_at_s[failed] = now_s
        self._failed_since_start |= failed
        self._first_passed_at_s[good & (now_s - self._passed_at_s > FIX_TIMEOUT_S)] = now_s
        first_required_s = np.where(self._passed_once, 0.0, self._first_required_s)
        recheck_s = np.where(self._failed_since_start, RECHECK_S, 0.0)
        required_s = np.maximum(first_required_s, recheck_s)
        passed = good & (now_s - self._failed_at_s >= required_s)
        self._passed_once |= passed
        self._passed_at_s[passed] = now_s
        return passed

    def _local_position(self, sensors: SensorState, state: EstimateState, passed: BoolArray) -> FloatArray:
        """(N, 3) local position from GNSS; zero where the checks have not passed."""
        position = np.zeros((len(passed), 3))
        if passed.any():
            lat, lon, alt = state.origin_lat_deg, state.origin_lon_deg, state.origin_alt_amsl_m
            north, east = to_local(sensors.gps_lat_deg, sensors.gps_lon_deg, lat, lon)
            np.copyto(position[:, 0], north, where=passed)
            np.copyto(position[:, 1], east, where=passed)
            np.copyto(position[:, 2], alt - sensors.gps_alt_amsl_m, where=passed)
        return position

    def _fuse(
        self, now_s: float, sensors: SensorState, passed: BoolArray, position: FloatArray,
        velocity: FloatArray,
    ) -> BoolArray:  # fmt: skip
        kalman, fusion = self._kalman, self._fusion
        use_position = passed & (self._fused_bits & POSITION_BIT != 0)
        use_velocity = passed & (self._fused_bits & VELOCITY_BIT != 0)
        measured, variances = np.concatenate([velocity, position], axis=1), self._variances(sensors)

        starting = (use_position & ~fusion.gnss_pos) | (use_velocity & ~fusion.gnss_vel)
        both_timed_out = (now_s - self.velocity_at_s > RESET_TIMEOUT_S) & (
            now_s - self.position_at_s > RESET_TIMEOUT_S
        )
        position_timed_out = use_position & fusion.gnss_pos & (now_s - self.position_at_s > POSITION_RESET_S)
        heading_reset = self._reset_heading(now_s, use_velocity, velocity[:, :2], variances[:, 0])
        resetting = (
            passed
            & (starting | both_timed_out | position_timed_out | heading_reset)
            & (use_position | use_velocity)
        )
        if resetting.any():
            self._reset_to_fix(now_s, resetting, use_position, use_velocity, measured, variances)

        accepted = self._accepted(passed, use_position, use_velocity, measured, variances)
        if accepted.any():
            innovation = np.where(accepted, measured - kalman.vector[:, :6], 0.0)
            kalman.fuse_states(VELOCITY, innovation, np.where(accepted, variances, UNUSED))
        velocity_accepted, position_accepted, height_accepted = accepted[:, (0, 3, 5)].T
        self.velocity_at_s[velocity_accepted] = now_s
        self.position_at_s[position_accepted] = now_s
        self._height_at_s[height_accepted] = now_s
        fusion.height_fused_at_s[height_accepted] = now_s
        self._control_height(now_s, passed, measured, variances[:, 5], variances[:, 2])
        return velocity_accepted | position_accepted

    def _variances(self, sensors: SensorState) -> FloatArray:
        """(N, 6) variances of a fix: velocity, position."""
        accuracy = np.maximum(sensors.gps_horizontal_accuracy_m, self._noise[:, 0])
        position = np.minimum(accuracy, self._max_noise_m) ** 2
        speed = np.maximum(sensors.gps_speed_accuracy_m_s, self._noise[:, 1]) ** 2
        vertical_noise_m = VERTICAL_NOISE_FACTOR * self._noise[:, 0]
        height = np.maximum(sensors.gps_vertical_accuracy_m, vertical_noise_m) ** 2
        vertical_speed = speed * VERTICAL_NOISE_FACTOR**2
        return np.stack([speed, speed, vertical_speed, position, position, height], axis=1)

    def _accepted(
        self, passed: BoolArray, use_position: BoolArray, use_velocity: BoolArray, measured: FloatArray,
        variances: FloatArray,
    ) -> BoolArray:  # fmt: skip
        """(N, 6) the parts of the fixes that are within their gates; sets the test ratios, and limits a
        vertical speed that is outside its gate because of a faulty accelerometer (in `measured`)."""
        predicted = self._kalman.vector[:, :6]
        innovation = np.where(passed[:, None], measured - predicted, 0.0)
        sigma = np.sqrt(self._kalman.variances(VELOCITY, POSITION + 3) + variances)
        normalized = innovation / sigma
        ratio = np.abs(normalized)
        test_ratio = np.stack([ratio[:, :3].max(axis=1), ratio[:, 3:5].max(axis=1), ratio[:, 5]], axis=1)
        test_ratio /= self._gates[:, (1, 0, 0)]
        np.copyto(self.test_ratio, np.minimum(test_ratio, MAX_TEST_RATIO), where=passed[:, None])
        # Down is positive: an estimate below the measurement has a negative innovation.
        np.copyto(self.below_sigma, -np.minimum(normalized[:, 2], normalized[:, 5]), where=passed)

        velocity_accepted = use_velocity & (test_ratio[:, 0] <= 1.0)
        position_accepted = use_position & (test_ratio[:, 1] <= 1.0)
        bad_accel = self._fusion.bad_acc_vertical
        is_clipped = use_velocity & bad_accel & (ratio[:, :2].max(axis=1) <= self._gates[:, 1])
        if is_clipped.any():
            limit = self._gates[:, 1] * sigma[:, 2]
            limited_speed = predicted[:, 2] + np.clip(innovation[:, 2], -limit, limit)
            np.copyto(measured[:, 2], limited_speed, where=is_clipped)
            velocity_accepted |= is_clipped
        height_accepted = passed & self._fusion.gps_hgt & (test_ratio[:, 2] <= 1.0)
        return np.stack([velocity_accepted] * 3 + [position_accepted] * 2 + [height_accepted], axis=1)

    def _reset_heading(
        self, now_s: float, use_velocity: BoolArray, velocity_ne: FloatArray, variance: FloatArray
    ) -> BoolArray:
        """Updates the yaw estimator, and resets headings while velocities are rejected.

        Returns:
            (N,) vehicles whose heading was reset to the yaw estimator's heading.
        """
        kalman, fusion = self._kalman, self._fusion
        self._yaw_estimator.fuse(velocity_ne, variance, use_velocity, fusion.in_air)
        accepted_at_s = np.maximum(self.velocity_at_s, self._first_passed_at_s)
        rejected_long = (
            use_velocity & fusion.gnss_vel & fusion.in_air & (now_s - accepted_at_s > YAW_RESET_AFTER_S)
        )
        if not rejected_long.any():
            return rejected_long
        heading, heading_variance = self._yaw_estimator.headings()
        difference = wrap_pi(heading - yaw_of(kalman.q_ned_frd))
        heading_reset = (
            rejected_long
            & (heading_variance < MAX_HEADING_SIGMA_RAD**2)
            & (np.abs(difference) > MAX_YAW_ERROR_RAD)
        )
        if heading_reset.any():
            kalman.reset_heading(heading_reset, difference, heading_variance)
            fusion.heading_reset_counter += heading_reset
        return heading_reset

    def _reset_to_fix(
        self, now_s: float, resetting: BoolArray, use_position: BoolArray, use_velocity: BoolArray,
        measured: FloatArray, variances: FloatArray,
    ) -> None:  # fmt: skip
        """Resets position and velocity to the fix, at the start of the fusion or after a timeout."""
        kalman, fusion = self._kalman, self._fusion
        position_resets, velocity_resets = resetting & use_position, resetting & use_velocity
        for k in range(3):
            kalman.reset_state(velocity_resets, VELOCITY + k, measured[:, k], variances[:, k])
        for k in (3, 4):
            kalman.reset_state(position_resets, VELOCITY + k, measured[:, k], variances[:, k])
        fusion.xy_reset_counter += position_resets
        fusion.vxy_reset_counter += velocity_resets
        fusion.vz_reset_counter += velocity_resets
        fusion.aided_once |= resetting
        fusion.gnss_pos |= position_resets
        fusion.gnss_vel |= velocity_resets
        self.position_at_s[position_resets] = now_s
        self.velocity_at_s[velocity_resets] = now_s

    def _control_height(
        self,
        now_s: float,
        passed: BoolArray,
        measured: FloatArray,
        height_variance: FloatArray,
        vertical_speed_variance: FloatArray,
    ) -> None:
        """Starts, resets or stops the fusion of GNSS height; each reset also shifts the barometer's
        offset."""
        kalman, fusion = self._kalman, self._fusion
        enabled = passed & (self._fused_bits & HEIGHT_BIT != 0)
        starting = enabled & ~fusion.gps_hgt
        rejected_long = fusion.gps_hgt & passed & (now_s - self._height_at_s > HEIGHT_TIMEOUT_S)
        reset_due = passed & fusion.gps_hgt & fusion.height_reset_due(now_s)
        resetting = starting | reset_due
        fusion.gps_hgt &= ~(rejected_long & ~reset_due)
        if not resetting.any():
            return
        fusion.height_shift_m += np.where(resetting, measured[:, 5] - kalman.position[:, 2], 0.0)
        kalman.reset_state(resetting, POSITION + 2, measured[:, 5], height_variance)
        kalman.reset_state(resetting & fusion.gnss_vel, VELOCITY + 2, measured[:, 2], vertical_speed_variance)
        fusion.z_reset_counter += resetting
        fusion.vz_reset_counter += reset_due
        fusion.gps_hgt |= starting
        self._height_at_s[resetting] = now_s
        fusion.height_fused_at_s[resetting] = now_s
        fusion.accel_good_at_s[resetting] = now_s

    @property
    def rejected(self) -> BoolArray:
        """(N,) vehicles whose newest position or velocity was outside its gate."""
        in_use = self._fusion.gnss_pos | self._fusion.gnss_vel
        return in_use & (self.test_ratio[:, :2] > 1.0).any(axis=1)
