"""The preview of a setpoint in one browser's scene, and the two handles to drag it.

The handles are viser's transform controls: the ground handle moves along the ground and turns about the
vertical, the height handle moves up and down, so that a preview cannot be tilted. `gizmo.py` reads the
browser's messages about the handles.
"""

from __future__ import annotations

import math
from typing import Any

import viser

from gcs_server.scene.frames import enu_from_ned, yaw_enu_from_ned
from gcs_server.scene.gizmo import GROUND_HANDLE, HEIGHT_HANDLE
from gcs_server.scene.labels import Label
from gcs_server.scene.model import q_along
from gcs_server.scene.palette import Palette, tone_corrected
from gcs_server.scene.pose import VehiclePose
from gcs_server.scene.shapes import Shapes
from gcs_server.scene.texts import altitude_text
from gcs_server.scene.views import Preview
from missions.frames import IDENTITY, Quaternion, Vector3, q_from_yaw

HANDLE_PX = 96.0
MIN_LINE_M = 0.35
"""Distance to the vehicle below which no line is drawn to the preview [m]."""
LABEL_BELOW_M = 0.14
"""The label is drawn this much below the preview [m]."""


def drag_label(preview: Preview, distance_m: float, altitude: str) -> str:
    """Distance to the vehicle, altitude, and yaw as text."""
    parts = [f"{distance_m:.1f} m away", altitude]
    if preview.yaw_ned_rad is not None:
        parts.append(f"yaw {round(math.degrees(preview.yaw_ned_rad)) % 360:03d}°")
    return " · ".join(parts)


class PreviewNode:
    """The preview in one browser's scene; it exists only while the page shows a preview."""

    def __init__(self, client: viser.ClientHandle, palette: Palette, shapes: Shapes) -> None:
        self._scene = client.scene
        self._root = self._scene.add_frame("/world/preview", show_axes=False)
        self._ghost = self._lines("/ghost", shapes.vehicle_outline, palette, 1.2)
        self._line = self._lines("/way", shapes.dots, palette, 1.4)
        self.label = Label(client, "/world/preview/label", palette.target, side="below")
        self.label.text = "not sent"
        self._handles: tuple[Any, Any] | None = None
        self._serial = -1
        self._drawn_preview: Preview | None = None
        self._dragged_handle = GROUND_HANDLE

    def remove(self) -> None:
        """Removes the preview and its handles."""
        self._remove_handles()
        self._root.remove()

    def update(
        self,
        preview: Preview,
        origin_enu_m: Vector3,
        vehicle: VehiclePose,
        *,
        handles: bool,
    ) -> None:
        """Moves the preview. If the page has set the position, the handles are added again there. During a
        drag, only the other handle is moved.

        Args:
            handles: whether handles can be dragged, which requires that the world of this view does not move.
        """
        east, north, up = enu_from_ned(preview.position_ned_m)
        position_enu_m = (origin_enu_m[0] + east, origin_enu_m[1] + north, origin_enu_m[2] + up)
        yaw = preview.yaw_ned_rad
        q = q_from_yaw(yaw_enu_from_ned(yaw)) if yaw is not None else IDENTITY
        self._ghost.position, self._ghost.wxyz = position_enu_m, q
        self.label.move((position_enu_m[0], position_enu_m[1], position_enu_m[2] - LABEL_BELOW_M))
        self.label.note = drag_label(
            preview,
            math.dist(position_enu_m, vehicle.position_enu_m),
            altitude_text(position_enu_m[2] - vehicle.ground_z_m, above_home=vehicle.home_enu_m is not None),
        )
        self._draw_line(vehicle.position_enu_m, position_enu_m)
        if not (handles and preview.handles):
            self._remove_handles()
        elif self._handles is None or preview.serial != self._serial:
            self._remove_handles()
            self._handles = self._add_handles(position_enu_m, q, changes_yaw=yaw is not None)
        elif self._drawn_preview is not None and preview != self._drawn_preview:
            self._move_other_handle(position_enu_m, q)
        self._serial, self._drawn_preview = preview.serial, preview

    def _move_other_handle(self, position_enu_m: Vector3, q: Quaternion) -> None:
        """Moves the handle that is not being dragged; the browser moves the dragged handle."""
        assert self._handles is not None
        ground, height = self._handles
        if self._dragged_handle == HEIGHT_HANDLE:
            ground.position, ground.wxyz = position_enu_m, q
        else:
            height.position = position_enu_m

    def set_dragged_handle(self, changes_yaw: bool) -> None:
        """Records which handle is being dragged; only the ground handle changes the yaw."""
        self._dragged_handle = GROUND_HANDLE if changes_yaw else HEIGHT_HANDLE

    def _add_handles(self, position_enu_m: Vector3, q: Quaternion, *, changes_yaw: bool) -> tuple[Any, Any]:
        common: dict[str, Any] = {
            "scale": HANDLE_PX,
            "fixed": True,
            "line_width": 3.0,
            "depth_test": False,
            "opacity": 0.9,
            "position": position_enu_m,
        }
        ground = self._scene.add_transform_controls(
            GROUND_HANDLE,
            active_axes=(True, True, False),
            disable_rotations=not changes_yaw,
            wxyz=q,
            **common,
        )
        height = self._scene.add_transform_controls(
            HEIGHT_HANDLE, active_axes=(False, False, True), disable_rotations=True, **common
        )
        return ground, height

    def _remove_handles(self) -> None:
        for handle in self._handles or ():
            handle.remove()
        self._handles = None

    def _draw_line(self, start: Vector3, end: Vector3) -> None:
        length_m = math.dist(start, end)
        self._line.visible = length_m > MIN_LINE_M
        if length_m > MIN_LINE_M:
            self._line.position = start
            self._line.wxyz = q_along((end[0] - start[0], end[1] - start[1], end[2] - start[2]))
            self._line.scale = (length_m, 1.0, 1.0)

    def _lines(self, name: str, points: Any, palette: Palette, width_px: float) -> Any:
        return self._scene.add_line_segments(
            f"/world/preview{name}",
            points,
            tone_corrected(palette.target, palette),
            thickness=width_px,
            thickness_units="screen",
        )
