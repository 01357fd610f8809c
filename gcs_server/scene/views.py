"""Where one looks from: four modes as a pose of the world, so that the browser's camera stays the user's.

Chase and top do not move the camera: they move the world under it, such that the vehicle stays at the
middle. Dragging and zooming are then the browser's own, at any latency, and never fought over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gcs_server.scene.frames import (
    IDENTITY,
    Quaternion,
    Vector3,
    conjugate,
    multiply,
    q_from_yaw,
    rotate,
)
from gcs_server.scene.model import GIMBAL_AT_M
from gcs_server.scene.palette import Theme
from gcs_server.scene.pose import VehiclePose

Mode = Literal["chase", "free", "gimbal", "top"]


@dataclass(frozen=True, slots=True)
class Preview:
    """What a page is about to ask of the view's vehicle, in the vehicle's local NED."""

    position_ned_m: Vector3
    yaw_ned_rad: float | None
    handles: bool
    """It may be dragged."""
    serial: int
    """Grows whenever the page puts it somewhere; a drag in the browser leaves it."""


@dataclass(frozen=True, slots=True)
class View:
    """What one browser wants to see."""

    mode: Mode = "chase"
    vehicle: str | None = None
    """None: the first one."""
    theme: Theme = "dark"
    preview: Preview | None = None


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera as the browser holds it."""

    position_m: Vector3
    look_at_m: Vector3
    fov_rad: float


@dataclass(frozen=True, slots=True)
class WorldPose:
    """Takes the world's ENU to what the browser's camera looks at."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    q: Quaternion = IDENTITY


CAMERAS: dict[Mode, Camera] = {
    "chase": Camera((-3.1, 0.0, 1.25), (0.35, 0.0, -0.05), 0.87),
    "free": Camera((-7.0, -7.0, 6.0), (0.0, 0.0, 1.5), 0.87),
    "gimbal": Camera((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.62),
    "top": Camera((0.0, -0.01, 22.0), (0.0, 0.0, 0.0), 0.70),
}
"""Where each mode starts; the user goes on from there (but in gimbal, which is the camera's view)."""


def world_pose(mode: Mode, pose: VehiclePose | None, heading_enu_rad: float) -> WorldPose:
    """How the world has to lie for this mode; without a vehicle as it is.

    Args:
        heading_enu_rad: where `chase` looks.
    """
    if mode == "free" or pose is None:
        return WorldPose()
    if mode == "top":
        return _world_from(pose.position_enu_m, IDENTITY)
    if mode == "chase":
        return _world_from(pose.position_enu_m, q_from_yaw(heading_enu_rad))
    lens = rotate(pose.q_enu_flu, GIMBAL_AT_M)
    at = (
        pose.position_enu_m[0] + lens[0],
        pose.position_enu_m[1] + lens[1],
        pose.position_enu_m[2] + lens[2],
    )
    return _world_from(at, multiply(pose.q_enu_flu, pose.q_body_camera or IDENTITY))


def in_world(world: WorldPose, point_m: Vector3) -> Vector3:
    """A point of the browser's camera frame in the world's ENU."""
    x, y, z = (point_m[i] - world.position_m[i] for i in range(3))
    return rotate(conjugate(world.q), (x, y, z))


def _world_from(eye_enu_m: Vector3, q_enu_eye: Quaternion) -> WorldPose:
    q = conjugate(q_enu_eye)
    x, y, z = rotate(q, eye_enu_m)
    return WorldPose((-x, -y, -z), q)
