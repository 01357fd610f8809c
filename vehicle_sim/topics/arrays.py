"""Topics whose values come from arrays of the simulation: their fields, sources and periods.

Names, units and order of the fields are PX4's; fields without a source are zero. Periods were measured on PX4
v1.16 with SDLOG_PROFILE 131; periods that only the default profile uses are from PX4's table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import yaw_of
from vehicle_sim.geodesy import to_global
from vehicle_sim.simulation import Simulation
from vehicle_sim.topics.layout import TopicLayout

Source = Callable[[Simulation], NDArray[Any]]
NAN = math.nan
DEFAULT, REPLAY, HIGH_RATE = 1 << 0, 1 << 1, 1 << 4
"""Bits of SDLOG_PROFILE."""
GPS_SAMPLES = "gps_count"
"""Value in place of a period: the topic is published with each GPS sample."""
Period = int | str
"""Period in milliseconds, or `GPS_SAMPLES`."""
GYRO_ID, ACCEL_ID, MAG_ID, BARO_ID, GPS_ID = 1310988, 1310988, 197388, 6620172, 11468804
"""Device ids of the simulated sensors."""


@dataclass(frozen=True, slots=True)
class ArrayTopic:
    """One topic, whose values come from arrays for all vehicles."""

    layout: TopicLayout
    periods: Mapping[int, Period]
    """Period for each bit of the profile. If several bits are set, `GPS_SAMPLES` applies, otherwise the
    shortest period."""
    sources: Mapping[str, Source | float]
    """Source of each field; the source of a key such as "x y z" has one column for each named field."""

    @property
    def sampled(self) -> bool:
        """Whether the topic has a field `timestamp_sample`, which the simulator sets to `timestamp`."""
        return any(field.name == "timestamp_sample" for field in self.layout.fields)

    def period(self, profile: int) -> Period | None:
        """Period in a profile; None: the profile does not contain the topic."""
        selected = [period for bit, period in self.periods.items() if profile & bit]
        per_gps_sample = [period for period in selected if isinstance(period, str)]
        return per_gps_sample[0] if per_gps_sample else min(selected, default=None)


def _motor_signals(s: Simulation) -> NDArray[Any]:
    signals = np.full((s.count, 12), np.nan)
    signals[:, :4] = np.where(s.motors_us < 1000.0, np.nan, (s.motors_us - 1000.0) / 1000.0)
    return signals


def _pwm_outputs(s: Simulation) -> NDArray[Any]:
    pulses = np.full((s.count, 16), 900.0)
    pulses[:, :4] = np.round(s.motors_us)
    return pulses


def _body_thrust(s: Simulation) -> NDArray[Any]:
    thrust = np.zeros((s.count, 3))
    thrust[:, 2] = -s.target.thrust
    return thrust


def _ground_speed(s: Simulation) -> NDArray[Any]:
    v = s.sensors.gps_velocity_ned_m_s
    return np.hypot(v[:, 0], v[:, 1])


def _course(s: Simulation) -> NDArray[Any]:
    v = s.sensors.gps_velocity_ned_m_s
    return np.arctan2(v[:, 1], v[:, 0])


def _air_density(s: Simulation) -> NDArray[Any]:
    """Density [kg/m³] at 15 °C: pressure / (gas constant of air · temperature)."""
    return s.sensors.baro_pressure_hpa * 100.0 / (287.1 * 288.15)


def _solution_status_flags(s: Simulation) -> NDArray[Any]:
    """ESTIMATOR_STATUS_FLAGS: attitude 0x01, horizontal velocity 0x02, vertical velocity and altitude 0x24,
    horizontal position 0x18, predicted position 0x300, accelerometer error 0x800."""
    e, predicted = s.estimate, s.fusion.gnss_pos | s.fusion.gnss_vel | s.estimate.valid_position
    return (
        e.valid_attitude * 0x01 + e.valid_velocity * 0x02 + e.valid_altitude * 0x24 + e.valid_position * 0x18
        + predicted * 0x300 + s.fusion.bad_acc_vertical * 0x800
    )  # fmt: skip


def _position_variance(s: Simulation) -> NDArray[Any]:
    horizontal, vertical = s.estimate.horizontal_accuracy_m, s.estimate.vertical_accuracy_m
    return np.stack((0.5 * horizontal**2, 0.5 * horizontal**2, vertical**2), axis=1)


def _velocity_variance(s: Simulation) -> NDArray[Any]:
    return np.repeat(s.estimate.speed_accuracy_m_s[:, np.newaxis] ** 2 / 3.0, 3, axis=1)


def _reset_count(s: Simulation) -> NDArray[Any]:
    """Sum of the reset counters, because vehicle_odometry has one counter for all resets."""
    f = s.fusion
    counters = f.xy_reset_counter + f.z_reset_counter + f.vxy_reset_counter + f.vz_reset_counter
    return (counters + f.heading_reset_counter) & 0xFF


def _true_lat_lon_deg(s: Simulation) -> tuple[NDArray[Any], NDArray[Any]]:
    p, origin = s.truth.position_ned_m, s.origin
    return to_global(p[:, 0], p[:, 1], np.full(s.count, origin.lat_deg), np.full(s.count, origin.lon_deg))


def _true_altitude_m(s: Simulation) -> NDArray[Any]:
    return s.origin.alt_amsl_m - s.truth.position_ned_m[:, 2]


def _imu_rates(s: Simulation) -> NDArray[Any]:
    return np.full((s.count, 4), 1.0 / s.dt_s)


def _source(value: Source | str | float) -> Source | float:
    return attrgetter(value) if isinstance(value, str) else value


_GPS_SOURCES: dict[str, Source | str | float] = {
    "latitude_deg": "sensors.gps_lat_deg", "longitude_deg": "sensors.gps_lon_deg",
    "altitude_msl_m": "sensors.gps_alt_amsl_m", "altitude_ellipsoid_m": "sensors.gps_alt_amsl_m",
    "device_id": GPS_ID, "s_variance_m_s": "sensors.gps_speed_accuracy_m_s", "c_variance_rad": 0.1,
    "eph": "sensors.gps_horizontal_accuracy_m", "epv": "sensors.gps_vertical_accuracy_m",
    "hdop": "sensors.gps_hdop", "vdop": "sensors.gps_vdop", "vel_m_s": _ground_speed,
    "vel_n_m_s vel_e_m_s vel_d_m_s": "sensors.gps_velocity_ned_m_s", "cog_rad": _course, "heading": NAN,
    "heading_offset": NAN, "fix_type": "sensors.gps_fix_type",
    "jamming_indicator": lambda s: s.sensor_faults.gps_jamming,
    "vel_ned_valid": lambda s: s.sensors.gps_fix_type >= 3, "satellites_used": "sensors.gps_satellites",
}  # fmt: skip
_TRUE_POSITION_SOURCES: dict[str, Source | str | float] = {
    "lat": lambda s: _true_lat_lon_deg(s)[0], "lon": lambda s: _true_lat_lon_deg(s)[1],
    "alt": _true_altitude_m, "alt_ellipsoid": _true_altitude_m, "lat_lon_valid": 1, "alt_valid": 1,
}  # fmt: skip
_TOPICS: tuple[tuple[str, Mapping[int, Period], Mapping[str, Source | str | float]], ...] = (
    ("vehicle_attitude", {DEFAULT: 50, REPLAY: 4, HIGH_RATE: 4}, {"q": "estimate.q_ned_frd"}),
    ("sensor_combined", {DEFAULT: 4, REPLAY: 4}, {
        "gyro_rad": "sensors.gyro_frd_rad_s", "gyro_integral_dt": 4000,
        "accelerometer_m_s2": "sensors.accel_frd_m_s2", "accelerometer_integral_dt": 4000}),
    ("vehicle_local_position", {DEFAULT: 100, REPLAY: 8}, {
        "x y z": "estimate.position_ned_m", "vx vy vz": "estimate.velocity_ned_m_s",
        "ax ay az": "estimate.acceleration_ned_m_s2", "z_deriv": lambda s: s.estimate.velocity_ned_m_s[:, 2],
        "ref_lat": "estimate.origin_lat_deg", "ref_lon": "estimate.origin_lon_deg",
        "ref_alt": "estimate.origin_alt_amsl_m", "heading": "estimate.heading_rad",
        "unaided_heading": "estimate.heading_rad", "dist_bottom": "estimate.height_above_ground_m",
        "dist_bottom_valid": lambda s: np.isfinite(s.estimate.height_above_ground_m),
        "dist_bottom_sensor_bitfield": 1, "eph": "estimate.horizontal_accuracy_m",
        "epv": "estimate.vertical_accuracy_m", "evh": "estimate.speed_accuracy_m_s",
        "evv": "estimate.speed_accuracy_m_s", "vxy_max": math.inf, "vz_max": math.inf, "hagl_min": math.inf,
        "hagl_max_z": math.inf, "hagl_max_xy": math.inf, "xy_valid": "estimate.valid_position",
        "z_valid": "estimate.valid_altitude", "v_xy_valid": "estimate.valid_velocity",
        "v_z_valid": "estimate.valid_altitude", "xy_global": lambda s: np.isfinite(s.estimate.origin_lat_deg),
        "z_global": lambda s: np.isfinite(s.estimate.origin_alt_amsl_m),
        "xy_reset_counter": lambda s: s.fusion.xy_reset_counter & 0xFF,
        "z_reset_counter": lambda s: s.fusion.z_reset_counter & 0xFF,
        "vxy_reset_counter": lambda s: s.fusion.vxy_reset_counter & 0xFF,
        "vz_reset_counter": lambda s: s.fusion.vz_reset_counter & 0xFF,
        "heading_reset_counter": lambda s: s.fusion.heading_reset_counter & 0xFF,
        "heading_good_for_control": "fusion.heading_good_for_control",
        "dead_reckoning": "fusion.dead_reckoning"}),
    ("vehicle_global_position", {DEFAULT: 200, REPLAY: 8}, {
        "lat": "estimate.lat_deg", "lon": "estimate.lon_deg", "alt": "estimate.alt_amsl_m",
        "alt_ellipsoid": "estimate.alt_amsl_m", "eph": "estimate.horizontal_accuracy_m",
        "epv": "estimate.vertical_accuracy_m", "terrain_alt": NAN, "lat_lon_valid": "estimate.valid_position",
        "alt_valid": "estimate.valid_altitude"}),
    ("vehicle_odometry", {}, {
        "pose_frame": 1, "velocity_frame": 1, "position": "estimate.position_ned_m",
        "q": "estimate.q_ned_frd", "velocity": "estimate.velocity_ned_m_s",
        "angular_velocity": "estimate.rates_frd_rad_s", "position_variance": _position_variance,
        "velocity_variance": _velocity_variance, "reset_counter": _reset_count}),
    ("vehicle_angular_velocity", {DEFAULT: 20, REPLAY: 10, HIGH_RATE: 4}, {
        "xyz": "estimate.rates_frd_rad_s", "xyz_derivative": "estimate.angular_acceleration_frd_rad_s2"}),
    ("vehicle_attitude_groundtruth", {DEFAULT: 10}, {"q": "truth.q_ned_frd"}),
    ("vehicle_angular_velocity_groundtruth", {DEFAULT: 10}, {"xyz": "truth.rates_frd_rad_s"}),
    ("estimator_status", {DEFAULT: 200, REPLAY: 10}, {
        "pos_horiz_accuracy": "estimate.horizontal_accuracy_m",
        "pos_vert_accuracy": "estimate.vertical_accuracy_m",
        "hdg_test_ratio": "estimate.innovation_ratio_mag",
        "vel_test_ratio": "estimate.innovation_ratio_velocity",
        "pos_test_ratio": "estimate.innovation_ratio_position",
        "hgt_test_ratio": "estimate.innovation_ratio_height", "tas_test_ratio": NAN, "hagl_test_ratio": NAN,
        "beta_test_ratio": NAN, "accel_device_id": ACCEL_ID, "gyro_device_id": GYRO_ID,
        "baro_device_id": BARO_ID, "mag_device_id": MAG_ID, "solution_status_flags": _solution_status_flags}),
    ("vehicle_rates_setpoint", {DEFAULT: 20, HIGH_RATE: 4}, {
        "roll pitch yaw": "target.rates_frd_rad_s", "thrust_body": _body_thrust}),
    ("vehicle_thrust_setpoint", {DEFAULT: 20, HIGH_RATE: 4}, {"xyz": _body_thrust}),
    ("vehicle_torque_setpoint", {DEFAULT: 20, HIGH_RATE: 4}, {"xyz": "torque_frd"}),
    ("vehicle_local_position_groundtruth", {DEFAULT: 20}, {
        "x y z": "truth.position_ned_m", "vx vy vz": "truth.velocity_ned_m_s",
        "ax ay az": "truth.acceleration_ned_m_s2", "z_deriv": lambda s: s.truth.velocity_ned_m_s[:, 2],
        "ref_lat": lambda s: np.full(s.count, s.origin.lat_deg),
        "ref_lon": lambda s: np.full(s.count, s.origin.lon_deg),
        "ref_alt": lambda s: np.full(s.count, s.origin.alt_amsl_m),
        "heading": lambda s: yaw_of(s.truth.q_ned_frd), "unaided_heading": NAN, "xy_valid": 1, "z_valid": 1,
        "v_xy_valid": 1, "v_z_valid": 1, "heading_good_for_control": 1, "xy_global": 1, "z_global": 1}),
    ("vehicle_acceleration", {DEFAULT: 50}, {"xyz": "sensors.accel_frd_m_s2"}),
    ("vehicle_attitude_setpoint", {DEFAULT: 50, HIGH_RATE: 8}, {
        "yaw_sp_move_rate": lambda s: np.nan_to_num(s.setpoints.yaw_rate_ned_rad_s),
        "q_d": "target.q_ned_frd", "thrust_body": _body_thrust}),
    ("actuator_motors", {DEFAULT: 100, HIGH_RATE: 4}, {"control": _motor_signals}),
    ("actuator_outputs", {DEFAULT: 100, HIGH_RATE: 4}, {"noutputs": 16, "output": _pwm_outputs}),
    ("vehicle_local_position_setpoint", {DEFAULT: 100}, {
        "x y z": "target.position_ned_m", "vx vy vz": "target.velocity_ned_m_s",
        "acceleration": "target.acceleration_ned_m_s2", "thrust": _body_thrust, "yaw": "target.yaw_ned_rad",
        "yawspeed": "target.yaw_rate_ned_rad_s"}),
    ("hover_thrust_estimate", {DEFAULT: 100}, {
        "hover_thrust": "target.hover_thrust", "valid": lambda s: s.setpoints.armed & ~s.setpoints.landed}),
    ("vehicle_air_data", {DEFAULT: 200, REPLAY: 100}, {
        "baro_device_id": BARO_ID, "baro_alt_meter": "sensors.baro_alt_amsl_m",
        "baro_pressure_pa": lambda s: s.sensors.baro_pressure_hpa * 100.0, "ambient_temperature": 15.0,
        "rho": _air_density}),
    ("trajectory_setpoint", {DEFAULT: 200}, {
        "position": "setpoints.position_ned_m", "velocity": "setpoints.velocity_ned_m_s",
        "acceleration": "setpoints.acceleration_ned_m_s2", "jerk": NAN, "yaw": "setpoints.yaw_ned_rad",
        "yawspeed": "setpoints.yaw_rate_ned_rad_s"}),
    ("vehicle_global_position_groundtruth", {DEFAULT: 100}, {**_TRUE_POSITION_SOURCES}),
    ("vehicle_magnetometer", {DEFAULT: 200, REPLAY: 70}, {
        "device_id": MAG_ID, "magnetometer_ga": "sensors.mag_frd_gauss"}),
    ("vehicle_gps_position", {DEFAULT: 200, REPLAY: GPS_SAMPLES}, {**_GPS_SOURCES}),
    ("sensor_gps", {DEFAULT: 1000}, {**_GPS_SOURCES}),
    ("sensor_accel", {DEFAULT: 1000}, {
        "device_id": ACCEL_ID, "temperature": 15.0, "samples": 1, "x y z": "sensors.accel_frd_m_s2"}),
    ("sensor_gyro", {DEFAULT: 1000}, {
        "device_id": GYRO_ID, "temperature": 15.0, "samples": 1, "x y z": "sensors.gyro_frd_rad_s"}),
    ("sensor_mag", {DEFAULT: 1000}, {
        "device_id": MAG_ID, "temperature": NAN, "x y z": "sensors.mag_frd_gauss"}),
    ("vehicle_imu_status", {DEFAULT: 1000}, {
        "accel_device_id": ACCEL_ID, "gyro_device_id": GYRO_ID, "accel_clipping": "sensors.accel_clipping",
        "accel_rate_hz gyro_rate_hz accel_raw_rate_hz gyro_raw_rate_hz": _imu_rates,
        "accel_vibration_metric": "sensors.accel_vibration_m_s2",
        "gyro_vibration_metric": "sensors.gyro_vibration_rad_s", "temperature_accel": 15.0,
        "temperature_gyro": 15.0}),
    ("cpuload", {DEFAULT: 500}, {"load": "cpu_load", "ram_usage": 0.03}),
    ("sensor_baro", {DEFAULT: 1000}, {
        "device_id": BARO_ID, "pressure": lambda s: s.sensors.baro_pressure_hpa * 100.0,
        "temperature": "sensors.baro_temperature_deg_c"}),
)  # fmt: skip
"""Name, periods and sources of each topic, ordered by id; a source that is a text is an attribute of the
simulation."""

ARRAY_TOPIC_COUNT = len(_TOPICS)


@cache
def array_topics(version: str) -> tuple[ArrayTopic, ...]:
    """The topics as a version of PX4 ("1.17") has them, ordered by id."""
    return tuple(
        ArrayTopic(
            TopicLayout(name, n, version), periods, {key: _source(value) for key, value in sources.items()}
        )
        for n, (name, periods, sources) in enumerate(_TOPICS)
    )


def current_values(topic: ArrayTopic, simulation: Simulation, row: int) -> dict[str, Any]:
    """Current values of a topic for one vehicle, without timestamps."""
    by_field: dict[str, Any] = {}
    for key, source in topic.sources.items():
        names = key.split()
        value = np.asarray(source(simulation)[row] if callable(source) else source)
        by_field |= {name: value[k] for k, name in enumerate(names)} if len(names) > 1 else {key: value}
    values: dict[str, Any] = {}
    for each in topic.layout.fields:
        value = np.asarray(by_field.get(each.name, 0))
        values[each.name] = np.broadcast_to(value, (each.length,)).tolist() if each.length else value.item()
    return values
