"""Decodes distance measurements: DISTANCE_SENSOR of each sensor, and OBSTACLE_DISTANCE in sectors
around the vehicle.

A distance beyond the sensor's range means that no obstacle is within range; None: unknown. Directions are
relative to the body (FRD), or to north if the message states this.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.numbers import Unusable, number, rotation
from gcs_server.vehicle.samples import DistanceSensor, DistanceSensors, ObstacleDistance
from missions.frames import Vector3, rotate

_distance = struct.Struct("<I3H4B2f4fB")
_obstacle_distance = struct.Struct("<Q72H2H2B2fB")

FORMATS: dict[int, struct.Struct] = {
    d.MAVLINK_MSG_ID_DISTANCE_SENSOR: _distance,
    d.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: _obstacle_distance,
}
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
