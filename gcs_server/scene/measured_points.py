"""Points measured by a vehicle's distance sensors, as positions in the scene."""

from __future__ import annotations

import numpy as np

from gcs_server.scene.frames import enu_from_ned
from gcs_server.scene.model import Points
from gcs_server.scene.ports import SceneVehicle
from gcs_server.streamer.offboard.estimates import scans_of
from missions.avoidance.scans import LEVEL_MAX_SINE, recent_scans
from missions.frames import Quaternion, Vector3

DRAWN_FOR_S = 2.5
"""Time for which a measured point is drawn [s]; by default PX4 sends DISTANCE_SENSOR every two seconds."""
HALF_HEIGHT_M = 0.18
"""Half the height of the stroke that marks a point [m]."""


def measured_points(
    vehicle: SceneVehicle, q_ned_frd: Quaternion, position_enu_m: Vector3, now_monotonic_s: float
) -> tuple[Vector3, ...]:
    """The measured points, except those of sensors that point down."""
    samples = (vehicle.topic("distance_sensors"), vehicle.topic("obstacle_distance"))
    if samples == (None, None):
        return ()
    x, y, z = position_enu_m
    points: list[Vector3] = []
    for scan in recent_scans(scans_of(samples, q_ned_frd, now_monotonic_s), now_monotonic_s, DRAWN_FOR_S):
        for (n, e, d), distance_m in zip(scan.directions_ned, scan.distances_m, strict=True):
            if distance_m is not None and d <= LEVEL_MAX_SINE:
                east, north, up = enu_from_ned((n * distance_m, e * distance_m, d * distance_m))
                points.append((x + east, y + north, z + up))
    return tuple(points)


def upright_lines(points_enu_m: tuple[Vector3, ...]) -> Points:
    """An upright line at each point, (N, 2, 3), which is visible from all sides."""
    points = np.asarray(points_enu_m, np.float32).reshape(-1, 1, 3)
    half = np.asarray([[0.0, 0.0, -HALF_HEIGHT_M], [0.0, 0.0, HALF_HEIGHT_M]], np.float32)
    return points + half
