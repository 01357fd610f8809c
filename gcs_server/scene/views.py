"""The four camera modes as poses of the world, so that the user keeps control of the browser's camera. The
modes chase and top do not move the camera; they move the world under the camera, so that the vehicle stays in
the middle. Dragging and zooming then happen only in the browser, without latency or conflict.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from gcs_server.language import LANGUAGES
from gcs_server.scene.dry_runs import DryRunMoment
from gcs_server.scene.model import GIMBAL_POSITION_M
from gcs_server.scene.palette import Theme
from gcs_server.scene.pose import VehiclePose
from missions.frames import IDENTITY, Quaternion, Vector3, conjugate, multiply, q_from_yaw, rotate

Mode = Literal["chase", "free", "gimbal", "top"]

HANDLES_DISTANCE_M = 6.0
"""Distance to which a camera that cannot drag the handles is moved [m]. Handles have the same size on the
screen at any distance."""
MIN_HANDLES_DISTANCE_M = 4.5
"""A camera nearer to the handles than this is moved back [m]; the camera of the mode `chase` is always
nearer."""
HANDLES_MAX_OFFSET_RAD = 0.1
"""Maximum angle between a handle and the middle of the picture. Farther out, a panel may hide the handle, or
it may be outside the picture."""
HANDLES_ELEVATION_RAD = 0.55
"""Elevation to which a camera that is too low is moved. From a low elevation, the horizontal handle looks
like a line."""
MIN_ELEVATION_RAD = 0.3
"""Minimum elevation; a camera at a lower elevation is moved."""


@dataclass(frozen=True, slots=True)
class Preview:
    """A setpoint that a page shows before it is sent, in the vehicle's local NED frame."""

    position_ned_m: Vector3
    yaw_ned_rad: float | None
    handles: bool
    """Whether the preview can be dragged."""
    serial: int
    """Incremented when the page moves the preview; not changed by a drag in the browser."""


@dataclass(frozen=True, slots=True)
class View:
    """The content of the view in one browser."""

    mode: Mode = "chase"
    vehicle: str | None = None
    """Id of the vehicle; None: the first vehicle."""
    theme: Theme = "dark"
    language: str = LANGUAGES[0]
    """Language of the labels: one of `LANGUAGES`."""
    preview: Preview | None = None
    dry_run: DryRunMoment | None = None


@dataclass(frozen=True, slots=True)
class Camera:
    """The browser's camera."""

    position_m: Vector3
    look_at_m: Vector3
    fov_rad: float


@dataclass(frozen=True, slots=True)
class WorldPose:
    """Pose of the world's ENU frame in the browser's scene."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    q: Quaternion = IDENTITY


CAMERAS: dict[Mode, Camera] = {
    "chase": Camera((-3.1, 0.0, 1.25), (0.35, 0.0, -0.05), 0.87),
    "free": Camera((-7.0, -7.0, 6.0), (0.0, 0.0, 1.5), 0.87),
    "gimbal": Camera((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.62),
    "top": Camera((0.0, -0.01, 22.0), (0.0, 0.0, 0.0), 0.70),
}
"""Initial camera of each mode; the user may move the camera, except in `gimbal`."""


def world_pose(mode: Mode, pose: VehiclePose | None, heading_enu_rad: float) -> WorldPose:
    """Pose of the world for this mode; the identity in mode `free`, and without a vehicle.

    Args:
        heading_enu_rad: viewing direction of `chase`.
    """
    if mode == "free" or pose is None:
        return WorldPose()
    if mode == "top":
        return _world_from(pose.position_enu_m, IDENTITY)
    if mode == "chase":
        return _world_from(pose.position_enu_m, q_from_yaw(heading_enu_rad))
    lens = rotate(pose.q_enu_flu, GIMBAL_POSITION_M)
    camera_enu_m = (
        pose.position_enu_m[0] + lens[0],
        pose.position_enu_m[1] + lens[1],
        pose.position_enu_m[2] + lens[2],
    )
    return _world_from(camera_enu_m, multiply(pose.q_enu_flu, pose.q_body_camera or IDENTITY))


def in_world(world: WorldPose, point_m: Vector3) -> Vector3:
    """Converts a point from the frame of the browser's scene to the world's ENU."""
    x, y, z = (point_m[i] - world.position_m[i] for i in range(3))
    return rotate(conjugate(world.q), (x, y, z))


def camera_for_handles(
    eye_m: Vector3, look_at_m: Vector3, handles_m: Vector3, vehicle_m: Vector3
) -> tuple[Vector3, Vector3]:
    """A camera pose from which handles can be dragged: the current pose if possible, or else a pose that
    looks at the handles.

    Args:
        eye_m, look_at_m, handles_m, vehicle_m: all in the world's ENU.

    Returns:
        (eye, look_at).
    """
    view_direction = _difference(look_at_m, eye_m)
    if _can_be_dragged(view_direction, _difference(handles_m, eye_m)):
        return eye_m, look_at_m
    horizontal_m = math.hypot(view_direction[0], view_direction[1])
    east, north = (
        (view_direction[0] / horizontal_m, view_direction[1] / horizontal_m)
        if horizontal_m > 0.0
        else (0.0, 1.0)
    )
    distance_m = max(HANDLES_DISTANCE_M, 1.6 * math.dist(handles_m, vehicle_m))
    elevation_rad = max(HANDLES_ELEVATION_RAD, math.atan2(-view_direction[2], horizontal_m))
    back_m, up_m = distance_m * math.cos(elevation_rad), distance_m * math.sin(elevation_rad)
    return (handles_m[0] - east * back_m, handles_m[1] - north * back_m, handles_m[2] + up_m), handles_m


def _can_be_dragged(view_direction: Vector3, to_handles: Vector3) -> bool:
    """Whether handles can be dragged well: near the middle of the picture, seen from above, and not too
    near."""
    distance_m = math.hypot(*to_handles)
    if distance_m < MIN_HANDLES_DISTANCE_M or -to_handles[2] < math.sin(MIN_ELEVATION_RAD) * distance_m:
        return False
    along_m = sum(a * b for a, b in zip(view_direction, to_handles, strict=True)) / math.hypot(
        *view_direction
    )
    return along_m > math.cos(HANDLES_MAX_OFFSET_RAD) * distance_m


def _difference(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _world_from(eye_enu_m: Vector3, q_enu_eye: Quaternion) -> WorldPose:
    q = conjugate(q_enu_eye)
    x, y, z = rotate(q, eye_enu_m)
    return WorldPose((-x, -y, -z), q)
