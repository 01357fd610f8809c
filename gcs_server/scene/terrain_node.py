"""The ground in one browser's scene: one mesh with colours by height, and lines on it."""

from __future__ import annotations

import io

import numpy as np
import trimesh
import viser
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from gcs_server.scene.palette import Palette, rgb
from gcs_server.scene.terrain import LINES_M, NEAR_HALF_M, NEAR_LINES_M, TerrainShape
from missions.terrain.relief import FINE_HALF_M

_count = 0


class TerrainNode:
    """The nodes of the ground.

    Args:
        client: viser's handle of the browser.
        shape: the ground.
        palette: the colours of the theme.
    """

    def __init__(self, client: viser.ClientHandle, shape: TerrainShape, palette: Palette) -> None:
        global _count
        _count += 1
        self.shape = shape
        name = f"/world/terrain_{_count}"
        self._root = client.scene.add_frame(name, show_axes=False)
        mesh = shape.mesh()
        side = round(len(mesh.vertices) ** 0.5)
        colours = shape.colours(palette.terrain_low, palette.terrain_high).reshape(side, side, 3)
        middles = (np.arange(side) + 0.5) / side
        u, v = np.meshgrid(middles, middles)
        material = PBRMaterial(
            baseColorTexture=Image.fromarray(colours[::-1]), metallicFactor=0.0, roughnessFactor=1.0
        )
        visual = TextureVisuals(uv=np.stack([u, v], axis=-1).reshape(-1, 2), material=material)
        # viser's own export leaves out the normals, without which the browser draws flat triangles.
        ground = trimesh.Trimesh(
            mesh.vertices, mesh.faces, vertex_normals=shape.normals(), visual=visual, process=False
        )
        with io.BytesIO() as content:
            ground.export(content, file_type="glb", include_normals=True)
            client.scene.add_glb(
                f"{name}/ground", content.getvalue(), cast_shadow=False, receive_shadow=False
            )
        for number, (step_m, half_m, colour) in enumerate(
            ((LINES_M, FINE_HALF_M, palette.grid_section), (NEAR_LINES_M, NEAR_HALF_M, palette.grid))
        ):
            lines = shape.lines(step_m, half_m)
            if len(lines):
                client.scene.add_line_segments(
                    f"{name}/lines_{number}", lines, rgb(colour), thickness=0.9, thickness_units="screen"
                )

    def remove(self) -> None:
        """Removes the nodes."""
        self._root.remove()
