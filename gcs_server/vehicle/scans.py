"""Scans of obstacles, from the samples of a vehicle's distance sensors."""

from __future__ import annotations

import math

from gcs_server.vehicle.samples import DistanceSensors, ObstacleDistance, Sample
from missions.avoidance.scans import Scan
from missions.frames import Quaternion, Vector3, rotate

MAX_SCAN_AGE_S = 3.0
"""Maximum age of a measurement [s]."""


def scans_of(samples: tuple[Sample | None, ...], q_ned_frd: Quaternion, now_s: float) -> tuple[Scan, ...]:
    """The newest scan of each sensor.

    Args:
        samples: samples of the topics `distance_sensors` and `obstacle_distance`.
        q_ned_frd: attitude of the vehicle.
        now_s: current time [s, monotonic].
    """
    scans: list[Scan] = []
    for sample in samples:
        if sample is None:
            continue
        received_s, value = sample.received_monotonic_s, sample.value
        if isinstance(value, DistanceSensors):
            for sensor in value.sensors:
                if sensor.distance_m is not None:
                    direction = rotate(q_ned_frd, sensor.direction_frd)
                    distance_m = sensor.distance_m if sensor.distance_m <= sensor.range_max_m else None
                    half_width_rad = (sensor.width_rad or 0.0) / 2.0
                    measured_s = received_s - max(0.0, sensor.behind_s)
                    scans.append(
                        Scan(measured_s, (direction,), (distance_m,), sensor.range_max_m, half_width_rad)
                    )
        elif isinstance(value, ObstacleDistance):
            scans.append(_scan_of_sectors(value, q_ned_frd, received_s))
    return tuple(scan for scan in scans if scan.directions_ned and now_s - scan.measured_s <= MAX_SCAN_AGE_S)


def _scan_of_sectors(value: ObstacleDistance, q_ned_frd: Quaternion, received_s: float) -> Scan:
    directions: list[Vector3] = []
    distances: list[float | None] = []
    for number, distance_m in enumerate(value.distances_m):
        if distance_m is None:
            continue
        angle_rad = math.radians(value.first_deg + number * value.step_deg)
        level = (math.cos(angle_rad), math.sin(angle_rad), 0.0)
        directions.append(rotate(q_ned_frd, level) if value.frame == "body" else level)
        distances.append(distance_m if distance_m <= value.range_max_m else None)
    half_width_rad = math.radians(abs(value.step_deg)) / 2.0
    return Scan(received_s, tuple(directions), tuple(distances), value.range_max_m, half_width_rad)
