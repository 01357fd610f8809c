"""All shapes of the scene, computed once per process."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_server.scene import model
from gcs_server.scene.model import Mesh, Points, ring_segments
from missions.frames import Vector3

# Each glyph consists of polylines in a box of width 0.6 and height 1.
_GLYPHS: dict[str, str] = {
    "0": ".15,0 .45,0 .6,.2 .6,.8 .45,1 .15,1 0,.8 0,.2 .15,0",
    "1": ".1,.75 .35,1 .35,0",
    "2": "0,.8 .1,1 .5,1 .6,.8 .6,.6 0,0 .6,0",
    "3": "0,1 .6,1 .3,.58 .6,.4 .6,.15 .45,0 .1,0 0,.15",
    "4": ".45,0 .45,1 0,.3 .6,.3",
    "5": ".6,1 .05,1 0,.55 .45,.6 .6,.4 .6,.15 .45,0 0,0",
    "6": ".5,1 .1,.6 0,.3 .1,0 .5,0 .6,.2 .6,.4 .5,.55 .05,.5",
    "7": "0,1 .6,1 .2,0",
    "8": ".3,.55 0,.75 .1,1 .5,1 .6,.75 .3,.55 .6,.3 .5,0 .1,0 0,.3 .3,.55",
    "9": ".1,0 .5,.4 .6,.7 .5,1 .1,1 0,.8 0,.6 .1,.45 .55,.5",
    "m": "0,0 0,.6|0,.5 .12,.6 .25,.55 .3,.4 .3,0|.3,.4 .38,.57 .5,.6 .6,.5 .6,0",
    "k": "0,0 0,1|.5,.65 0,.3 .55,0",
    "N": "0,0 0,1 .6,0 .6,1",
    "E": ".6,0 0,0 0,1 .6,1|0,.52 .45,.52",
    "S": "0,.1 .15,0 .45,0 .6,.2 .5,.45 .1,.6 0,.8 .15,1 .45,1 .6,.9",
    "W": "0,1 .15,0 .3,.7 .45,0 .6,1",
    " ": "",
}
GLYPH_ADVANCE = 0.85
"""Distance from the start of one glyph to the start of the next."""


def text_segments(text: str, *, height_m: float, at_m: Vector3) -> Points:
    """A line of text on the ground, readable from the south, centred at a point; (N, 2, 3)."""
    width = (len(text) - 1) * GLYPH_ADVANCE + 0.6
    segments: list[tuple[tuple[float, float, float], tuple[float, float, float]]] = []
    for i, character in enumerate(text):
        for polyline in filter(None, _GLYPHS[character].split("|")):
            points = [tuple(map(float, pair.split(","))) for pair in polyline.split()]
            positioned = [(i * GLYPH_ADVANCE + x - width / 2, y - 0.5, 0.0) for x, y in points]
            segments += list(itertools.pairwise(positioned))
    lines = np.asarray(segments, np.float32).reshape(-1, 2, 3)
    return (lines * np.float32(height_m) + np.asarray(at_m, np.float32)).astype(np.float32)


def scale_marks(step_m: float) -> Points:
    """The compass and the distances from the origin: N, E, S, W and 1, 2 and 5 steps along each axis."""
    size = step_m * 0.08
    parts = [
        text_segments(letter, height_m=size * 1.6, at_m=(x * step_m * 6, y * step_m * 6, 0.0))
        for letter, x, y in (("N", 0, 1), ("E", 1, 0), ("S", 0, -1), ("W", -1, 0))
    ]
    for count in (1, 2, 5):
        distance_m = count * step_m
        label = f"{distance_m:.0f} m" if distance_m < 1000 else f"{distance_m / 1000:.0f} km"
        for x, y in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            # Beside the grid line.
            position_m = (x * distance_m + size * 2.2, y * distance_m + size * 0.9, 0.0)
            parts.append(text_segments(label, height_m=size, at_m=position_m))
    return np.concatenate(parts)


def home_sign() -> Points:
    """The sign of the home position: a house in a ring, 1.2 m wide."""
    outline = (
        (-0.26, -0.24),
        (-0.26, 0.05),
        (-0.36, 0.05),
        (0, 0.36),
        (0.36, 0.05),
        (0.26, 0.05),
        (0.26, -0.24),
    )
    points = np.asarray([(x, y, 0.0) for x, y in (*outline, outline[0])], np.float32)
    house_lines = np.stack([points[:-1], points[1:]], axis=1)
    return np.concatenate([ring_segments(0.6), house_lines * np.float32(0.95)])


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
    home: Points = field(default_factory=home_sign)
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
