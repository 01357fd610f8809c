"""One vehicle in one browser's scene: its nodes, and the changes that are sent at each step."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import viser

from gcs_server.scene.labels import Label
from gcs_server.scene.model import GIMBAL_POSITION_M, ROTORS_FLU_M, Points, q_along, rotor_quaternions
from gcs_server.scene.moving_node import MovingNode
from gcs_server.scene.palette import Palette, tone_corrected
from gcs_server.scene.pose import Target, VehiclePose, upright_lines
from gcs_server.scene.shapes import Shapes
from gcs_server.scene.smoothing import Smoother, Trail
from gcs_server.scene.terrain import TerrainShape
from gcs_server.scene.texts import altitude_text
from missions.frames import IDENTITY, Quaternion, Vector3, multiply, q_from_yaw

FRUSTUM_MIN_M = 0.9
FRUSTUM_MAX_M = 2.6
TRAIL_PERIOD_S = 1.0 / 15.0
LABEL_ABOVE_M = 0.36
LABEL_BELOW_M = 0.12
GROUND_GAP_M = 0.012
"""Marks on the ground are drawn this much above the ground to avoid flicker [m]."""
MIN_LINE_M = 0.35
"""Distance to the target below which no line to the target is drawn [m]."""


class VehicleNode:
    """The nodes of one vehicle.

    Args:
        index: index in the fleet, which selects the identity colour.
    """

    _count = 0

    def __init__(self, client: viser.ClientHandle, index: int, palette: Palette, shapes: Shapes) -> None:
        VehicleNode._count += 1
        self._root = f"/world/vehicle_{VehicleNode._count}"
        self._client, self._scene = client, client.scene
        self._palette, self._shapes = palette, shapes
        self._colour = palette.vehicle_colour(index)
        self._rgb = tone_corrected(self._colour, palette)
        self._drawn_pose: VehiclePose | None = None
        self._drawn_terrain: TerrainShape | None = None
        self._angles: tuple[float, ...] = ()
        self._trail_version = -1
        self._next_trail_s = 0.0
        self._recent_end: Vector3 | None = None
        self._recent_lines: Points | None = None
        self._last_recent_point: Vector3 | None = None
        """The newest trail point in `_recent_lines`."""
        self._frustum_m = 0.0
        self._add_airframe()
        self._add_gimbal()
        self._add_ground_marks()
        self._add_target()
        self._measured_points: Any = None
        """Node of the measured points; created with the first points, because most vehicles have no
        sensor."""
        self._sealed: Any = None
        self._lines("/tail", np.zeros((1, 2, 3), np.float32), self._colour, 2.6)
        self._recent_node = self._moving_node("/tail")
        self._label = Label(client, f"{self._root}/place/label", self._colour)
        self._label.move((0.0, 0.0, LABEL_ABOVE_M))
        self._hidden: bool | None = None

    def remove(self) -> None:
        """Removes all nodes."""
        self._root_node.remove()

    @property
    def labels(self) -> list[Label]:
        """The vehicle's labels."""
        return [self._label, self._target_label]

    def update(
        self,
        smoother: Smoother,
        trail: Trail,
        now_s: float,
        *,
        hidden: bool,
        terrain: TerrainShape | None = None,
    ) -> None:
        """Sends the changes since the last call.

        Args:
            terrain: the known ground, on which marks are drawn; None: level ground at the vehicle's home.
            hidden: hides airframe, label and frustum, because the view looks through the vehicle's camera.
        """
        pose = smoother.pose
        if pose is None:
            return
        last = self._drawn_pose
        if terrain is not self._drawn_terrain:  # the marks on the ground are drawn again
            last, self._drawn_terrain = None, terrain
        if pose is last and hidden == self._hidden:  # this vehicle was not updated in this step
            return
        if hidden != self._hidden:
            self._hidden = hidden
            self._body.visible = not hidden
            self._label.visible = not hidden
        if last is None or pose.position_enu_m != last.position_enu_m or pose.q_enu_flu != last.q_enu_flu:
            self._move(pose, last, terrain)
        if pose.motors is not None and smoother.rotor_angles_rad != self._angles:
            self._angles = smoother.rotor_angles_rad
            self._blades_node.set_property("batched_wxyzs", rotor_quaternions(self._angles))
        self._point_gimbal(pose, last)
        if last is None or pose.lost != last.lost:
            self._show_lost(pose.lost)
        if last is None or pose.home_enu_m != last.home_enu_m:
            self._home.visible = pose.home_enu_m is not None
            if pose.home_enu_m is not None:
                self._home.position = _above_ground(pose.home_enu_m)
                self._home.wxyz = IDENTITY if terrain is None else terrain.tilt_at(*pose.home_enu_m[:2])
        self._show_target(pose, last)
        if last is None or pose.measured_points_enu_m != last.measured_points_enu_m:
            self._show_measured_points(pose)
        self._label.text, self._label.note = pose.label, pose.note
        if now_s >= self._next_trail_s:
            self._next_trail_s = now_s + TRAIL_PERIOD_S
            self._draw_trail(trail, pose.position_enu_m)
        self._drawn_pose = pose

    def _move(self, pose: VehiclePose, last: VehiclePose | None, terrain: TerrainShape | None) -> None:
        x, y, z = pose.position_enu_m
        if last is None or pose.q_enu_flu != last.q_enu_flu:
            self._body_node.turn(pose.q_enu_flu)
        if last is not None and pose.position_enu_m == last.position_enu_m:
            return
        self._position_node.place(pose.position_enu_m)
        known_z_m = None if terrain is None else terrain.z_at(x, y)
        ground_z_m = pose.ground_z_m if known_z_m is None else known_z_m
        height_m = z - ground_z_m
        self._ground_node.place((x, y, ground_z_m))
        if terrain is not None:
            self._ground_node.turn(terrain.tilt_at(x, y))
        self._height_line_node.scale(1.0, 1.0, max(0.001, height_m))
        self._height_line.visible = height_m > 0.3

    def _point_gimbal(self, pose: VehiclePose, last: VehiclePose | None) -> None:
        q = pose.q_body_camera
        if last is None or (q is None) != (last.q_body_camera is None):
            self._gimbal.visible = q is not None
        if q is None:
            return
        if last is None or q != last.q_body_camera:
            self._gimbal_node.turn(q)
        depth_m = frustum_depth_m(pose, q)
        if abs(depth_m - self._frustum_m) > 0.02:
            self._frustum_m = depth_m
            self._frustum.scale = depth_m

    def _show_lost(self, lost: bool) -> None:
        """Draws a lost vehicle as grey wireframe, so that it does not look connected."""
        p = self._palette
        grey = p.lost
        self._shell.color, self._shell.opacity = (grey, 0.22) if lost else (p.body, None)
        self._dark_parts.color, self._dark_parts.opacity = (grey, 0.22) if lost else (p.dark_part, None)
        colour = grey if lost else self._rgb
        self._front_mark.color, self._front_mark.opacity = colour, 0.5 if lost else None
        self._rims.colors = np.asarray(colour, np.uint8)
        self._discs.visible = self._frustum.visible = not lost
        self._blades.visible = not lost
        self._label.colour = self._palette.text_3 if lost else self._colour

    def _show_target(self, pose: VehiclePose, last: VehiclePose | None) -> None:
        target = pose.target
        if last is None or (target is None) != (last.target is None):
            self._target.visible = self._target_line.visible = target is not None
            self._target_label.visible = target is not None
        if target is None:
            return
        if last is None or target != last.target:
            yaw = target.yaw_enu_rad
            self._target_node.place(target.position_enu_m)
            self._target_node.turn(q_from_yaw(yaw) if yaw is not None else IDENTITY)
            x, y, z = target.position_enu_m
            self._target_label.move((x, y, z - LABEL_BELOW_M))
        self._draw_target_line(pose, target)
        altitude = altitude_text(
            target.position_enu_m[2] - pose.ground_z_m, above_home=pose.home_enu_m is not None
        )
        self._target_label.text = "velocity setpoint" if target.is_velocity else f"target {altitude}"

    def _show_measured_points(self, pose: VehiclePose) -> None:
        if self._measured_points is None and pose.measured_points_enu_m:
            self._measured_points = self._lines(
                "/measured_points", upright_lines(pose.measured_points_enu_m), self._palette.text_2, 3.0
            )
        elif self._measured_points is not None:
            self._measured_points.visible = bool(pose.measured_points_enu_m)
            if pose.measured_points_enu_m:
                self._measured_points.points = upright_lines(pose.measured_points_enu_m)

    def _draw_target_line(self, pose: VehiclePose, target: Target) -> None:
        a, b = pose.position_enu_m, target.position_enu_m
        offset = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
        length_m = math.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
        has_line = length_m > MIN_LINE_M
        self._target_line.visible = has_line
        self._target_label.visible = has_line
        if has_line:
            self._target_line_node.place(a)
            self._target_line_node.turn(q_along(offset))
            self._target_line_node.scale(length_m, 1.0, 1.0)

    def _draw_trail(self, trail: Trail, vehicle_enu_m: Vector3) -> None:
        if trail.version != self._trail_version:
            self._trail_version = trail.version
            if self._sealed is not None:
                self._sealed.remove()
                self._sealed = None
            if len(trail.sealed) > 1:
                self._sealed = self._lines("/trail", _line_segments(trail.sealed), self._colour, 2.6)
            self._recent_end = None
        if trail.recent and vehicle_enu_m != self._recent_end:
            self._recent_end = vehicle_enu_m
            self._recent_node.set_property("points", self._recent_trail_lines(trail.recent, vehicle_enu_m))

    def _recent_trail_lines(self, recent: list[Vector3], vehicle_enu_m: Vector3) -> Points:
        """The lines between the newest points and to the vehicle; most calls change only the last line."""
        if (
            self._recent_lines is None
            or len(self._recent_lines) != len(recent)
            or self._last_recent_point != recent[-1]
        ):
            self._recent_lines = _line_segments([*recent, vehicle_enu_m])
            self._last_recent_point = recent[-1]
        lines = self._recent_lines.copy()
        lines[-1, 1] = vehicle_enu_m
        return lines

    def _add_airframe(self) -> None:
        s, p = self._shapes, self._palette
        self._root_node = self._scene.add_frame(self._root, show_axes=False)
        self._scene.add_frame(f"{self._root}/place", show_axes=False)
        self._position_node = self._moving_node("/place")
        self._body = self._scene.add_frame(f"{self._root}/place/body", show_axes=False)
        self._body_node = self._moving_node("/place/body")
        self._shell = self._mesh("/place/body/shell", s.shell, p.body)
        self._dark_parts = self._mesh("/place/body/dark", s.dark_parts, p.dark_part)
        self._front_mark = self._mesh("/place/body/mark", s.front_mark, self._rgb, side="double")
        self._discs = self._mesh(
            "/place/body/discs", s.rotor_discs, self._rgb, opacity=p.disc_opacity, side="double"
        )
        self._rims = self._lines("/place/body/rims", s.rotor_rims, self._colour, 1.5)
        self._blades = self._scene.add_batched_meshes_simple(
            f"{self._root}/place/body/blades",
            s.blades.vertices,
            s.blades.faces,
            batched_wxyzs=rotor_quaternions((0.3, 1.1, 2.0, 2.7)),
            batched_positions=np.asarray(ROTORS_FLU_M, np.float32),
            batched_colors=p.body,
            side="double",
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )
        self._blades_node = self._moving_node("/place/body/blades")

    def _add_gimbal(self) -> None:
        s, p = self._shapes, self._palette
        self._gimbal = self._scene.add_frame(
            f"{self._root}/place/body/gimbal", show_axes=False, position=GIMBAL_POSITION_M
        )
        self._gimbal_node = self._moving_node("/place/body/gimbal")
        self._mesh("/place/body/gimbal/camera", s.camera, p.dark_part)
        self._lines("/place/body/gimbal/lens", s.lens, p.text, 2.0)
        self._frustum = self._scene.add_frame(f"{self._root}/place/body/gimbal/sees", show_axes=False)
        volume, edges = s.frustum
        self._mesh("/place/body/gimbal/sees/volume", volume, self._rgb, opacity=0.13, side="double")
        self._lines("/place/body/gimbal/sees/edges", edges, self._colour, 1.2)

    def _add_ground_marks(self) -> None:
        p = self._palette
        self._home = self._lines("/home", self._shapes.home, p.text_2, 1.8)
        self._scene.add_frame(f"{self._root}/below", show_axes=False)
        self._ground_node = self._moving_node("/below")
        self._scene.add_image(
            f"{self._root}/below/shadow",
            self._shadow_image(),
            position=(0.0, 0.0, GROUND_GAP_M),
            render_width=1.7,
            render_height=1.7,
            format="png",
            cast_shadow=False,
            receive_shadow=False,
        )
        upright = np.asarray([[(0, 0, 0), (0, 0, 1)]], np.float32)
        self._height_line = self._lines("/below/plumb", upright, p.text_3, 1.0)
        self._height_line_node = self._moving_node("/below/plumb")

    def _add_target(self) -> None:
        p = self._palette
        self._target = self._lines("/target", self._shapes.vehicle_outline, p.target, 1.6)
        self._target_node = self._moving_node("/target")
        self._target_line = self._lines("/way", self._shapes.dots, p.target, 2.0)
        self._target_line_node = self._moving_node("/way")
        self._target_label = Label(self._client, f"{self._root}/target_label", p.target, side="below")
        self._target.visible = self._target_line.visible = False
        self._target_label.visible = False

    def _shadow_image(self) -> Any:
        image = self._shapes.shadow.copy()
        image[..., 3] = (image[..., 3] * self._palette.shadow_opacity).astype(np.uint8)
        return image

    def _moving_node(self, name: str) -> MovingNode:
        return MovingNode(self._client, self._root + name)

    def _mesh(self, name: str, mesh: Any, colour: tuple[int, int, int], **options: Any) -> Any:
        return self._scene.add_mesh_simple(
            self._root + name,
            mesh.vertices,
            mesh.faces,
            color=colour,
            cast_shadow=False,
            receive_shadow=False,
            **options,
        )

    def _lines(self, name: str, points: Points, colour: str, width_px: float) -> Any:
        return self._scene.add_line_segments(
            self._root + name,
            points,
            tone_corrected(colour, self._palette),
            thickness=width_px,
            thickness_units="screen",
        )


def frustum_depth_m(pose: VehiclePose, q_body_camera: Quaternion) -> float:
    """Depth of the frustum [m]; the frustum ends at the ground if the ground is near."""
    w, x, y, z = multiply(pose.q_enu_flu, q_body_camera)
    forward_up = 2.0 * (x * z - w * y)
    height_m = pose.position_enu_m[2] - pose.ground_z_m
    if forward_up > -0.05:
        return FRUSTUM_MAX_M
    return min(FRUSTUM_MAX_M, max(FRUSTUM_MIN_M, height_m / -forward_up))


def _line_segments(points: list[Vector3]) -> Points:
    line = np.asarray(points, np.float32)
    return np.stack([line[:-1], line[1:]], axis=1)


def _above_ground(position_m: Vector3) -> Vector3:
    return (position_m[0], position_m[1], position_m[2] + GROUND_GAP_M)
