"""Estimates of attitude, velocity and position from the sensors, like PX4's EKF2.

A strapdown prediction runs at half the IMU rate, as in PX4. One module for each sensor corrects the Kalman
filter (`kalman.py`): `gnss.py`, `barometer.py`, `magnetometer.py` and `vision.py`. Without these sensors,
`constraints.py` limits the drift. Outputs follow corrections smoothly (EKF2_TAU_POS, EKF2_TAU_VEL). A reset
of the filter moves the outputs at once by the same amount. Without aiding the estimate drifts with the errors
of the IMU; position and velocity become invalid after EKF2_NOAID_TOUT.
"""

from __future__ import annotations

import math
import re
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.barometer import Barometer
from vehicle_sim.estimator.constraints import UPDATE_INTERVAL_S as CONSTRAINT_INTERVAL_S
from vehicle_sim.estimator.constraints import Constraints
from vehicle_sim.estimator.fusion import HORIZON_S, blank_fusion
from vehicle_sim.estimator.gnss import Gnss
from vehicle_sim.estimator.gyro_filter import GyroFilter
from vehicle_sim.estimator.kalman import Kalman
from vehicle_sim.estimator.kalman_loops import POSITION, VELOCITY, YAW
from vehicle_sim.estimator.magnetometer import ANOMALY_HEIGHT_M, Magnetometer
from vehicle_sim.estimator.terrain import Terrain
from vehicle_sim.estimator.vision import Vision, VisionSample
from vehicle_sim.estimator.yaw_estimator import PREDICTIONS_PER_STEP as YAW_PREDICTIONS_PER_STEP
from vehicle_sim.estimator.yaw_estimator import YawEstimator
from vehicle_sim.frames import quaternion_from_euler, rotate, rotation_matrix
from vehicle_sim.geodesy import to_global, to_local
from vehicle_sim.kernels import Blocks, Column, Rows, kernel
from vehicle_sim.masks import all_of
from vehicle_sim.parameters import Parameters
from vehicle_sim.rotations import heading
from vehicle_sim.state import EstimateState, SensorState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

RANGE_EVERY_STEPS = 10
"""IMU samples per range measurement (25 Hz)."""
DEAD_RECKONING_AFTER_S = 1.0
_SAMPLES_PER_PREDICTION = 2
_ALIGN_SAMPLES = 25
"""Number of IMU samples that the alignment adds up."""
_BARO_SAMPLES = 2
"""Number of barometer samples that are averaged, as in PX4's sensor hub (20 Hz, SENS_BARO_RATE). The recorded
pressure altitude has a noise of 0.06 m, a single sample 0.09 m."""
_PUBLISH_EVERY_PREDICTIONS = 5
_TIMEOUTS_EVERY_PREDICTIONS = 10
_MAG_SAMPLES = 4
"""Number of magnetometer samples that are averaged (SENS_MAG_RATE)."""
_UNKNOWN_AT_BOOT = re.compile(r"(origin_)?(lat_deg|lon_deg|alt_amsl_m)|height_above_ground_m")
_VECTOR = re.compile(r".*_ned_m(_s2?)?|.*_frd_rad_s2?")


def blank_estimate(count: int) -> EstimateState:
    """Estimates of N vehicles that are level, at rest and without a global position."""
    values: dict[str, np.ndarray] = {}
    for name in (field.name for field in fields(EstimateState)):
        if name.startswith("valid_") or name == "gps_rejected":
            values[name] = np.zeros(count, dtype=np.bool_)
        elif _VECTOR.fullmatch(name):
            values[name] = np.zeros((count, 3))
        else:
            values[name] = np.full(count, np.nan if _UNKNOWN_AT_BOOT.fullmatch(name) else 0.0)
    values["q_ned_frd"] = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    return EstimateState(**values)


class Estimator:
    """The estimators of N vehicles.

    Args:
        count: N.
        dt_s: IMU interval.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self._predict_s = dt_s * _SAMPLES_PER_PREDICTION
        self.state = blank_estimate(count)
        self.fusion = blank_fusion(count)
        self.kalman = Kalman(count, self._predict_s, self.state.q_ned_frd)
        self._yaw_estimator = YawEstimator(count, self.state.q_ned_frd)
        self._angle_sum, self._velocity_sum = np.zeros((count, 3)), np.zeros((count, 3))
        self._gnss = Gnss(count, self.kalman, self.fusion, self._yaw_estimator)
        self._barometer = Barometer(count, self.kalman, self.fusion)
        self._magnetometer = Magnetometer(count, self.kalman, self.fusion)
        self._constraints = Constraints(count, self.kalman, self.fusion)
        self._vision = Vision(count)
        self._terrain = Terrain(count, dt_s * RANGE_EVERY_STEPS)
        self._gyro_filter = GyroFilter(count, dt_s)
        self._samples = self._predictions = 0
        self._constrain_every = round(CONSTRAINT_INTERVAL_S / self._predict_s)
        self._aligned = np.zeros(count, dtype=np.bool_)
        """(N,) vehicles whose alignment is complete."""
        self._align_force_sum, self._align_field_sum = np.zeros((count, 3)), np.zeros((count, 3))
        self._align_samples = np.zeros(count, dtype=np.int64)
        self._delta_angle = np.zeros((count, 3))
        self._delta_velocity = np.zeros((count, 3))
        self._output_offset = np.zeros((count, 2, 3))
        """(N, 2, 3) output minus filter state, for velocity and position; decays after a correction."""
        self._offset_decay = np.ones((count, 2))
        """(N, 2) factor per prediction of the velocity's and the position's output offset."""
        self._aided_at_s = np.full(count, -math.inf)
        self._no_aid_limit_s = np.zeros(count)
        self._vision_height_at_s = np.full(count, -math.inf)
        self._armed = np.zeros(count, dtype=np.bool_)
        self._sample_counts = [0, 0, 0]
        """Samples of GNSS, barometer and magnetometer at the last fusion."""
        self._baro_at_s = 0.0
        self._mag_sum = np.zeros((count, 3))
        self._mag_samples = 0
        self._mag_fresh = np.zeros(count, dtype=np.bool_)
        self._mag_at_s = 0.0

    @property
    def _now_s(self) -> float:
        return self._samples * self._dt_s

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads IMU_* and EKF2_* of vehicle `i`."""
        value = parameters.finite_value
        for module in (
            self.kalman,
            self._gnss,
            self._barometer,
            self._magnetometer,
            self._constraints,
            self._vision,
            self._terrain,
        ):
            module.configure(i, parameters)
        self._gyro_filter.configure(i, value("IMU_GYRO_CUTOFF"), value("IMU_DGYRO_CUTOFF"))
        for k, name in enumerate(("EKF2_TAU_VEL", "EKF2_TAU_POS")):
            self._offset_decay[i, k] = 1.0 - min(1.0, self._predict_s / max(value(name), self._predict_s))
        self._no_aid_limit_s[i] = 1e-6 * value("EKF2_NOAID_TOUT") + HORIZON_S

    def update(self, sensors: SensorState) -> None:
        """Processes the sensor samples of this step."""
        state = self.state
        if not all_of(self._aligned):
            self._align(sensors)
        self._gyro_filter.update(
            sensors.gyro_frd_rad_s, state.rates_frd_rad_s, state.angular_acceleration_frd_rad_s2
        )
        _add_sample(
            self._dt_s,
            sensors.gyro_frd_rad_s,
            sensors.accel_frd_m_s2,
            self._delta_angle,
            self._delta_velocity,
        )
        self._samples += 1
        if self._samples % _SAMPLES_PER_PREDICTION:
            return
        self._predict()
        counts = [sensors.gps_count, sensors.baro_count, sensors.mag_count]
        constrain = self._predictions % self._constrain_every == 0
        if counts != self._sample_counts or constrain or self._vision.has_samples:
            self._fuse(sensors, counts, constrain)

    def update_range(self, range_m: FloatArray, in_air: BoolArray, armed: BoolArray) -> None:
        """Updates the height above ground and the flight state; called every RANGE_EVERY_STEPS samples.

        Args:
            range_m: (N,) ranges; NaN: no measurement.
            in_air: (N,) vehicles in the air.
            armed: (N,) armed vehicles.
        """
        state, fusion = self.state, self.fusion
        height = self._terrain.update(
            range_m, self.kalman.matrix[:, 2, 2], in_air, state.position_ned_m[:, 2]
        )
        np.copyto(state.height_above_ground_m, np.where(state.valid_altitude, height, np.nan))
        fusion.mag_aligned_in_flight &= fusion.in_air | ~in_air
        np.copyto(fusion.in_air, in_air)
        np.copyto(self._armed, armed)

    def add_vision(self, i: int, sample: VisionSample) -> None:
        """Stores an external position, velocity or heading of vehicle `i` for the next fusion."""
        self._vision.add_sample(i, sample)

    def place(
        self, i: int, position_ned_m: FloatArray, velocity_ned_m_s: FloatArray, q_ned_frd: FloatArray
    ) -> None:
        """Sets the estimated motion of vehicle `i`, which was moved; uncertainty and biases stay, and its
        heading is estimated without a magnetometer from the beginning."""
        state, kalman = self.state, self.kalman
        kalman.position[i] = state.position_ned_m[i] = position_ned_m
        kalman.velocity[i] = state.velocity_ned_m_s[i] = velocity_ned_m_s
        state.q_ned_frd[i] = q_ned_frd
        kalman.matrix[:] = rotation_matrix(state.q_ned_frd)
        state.heading_rad[i] = heading(state.q_ned_frd[i])
        self._output_offset[i] = 0.0
        self._yaw_estimator.stop(np.arange(len(self._aligned)) == i)
        self._publish()

    def set_origin(self, i: int, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Sets the local origin of vehicle `i`; its global position does not change."""
        state = self.state
        old_lat_deg, old_lon_deg = state.origin_lat_deg[i], state.origin_lon_deg[i]
        if np.isfinite(old_lat_deg):
            north_m, east_m = to_local(old_lat_deg, old_lon_deg, np.asarray(lat_deg), np.asarray(lon_deg))
            shift = np.array([north_m, east_m, alt_amsl_m - state.origin_alt_amsl_m[i]])
            self.kalman.position[i] += shift
            state.position_ned_m[i] += shift
            self._barometer.bias_m[i] += shift[2]
        state.origin_lat_deg[i], state.origin_lon_deg[i] = lat_deg, lon_deg
        state.origin_alt_amsl_m[i] = alt_amsl_m

    def _align(self, sensors: SensorState) -> None:
        """Initializes roll and pitch from the accelerometer and the heading from the magnetometer after a
        start."""
        unaligned = ~self._aligned
        self._align_force_sum[unaligned] += sensors.accel_frd_m_s2[unaligned]
        self._align_field_sum[unaligned] += sensors.mag_frd_gauss[unaligned]
        self._align_samples[unaligned] += 1
        for i in map(int, np.flatnonzero(unaligned & (self._align_samples >= _ALIGN_SAMPLES))):
            ax, ay, az = self._align_force_sum[i]
            roll, pitch = math.atan2(-ay, -az), math.atan2(ax, math.hypot(ay, az))
            tilt_matrix = rotation_matrix(quaternion_from_euler(roll, pitch, 0.0)[None, :])
            level_field = rotate(tilt_matrix, self._align_field_sum[i : i + 1])[0]
            yaw = self._magnetometer.align(i, self._now_s, level_field)
            self.state.q_ned_frd[i] = quaternion_from_euler(roll, pitch, yaw)
            self.state.valid_attitude[i] = True
            self.state.valid_altitude[i] = True
            self._barometer.align(i, self._now_s, float(sensors.baro_alt_amsl_m[i]))
            self.kalman.motion[i] = 0.0
            self._aligned[i] = True
        self.kalman.matrix[:] = rotation_matrix(self.state.q_ned_frd)

    def _predict(self) -> None:
        state, kalman = self.state, self.kalman
        kalman.predict(self._delta_angle, self._delta_velocity)
        if self._constraints.active:
            self._constraints.add(self._delta_angle, self._delta_velocity, self._predict_s)
        _publish_motion(
            self._predict_s, self._delta_angle, self._delta_velocity, self._angle_sum, self._velocity_sum,
            self._offset_decay, self._output_offset, kalman.vector, kalman.velocity_change, state.q_ned_frd,
            state.velocity_ned_m_s, state.position_ned_m, state.acceleration_ned_m_s2, state.heading_rad,
        )  # fmt: skip
        if self._predictions % YAW_PREDICTIONS_PER_STEP == 0:
            step_s = self._predict_s * YAW_PREDICTIONS_PER_STEP
            self._yaw_estimator.predict(self._angle_sum, self._velocity_sum, step_s)
            self._angle_sum.fill(0.0)
            self._velocity_sum.fill(0.0)
        self._predictions += 1
        if self._predictions % _PUBLISH_EVERY_PREDICTIONS == 0:
            self._publish()

    def _publish(self) -> None:
        """Updates global position, accuracy and validity, at 25 Hz."""
        state, fusion, now_s = self.state, self.fusion, self._now_s
        state.lat_deg[:], state.lon_deg[:] = to_global(
            state.position_ned_m[:, 0], state.position_ned_m[:, 1], state.origin_lat_deg, state.origin_lon_deg
        )
        np.subtract(state.origin_alt_amsl_m, state.position_ned_m[:, 2], out=state.alt_amsl_m)
        variances = self.kalman.variances(VELOCITY, POSITION + 3)
        state.horizontal_accuracy_m[:] = np.sqrt(variances[:, 3] + variances[:, 4])
        state.vertical_accuracy_m[:] = np.sqrt(variances[:, 5])
        state.speed_accuracy_m_s[:] = np.sqrt(variances[:, 0] + variances[:, 1])
        if self._predictions % _TIMEOUTS_EVERY_PREDICTIONS == 0:
            self._stop_without_samples(now_s)
        unaided_s = now_s - self._aided_at_s
        np.copyto(fusion.dead_reckoning, unaided_s > DEAD_RECKONING_AFTER_S + HORIZON_S)
        aided = unaided_s < self._no_aid_limit_s
        state.valid_position[:] = aided
        state.valid_velocity[:] = aided
        state.valid_altitude[:] = self._aligned & ~fusion.fake_hgt

    def _stop_without_samples(self, now_s: float) -> None:
        """Stops the fusion of sensors that send no data; called about 12 times per second."""
        self._gnss.stop_without_samples(now_s)
        self._barometer.stop_without_samples(now_s)
        self._magnetometer.stop_without_samples(now_s, self.kalman.horizontal_accel_m_s2)
        np.copyto(self.fusion.vision_hgt, now_s - self._vision_height_at_s <= DEAD_RECKONING_AFTER_S)

    def _fuse(self, sensors: SensorState, counts: list[int], constrain: bool) -> None:
        """Fuses new samples. The outputs follow corrections smoothly, and follow resets immediately."""
        kalman, fusion, state, now_s = self.kalman, self.fusion, self.state, self._now_s
        old_counts, self._sample_counts = self._sample_counts, counts
        gnss_due = counts[0] != old_counts[0]
        baro_due = counts[1] != old_counts[1] and counts[1] % _BARO_SAMPLES == 0
        if counts[1] != old_counts[1]:
            self._barometer.add(sensors)
        if counts[2] != old_counts[2]:
            self._add_mag(sensors)
        mag_due = self._mag_samples == _MAG_SAMPLES
        if not (gnss_due or baro_due or mag_due or constrain or self._vision.has_samples):
            return
        old_motion = kalman.motion.copy()
        kalman.propagate_covariance()
        if gnss_due:
            aided = self._gnss.fuse(now_s, sensors, state, self._aligned)
            self._aided_at_s[aided] = now_s
            if self._gnss.first_fix_late.any():
                # PX4 learns the declination with the first fix and aligns the heading again.
                self._magnetometer.reset_field(self._gnss.first_fix_late, now_s)
            state.gps_rejected[:] = self._gnss.rejected
            state.valid_position |= aided
            state.valid_velocity |= aided
        if baro_due:
            self._barometer.fuse(now_s, now_s - self._baro_at_s, self._aligned)
            self._baro_at_s = now_s
        if baro_due or gnss_due:
            self._publish_ratios(now_s)
        if mag_due:
            self._fuse_mag()
        if self._vision.has_samples:
            self._fuse_vision()
        if constrain:
            aided = fusion.gnss_pos | fusion.gnss_vel | self._vision.aided(now_s)
            armed_or_flying = self._armed | fusion.in_air
            self._constraints.update(aided, armed_or_flying, self._aligned)
        self._output_offset -= kalman.motion - old_motion - kalman.reset_shift
        kalman.reset_shift.fill(0.0)

    def _publish_ratios(self, now_s: float) -> None:
        """Publishes the test ratios of ESTIMATOR_STATUS, and checks the accelerometer."""
        state, fusion = self.state, self.fusion
        state.innovation_ratio_velocity[:] = np.where(fusion.gnss_vel, self._gnss.test_ratio[:, 0], 0.0)
        state.innovation_ratio_position[:] = np.where(fusion.gnss_pos, self._gnss.test_ratio[:, 1], 0.0)
        gps_ratio = np.where(fusion.gps_hgt, self._gnss.test_ratio[:, 2], 0.0)
        baro_ratio = np.where(fusion.baro_hgt, self._barometer.test_ratio, 0.0)
        source_count = np.maximum(fusion.gps_hgt * 1 + fusion.baro_hgt * 1, 1)
        state.innovation_ratio_height[:] = (gps_ratio + baro_ratio) / source_count
        baro_below = np.where(fusion.baro_hgt, self._barometer.below_sigma, 0.0)
        fusion.check_accelerometer(now_s, baro_below, np.where(fusion.gps_hgt, self._gnss.below_sigma, 0.0))
        np.copyto(self.kalman.bad_accel, fusion.bad_acc_vertical)

    def _add_mag(self, sensors: SensorState) -> None:
        """Adds a sample to the average that is fused, as in PX4's sensor hub."""
        fresh = self._mag_fresh & sensors.mag_fresh if self._mag_samples else sensors.mag_fresh.copy()
        self._mag_fresh = fresh
        self._mag_sum += sensors.mag_frd_gauss
        self._mag_samples += 1

    def _fuse_mag(self) -> None:
        state, now_s = self.state, self._now_s
        height = np.where(
            np.isnan(state.height_above_ground_m), -self.kalman.position[:, 2], state.height_above_ground_m
        )
        self._magnetometer.fuse(
            now_s, now_s - self._mag_at_s, self._mag_sum / _MAG_SAMPLES, self._mag_fresh & self._aligned,
            height > ANOMALY_HEIGHT_M,
        )  # fmt: skip
        state.innovation_ratio_mag[:] = self._magnetometer.test_ratio
        self._mag_at_s, self._mag_samples = now_s, 0
        self._mag_sum.fill(0.0)

    def _fuse_vision(self) -> None:
        state, kalman, now_s = self.state, self.kalman, self._now_s
        gnss_fused = self.fusion.gnss_pos | self.fusion.gnss_vel
        for result in self._vision.fuse(kalman, gnss_fused & ~self.fusion.dead_reckoning, now_s):
            i = result.row
            if result.horizontal_fused:
                self._aided_at_s[i] = now_s
                state.valid_position[i] = state.valid_velocity[i] = True
            if result.vertical_fused:
                self._vision_height_at_s[i] = now_s
            heading_variance = self._vision.heading_variance(i)
            if math.isfinite(heading_variance) and math.isfinite(result.heading_rad):
                count = len(state.heading_rad)
                innovations, variances = np.zeros(count), np.full(count, np.inf)
                innovations[i] = math.remainder(result.heading_rad - float(state.heading_rad[i]), math.tau)
                variances[i] = heading_variance
                kalman.fuse(YAW, innovations, variances)


@kernel
def _add_sample(dt_s: float, gyro: Rows, accel: Rows, delta_angle: Rows, delta_velocity: Rows) -> None:
    for i in range(gyro.shape[0]):
        for k in range(3):
            delta_angle[i, k] += dt_s * gyro[i, k]
            delta_velocity[i, k] += dt_s * accel[i, k]


@kernel
def _publish_motion(
    dt_s: float, delta_angle: Rows, delta_velocity: Rows, angle_sum: Rows, velocity_sum: Rows,
    offset_decay: Rows, output_offset: Blocks, vector: Rows, velocity_change: Rows, q: Rows, velocity: Rows,
    position: Rows, acceleration: Rows, heading_rad: Column,
) -> None:  # fmt: skip
    """Writes the outputs after a prediction, adds the step to the yaw estimator's sums, and clears the
    IMU sums."""
    for i in range(q.shape[0]):
        for k in range(3):
            angle_sum[i, k] += delta_angle[i, k]
            velocity_sum[i, k] += delta_velocity[i, k]
            delta_angle[i, k] = delta_velocity[i, k] = 0.0
            output_offset[i, 0, k] *= offset_decay[i, 0]
            output_offset[i, 1, k] *= offset_decay[i, 1]
            velocity[i, k] = vector[i, k] + output_offset[i, 0, k]
            position[i, k] = vector[i, 3 + k] + output_offset[i, 1, k]
            acceleration[i, k] = velocity_change[i, k] / dt_s
        heading_rad[i] = heading(q[i])
