"""Decodes payloads into samples: pure functions, one for each message.

Every decoder gets full payloads, padded with zeros, by key (`instances.py`). It returns the sample's value
and, if the message contains it, the time since the vehicle's boot [s]. Returned numbers are finite and
plausible (`numbers.py`); other numbers become None. If the sample is useless without a number, the decoder
raises Unusable. `FORMATS` repeats the layouts of the MAVLink dialect; a test compares them.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping

from gcs_server.mavlink import dialect as d
from gcs_server.vehicle import gimbal_decoder, samples
from gcs_server.vehicle.instances import instance_of, message_of
from gcs_server.vehicle.numbers import Unusable, number, require_on_earth, require_valid, rotation, vector
from gcs_server.vehicle.samples import DistanceSensor, DistanceSensors, ObstacleDistance
from missions.frames import Vector3, euler_from_q, q_from_euler, rotate

_distance = struct.Struct("<I3H4B2f4fB")
_obstacle_distance = struct.Struct("<Q72H2H2B2fB")

SECTORS = 72
UNKNOWN_CM = 0xFFFF
INVALID_SIGNAL = 1
"""DISTANCE_SENSOR.signal_quality of an invalid measurement; 0 means unknown."""
MAX_WIDTH_RAD = math.pi
_SIDE = math.sqrt(0.5)
DIRECTIONS_FRD: dict[int, Vector3] = {
    d.MAV_SENSOR_ROTATION_NONE: (1.0, 0.0, 0.0),
    d.MAV_SENSOR_ROTATION_YAW_45: (_SIDE, _SIDE, 0.0),
    d.MAV_SENSOR_ROTATION_YAW_90: (0.0, 1.0, 0.0),
    d.MAV_SENSOR_ROTATION_YAW_135: (-_SIDE, _SIDE, 0.0),
    d.MAV_SENSOR_ROTATION_YAW_180: (-1.0, 0.0, 0.0),
    d.MAV_SENSOR_ROTATION_YAW_225: (-_SIDE, -_SIDE, 0.0),
    d.MAV_SENSOR_ROTATION_YAW_270: (0.0, -1.0, 0.0),
    d.MAV_SENSOR_ROTATION_YAW_315: (_SIDE, -_SIDE, 0.0),
    d.MAV_SENSOR_ROTATION_PITCH_90: (0.0, 0.0, -1.0),
    d.MAV_SENSOR_ROTATION_PITCH_270: (0.0, 0.0, 1.0),
}


def distance_sensors(payloads: Mapping[int, bytes]) -> tuple[DistanceSensors, float | None]:
    """DISTANCE_SENSOR of all sensors whose direction is known.

    Raises:
        Unusable: no sensor has a known direction.
    """
    unpacked = [_distance.unpack_from(payload) for _, payload in sorted(payloads.items())]
    newest_ms = max(values[0] for values in unpacked)
    sensors = tuple(sensor for values in unpacked if (sensor := _sensor(values, newest_ms)) is not None)
    if not sensors:
        raise Unusable("DISTANCE_SENSOR: no sensor reports its direction and range")
    return DistanceSensors(sensors), newest_ms / 1e3


def _sensor(values: tuple[float, ...], newest_ms: float) -> DistanceSensor | None:
    """The measurement of one sensor; None if its direction or range is unknown."""
    time_ms, min_cm, max_cm, measured_cm, _, sensor_id, orientation, _, width_rad, *rest = values
    direction = DIRECTIONS_FRD.get(int(orientation))
    if orientation == d.MAV_SENSOR_ROTATION_CUSTOM:
        sensor_rotation = rotation(rest[1:5])
        direction = None if sensor_rotation is None else rotate(sensor_rotation, (1.0, 0.0, 0.0))
    if direction is None or max_cm == 0:
        return None
    reported_width_rad = number(width_rad)
    return DistanceSensor(
        sensor_id=int(sensor_id),
        direction_frd=direction,
        distance_m=None if rest[5] == INVALID_SIGNAL else measured_cm / 100,
        range_min_m=min_cm / 100,
        range_max_m=max_cm / 100,
        width_rad=reported_width_rad
        if reported_width_rad is not None and 0.0 < reported_width_rad <= MAX_WIDTH_RAD
        else None,
        behind_s=(newest_ms - time_ms) / 1e3,
    )


def obstacle_distance(payloads: Mapping[int, bytes]) -> tuple[ObstacleDistance, float | None]:
    """OBSTACLE_DISTANCE.

    Raises:
        Unusable: the message has no range, or its sectors have no width.
    """
    values = _obstacle_distance.unpack_from(payloads[d.MAVLINK_MSG_ID_OBSTACLE_DISTANCE])
    measured, (min_cm, max_cm, _, step, step_f, offset, frame) = values[1:73], values[73:80]
    step_deg = number(step_f) or float(step)
    first_deg = number(offset)
    if not 0.1 <= abs(step_deg) <= 180.0 or first_deg is None or abs(first_deg) > 360.0:
        raise Unusable("OBSTACLE_DISTANCE: its sectors have no width or no direction")
    if max_cm == 0:
        raise Unusable("OBSTACLE_DISTANCE: it has no range")
    count = min(SECTORS, round(360.0 / abs(step_deg)))
    distances = tuple(None if cm == UNKNOWN_CM else cm / 100 for cm in measured[:count])
    frame_name = "body" if frame == d.MAV_FRAME_BODY_FRD else "north"
    value = ObstacleDistance(frame_name, first_deg, step_deg, distances, min_cm / 100, max_cm / 100)
    return value, values[0] / 1e6


Payloads = Mapping[int, bytes]
Decoded = tuple[object, float | None]
"""(value, time since the vehicle's boot [s])."""

_attitude_quaternion = struct.Struct("<I7f")
_attitude = struct.Struct("<I6f")
_local_position = struct.Struct("<I6f")
_global_position = struct.Struct("<I4i3hH")
_gps = struct.Struct("<Q3i4H2BiI")
_battery = struct.Struct("<iih10Hh3BbiB4H")
_sys_status = struct.Struct("<3IHHh6Hb")
_home = struct.Struct("<3i3f")
_servo = struct.Struct("<I8HB8H")
_target_local = struct.Struct("<I11fHB")
_target_attitude = struct.Struct("<I4f3ff")
_hud = struct.Struct("<4fhH")
_estimator = struct.Struct("<Q8fH")
_wind = struct.Struct("<Q8f")
_orbit = struct.Struct("<QfiifB")

_mission_current = struct.Struct("<HHBBIII")
_mission_reached = struct.Struct("<H")

FORMATS: dict[int, struct.Struct] = {
    d.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _attitude_quaternion,
    d.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    d.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position,
    d.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position,
    d.MAVLINK_MSG_ID_GPS_RAW_INT: _gps,
    d.MAVLINK_MSG_ID_BATTERY_STATUS: _battery,
    d.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    d.MAVLINK_MSG_ID_HOME_POSITION: _home,
    d.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _servo,
    d.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: _target_local,
    d.MAVLINK_MSG_ID_ATTITUDE_TARGET: _target_attitude,
    d.MAVLINK_MSG_ID_VFR_HUD: _hud,
    d.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator,
    d.MAVLINK_MSG_ID_WIND_COV: _wind,
    d.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS: _orbit,
    d.MAVLINK_MSG_ID_MISSION_CURRENT: _mission_current,
    d.MAVLINK_MSG_ID_MISSION_ITEM_REACHED: _mission_reached,
    **gimbal_decoder.FORMATS,
    d.MAVLINK_MSG_ID_DISTANCE_SENSOR: _distance,
    d.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: _obstacle_distance,
}

GLOBAL_FRAMES = (d.MAV_FRAME_GLOBAL, d.MAV_FRAME_GLOBAL_INT)
MAX_CELL_MV = 6000
"""Maximum voltage of a cell [mV]; a larger value is the total voltage of a battery, or marks an unused
cell."""
UNKNOWN_CURRENTS = (-1, -100)
"""Values that mean an unknown current [cA]: -1 in MAVLink, -100 (-1 A) from PX4."""
IGNORE_AXES = (
    (
        d.POSITION_TARGET_TYPEMASK_X_IGNORE,
        d.POSITION_TARGET_TYPEMASK_Y_IGNORE,
        d.POSITION_TARGET_TYPEMASK_Z_IGNORE,
    ),
    (
        d.POSITION_TARGET_TYPEMASK_VX_IGNORE,
        d.POSITION_TARGET_TYPEMASK_VY_IGNORE,
        d.POSITION_TARGET_TYPEMASK_VZ_IGNORE,
    ),
    (
        d.POSITION_TARGET_TYPEMASK_AX_IGNORE,
        d.POSITION_TARGET_TYPEMASK_AY_IGNORE,
        d.POSITION_TARGET_TYPEMASK_AZ_IGNORE,
    ),
)


def attitude_quaternion(payloads: Payloads) -> Decoded:
    """ATTITUDE_QUATERNION."""
    time_ms, w, x, y, z, p, q, r = _attitude_quaternion.unpack_from(
        payloads[d.MAVLINK_MSG_ID_ATTITUDE_QUATERNION]
    )
    q_ned_frd = rotation((w, x, y, z))
    if q_ned_frd is None:
        raise Unusable("ATTITUDE_QUATERNION: its quaternion is not a rotation")
    roll, pitch, yaw = euler_from_q(q_ned_frd)
    return samples.Attitude(roll, pitch, yaw, q_ned_frd, vector((p, q, r))), time_ms / 1e3


def attitude(payloads: Payloads) -> Decoded:
    """ATTITUDE, for vehicles that send no quaternion."""
    time_ms, roll, pitch, yaw, p, q, r = _attitude.unpack_from(payloads[d.MAVLINK_MSG_ID_ATTITUDE])
    require_valid("ATTITUDE: an angle", roll, pitch, yaw)
    quaternion = q_from_euler(roll, pitch, yaw)
    return samples.Attitude(roll, pitch, yaw, quaternion, vector((p, q, r))), time_ms / 1e3


def local_position(payloads: Payloads) -> Decoded:
    """LOCAL_POSITION_NED."""
    time_ms, x, y, z, vx, vy, vz = _local_position.unpack_from(payloads[d.MAVLINK_MSG_ID_LOCAL_POSITION_NED])
    require_valid("LOCAL_POSITION_NED: a position or velocity", x, y, z, vx, vy, vz)
    return samples.LocalPosition((x, y, z), (vx, vy, vz)), time_ms / 1e3


def global_position(payloads: Payloads) -> Decoded:
    """GLOBAL_POSITION_INT."""
    time_ms, lat, lon, alt, relative, vx, vy, vz, heading = _global_position.unpack_from(
        payloads[d.MAVLINK_MSG_ID_GLOBAL_POSITION_INT]
    )
    require_on_earth("GLOBAL_POSITION_INT", lat / 1e7, lon / 1e7)
    value = samples.GlobalPosition(
        lat_deg=lat / 1e7,
        lon_deg=lon / 1e7,
        alt_amsl_m=alt / 1e3,
        alt_home_m=relative / 1e3,
        velocity_ned_m_s=(vx / 100, vy / 100, vz / 100),
        heading_deg=heading / 100 if heading <= 36000 else None,
    )
    return value, time_ms / 1e3


def gps(payloads: Payloads) -> Decoded:
    """GPS_RAW_INT. These values mean unknown: satellites 255, HDOP 0xFFFF, accuracy 0."""
    fields = _gps.unpack_from(payloads[d.MAVLINK_MSG_ID_GPS_RAW_INT])
    hdop, fix_type, satellites, accuracy_mm = fields[4], fields[8], fields[9], fields[11]
    value = samples.Gps(
        fix_type=fix_type,
        satellites=None if satellites == 255 else satellites,
        hdop=None if hdop == 0xFFFF else hdop / 100,
        horizontal_accuracy_m=accuracy_mm / 1e3 if accuracy_mm else None,
    )
    return value, None


def battery(payloads: Payloads) -> Decoded:
    """BATTERY_STATUS, or SYS_STATUS until the first BATTERY_STATUS is received."""
    status = d.MAVLINK_MSG_ID_BATTERY_STATUS
    batteries = [
        _battery_reading(instance_of(k), p) for k, p in sorted(payloads.items()) if message_of(k) == status
    ]
    if not batteries:
        return _battery_from_sys_status(payloads[d.MAVLINK_MSG_ID_SYS_STATUS]), None
    lowest = min(
        batteries, key=lambda b: (101 if b.remaining_percent is None else b.remaining_percent, b.battery_id)
    )
    value = samples.Battery(
        lowest.remaining_percent,
        lowest.voltage_v,
        lowest.current_a,
        lowest.consumed_mah,
        lowest.time_remaining_s,
        lowest.cell_voltages_v,
        lowest.battery_id,
        tuple(batteries) if len(batteries) > 1 else (),
    )
    return value, None


def _battery_reading(battery_id: int, payload: bytes) -> samples.BatteryReading:
    values = _battery.unpack_from(payload)
    consumed_mah, current_ca, remaining, time_s = values[0], values[13], values[17], values[18]
    # Cells 11 to 14 are at the end of the message: 0 means unknown, because older senders omit them.
    cells = [mv for mv in values[3:13] if mv != 0xFFFF] + [
        mv for mv in values[20:24] if mv not in (0, 0xFFFF)
    ]
    return samples.BatteryReading(
        battery_id=battery_id,
        remaining_percent=remaining if 0 <= remaining <= 100 else None,
        voltage_v=sum(cells) / 1e3 if cells else None,
        current_a=None if current_ca in UNKNOWN_CURRENTS else current_ca / 100,
        consumed_mah=None if consumed_mah == -1 else consumed_mah,
        time_remaining_s=time_s if time_s > 0 else None,
        cell_voltages_v=_cell_voltages_v(cells),
    )


def _cell_voltages_v(millivolts: list[int]) -> tuple[float, ...] | None:
    """Voltage of each cell [V]; None if the values are not cell voltages: a single value is the total
    voltage, and a total above 65.5 V is split over several values."""
    if len(millivolts) < 2 or max(millivolts) > MAX_CELL_MV:
        return None
    return tuple(mv / 1e3 for mv in millivolts)


def _battery_from_sys_status(payload: bytes) -> samples.Battery:
    _, _, _, _, millivolt, current_ca, *_, remaining = _sys_status.unpack_from(payload)
    return samples.Battery(
        remaining_percent=remaining if 0 <= remaining <= 100 else None,
        voltage_v=None if millivolt == 0xFFFF else millivolt / 1e3,
        current_a=None if current_ca in UNKNOWN_CURRENTS else current_ca / 100,
        consumed_mah=None,
        time_remaining_s=None,
    )


def home(payloads: Payloads) -> Decoded:
    """HOME_POSITION."""
    lat, lon, alt_mm, x, y, z = _home.unpack_from(payloads[d.MAVLINK_MSG_ID_HOME_POSITION])
    require_on_earth("HOME_POSITION", lat / 1e7, lon / 1e7)
    return samples.Home(lat / 1e7, lon / 1e7, alt_mm / 1e3, vector((x, y, z))), None


def motors(payloads: Payloads) -> Decoded:
    """SERVO_OUTPUT_RAW: outputs up to the last used one."""
    unpacked = [(instance_of(key), _servo.unpack_from(payload)) for key, payload in sorted(payloads.items())]
    groups = tuple(samples.OutputGroup(port, _used_outputs(values[1:9])) for port, values in unpacked)
    time_boot_s = unpacked[0][1][0] / 1e6
    return samples.Motors(groups[0].pwm_us, groups if len(groups) > 1 else ()), time_boot_s


def _used_outputs(outputs: tuple[int, ...]) -> tuple[int, ...]:
    used = [n for n, pwm_us in enumerate(outputs, 1) if pwm_us not in (0, 0xFFFF)]
    return outputs[: used[-1]] if used else ()


def target_local(payloads: Payloads) -> Decoded:
    """POSITION_TARGET_LOCAL_NED; ignored fields and NaN mean not controlled."""
    values = _target_local.unpack_from(payloads[d.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED])
    mask = values[12]

    def axes(first: int, bits: tuple[int, int, int]) -> tuple[float | None, float | None, float | None]:
        a, b, c = (None if mask & bit else number(values[first + i]) for i, bit in enumerate(bits))
        return a, b, c

    return (
        samples.TargetLocal(
            axes(1, IGNORE_AXES[0]),
            axes(4, IGNORE_AXES[1]),
            axes(7, IGNORE_AXES[2]),
            None if mask & d.POSITION_TARGET_TYPEMASK_YAW_IGNORE else number(values[10]),
            None if mask & d.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE else number(values[11]),
        ),
        values[0] / 1e3,
    )


def target_attitude(payloads: Payloads) -> Decoded | None:
    """ATTITUDE_TARGET; None while the vehicle sends NaN."""
    time_ms, w, x, y, z, p, q, r, thrust = _target_attitude.unpack_from(
        payloads[d.MAVLINK_MSG_ID_ATTITUDE_TARGET]
    )
    if any(number(v) is None for v in (w, x, y, z, p, q, r, thrust)):
        return None
    return samples.TargetAttitude((w, x, y, z), (p, q, r), thrust), time_ms / 1e3


def hud(payloads: Payloads) -> Decoded:
    """VFR_HUD."""
    airspeed, groundspeed, _alt, climb, _heading, throttle = _hud.unpack_from(
        payloads[d.MAVLINK_MSG_ID_VFR_HUD]
    )
    return samples.Hud(number(groundspeed), number(airspeed), number(climb), throttle), None


def health(payloads: Payloads) -> Decoded:
    """SYS_STATUS. PX4 sets its pre-arm check only in the healthy mask, never in the present mask."""
    present, enabled, healthy, load, *_ = _sys_status.unpack_from(payloads[d.MAVLINK_MSG_ID_SYS_STATUS])
    prearm = d.MAV_SYS_STATUS_PREARM_CHECK
    return (
        samples.Health(
            present,
            enabled,
            healthy,
            bool(healthy & prearm) if present else None,
            load / 1000 if load <= 1000 else None,
        ),
        None,
    )


def estimator(payloads: Payloads) -> Decoded:
    """ESTIMATOR_STATUS."""
    values = _estimator.unpack_from(payloads[d.MAVLINK_MSG_ID_ESTIMATOR_STATUS])
    return samples.Estimator(values[9], number(values[7]), number(values[8])), values[0] / 1e6


def wind(payloads: Payloads) -> Decoded:
    """WIND_COV."""
    time_us, north, east, down, *_ = _wind.unpack_from(payloads[d.MAVLINK_MSG_ID_WIND_COV])
    require_valid("WIND_COV: wind speed north or east", north, east)
    return samples.Wind((north, east, number(down) or 0.0), math.hypot(north, east)), time_us / 1e6


def orbit(payloads: Payloads) -> Decoded:
    """ORBIT_EXECUTION_STATUS."""
    time_us, radius_m, lat, lon, alt_m, frame = _orbit.unpack_from(
        payloads[d.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS]
    )
    require_on_earth("ORBIT_EXECUTION_STATUS", lat / 1e7, lon / 1e7)
    require_valid("ORBIT_EXECUTION_STATUS: radius", radius_m)
    if frame not in GLOBAL_FRAMES:
        raise Unusable(f"ORBIT_EXECUTION_STATUS: the frame {frame} is not global")
    value = samples.Orbit(lat / 1e7, lon / 1e7, number(alt_m), abs(radius_m), radius_m >= 0.0)
    return value, time_us / 1e6


def mission(payloads: Payloads) -> Decoded | None:
    """MISSION_CURRENT with the newest MISSION_ITEM_REACHED; None before the first MISSION_CURRENT."""
    payload = payloads.get(d.MAVLINK_MSG_ID_MISSION_CURRENT)
    if payload is None:
        return None
    current, total, _state, _mode, mission_id, fence_id, rally_id = _mission_current.unpack_from(payload)
    reached_payload = payloads.get(d.MAVLINK_MSG_ID_MISSION_ITEM_REACHED)
    reached = None if reached_payload is None else _mission_reached.unpack_from(reached_payload)[0]
    return samples.Mission(current, item_count(total), reached, mission_id, fence_id, rally_id), None


def item_count(total: int) -> int | None:
    """MISSION_CURRENT.total: 65535 means no mission, 0 unknown."""
    return 0 if total == 0xFFFF else total or None


Decoder = Callable[[Payloads], Decoded | None]

DECODERS: dict[str, tuple[tuple[int, ...], Decoder]] = {
    "local_position": ((d.MAVLINK_MSG_ID_LOCAL_POSITION_NED,), local_position),
    "global_position": ((d.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,), global_position),
    "gps": ((d.MAVLINK_MSG_ID_GPS_RAW_INT,), gps),
    "battery": ((d.MAVLINK_MSG_ID_BATTERY_STATUS, d.MAVLINK_MSG_ID_SYS_STATUS), battery),
    "home": ((d.MAVLINK_MSG_ID_HOME_POSITION,), home),
    "motors": ((d.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,), motors),
    "target_local": ((d.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,), target_local),
    "target_attitude": ((d.MAVLINK_MSG_ID_ATTITUDE_TARGET,), target_attitude),
    "hud": ((d.MAVLINK_MSG_ID_VFR_HUD,), hud),
    "health": ((d.MAVLINK_MSG_ID_SYS_STATUS,), health),
    "mission": ((d.MAVLINK_MSG_ID_MISSION_CURRENT, d.MAVLINK_MSG_ID_MISSION_ITEM_REACHED), mission),
    "estimator": ((d.MAVLINK_MSG_ID_ESTIMATOR_STATUS,), estimator),
    "wind": ((d.MAVLINK_MSG_ID_WIND_COV,), wind),
    "orbit": ((d.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS,), orbit),
    "distance_sensors": ((d.MAVLINK_MSG_ID_DISTANCE_SENSOR,), distance_sensors),
    "obstacle_distance": ((d.MAVLINK_MSG_ID_OBSTACLE_DISTANCE,), obstacle_distance),
}
"""Messages and decoder of each topic. `vehicle/state.py` decodes the topics attitude (the newer of two
messages) and gimbal (several gimbals)."""
