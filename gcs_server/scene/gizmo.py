"""Drags of the preview's two handles. The browser's messages are checked here and are not passed to viser.

A drag is converted to a position in the vehicle's local NED, which the page of the view may send. No I/O; the
handles are in `preview_node.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import msgspec
from pydantic import BaseModel, ConfigDict, Field

from gcs_server.scene.frames import yaw_enu_from_ned
from gcs_server.scene.views import Preview
from missions.frames import Quaternion, Vector3, normalized, yaw_from_q

GROUND_HANDLE = "/world/gizmo_ground"
HEIGHT_HANDLE = "/world/gizmo_height"
MAX_DRAG_DISTANCE_M = 1_000.0
"""Maximum distance from the vehicle to which the preview can be dragged [m]. Near the horizon one pixel
covers a large distance.
"""

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-1e5, le=1e5)]
Angle = Annotated[float, Field(allow_inf_nan=False, ge=-2 * math.pi, le=2 * math.pi)]


class PreviewRequest(BaseModel):
    """A setpoint that a page shows before it is sent."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    position_ned_m: tuple[Finite, Finite, Finite] = Field(
        description="Position in the vehicle's local frame."
    )
    yaw_ned_rad: Angle | None = None
    handles: bool = Field(
        default=False, description="Whether the preview has handles to drag; they are shown in mode `free`."
    )


class MovedMessage(
    msgspec.Struct,
    tag_field="type",
    tag="TransformControlsUpdateMessage",
    frozen=True,
    forbid_unknown_fields=True,
):
    """viser's message about a handle that is being dragged."""

    name: str
    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    owner: str = ""


class ReleasedMessage(
    msgspec.Struct,
    tag_field="type",
    tag="TransformControlsDragEndMessage",
    frozen=True,
    forbid_unknown_fields=True,
):
    """viser's message about a released handle."""

    name: str
    owner: str = ""


@dataclass(frozen=True, slots=True)
class Drag:
    """A drag of a handle in one browser, in the world's ENU frame. A release has no pose."""

    position_enu_m: Vector3 | None
    q_enu: Quaternion | None
    changes_yaw: bool
    """Whether this handle also changes the yaw."""


@dataclass(frozen=True, slots=True)
class SceneGizmo:
    """Position to which the preview of a view was dragged, in the vehicle's local NED frame."""

    view: str
    """Token of the view."""
    vehicle: str
    position_ned_m: Vector3
    yaw_ned_rad: float | None
    released: bool
    """Whether the handle was released."""


def parse_drag(message: MovedMessage | ReleasedMessage) -> Drag | None:
    """The drag in a browser's message; None if the message is for another handle or has no valid position."""
    if message.name not in (GROUND_HANDLE, HEIGHT_HANDLE):
        return None
    changes_yaw = message.name == GROUND_HANDLE
    if isinstance(message, ReleasedMessage):
        return Drag(None, None, changes_yaw)
    q = normalized(message.wxyz)
    if q is None or not all(map(math.isfinite, message.position)):
        return None
    return Drag(message.position, q, changes_yaw)


def apply_drag(preview: Preview, drag: Drag, origin_enu_m: Vector3, vehicle_enu_m: Vector3) -> Preview | None:
    """The preview after a drag; None if it was dragged too far.

    Args:
        origin_enu_m: origin of the vehicle's local frame.
        vehicle_enu_m: position of the vehicle.
    """
    if drag.position_enu_m is None or drag.q_enu is None:
        return preview
    if math.dist(drag.position_enu_m, vehicle_enu_m) > MAX_DRAG_DISTANCE_M:
        return None
    east, north, up = (p - o for p, o in zip(drag.position_enu_m, origin_enu_m, strict=True))
    yaw_ned_rad = preview.yaw_ned_rad
    if drag.changes_yaw and yaw_ned_rad is not None:
        yaw_ned_rad = math.remainder(yaw_enu_from_ned(yaw_from_q(drag.q_enu)), 2 * math.pi)
    return Preview((north, east, -up), yaw_ned_rad, preview.handles, preview.serial)
