"""The settings of a pattern, by `kind`: its geometry and values, without the path that follows from them.

`patterns/` makes the items. These are separate, because a plan contains patterns, and reading a plan must not
import shapely (0.2 s).
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from missions.values import Altitude, Metres, Model, Number, Point

MAX_POINTS = 2000
"""Maximum number of corners of one area or line."""
MAX_ROUNDS = 100

Points = Annotated[tuple[Point, ...], Field(max_length=MAX_POINTS)]
Overlap = Annotated[float, Field(ge=0.0, le=0.95, allow_inf_nan=False)]
Size = Annotated[float, Field(gt=0.0, lt=1e6, allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=1, le=1_000_000)]
Rounds = Annotated[int, Field(ge=1, le=MAX_ROUNDS)]


class CameraModel(Model):
    """A camera, with the values of its data sheet."""

    sensor_width_mm: Size
    sensor_height_mm: Size
    focal_length_mm: Size
    image_width_px: Pixels
    image_height_px: Pixels
    landscape: bool = True
    """Whether the photo's width is across the line of flight, or horizontal at the sides of a structure."""


class PhotoCoverage(Model):
    """Overlaps of the photos, and distance of the camera to the surface. Without a camera, the distances
    between lines and between photos are given instead of the overlaps."""

    camera: CameraModel | None = None
    distance_m: Size
    """Distance from the camera to the ground, or to the structure's sides."""
    front_overlap: Overlap = 0.75
    """Overlap of successive photos, as a fraction of the photo."""
    side_overlap: Overlap = 0.65
    """Overlap of neighbouring lines, as a fraction of the photo."""
    spacing_m: Size | None = None
    """Distance between neighbouring lines or rounds; only without a camera."""
    trigger_m: Metres | None = None
    """Distance between two photos, 0: no photos; only without a camera."""

    @model_validator(mode="after")
    def _camera_or_distances(self) -> Self:
        given = (self.spacing_m is not None, self.trigger_m is not None)
        if self.camera is None and not all(given):
            raise ValueError("give camera, or spacing_m and trigger_m")
        if self.camera is not None and any(given):
            raise ValueError("spacing_m and trigger_m follow from the camera: leave them out")
        return self


class SurveyPattern(Model):
    """Parallel lines over an area, with photos."""

    kind: Literal["survey"]
    outer: Points
    holes: Annotated[tuple[Points, ...], Field(max_length=100)] = ()
    coverage: PhotoCoverage
    altitude: Altitude
    heading_deg: Number | None = None
    """Direction of the lines, clockwise from north; null: the direction with the shortest path."""
    turnaround_m: Metres = 0.0
    crosshatch: bool = False
    speed_m_s: Size | None = None


class CorridorPattern(Model):
    """Parallel lines along a road, a river or a power line, with photos."""

    kind: Literal["corridor"]
    points: Points
    width_m: Metres
    coverage: PhotoCoverage
    altitude: Altitude
    turnaround_m: Metres = 0.0


class PerimeterPattern(Model):
    """A path around an area, clockwise, at a distance from its edge: positive outside, negative inside."""

    kind: Literal["perimeter"]
    outer: Points
    offset_m: Number = 0.0
    altitude: Altitude
    rounds: Rounds = 1


class OrbitPattern(Model):
    """Circles around a point, as waypoints."""

    kind: Literal["orbit"]
    center: Point
    radius_m: Metres
    altitude: Altitude
    look_at: Altitude | None = None
    """The camera points at the centre at this altitude; null: the camera is not pointed."""
    rounds: Rounds = 1
    clockwise: bool = True
    start_deg: Number = 0.0
    """Bearing of the start from the centre, clockwise from north."""


class StructurePattern(Model):
    """Rounds around a structure at several heights, with photos of the sides of the structure."""

    kind: Literal["structure"]
    outline: Points
    coverage: PhotoCoverage
    base: Altitude
    """Altitude of the structure's base."""
    height_m: Metres
    """Height of the structure above its base."""
    lowest_m: Metres = 3.0
    """Height of the lowest round above the base."""
    from_top: bool = False
    gimbal_pitch_deg: Number = 0.0
    layers: Rounds | None = None
    """Number of rounds, each one spacing above the one below: from the lowest round up, or with `from_top`
    from half a spacing below the top down; null: as many as cover the height, evenly spaced."""
    entrance: Altitude | None = None
    """Altitude at which the vehicle flies to the structure and leaves it; null: the rounds begin and end the
    pattern."""


PatternDocument = Annotated[
    SurveyPattern | CorridorPattern | PerimeterPattern | OrbitPattern | StructurePattern,
    Field(discriminator="kind"),
]
"""A pattern of any kind."""
