"""Topics whose values come from arrays of the simulation: their fields, sources and periods.

Names, units and order of the fields are PX4's; fields without a source are zero. Periods were measured on PX4
v1.16 with SDLOG_PROFILE 131; periods that only the default profile uses are from PX4's table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
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
    sources: Mapping[str, Source | float] = field(default_factory=dict)
    """Source of each field; the source of a key such as "x y z" has one column for each named field."""
    sampled: bool = False
    """Whether the topic has a field `timestamp_sample`, which the simulator sets to `timestamp`."""

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


def _columns(names: str, source: Source) -> dict[str, Source]:
    """Source of several fields, as a dictionary because a keyword cannot contain spaces."""
    return {names: source}


_LOCAL_POSITION = (
    "uint64_t timestamp_sample;uint64_t ref_timestamp;double ref_lat;double ref_lon;float x;float y;float z;"
    "float[2] delta_xy;float delta_z;float vx;float vy;float vz;float z_deriv;float[2] delta_vxy;"
    "float delta_vz;float ax;float ay;float az;float heading;float heading_var;float unaided_heading;"
    "float delta_heading;float tilt_var;float ref_alt;float dist_bottom;float dist_bottom_var;"
    "float delta_dist_bottom;float eph;float epv;float evh;float evv;float vxy_max;float vz_max;"
    "float hagl_min;float hagl_max_z;float hagl_max_xy;bool xy_valid;bool z_valid;bool v_xy_valid;"
    "bool v_z_valid;uint8_t xy_reset_counter;uint8_t z_reset_counter;uint8_t vxy_reset_counter;"
    "uint8_t vz_reset_counter;uint8_t heading_reset_counter;bool heading_good_for_control;bool xy_global;"
    "bool z_global;bool dist_bottom_valid;uint8_t dist_bottom_reset_counter;"
    "uint8_t dist_bottom_sensor_bitfield;bool dead_reckoning"
)
_GLOBAL_POSITION = (
    "uint64_t timestamp_sample;double lat;double lon;float alt;float alt_ellipsoid;float delta_alt;"
    "float delta_terrain;float eph;float epv;float terrain_alt;bool lat_lon_valid;bool alt_valid;"
    "uint8_t lat_lon_reset_counter;uint8_t alt_reset_counter;uint8_t terrain_reset_counter;"
    "bool terrain_alt_valid;bool dead_reckoning"
)
_ATTITUDE = "uint64_t timestamp_sample;float[4] q;float[4] delta_q_reset;uint8_t quat_reset_counter"
_ANGULAR_VELOCITY = "uint64_t timestamp_sample;float[3] xyz;float[3] xyz_derivative"
_VECTOR = "uint64_t timestamp_sample;float[3] xyz"
_IMU = (
    "uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;float temperature;"
    "uint32_t error_count;uint8_t[3] clip_counter;uint8_t samples"
)
_GPS = (
    "uint64_t timestamp_sample;double latitude_deg;double longitude_deg;double altitude_msl_m;"
    "double altitude_ellipsoid_m;uint64_t time_utc_usec;uint32_t device_id;float s_variance_m_s;"
    "float c_variance_rad;float eph;float epv;float hdop;float vdop;int32_t noise_per_ms;"
    "int32_t jamming_indicator;float vel_m_s;float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;float cog_rad;"
    "int32_t timestamp_time_relative;float heading;float heading_offset;float heading_accuracy;"
    "float rtcm_injection_rate;uint16_t automatic_gain_control;uint8_t fix_type;uint8_t jamming_state;"
    "uint8_t spoofing_state;bool vel_ned_valid;uint8_t satellites_used;uint8_t selected_rtcm_instance;"
    "bool rtcm_crc_failed;uint8_t rtcm_msg_used"
)
_GPS_SOURCES: dict[str, Source | float] = {
    "latitude_deg": lambda s: s.sensors.gps_lat_deg,
    "longitude_deg": lambda s: s.sensors.gps_lon_deg,
    "altitude_msl_m": lambda s: s.sensors.gps_alt_amsl_m,
    "altitude_ellipsoid_m": lambda s: s.sensors.gps_alt_amsl_m,
    "device_id": GPS_ID,
    "s_variance_m_s": lambda s: s.sensors.gps_speed_accuracy_m_s,
    "c_variance_rad": 0.1,
    "eph": lambda s: s.sensors.gps_horizontal_accuracy_m,
    "epv": lambda s: s.sensors.gps_vertical_accuracy_m,
    "hdop": lambda s: s.sensors.gps_hdop,
    "vdop": lambda s: s.sensors.gps_vdop,
    "vel_m_s": _ground_speed,
    **_columns("vel_n_m_s vel_e_m_s vel_d_m_s", lambda s: s.sensors.gps_velocity_ned_m_s),
    "cog_rad": _course,
    "heading": NAN,
    "heading_offset": NAN,
    "fix_type": lambda s: s.sensors.gps_fix_type,
    "vel_ned_valid": lambda s: s.sensors.gps_fix_type >= 3,
    "satellites_used": lambda s: s.sensors.gps_satellites,
}


def _topics() -> list[ArrayTopic]:
    topics: list[ArrayTopic] = []

    def add(name: str, declaration: str, periods: dict[int, Period], **sources: Source | float) -> None:
        layout = TopicLayout(name, declaration, len(topics))
        topics.append(ArrayTopic(layout, periods, sources, "timestamp_sample" in declaration))

    add("vehicle_attitude", _ATTITUDE, {DEFAULT: 50, REPLAY: 4, HIGH_RATE: 4},
        q=lambda s: s.estimate.q_ned_frd)  # fmt: skip
    add("sensor_combined", "float[3] gyro_rad;uint32_t gyro_integral_dt;"
        "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;"
        "uint32_t accelerometer_integral_dt;uint8_t accelerometer_clipping;uint8_t gyro_clipping;"
        "uint8_t accel_calibration_count;uint8_t gyro_calibration_count",
        {DEFAULT: 4, REPLAY: 4},
        gyro_rad=lambda s: s.sensors.gyro_frd_rad_s, gyro_integral_dt=4000,
        accelerometer_m_s2=lambda s: s.sensors.accel_frd_m_s2, accelerometer_integral_dt=4000)  # fmt: skip
    add("vehicle_local_position", _LOCAL_POSITION, {DEFAULT: 100, REPLAY: 8},
        **_columns("x y z", lambda s: s.estimate.position_ned_m),
        **_columns("vx vy vz", lambda s: s.estimate.velocity_ned_m_s),
        **_columns("ax ay az", lambda s: s.estimate.acceleration_ned_m_s2),
        z_deriv=lambda s: s.estimate.velocity_ned_m_s[:, 2],
        ref_lat=lambda s: s.estimate.origin_lat_deg, ref_lon=lambda s: s.estimate.origin_lon_deg,
        ref_alt=lambda s: s.estimate.origin_alt_amsl_m, heading=lambda s: s.estimate.heading_rad,
        unaided_heading=lambda s: s.estimate.heading_rad,
        dist_bottom=lambda s: s.estimate.height_above_ground_m,
        dist_bottom_valid=lambda s: np.isfinite(s.estimate.height_above_ground_m),
        dist_bottom_sensor_bitfield=1,
        eph=lambda s: s.estimate.horizontal_accuracy_m, epv=lambda s: s.estimate.vertical_accuracy_m,
        evh=lambda s: s.estimate.speed_accuracy_m_s, evv=lambda s: s.estimate.speed_accuracy_m_s,
        vxy_max=math.inf, vz_max=math.inf, hagl_min=math.inf, hagl_max_z=math.inf, hagl_max_xy=math.inf,
        xy_valid=lambda s: s.estimate.valid_position, z_valid=lambda s: s.estimate.valid_altitude,
        v_xy_valid=lambda s: s.estimate.valid_velocity, v_z_valid=lambda s: s.estimate.valid_altitude,
        xy_global=lambda s: np.isfinite(s.estimate.origin_lat_deg),
        z_global=lambda s: np.isfinite(s.estimate.origin_alt_amsl_m),
        xy_reset_counter=lambda s: s.fusion.xy_reset_counter & 0xFF,
        z_reset_counter=lambda s: s.fusion.z_reset_counter & 0xFF,
        vxy_reset_counter=lambda s: s.fusion.vxy_reset_counter & 0xFF,
        vz_reset_counter=lambda s: s.fusion.vz_reset_counter & 0xFF,
        heading_reset_counter=lambda s: s.fusion.heading_reset_counter & 0xFF,
        heading_good_for_control=lambda s: s.fusion.heading_good_for_control,
        dead_reckoning=lambda s: s.fusion.dead_reckoning)  # fmt: skip
    add("vehicle_global_position", _GLOBAL_POSITION, {DEFAULT: 200, REPLAY: 8},
        lat=lambda s: s.estimate.lat_deg, lon=lambda s: s.estimate.lon_deg,
        alt=lambda s: s.estimate.alt_amsl_m, alt_ellipsoid=lambda s: s.estimate.alt_amsl_m,
        eph=lambda s: s.estimate.horizontal_accuracy_m, epv=lambda s: s.estimate.vertical_accuracy_m,
        terrain_alt=NAN, lat_lon_valid=lambda s: s.estimate.valid_position,
        alt_valid=lambda s: s.estimate.valid_altitude)  # fmt: skip
    add("vehicle_odometry", "uint64_t timestamp_sample;float[3] position;float[4] q;float[3] velocity;"
        "float[3] angular_velocity;float[3] position_variance;float[3] orientation_variance;"
        "float[3] velocity_variance;uint8_t pose_frame;uint8_t velocity_frame;uint8_t reset_counter;"
        "int8_t quality", {}, pose_frame=1, velocity_frame=1,
        position=lambda s: s.estimate.position_ned_m, q=lambda s: s.estimate.q_ned_frd,
        velocity=lambda s: s.estimate.velocity_ned_m_s,
        angular_velocity=lambda s: s.estimate.rates_frd_rad_s,
        position_variance=_position_variance, velocity_variance=_velocity_variance,
        reset_counter=_reset_count)  # fmt: skip
    add("vehicle_angular_velocity", _ANGULAR_VELOCITY, {DEFAULT: 20, REPLAY: 10, HIGH_RATE: 4},
        xyz=lambda s: s.estimate.rates_frd_rad_s,
        xyz_derivative=lambda s: s.estimate.angular_acceleration_frd_rad_s2)  # fmt: skip
    add("vehicle_attitude_groundtruth", _ATTITUDE, {DEFAULT: 10}, q=lambda s: s.truth.q_ned_frd)
    add("vehicle_angular_velocity_groundtruth", _ANGULAR_VELOCITY, {DEFAULT: 10},
        xyz=lambda s: s.truth.rates_frd_rad_s)  # fmt: skip
    add("estimator_status", "uint64_t timestamp_sample;uint64_t control_mode_flags;"
        "float[3] output_tracking_error;uint32_t filter_fault_flags;float pos_horiz_accuracy;"
        "float pos_vert_accuracy;float hdg_test_ratio;float vel_test_ratio;float pos_test_ratio;"
        "float hgt_test_ratio;float tas_test_ratio;float hagl_test_ratio;float beta_test_ratio;"
        "float time_slip;uint32_t accel_device_id;uint32_t gyro_device_id;uint32_t baro_device_id;"
        "uint32_t mag_device_id;uint16_t gps_check_fail_flags;uint16_t solution_status_flags;"
        "uint8_t health_flags;uint8_t timeout_flags", {DEFAULT: 200, REPLAY: 10},
        pos_horiz_accuracy=lambda s: s.estimate.horizontal_accuracy_m,
        pos_vert_accuracy=lambda s: s.estimate.vertical_accuracy_m,
        hdg_test_ratio=lambda s: s.estimate.innovation_ratio_mag,
        vel_test_ratio=lambda s: s.estimate.innovation_ratio_velocity,
        pos_test_ratio=lambda s: s.estimate.innovation_ratio_position,
        hgt_test_ratio=lambda s: s.estimate.innovation_ratio_height,
        tas_test_ratio=NAN, hagl_test_ratio=NAN, beta_test_ratio=NAN, accel_device_id=ACCEL_ID,
        gyro_device_id=GYRO_ID, baro_device_id=BARO_ID, mag_device_id=MAG_ID,
        solution_status_flags=_solution_status_flags)  # fmt: skip
    add("vehicle_rates_setpoint", "float roll;float pitch;float yaw;float[3] thrust_body;bool reset_integral",
        {DEFAULT: 20, HIGH_RATE: 4},
        **_columns("roll pitch yaw", lambda s: s.target.rates_frd_rad_s),
        thrust_body=_body_thrust)  # fmt: skip
    add("vehicle_thrust_setpoint", _VECTOR, {DEFAULT: 20, HIGH_RATE: 4}, xyz=_body_thrust)
    add("vehicle_torque_setpoint", _VECTOR, {DEFAULT: 20, HIGH_RATE: 4}, xyz=lambda s: s.torque_frd)
    add("vehicle_local_position_groundtruth", _LOCAL_POSITION, {DEFAULT: 20},
        **_columns("x y z", lambda s: s.truth.position_ned_m),
        **_columns("vx vy vz", lambda s: s.truth.velocity_ned_m_s),
        **_columns("ax ay az", lambda s: s.truth.acceleration_ned_m_s2),
        z_deriv=lambda s: s.truth.velocity_ned_m_s[:, 2],
        ref_lat=lambda s: np.full(s.count, s.home.lat_deg),
        ref_lon=lambda s: np.full(s.count, s.home.lon_deg),
        ref_alt=lambda s: np.full(s.count, s.home.alt_amsl_m), heading=lambda s: yaw_of(s.truth.q_ned_frd),
        unaided_heading=NAN, xy_valid=1, z_valid=1, v_xy_valid=1, v_z_valid=1, heading_good_for_control=1,
        xy_global=1, z_global=1)  # fmt: skip
    add("vehicle_acceleration", _VECTOR, {DEFAULT: 50}, xyz=lambda s: s.sensors.accel_frd_m_s2)
    add("vehicle_attitude_setpoint", "float yaw_sp_move_rate;float[4] q_d;float[3] thrust_body;"
        "bool reset_integral;bool fw_control_yaw_wheel", {DEFAULT: 50, HIGH_RATE: 8},
        yaw_sp_move_rate=lambda s: np.nan_to_num(s.setpoints.yaw_rate_ned_rad_s),
        q_d=lambda s: s.target.q_ned_frd, thrust_body=_body_thrust)  # fmt: skip
    add("actuator_motors", "uint64_t timestamp_sample;float[12] control;uint16_t reversible_flags",
        {DEFAULT: 100, HIGH_RATE: 4}, control=_motor_signals)  # fmt: skip
    add("actuator_outputs", "uint32_t noutputs;float[16] output", {DEFAULT: 100, HIGH_RATE: 4}, noutputs=16,
        output=_pwm_outputs)  # fmt: skip
    add("vehicle_local_position_setpoint", "float x;float y;float z;float vx;float vy;float vz;"
        "float[3] acceleration;float[3] thrust;float yaw;float yawspeed", {DEFAULT: 100},
        **_columns("x y z", lambda s: s.target.position_ned_m),
        **_columns("vx vy vz", lambda s: s.target.velocity_ned_m_s),
        acceleration=lambda s: s.target.acceleration_ned_m_s2, thrust=_body_thrust,
        yaw=lambda s: s.target.yaw_ned_rad, yawspeed=lambda s: s.target.yaw_rate_ned_rad_s)  # fmt: skip
    add("hover_thrust_estimate", "uint64_t timestamp_sample;float hover_thrust;float hover_thrust_var;"
        "float accel_innov;float accel_innov_var;float accel_innov_test_ratio;float accel_noise_var;"
        "bool valid", {DEFAULT: 100}, hover_thrust=lambda s: s.target.hover_thrust,
        valid=lambda s: s.setpoints.armed & ~s.setpoints.landed)  # fmt: skip
    add("vehicle_air_data", "uint64_t timestamp_sample;uint32_t baro_device_id;float baro_alt_meter;"
        "float baro_pressure_pa;float ambient_temperature;float rho;uint8_t temperature_source;"
        "uint8_t calibration_count", {DEFAULT: 200, REPLAY: 100}, baro_device_id=BARO_ID,
        baro_alt_meter=lambda s: s.sensors.baro_alt_amsl_m,
        baro_pressure_pa=lambda s: s.sensors.baro_pressure_hpa * 100.0, ambient_temperature=15.0,
        rho=_air_density)  # fmt: skip
    add("trajectory_setpoint", "float[3] position;float[3] velocity;float[3] acceleration;float[3] jerk;"
        "float yaw;float yawspeed", {DEFAULT: 200}, position=lambda s: s.setpoints.position_ned_m,
        velocity=lambda s: s.setpoints.velocity_ned_m_s,
        acceleration=lambda s: s.setpoints.acceleration_ned_m_s2, jerk=NAN,
        yaw=lambda s: s.setpoints.yaw_ned_rad, yawspeed=lambda s: s.setpoints.yaw_rate_ned_rad_s)  # fmt: skip
    add("vehicle_global_position_groundtruth", _GLOBAL_POSITION, {DEFAULT: 100}, **_true_position_sources())
    add("vehicle_magnetometer", "uint64_t timestamp_sample;uint32_t device_id;float[3] magnetometer_ga;"
        "uint8_t calibration_count", {DEFAULT: 200, REPLAY: 70}, device_id=MAG_ID,
        magnetometer_ga=lambda s: s.sensors.mag_frd_gauss)  # fmt: skip
    add("vehicle_gps_position", _GPS, {DEFAULT: 200, REPLAY: GPS_SAMPLES}, **_GPS_SOURCES)
    add("sensor_gps", _GPS, {DEFAULT: 1000}, **_GPS_SOURCES)
    add("sensor_accel", _IMU, {DEFAULT: 1000}, device_id=ACCEL_ID, temperature=15.0, samples=1,
        **_columns("x y z", lambda s: s.sensors.accel_frd_m_s2))  # fmt: skip
    add("sensor_gyro", _IMU, {DEFAULT: 1000}, device_id=GYRO_ID, temperature=15.0, samples=1,
        **_columns("x y z", lambda s: s.sensors.gyro_frd_rad_s))  # fmt: skip
    add("sensor_mag", "uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;"
        "float temperature;uint32_t error_count", {DEFAULT: 1000}, device_id=MAG_ID, temperature=NAN,
        **_columns("x y z", lambda s: s.sensors.mag_frd_gauss))  # fmt: skip
    add("sensor_baro", "uint64_t timestamp_sample;uint32_t device_id;float pressure;float temperature;"
        "uint32_t error_count", {DEFAULT: 1000}, device_id=BARO_ID,
        pressure=lambda s: s.sensors.baro_pressure_hpa * 100.0,
        temperature=lambda s: s.sensors.baro_temperature_deg_c)  # fmt: skip
    return topics


def _true_position_sources() -> dict[str, Source | float]:
    def lat_lon_deg(s: Simulation) -> tuple[NDArray[Any], NDArray[Any]]:
        p = s.truth.position_ned_m
        lat0, lon0 = np.full(s.count, s.home.lat_deg), np.full(s.count, s.home.lon_deg)
        return to_global(p[:, 0], p[:, 1], lat0, lon0)

    return {
        "lat": lambda s: lat_lon_deg(s)[0],
        "lon": lambda s: lat_lon_deg(s)[1],
        "alt": lambda s: s.home.alt_amsl_m - s.truth.position_ned_m[:, 2],
        "alt_ellipsoid": lambda s: s.home.alt_amsl_m - s.truth.position_ned_m[:, 2],
        "lat_lon_valid": 1,
        "alt_valid": 1,
    }


ARRAY_TOPICS: tuple[ArrayTopic, ...] = tuple(_topics())
"""All array topics, ordered by id."""


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
