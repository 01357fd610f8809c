"""Converts a click in the 3D view to a global position: intersects its ray with the ground.

The browser converts the ray to the world's ENU frame as drawn at the time of the click. The server could not
do this, because the mode `chase` moves the world under the camera thirty times a second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from missions.frames import Vector3

REACH_M = 5_000.0
"""Clicks farther away are ignored: at that distance a pixel covers hundreds of metres, and the ground is not
flat."""

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]
Fraction = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=1.0)]


class ClickRequest(BaseModel):
    """A click, sent by the script of the view."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    eye_enu_m: tuple[Finite, Finite, Finite]
    ray_enu: tuple[Finite, Finite, Finite] = Field(
        description="Direction from the camera to the clicked point."
    )
    view_x: Fraction = Field(description="Position in the view from its left edge, 0 to 1.")
    view_y: Fraction = Field(description="Position in the view from its upper edge, 0 to 1.")


@dataclass(frozen=True, slots=True)
class SceneClick:
    """A clicked point of the ground, at the altitude of a vehicle's home."""

    view: str
    """The token of the clicked view."""
    vehicle: str
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    view_x: float
    view_y: float


def ground_point(eye_enu_m: Vector3, ray_enu: Vector3, ground_z_m: float) -> Vector3 | None:
    """Intersection of the ray with the level ground; None if the ray does not point down, the camera is below
    the ground, or the point is farther away than `REACH_M`."""
    descent = -ray_enu[2]
    height_m = eye_enu_m[2] - ground_z_m
    if descent <= 0.0 or height_m <= 0.0:
        return None
    offset_en_m = (ray_enu[0] / descent * height_m, ray_enu[1] / descent * height_m)
    if math.hypot(*offset_en_m) > REACH_M:
        return None
    return (eye_enu_m[0] + offset_en_m[0], eye_enu_m[1] + offset_en_m[1], ground_z_m)
