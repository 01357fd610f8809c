"""What the autopilots believe: attitude, velocity and position from the sensors alone.

A strapdown prediction at half the IMU rate (PX4's filter also takes two samples at a time), corrected by GPS
at its rate, by the barometer in height and by the magnetometer in heading. Corrections reach the
outputs smoothly (EKF2_TAU_POS, EKF2_TAU_VEL). Without GPS the velocity is held near what a vehicle that goes
nowhere would show, which keeps the attitude level, and the position stops being valid after EKF2_NOAID_TOUT.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.channels import ERROR, POSITION, VELOCITY, Channels
from vehicle_sim.estimator.gyro_filter import GyroFilter
from vehicle_sim.estimator.heading import Heading
from vehicle_sim.estimator.outputs import blank_estimate, blank_row
from vehicle_sim.estimator.terrain import Terrain
from vehicle_sim.estimator.vision import Vision, VisionSample
from vehicle_sim.frames import (
    GRAVITY_M_S2,
    quaternion_from_euler,
    quaternion_product,
    quaternion_rate,
    rotate,
    rotation_matrix,
    row_norm,
    yaw_of,
)
from vehicle_sim.geodesy import to_global, to_local
from vehicle_sim.masks import all_of
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import SensorState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

RANGE_EVERY_STEPS = 10
"""A range every so many IMU samples, 25 Hz."""
_SAMPLES_A_PREDICTION = 2
_GLOBAL_EVERY_PREDICTIONS = 5
_STANDING_VARIANCE = 0.25
"""(m²) of the assumption that a vehicle without an origin has not moved."""
_GPS_POSITION_OR_SPEED = 0b101
"""Bits of EKF2_GPS_CTRL: horizontal position, velocity."""
_GRAVITY_FUSION = 4
"""Bit of EKF2_IMU_CTRL."""
_GRAVITY_GATE = 0.25
"""A sample that leans more than this part of EKF2_GRAV_NOISE is not gravity alone."""
REJECTED_LIMIT_S = 7.0
"""After so long outside its gate GPS is believed and the estimate reset to it (PX4's reset timeout)."""
_BARO_BIAS_GAIN = 0.005
_VERTICAL_SPEED_FACTOR = 1.5
"""GPS velocity is taken to be this much worse vertically."""


class Estimator:
    """The estimators of N vehicles.

    Args:
        count: N.
        dt_s: IMU interval.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self._predict_s = dt_s * _SAMPLES_A_PREDICTION
        # Arrays without dimensions: NumPy takes twice as long to multiply with a plain number.
        self._sample_step, self._predict_step = np.array(dt_s), np.array(self._predict_s)
        self.state = blank_estimate(count)
        self.channels = Channels(count)
        self._gyro = GyroFilter(count, dt_s)
        self._samples = 0
        self._predictions = 0
        self._started = np.zeros(count, dtype=np.bool_)
        self._delta_angle = np.zeros((count, 3))
        self._delta_velocity = np.zeros((count, 3))
        self._residual = np.zeros((count, 3, 2))
        self._decay = np.ones((count, 3, 2))
        self._matrix = rotation_matrix(self.state.q_ned_frd)
        self._heading = Heading(count, self._predict_s)
        self._gps_good_s = np.zeros(count)
        self._gps_fused = np.ones(count, dtype=bool)
        self._gps_wait_s = np.zeros(count)
        self._no_aid_s = np.full(count, math.inf)
        self._no_aid_limit_s = np.zeros(count)
        self._rejected_s = np.zeros((count, 3))
        self._gps_noise = np.zeros((count, 2))
        self._gates = np.ones((count, 2))
        self._fake_variance = np.zeros(count)
        self._baro_variance = np.ones((count, 1))
        self._baro_bias_m = np.zeros(count)
        self._counts = [0, 0, 0]
        self._gps_sample = -1
        self._leaning = np.zeros((count, 2))
        self._leaning_count = np.zeros((count, 1))
        self._gravity_gate_m_s2 = np.zeros((count, 1))
        self._gravity_variance = np.full((count, 1), np.inf)
        self._vision = Vision(count)
        self._terrain = Terrain(count, dt_s * RANGE_EVERY_STEPS)
        self._gps_aided = np.zeros(count, dtype=np.bool_)
        self._gravity_step = np.tile([0.0, 0.0, GRAVITY_M_S2 * self._predict_s], (count, 1))
        # Views of arrays that are only ever written in place: to make them anew costs as much as a product.
        motion = self.channels.state
        self._motion, self._accel_bias = motion[:, :, :2], motion[:, 2, ERROR]
        self._position, self._velocity = motion[:, :, POSITION], motion[:, :, VELOCITY]
        self._level_acceleration = self.state.acceleration_ned_m_s2[:, :2]

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read IMU_* and EKF2_* of vehicle `i`."""

        def value(name: str) -> float:
            return parameters.usable(name)

        self.channels.configure(i, parameters)
        self._vision.configure(i, parameters)
        self._terrain.configure(i, parameters)
        self._gyro.configure(i, value("IMU_GYRO_CUTOFF"), value("IMU_DGYRO_CUTOFF"))
        for k, name in enumerate(("EKF2_TAU_POS", "EKF2_TAU_VEL")):
            self._decay[i, :, k] = 1.0 - min(1.0, self._predict_s / max(value(name), self._predict_s))
        self._heading.configure(i, parameters)
        self._gps_wait_s[i] = value("EKF2_REQ_GPS_H")
        self._gps_fused[i] = bool(int(parameters.get("EKF2_GPS_CTRL")) & _GPS_POSITION_OR_SPEED)
        self._no_aid_limit_s[i] = 1e-6 * value("EKF2_NOAID_TOUT")
        self._gps_noise[i] = value("EKF2_GPS_P_NOISE"), value("EKF2_GPS_V_NOISE")
        self._gates[i] = max(value("EKF2_GPS_P_GATE"), 1.0), max(value("EKF2_GPS_V_GATE"), 1.0)
        self._fake_variance[i] = value("EKF2_NOAID_NOISE") ** 2
        fuses_gravity = int(parameters.get("EKF2_IMU_CTRL")) & _GRAVITY_FUSION
        self._gravity_variance[i] = value("EKF2_GRAV_NOISE") ** 2 if fuses_gravity else np.inf
        self._gravity_gate_m_s2[i] = _GRAVITY_GATE * value("EKF2_GRAV_NOISE")
        self._baro_variance[i] = max(value("EKF2_BARO_NOISE"), 0.01) ** 2

    def reset(self, i: int) -> None:
        """Vehicle `i` starts anew, as after a reboot."""
        blank_row(self.state, i)
        self.channels.reset(i)
        self._vision.reset(i)
        self._terrain.reset(i)
        self._gyro.reset(i)
        self._started[i] = False
        sums = (self._delta_angle, self._delta_velocity, self._residual)
        for rows in (*sums, self._gps_good_s, self._rejected_s, self._baro_bias_m):
            rows[i] = 0.0
        self._heading.reset(i)
        self._no_aid_s[i] = math.inf
        self._matrix = rotation_matrix(self.state.q_ned_frd)

    def update(self, sensors: SensorState) -> None:
        """Take this step's samples."""
        state = self.state
        if not all_of(self._started):
            self._align(sensors)
        self._gyro.update(
            sensors.gyro_frd_rad_s, state.rates_frd_rad_s, state.angular_acceleration_frd_rad_s2
        )
        self._delta_angle += sensors.gyro_frd_rad_s
        self._delta_velocity += sensors.accel_frd_m_s2
        self._samples += 1
        if self._samples % _SAMPLES_A_PREDICTION == 0:
            self._predict()
            counts = [sensors.gps_count, sensors.baro_count, sensors.mag_count]
            if counts != self._counts:
                if counts[0] != self._counts[0]:
                    self._fuse_gps(sensors)
                if counts[1] != self._counts[1]:
                    self._fuse_baro(sensors)
                if counts[2] != self._counts[2]:
                    self._fuse_mag(sensors)
                self._counts = counts
            if self._vision.waits:
                self._fuse_vision()

    def take_ranges(self, range_m: FloatArray, in_air: BoolArray) -> None:
        """Ranges (N,) [m] every RANGE_EVERY_STEPS samples (NaN: none), and who is in the air (N,)."""
        state = self.state
        height = self._terrain.update(range_m, self._matrix[:, 2, 2], in_air, state.position_ned_m[:, 2])
        np.copyto(state.height_above_ground_m, np.where(state.valid_altitude, height, np.nan))

    def take_vision(self, i: int, sample: VisionSample) -> None:
        """A position, velocity or heading of vehicle `i` measured from outside (EKF2_EV_CTRL)."""
        self._vision.put(i, sample)

    def set_origin(self, i: int, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Local (0, 0, 0) of vehicle `i` lies there; where it is on the globe does not change by that."""
        state = self.state
        old = (state.origin_lat_deg[i], state.origin_lon_deg[i], state.origin_alt_amsl_m[i])
        if np.isfinite(old[0]):
            north_m, east_m = to_local(old[0], old[1], np.asarray(lat_deg), np.asarray(lon_deg))
            shift = np.array([north_m, east_m, alt_amsl_m - old[2]])
            self._position[i] += shift
            state.position_ned_m[i] += shift
            self._baro_bias_m[i] += shift[2]
        state.origin_lat_deg[i], state.origin_lon_deg[i] = lat_deg, lon_deg
        state.origin_alt_amsl_m[i] = alt_amsl_m

    def _fuse_vision(self) -> None:
        state, channels = self.state, self.channels
        before = channels.state[:, :, :2].copy()
        for aid in self._vision.fuse(channels, self._gps_aided, self._samples * self._dt_s):
            i = aid.row
            if aid.horizontal:
                self._no_aid_s[i] = 0.0
                state.valid_position[i] = state.valid_velocity[i] = True
            gain = self._vision.heading_gain(i, float(self._heading.variance[i]))
            if gain > 0.0 and math.isfinite(aid.heading_rad):
                turn = np.zeros((state.heading_rad.shape[0], 3))
                turn[i, 2] = gain * math.remainder(aid.heading_rad - float(state.heading_rad[i]), math.tau)
                self._turn(turn)
                self._heading.variance[i] *= 1.0 - gain
        self._residual -= channels.state[:, :, :2] - before

    def _align(self, sensors: SensorState) -> None:
        """Level by the accelerometer and turn by the magnetometer where an estimator has just started."""
        for i in map(int, np.flatnonzero(~self._started)):
            ax, ay, az = sensors.accel_frd_m_s2[i]
            roll, pitch = math.atan2(-ay, -az), math.atan2(ax, math.hypot(ay, az))
            level = rotation_matrix(quaternion_from_euler(roll, pitch, 0.0)[None, :])
            yaw = self._heading.first_rad(i, rotate(level, sensors.mag_frd_gauss[i : i + 1])[0])
            self.state.q_ned_frd[i] = quaternion_from_euler(roll, pitch, yaw)
            self.state.valid_attitude[i] = True
            self.state.valid_altitude[i] = True
            self._baro_bias_m[i] = sensors.baro_alt_amsl_m[i]
            self._started[i] = True
        self._matrix = rotation_matrix(self.state.q_ned_frd)

    def _predict(self) -> None:
        state, dt_s = self.state, self._predict_step
        q = state.q_ned_frd
        turn = self._delta_angle * self._sample_step
        q += quaternion_rate(q, turn)
        q /= row_norm(q)
        self._matrix = rotation_matrix(q)
        gained = rotate(self._matrix, self._delta_velocity * self._sample_step)
        gained += self._gravity_step
        gained[:, 2] -= self._accel_bias * dt_s
        self._delta_angle.fill(0.0)
        self._delta_velocity.fill(0.0)
        position, velocity = self._position, self._velocity
        position += dt_s * velocity
        velocity += gained
        self._residual *= self._decay
        smooth = self._motion + self._residual
        state.position_ned_m[:] = smooth[:, :, POSITION]
        state.velocity_ned_m_s[:] = smooth[:, :, VELOCITY]
        np.divide(gained, dt_s, out=state.acceleration_ned_m_s2)
        level = self._level_acceleration
        calm = np.maximum.reduce(np.abs(level), axis=1, keepdims=True) < self._gravity_gate_m_s2
        self._leaning += calm * level
        self._leaning_count += calm
        state.heading_rad[:] = yaw_of(q)
        self._predictions += 1
        if self._predictions % _GLOBAL_EVERY_PREDICTIONS == 0:
            self._publish_global()

    def _publish_global(self) -> None:
        state = self.state
        state.lat_deg[:], state.lon_deg[:] = to_global(
            state.position_ned_m[:, 0], state.position_ned_m[:, 1], state.origin_lat_deg, state.origin_lon_deg
        )
        np.subtract(state.origin_alt_amsl_m, state.position_ned_m[:, 2], out=state.alt_amsl_m)
        self._no_aid_s += _GLOBAL_EVERY_PREDICTIONS * self._predict_s
        aided = self._no_aid_s < self._no_aid_limit_s
        state.valid_position[:] = aided
        state.valid_velocity[:] = aided

    def _fuse_gps(self, sensors: SensorState) -> None:
        state, channels = self.state, self.channels
        interval_s = (
            max(self._samples - self._gps_sample, 1) * self._dt_s if self._gps_sample >= 0 else self._dt_s
        )
        self._gps_sample = self._samples
        fixed = (sensors.gps_fix_type >= 3) & self._gps_fused
        self._gps_good_s[:] = np.where(fixed, self._gps_good_s + interval_s, 0.0)
        self._set_origins(sensors, fixed)
        aided = fixed & np.isfinite(state.origin_lat_deg)
        position = self._measured_position(sensors, aided)
        position_variance = np.empty_like(position)
        horizontal = np.maximum(sensors.gps_horizontal_accuracy_m, self._gps_noise[:, 0]) ** 2
        standing = np.where(np.isfinite(state.origin_lat_deg), self._fake_variance, _STANDING_VARIANCE)
        # Who is seen from outside need not be taken to stand.
        standing = np.where(self._vision.fresh(self._samples * self._dt_s), np.inf, standing)
        position_variance[:, :2] = np.where(aided, horizontal, standing)[:, None]
        vertical = np.maximum(sensors.gps_vertical_accuracy_m, self._gps_noise[:, 0]) ** 2
        position_variance[:, 2] = np.where(aided, vertical, np.inf)
        speed = np.maximum(sensors.gps_speed_accuracy_m_s, self._gps_noise[:, 1])
        velocity_variance = np.where(aided, speed**2, np.inf)[:, None] * np.array(
            [1.0, 1.0, _VERTICAL_SPEED_FACTOR**2]
        )
        velocity = np.where(aided[:, None], sensors.gps_velocity_ned_m_s, channels.state[:, :, VELOCITY])
        returned = aided & (
            ~(self._no_aid_s < self._no_aid_limit_s) | (self._rejected_s > REJECTED_LIMIT_S).any(axis=1)
        )
        if returned.any():
            self._rejected_s[returned] = 0.0
            channels.reset_motion(returned, position, velocity, position_variance, velocity_variance)
            self._residual[returned] = 0.0
            self._baro_bias_m[returned] = (sensors.baro_alt_amsl_m + position[:, 2])[returned]
        channels.predict_covariance(interval_s)
        before = channels.state[:, :, :2].copy()
        ratio = self._fuse_gated(POSITION, position, position_variance, self._gates[:, :1])
        state.innovation_ratio_position[:] = ratio[:, :2].max(axis=1)
        state.innovation_ratio_height[:] = ratio[:, 2]
        taken = state.innovation_ratio_position <= 1.0
        ratio = self._fuse_gated(VELOCITY, velocity, velocity_variance, self._gates[:, 1:])
        state.innovation_ratio_velocity[:] = ratio.max(axis=1)
        taken_speed = state.innovation_ratio_velocity <= 1.0
        for k, good in enumerate((taken, taken_speed, state.innovation_ratio_height <= 1.0)):
            self._rejected_s[:, k] = np.where(good, 0.0, self._rejected_s[:, k] + interval_s)
        np.copyto(state.gps_rejected, aided & ~(taken & taken_speed))
        aided &= taken | taken_speed
        self._gps_aided[:] = aided
        self._fuse_gravity()
        self._residual -= channels.state[:, :, :2] - before
        self._no_aid_s[aided] = 0.0
        state.valid_position[aided] = True
        state.valid_velocity[aided] = True
        self._take_tilt_errors()
        variance = np.einsum("naii->nai", channels.covariance)
        state.horizontal_accuracy_m[:] = np.sqrt(variance[:, :2, POSITION].sum(axis=1))
        state.vertical_accuracy_m[:] = np.sqrt(variance[:, 2, POSITION])
        state.speed_accuracy_m_s[:] = np.sqrt(variance[:, :2, VELOCITY].sum(axis=1))

    def _fuse_gated(
        self, row: int, measured: FloatArray, variance: FloatArray, gate: FloatArray
    ) -> FloatArray:
        """Fuse GPS unless its innovation lies outside the gate; a bad horizontal axis spoils the other.

        Returns:
            Innovation over gate (N, 3); above 1 it was rejected.
        """
        channels = self.channels
        innovation = measured - channels.state[:, :, row]
        total = channels.covariance[:, :, row, row] + variance
        ratio = np.abs(innovation) / (gate * np.sqrt(total))
        good = ratio <= 1.0
        if not good.all():
            good[:, :2] = good[:, :2].all(axis=1, keepdims=True)
            variance = np.where(good, variance, np.inf)
            innovation = np.where(good, innovation, 0.0)
        channels.fuse(row, innovation, variance)
        return ratio

    def _set_origins(self, sensors: SensorState, fixed: BoolArray) -> None:
        """After EKF2_REQ_GPS_H of good GPS the local origin is where GPS says we are."""
        state = self.state
        missing = fixed & np.isnan(state.origin_lat_deg) & (self._gps_good_s >= self._gps_wait_s)
        if missing.any():
            state.origin_lat_deg[missing] = sensors.gps_lat_deg[missing]
            state.origin_lon_deg[missing] = sensors.gps_lon_deg[missing]
            state.origin_alt_amsl_m[missing] = sensors.gps_alt_amsl_m[missing]

    def _measured_position(self, sensors: SensorState, aided: BoolArray) -> FloatArray:
        """Local position by GPS; where there is none, the position last believed."""
        state = self.state
        position = self.state.position_ned_m.copy()
        position[np.isnan(state.origin_lat_deg)] = 0.0
        if aided.any():
            north, east = to_local(
                sensors.gps_lat_deg, sensors.gps_lon_deg, state.origin_lat_deg, state.origin_lon_deg
            )
            np.copyto(position[:, 0], north, where=aided)
            np.copyto(position[:, 1], east, where=aided)
            np.copyto(position[:, 2], state.origin_alt_amsl_m - sensors.gps_alt_amsl_m, where=aided)
        return position

    def _fuse_gravity(self) -> None:
        """A vehicle that does not accelerate feels gravity straight from below: any lean is tilt error."""
        count = np.maximum(self._leaning_count, 1.0)
        variance = np.where(self._leaning_count > 0.0, self._gravity_variance / count, np.inf)
        innovation = self._leaning / count - self.channels.state[:, :2, ERROR]
        self.channels.fuse(ERROR, innovation, variance, slice(0, 2))
        self._leaning[:] = 0.0
        self._leaning_count[:] = 0.0

    def _take_tilt_errors(self) -> None:
        """Turn the attitude so that the horizontal acceleration errors found vanish."""
        errors = self.channels.state[:, :2, ERROR]
        turn = np.zeros((errors.shape[0], 3))
        turn[:, 0] = -errors[:, 1] / GRAVITY_M_S2
        turn[:, 1] = errors[:, 0] / GRAVITY_M_S2
        errors[:] = 0.0
        self._turn(turn)

    def _turn(self, turn_ned_rad: FloatArray) -> None:
        delta = np.concatenate([np.ones((turn_ned_rad.shape[0], 1)), 0.5 * turn_ned_rad], axis=1)
        q = quaternion_product(delta, self.state.q_ned_frd)
        self.state.q_ned_frd[:] = q / row_norm(q)

    def _fuse_baro(self, sensors: SensorState) -> None:
        height = -self.channels.state[:, 2, POSITION]
        measured = sensors.baro_alt_amsl_m - self._baro_bias_m
        innovation = measured - height
        aided = self._no_aid_s < self._no_aid_limit_s
        self._baro_bias_m += np.where(aided, _BARO_BIAS_GAIN, 0.0) * innovation
        before = self.channels.state[:, 2, :2].copy()
        total = self.channels.fuse(POSITION, -innovation[:, None], self._baro_variance, slice(2, 3))
        self._residual[:, 2] -= self.channels.state[:, 2, :2] - before
        ratio = np.abs(innovation) / (5.0 * np.sqrt(total[:, 0]))
        np.copyto(self.state.innovation_ratio_height, ratio, where=~aided)

    def _fuse_mag(self, sensors: SensorState) -> None:
        turn = np.zeros((len(self._started), 3))
        turn[:, 2], self.state.innovation_ratio_mag[:] = self._heading.fuse(
            self._matrix, sensors.mag_frd_gauss
        )
        self._turn(turn)
