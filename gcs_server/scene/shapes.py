"""All shapes of the scene, computed once per process."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_server.scene import model, strokes
from gcs_server.scene.model import Mesh, Points


@dataclass(frozen=True, slots=True)
class Shapes:
    """The shapes, ready to be sent."""

    shell: Mesh = field(default_factory=model.shell)
    dark_parts: Mesh = field(default_factory=model.dark_parts)
    front_mark: Mesh = field(default_factory=model.front_mark)
    rotor_discs: Mesh = field(default_factory=model.rotor_discs)
    rotor_rims: Points = field(default_factory=model.rotor_rims)
    blades: Mesh = field(default_factory=model.blade_pair)
    camera: Mesh = field(default_factory=model.camera_ball)
    lens: Points = field(default_factory=model.camera_lens_ring)
    frustum: tuple[Mesh, Points] = field(default_factory=model.frustum)
    vehicle_outline: Points = field(default_factory=model.vehicle_outline)
    dots: Points = field(default_factory=model.dots)
    home: Points = field(default_factory=strokes.home_sign)
    shadow: NDArray[np.uint8] = field(default_factory=lambda: _soft_shadow(64))


@functools.cache
def shapes() -> Shapes:
    """The shapes, which all views share."""
    return Shapes()


def _soft_shadow(size: int) -> NDArray[np.uint8]:
    """(size, size, 4): black, with an edge that fades out."""
    axis = np.linspace(-1, 1, size)
    radius = np.hypot(axis[:, None], axis[None, :])
    image = np.zeros((size, size, 4), np.uint8)
    image[..., 3] = (255 * np.clip(1 - radius, 0, 1) ** 1.3).astype(np.uint8)
    return image
