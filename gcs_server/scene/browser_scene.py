"""The scene of one browser: viser nodes are created once, afterwards only changes are sent.

Each browser has its own scene, because each has its own theme and camera. Nodes below `/world` are in the
world's ENU; the view moves `/world` itself (`views.py`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import viser

from gcs_server.faults import Isolation
from gcs_server.scene.dry_run_node import DryRunNode
from gcs_server.scene.dry_runs import pose_at
from gcs_server.scene.frames import enu_from_ned
from gcs_server.scene.labels import Label, LabelLayer, origin_text
from gcs_server.scene.moving_node import MovingNode
from gcs_server.scene.palette import PALETTES, Palette, rgb
from gcs_server.scene.pose import VehiclePose
from gcs_server.scene.preview_node import PreviewNode
from gcs_server.scene.shapes import Shapes, scale_marks, shapes
from gcs_server.scene.smoothing import Smoother
from gcs_server.scene.terrain import LINES_M, TerrainShape
from gcs_server.scene.terrain_node import TerrainNode
from gcs_server.scene.tracks import Track
from gcs_server.scene.vehicle_node import VehicleNode
from gcs_server.scene.views import CAMERAS, Mode, View, WorldPose, camera_for_handles, in_world, world_pose
from missions.frames import Vector3, yaw_from_q

GRID_STEPS_M = (1.0, 10.0, 100.0)
"""Sizes of the grid's cells [m]; a section has ten cells."""
MAX_CAMERA_HEIGHT_CELLS = 45.0
"""Camera height above the ground [cells] from which the next coarser grid is drawn."""
COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
COMPASS_DISTANCE_M = 8_000.0
"""Distance of the compass letters, so that they appear at the horizon [m]."""
MAX_CAMERA_DRIFT_M = 0.02
"""Distance from its pose in the mode `gimbal` at which the camera is put back [m]."""
CAMERA_FAR_M = 20_000.0
"""Distance up to which the camera draws [m]."""


class BrowserScene:
    """The scene of one connected browser.

    Args:
        client: viser's handle of the browser.
        view: the requested view.
        isolation: runs the drawing of each vehicle separately, so that a fault affects only one vehicle.
        previous: the browser's previous scene (in another theme); its camera pose is kept.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        view: View,
        isolation: Isolation,
        previous: BrowserScene | None = None,
    ) -> None:
        self._client = client
        self._isolation = isolation
        self._scene = client.scene
        self._palette: Palette = PALETTES[view.theme]
        self._shapes: Shapes = shapes()
        self._vehicles: dict[str, VehicleNode] = {}
        self._world_pose = previous._world_pose if previous is not None else WorldPose()
        self._mode: Mode | None = previous._mode if previous is not None else None
        self._grid_step_m = 0.0
        self._next_grid_s = 0.0
        self._last_framed_serial = previous._last_framed_serial if previous is not None else -1
        """Serial of the preview for which the camera was moved last; -1: not moved yet."""
        client.gui.configure_theme(
            control_layout="floating",
            dark_mode=view.theme == "dark",
            show_logo=False,
            show_share_button=False,
        )
        self._scene.configure_environment_map(None)
        self._scene.configure_default_lights(enabled=False)
        self.theme = view.theme
        with client.atomic():
            p, q = self._world_pose.position_m, self._world_pose.q
            self._world = self._scene.add_frame("/world", show_axes=False, position=p, wxyz=q)
            self._lights = self._scene.add_frame("/lights", show_axes=False, wxyz=q)
            self._moving_world = MovingNode(client, "/world", p, q)
            self._turning_lights = MovingNode(client, "/lights", q=q)
            self._add_lights()
            self._grid = self._add_grid()
            self._scale_marks: Any = None
            self._preview: PreviewNode | None = None
            self._dry_run: list[DryRunNode] = []
            self._terrain: TerrainNode | None = None
            self._label_layer = LabelLayer(client, view.language)
            self._compass = [self._compass_label(i, name) for i, name in enumerate(COMPASS)]

    def close(self) -> None:
        """Removes all nodes, so that the scene can be built again in another theme; the browser stays
        connected.
        """
        with self._client.atomic():
            for node in self._vehicles.values():
                node.remove()
            self._vehicles.clear()
            self._label_layer.remove()
            self._remove_preview()
            self._remove_dry_run()
            self._show_terrain(None)
            for handle in (self._scale_marks, self._grid, self._world, self._lights):
                if handle is not None:
                    handle.remove()

    def update(
        self,
        view: View,
        fleet: Mapping[str, Track],
        now_s: float,
        dry_run_start_m: Vector3 | None = None,
        origin_deg_m: Vector3 | None = None,
        terrain: TerrainShape | None = None,
    ) -> None:
        """Sends the changes since the last call.

        Args:
            fleet: vehicles by id; their order determines the colours.
            dry_run_start_m: start of the dry run that the view shows, in the world's ENU frame.
            origin_deg_m: geographic position of the world's origin; None: it is not known.
            terrain: the known ground; None: a level grid is drawn.
        """
        followed_id = view.vehicle if view.vehicle in fleet else next(iter(fleet), None)
        with self._client.atomic():
            for vehicle_id in [v for v in self._vehicles if v not in fleet]:
                self._vehicles.pop(vehicle_id).remove()
            self._show_terrain(terrain)
            self._add_vehicle(fleet, followed_id)
            simulated_pose = self._show_dry_run(view, dry_run_start_m)
            for vehicle_id, node in self._vehicles.items():
                track = fleet[vehicle_id]
                if track.smoother.pose is None:
                    continue
                self._isolation.run(
                    f"drawing vehicle {vehicle_id}",
                    node.update,
                    track.smoother,
                    track.trail,
                    now_s,
                    hidden=view.mode == "gimbal" and vehicle_id == followed_id and simulated_pose is None,
                    terrain=terrain,
                )
            self._update_camera(
                view, fleet[followed_id].smoother if followed_id is not None else None, simulated_pose
            )
            self._show_preview(view, fleet[followed_id] if followed_id is not None else None)
            if now_s >= self._next_grid_s:
                self._next_grid_s = now_s + 0.5
                self._choose_grid_cells()
                self._show_scale_marks(view.mode)
            if self._label_layer.is_due(now_s):
                origin = origin_text(origin_deg_m)
                self._label_layer.update(
                    self._labels(), mode=view.mode, scale=self._scale_text, origin=origin
                )

    def _labels(self) -> list[Label]:
        preview = [] if self._preview is None else [self._preview.label]
        return [
            *self._compass,
            *(label for node in self._vehicles.values() for label in node.labels),
            *preview,
            *(node.label for node in self._dry_run),
        ]

    def _add_vehicle(self, fleet: Mapping[str, Track], followed_id: str | None) -> None:
        """Creates the nodes of one vehicle that has none yet; the followed vehicle is the first. Creating the
        nodes of a whole fleet at once would stop all views for seconds: one vehicle takes 24 ms on a slow
        machine.
        """
        missing_ids = [v for v in fleet if v not in self._vehicles and fleet[v].smoother.pose is not None]
        if missing_ids:
            new_id = followed_id if followed_id in missing_ids else missing_ids[0]
            self._vehicles[new_id] = VehicleNode(
                self._client, list(fleet).index(new_id), self._palette, self._shapes
            )

    def set_dragged_handle(self, *, changes_yaw: bool) -> None:
        """Records that one of the preview's handles is being dragged in this browser."""
        if self._preview is not None:
            self._preview.set_dragged_handle(changes_yaw)

    def _show_preview(self, view: View, track: Track | None) -> None:
        """Draws the preview; without a preview nothing is created or sent."""
        pose = track.smoother.pose if track is not None else None
        origin = track.local_origin_enu_m if track is not None else None
        if view.preview is None or pose is None or origin is None or pose.lost:
            self._remove_preview()
            return
        if self._preview is None:
            self._preview = PreviewNode(self._client, self._palette, self._shapes)
        world_is_fixed = view.mode == "free"  # in the other modes the world moves during a drag
        position_enu_m = enu_from_ned(view.preview.position_ned_m)
        if not world_is_fixed:
            self._last_framed_serial = -1
        elif view.preview.handles and view.preview.serial != self._last_framed_serial:
            self._last_framed_serial = view.preview.serial
            self._move_camera_to_handles(_sum(origin, position_enu_m), pose.position_enu_m)
        self._preview.update(view.preview, origin, pose, handles=world_is_fixed)

    def _show_dry_run(self, view: View, start_m: Vector3 | None) -> VehiclePose | None:
        """Draws paths and vehicles of the dry run if the page shows one.

        Returns:
            The pose of the first simulated vehicle, if the camera follows it instead of the real vehicle.
        """
        dry_run = view.dry_run
        if dry_run is None or start_m is None:
            self._remove_dry_run()
            return None
        nodes = self._dry_run
        if not nodes or nodes[0].path is not dry_run.paths[0] or nodes[0].origin_enu_m != start_m:
            self._remove_dry_run()
            nodes += [
                DryRunNode(self._client, number, path, start_m, self._palette, self._shapes)
                for number, path in enumerate(dry_run.paths)
            ]
        poses = [pose_at(node.path, dry_run.t_s or 0.0, start_m) for node in nodes]
        for node, pose in zip(nodes, poses, strict=True):
            camera_is_inside = dry_run.follow and view.mode == "gimbal" and node is nodes[0]
            node.update(
                pose, hidden=dry_run.t_s is None or camera_is_inside, corridor_edges_only=dry_run.t_s is None
            )
        return poses[0] if dry_run.follow and dry_run.t_s is not None else None

    def _show_terrain(self, shape: TerrainShape | None) -> None:
        """Draws the known ground in place of the level grid."""
        if self._terrain is not None and self._terrain.shape is not shape:
            self._terrain.remove()
            self._terrain = None
        if self._terrain is None and shape is not None:
            self._terrain = TerrainNode(self._client, shape, self._palette)
        if self._grid.visible != (shape is None):
            self._grid.visible = shape is None

    def _remove_dry_run(self) -> None:
        for node in self._dry_run:
            node.remove()
        self._dry_run.clear()

    def _move_camera_to_handles(self, handles_m: Vector3, vehicle_m: Vector3) -> None:
        """Moves the camera so that it shows the handles that a page has moved; keeps its direction."""
        camera = self._client.camera
        position, look_at = camera_for_handles(
            _triple(camera.position), _triple(camera.look_at), handles_m, vehicle_m
        )
        if position != _triple(camera.position):
            self._set_camera(position, look_at, CAMERAS["free"].fov_rad)

    def _remove_preview(self) -> None:
        if self._preview is not None:
            self._preview.remove()
            self._preview = None

    @property
    def _scale_text(self) -> str:
        if self._terrain is None:
            return f"grid {self._grid_step_m:.0f} m · {self._grid_step_m * 10:.0f} m"
        note = self._terrain.shape.terrain.note
        return f"terrain · lines {LINES_M:.0f} m{' · ' if note else ''}{note}"

    def _update_camera(
        self, view: View, smoother: Smoother | None, simulated_pose: VehiclePose | None
    ) -> None:
        pose = smoother.pose if smoother is not None else None
        heading_enu_rad = smoother.heading_enu_rad if smoother is not None else 0.0
        if simulated_pose is not None:
            pose, heading_enu_rad = simulated_pose, yaw_from_q(simulated_pose.q_enu_flu)
        world = world_pose(view.mode, pose, heading_enu_rad)
        if view.mode != self._mode:
            self._start_mode(view.mode, world, pose)
        elif view.mode == "gimbal":
            self._restore_gimbal_camera()
        if world != self._world_pose:
            self._moving_world.place(world.position_m)
            self._moving_world.turn(world.q)
            self._turning_lights.turn(world.q)
            self._world_pose = world

    def _start_mode(self, mode: Mode, world: WorldPose, pose: VehiclePose | None) -> None:
        camera_pose, camera = CAMERAS[mode], self._client.camera
        position, look_at = camera_pose.position_m, camera_pose.look_at_m
        if mode == "free" and self._mode is not None:
            # The camera pose is kept; only the world moves back.
            position = in_world(self._world_pose, _triple(camera.position))
            look_at = in_world(self._world_pose, _triple(camera.look_at))
        elif mode == "free" and pose is not None:
            position = _sum(camera_pose.position_m, pose.position_enu_m)
            look_at = pose.position_enu_m
        self._mode = mode
        self._set_camera(position, look_at, camera_pose.fov_rad)

    def _set_camera(self, position: Vector3, look_at: Vector3, fov_rad: float) -> None:
        camera = self._client.camera
        camera.up_direction = (0.0, 0.0, 1.0)
        camera.position = position
        camera.look_at = look_at
        camera.fov = fov_rad
        camera.near, camera.far = 0.05, CAMERA_FAR_M

    def _restore_gimbal_camera(self) -> None:
        camera_pose, camera = CAMERAS["gimbal"], self._client.camera
        look_at = _triple(camera.look_at)
        view_direction = _difference(look_at, _triple(camera.position))
        drift_m = math.dist(_triple(camera.position), camera_pose.position_m)
        if drift_m > MAX_CAMERA_DRIFT_M or math.hypot(view_direction[1], view_direction[2]) > 0.01 * max(
            0.1, view_direction[0]
        ):
            self._set_camera(camera_pose.position_m, camera_pose.look_at_m, camera_pose.fov_rad)

    def _choose_grid_cells(self) -> None:
        """Chooses the grid's cell size: finer near the ground, coarser from above."""
        camera = self._client.camera
        height_m = abs(in_world(self._world_pose, _triple(camera.position))[2])
        step_m = next(
            (s for s in GRID_STEPS_M[:-1] if height_m < MAX_CAMERA_HEIGHT_CELLS * s), GRID_STEPS_M[-1]
        )
        if step_m == self._grid_step_m:
            return
        self._grid_step_m = step_m
        self._grid.cell_size, self._grid.section_size = step_m, step_m * 10
        self._grid.fade_distance = step_m * 90
        if self._scale_marks is not None:
            self._scale_marks.remove()
        self._scale_marks = self._scene.add_line_segments(
            "/world/marks",
            scale_marks(step_m * 10),
            rgb(self._palette.text_3),
            thickness=1.2,
            thickness_units="screen",
            position=(0.0, 0.0, 0.004 * step_m),
        )

    def _show_scale_marks(self, mode: Mode) -> None:
        """Shows the numbers on the ground only from above, because they cannot be read from a low camera
        behind a vehicle."""
        is_readable = mode in ("free", "top") and self._terrain is None
        if self._scale_marks.visible != is_readable:
            self._scale_marks.visible = is_readable

    def _compass_label(self, eighth: int, name: str) -> Label:
        label = Label(self._client, f"/world/compass_{name}", self._palette.text_3, side="sign")
        bearing_rad = eighth * math.pi / 4
        label.move(
            (math.sin(bearing_rad) * COMPASS_DISTANCE_M, math.cos(bearing_rad) * COMPASS_DISTANCE_M, 0.0)
        )
        label.text = name
        return label

    def _add_grid(self) -> Any:
        return self._scene.add_grid(
            "/world/ground",
            infinite_grid=True,
            cell_color=rgb(self._palette.grid),
            section_color=rgb(self._palette.grid_section),
            cell_thickness=0.9,
            section_thickness=1.3,
            cell_size=1.0,
            section_size=10.0,
            fade_distance=90.0,
            fade_strength=1.6,
            shadow_opacity=0.0,
        )

    def _add_lights(self) -> None:
        dark = self._palette.theme == "dark"
        self._scene.add_light_hemisphere(
            "/lights/sky",
            sky_color=(255, 255, 255),
            ground_color=(70, 84, 96) if dark else (170, 178, 184),
            intensity=1.5 if dark else 2.6,
            position=(0.0, 0.0, 1.0),
        )
        self._scene.add_light_directional("/lights/sun", intensity=2.2, position=(-3.0, 2.0, 6.0))
        self._scene.add_light_directional("/lights/back", intensity=0.7, position=(4.0, -3.0, 2.0))


def _triple(v: np.ndarray[Any, Any] | Vector3) -> Vector3:
    return (float(v[0]), float(v[1]), float(v[2]))


def _sum(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _difference(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
