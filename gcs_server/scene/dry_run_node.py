"""One vehicle of a dry run in a browser's scene. Corridor and path are sent once; then only the pose is
sent."""

from __future__ import annotations

from typing import Any

import viser

from gcs_server.scene.dry_runs import DryRunPath, corridor_edges, corridor_mesh, path_lines
from gcs_server.scene.labels import Label
from gcs_server.scene.model import GIMBAL_POSITION_M
from gcs_server.scene.moving_node import MovingNode
from gcs_server.scene.palette import Palette, tone_corrected
from gcs_server.scene.pose import VehiclePose
from gcs_server.scene.shapes import Shapes
from gcs_server.scene.vehicle_node import LABEL_ABOVE_M, frustum_depth_m
from missions.frames import Vector3

ROOT = "/world/dry_run"


class DryRunNode:
    """The nodes of the vehicle, in the colour of targets, so that the vehicle is not mistaken for a real one.

    Args:
        number: number of the vehicle in the dry run, from 0.
        origin_enu_m: origin of the path, in the world's ENU frame.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        number: int,
        path: DryRunPath,
        origin_enu_m: Vector3,
        palette: Palette,
        shapes: Shapes,
    ) -> None:
        self.path, self.origin_enu_m = path, origin_enu_m
        self._scene, self._colour = client.scene, tone_corrected(palette.target, palette)
        self._drawn_pose: VehiclePose | None = None
        self._root_name = root = f"{ROOT}_{number}"
        self._root = self._scene.add_frame(root, show_axes=False)
        self._scene.add_frame(f"{root}/flown", show_axes=False, position=origin_enu_m)
        self._lines("/flown/way", path_lines(path), 1.6)
        corridor, lines = corridor_mesh(path), corridor_edges(path)
        self._corridor = None if corridor is None else self._mesh("/flown/corridor", corridor, 0.16)
        if lines is not None:
            self._lines("/flown/edges", lines, 1.0)
        self._simulated_vehicle = self._scene.add_frame(f"{root}/ghost", show_axes=False)
        self._simulated_node = MovingNode(client, f"{root}/ghost")
        self._mesh("/ghost/shell", shapes.shell, 0.45)
        self._lines("/ghost/outline", shapes.vehicle_outline, 1.6)
        self._scene.add_frame(f"{root}/ghost/gimbal", show_axes=False, position=GIMBAL_POSITION_M)
        self._gimbal_node = MovingNode(client, f"{root}/ghost/gimbal")
        self._frustum = self._scene.add_frame(f"{root}/ghost/gimbal/sees", show_axes=False)
        volume, edges = shapes.frustum
        self._mesh("/ghost/gimbal/sees/volume", volume, 0.13)
        self._lines("/ghost/gimbal/sees/edges", edges, 1.2)
        self.label = Label(client, f"{root}/label", palette.target)

    def remove(self) -> None:
        """Removes all nodes."""
        self._root.remove()

    def update(self, pose: VehiclePose, *, hidden: bool, corridor_edges_only: bool) -> None:
        """Moves the simulated vehicle.

        Args:
            hidden: hides the simulated vehicle, because the view looks through its camera.
            corridor_edges_only: draws only the edges of the corridor, because the camera is inside it, behind
                the real vehicle.
        """
        self._simulated_vehicle.visible = self.label.visible = not hidden
        if self._corridor is not None:
            self._corridor.visible = not corridor_edges_only
        if pose == self._drawn_pose:
            return
        self._drawn_pose = pose
        self._simulated_node.place(pose.position_enu_m)
        self._simulated_node.turn(pose.q_enu_flu)
        if pose.q_body_camera is not None:
            self._gimbal_node.turn(pose.q_body_camera)
            self._frustum.scale = frustum_depth_m(pose, pose.q_body_camera)
        x, y, z = pose.position_enu_m
        self.label.move((x, y, z + LABEL_ABOVE_M))
        self.label.text, self.label.note = pose.label, pose.note

    def _mesh(self, name: str, mesh: Any, opacity: float) -> Any:
        return self._scene.add_mesh_simple(
            self._root_name + name,
            mesh.vertices,
            mesh.faces,
            color=self._colour,
            opacity=opacity,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _lines(self, name: str, points: Any, width_px: float) -> None:
        self._scene.add_line_segments(
            self._root_name + name, points, self._colour, thickness=width_px, thickness_units="screen"
        )
