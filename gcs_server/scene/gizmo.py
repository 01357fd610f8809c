"""The preview of a setpoint before it is sent, and the two handles to drag it.

The handles are viser's transform controls: one along the ground and about the vertical, one up and down, so
that a position cannot be tilted. This module reads and checks a browser's messages about them, and does not
pass them to viser. A drag is converted to a position in the vehicle's local NED frame, which the page of the
view may send as a setpoint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import msgspec
import viser
from pydantic import BaseModel, ConfigDict, Field

from gcs_server.scene.frames import enu_from_ned, yaw_enu_from_ned
from gcs_server.scene.labels import Label, height_text
from gcs_server.scene.model import q_along
from gcs_server.scene.palette import Palette, lit
from gcs_server.scene.shapes import Shapes
from gcs_server.scene.views import Preview
from missions.frames import IDENTITY, Quaternion, Vector3, normalized, q_from_yaw, yaw_from_q

GROUND_HANDLE = "/world/gizmo_ground"
HEIGHT_HANDLE = "/world/gizmo_height"
HANDLE_PX = 96.0
REACH_M = 1_000.0
"""Maximum distance from the vehicle to which the preview can be dragged [m]; near the horizon a pixel covers
as much.
"""
AWAY_M = 0.35
LABEL_BELOW_M = 0.14

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
    turns: bool
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


def drag_of(message: MovedMessage | ReleasedMessage) -> Drag | None:
    """The drag in a browser's message; None if it is for another handle or the position is not valid."""
    if message.name not in (GROUND_HANDLE, HEIGHT_HANDLE):
        return None
    turns = message.name == GROUND_HANDLE
    if isinstance(message, ReleasedMessage):
        return Drag(None, None, turns)
    q = normalized(message.wxyz)
    if q is None or not all(map(math.isfinite, message.position)):
        return None
    return Drag(message.position, q, turns)


def dragged(preview: Preview, drag: Drag, origin_enu_m: Vector3, vehicle_enu_m: Vector3) -> Preview | None:
    """The preview after a drag; None if it was dragged too far.

    Args:
        origin_enu_m: origin of the vehicle's local frame.
        vehicle_enu_m: position of the vehicle.
    """
    if drag.position_enu_m is None or drag.q_enu is None:
        return preview
    if math.dist(drag.position_enu_m, vehicle_enu_m) > REACH_M:
        return None
    east, north, up = (p - o for p, o in zip(drag.position_enu_m, origin_enu_m, strict=True))
    yaw_ned_rad = preview.yaw_ned_rad
    if drag.turns and yaw_ned_rad is not None:
        yaw_ned_rad = math.remainder(yaw_enu_from_ned(yaw_from_q(drag.q_enu)), 2 * math.pi)
    return Preview((north, east, -up), yaw_ned_rad, preview.handles, preview.serial)


def drag_label(preview: Preview, position_enu_m: Vector3, vehicle_enu_m: Vector3, ground_z_m: float) -> str:
    """Distance, height above home and yaw."""
    parts = [
        f"{math.dist(position_enu_m, vehicle_enu_m):.1f} m",
        f"height {height_text(position_enu_m[2] - ground_z_m)}",
    ]
    if preview.yaw_ned_rad is not None:
        parts.append(f"{round(math.degrees(preview.yaw_ned_rad)) % 360:03d}°")
    return " · ".join(parts)


class PreviewNode:
    """The preview in one browser's scene; it exists only while the page shows a preview."""

    def __init__(self, client: viser.ClientHandle, palette: Palette, shapes: Shapes) -> None:
        self._scene = client.scene
        self._root = self._scene.add_frame("/world/preview", show_axes=False)
        self._ghost = self._lines("/ghost", shapes.ghost, palette, 1.2)
        self._way = self._lines("/way", shapes.dots, palette, 1.4)
        self.label = Label(client, "/world/preview/label", palette.target, side="below")
        self.label.text = "not sent"
        self._handles: tuple[Any, Any] | None = None
        self._serial = -1
        self._drawn: Preview | None = None
        self._held = GROUND_HANDLE

    def remove(self) -> None:
        """Removes the preview and its handles."""
        self._remove_handles()
        self._root.remove()

    def update(
        self,
        preview: Preview,
        origin_enu_m: Vector3,
        vehicle_enu_m: Vector3,
        ground_z_m: float,
        *,
        handles: bool,
    ) -> None:
        """Moves the preview. Moves the handles only if the position was set by the page and not by a drag in
        this browser.

        Args:
            handles: whether handles can be dragged, which requires that the world of this view does not move.
        """
        east, north, up = enu_from_ned(preview.position_ned_m)
        at = (origin_enu_m[0] + east, origin_enu_m[1] + north, origin_enu_m[2] + up)
        yaw = preview.yaw_ned_rad
        q = q_from_yaw(yaw_enu_from_ned(yaw)) if yaw is not None else IDENTITY
        self._ghost.position, self._ghost.wxyz = at, q
        self.label.move((at[0], at[1], at[2] - LABEL_BELOW_M))
        self.label.note = drag_label(preview, at, vehicle_enu_m, ground_z_m)
        self._stretch(vehicle_enu_m, at)
        if not (handles and preview.handles):
            self._remove_handles()
        elif self._handles is None or preview.serial != self._serial:
            self._remove_handles()
            self._handles = self._add_handles(at, q, turns=yaw is not None)
        elif self._drawn is not None and preview != self._drawn:
            self._follow(at, q)
        self._serial, self._drawn = preview.serial, preview

    def _follow(self, at: Vector3, q: Quaternion) -> None:
        """Moves the handle that is not being dragged; the browser moves the other one."""
        assert self._handles is not None
        ground, height = self._handles
        if self._held == HEIGHT_HANDLE:
            ground.position, ground.wxyz = at, q
        else:
            height.position = at

    def held(self, turns: bool) -> None:
        """Records which handle is being dragged."""
        self._held = GROUND_HANDLE if turns else HEIGHT_HANDLE

    def _add_handles(self, at: Vector3, q: Quaternion, *, turns: bool) -> tuple[Any, Any]:
        common: dict[str, Any] = {
            "scale": HANDLE_PX,
            "fixed": True,
            "line_width": 3.0,
            "depth_test": False,
            "opacity": 0.9,
            "position": at,
        }
        ground = self._scene.add_transform_controls(
            GROUND_HANDLE, active_axes=(True, True, False), disable_rotations=not turns, wxyz=q, **common
        )
        height = self._scene.add_transform_controls(
            HEIGHT_HANDLE, active_axes=(False, False, True), disable_rotations=True, **common
        )
        return ground, height

    def _remove_handles(self) -> None:
        for handle in self._handles or ():
            handle.remove()
        self._handles = None

    def _stretch(self, start: Vector3, end: Vector3) -> None:
        length_m = math.dist(start, end)
        self._way.visible = length_m > AWAY_M
        if length_m > AWAY_M:
            self._way.position = start
            self._way.wxyz = q_along((end[0] - start[0], end[1] - start[1], end[2] - start[2]))
            self._way.scale = (length_m, 1.0, 1.0)

    def _lines(self, name: str, points: Any, palette: Palette, width_px: float) -> Any:
        return self._scene.add_line_segments(
            f"/world/preview{name}",
            points,
            lit(palette.target, palette),
            thickness=width_px,
            thickness_units="screen",
        )
