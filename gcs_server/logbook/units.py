"""Units of the fields of PX4's topics. A ULog has none; PX4's message definitions have them as comments."""

from __future__ import annotations

import re

_UNITS: tuple[tuple[str, str, str], ...] = (
    ("vehicle_local_position.*|trajectory_setpoint", r"(delta_)?(x|y|z)|position\[\d\]", "m"),
    ("vehicle_local_position.*|trajectory_setpoint", r"v[xyz]|z_deriv|velocity\[\d\]|ev[hv]", "m/s"),
    ("vehicle_local_position.*|trajectory_setpoint", r"a[xyz]|acceleration\[\d\]", "m/s²"),
    ("vehicle_local_position.*|trajectory_setpoint", r"heading|yaw|heading_var", "rad"),
    ("vehicle_local_position.*", r"dist_bottom|ep[hv]|ref_alt|hagl_.*", "m"),
    ("vehicle_local_position.*|trajectory_setpoint", r"yawspeed", "rad/s"),
    ("vehicle_global_position.*|home_position", r"lat|lon", "°"),
    ("vehicle_global_position.*|home_position", r"alt(_ellipsoid)?|ep[hv]|terrain_alt", "m"),
    ("vehicle_gps_position|sensor_gps", r"latitude_deg|longitude_deg", "°"),
    ("vehicle_gps_position|sensor_gps", r"altitude_\w+_m|ep[hv]", "m"),
    ("vehicle_gps_position|sensor_gps", r"vel_\w+_m_s|s_variance_m_s", "m/s"),
    ("vehicle_gps_position|sensor_gps", r"cog_rad|heading", "rad"),
    (
        "vehicle_angular_velocity.*|vehicle_rates_setpoint|sensor_gyro",
        r"xyz\[\d\]|roll|pitch|yaw|x|y|z",
        "rad/s",
    ),
    ("vehicle_attitude_setpoint", r"(roll|pitch|yaw)_body", "rad"),
    ("vehicle_acceleration|sensor_accel", r"xyz\[\d\]|x|y|z", "m/s²"),
    ("sensor_combined", r"gyro_rad\[\d\]", "rad/s"),
    ("sensor_combined", r"accelerometer_m_s2\[\d\]", "m/s²"),
    ("vehicle_magnetometer", r"magnetometer_ga\[\d\]", "gauss"),
    ("sensor_mag", r"x|y|z", "gauss"),
    ("battery_status", r"voltage_v|voltage_cell_v\[\d+\]|ocv_estimate(_filtered)?", "V"),
    ("battery_status", r"current_a|current_average_a", "A"),
    ("battery_status", r"discharged_mah", "mAh"),
    ("battery_status", r"temperature", "°C"),
    ("battery_status", r"time_remaining_s", "s"),
    ("distance_sensor", r"current_distance|(min|max)_distance", "m"),
    ("vehicle_air_data", r"baro_alt_meter", "m"),
    ("vehicle_air_data", r"baro_pressure_pa", "Pa"),
    ("actuator_outputs", r"output\[\d+\]", "µs"),
)
_PATTERNS = [(re.compile(topic), re.compile(field), unit) for topic, field, unit in _UNITS]
_SUFFIXES = (
    ("_m_s2", "m/s²"),
    ("_rad_s", "rad/s"),
    ("_m_s", "m/s"),
    ("_rad", "rad"),
    ("_deg", "°"),
    ("_hz", "Hz"),
    ("_celsius", "°C"),
    ("_usec", "µs"),
    ("_us", "µs"),
    ("_ms", "ms"),
)


def ulog_unit(topic: str, field: str) -> str | None:
    """Unit of a field of PX4; None: not known."""
    for topics, fields, unit in _PATTERNS:
        if topics.fullmatch(topic) and fields.fullmatch(field):
            return unit
    name = field.split("[", 1)[0]
    return next((unit for suffix, unit in _SUFFIXES if name.endswith(suffix)), None)


_MAVLINK_UNITS = {"degE7": "1e-7 °", "m/s/s": "m/s²", "deg": "°", "deg/s": "°/s", "us": "µs", "degC": "°C"}
"""Units of the dialect that are written differently."""


def mavlink_unit(unit: str) -> str:
    """A unit of MAVLink's definitions as it is shown."""
    return _MAVLINK_UNITS.get(unit, unit)
