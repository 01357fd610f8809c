"""The document of a pattern: its geometry and settings, by `kind`; `make` returns the items."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from missions.bounded_json import load
from missions.errors import PlanError, field_path, from_validation
from missions.patterns import corridor, rounds, survey
from missions.patterns.camera import Camera, Coverage
from missions.patterns.ground import MAX_POINTS
from missions.patterns.result import Pattern
from missions.values import Altitude, Metres, Model, Number, Point

Points = Annotated[tuple[Point, ...], Field(max_length=MAX_POINTS)]
Overlap = Annotated[float, Field(ge=0.0, le=0.95, allow_inf_nan=False)]
Size = Annotated[float, Field(gt=0.0, lt=1e6, allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=1, le=1_000_000)]
Rounds = Annotated[int, Field(ge=1, le=rounds.MAX_ROUNDS)]


class CameraModel(Model):
    """A camera, with the values of its data sheet."""

    sensor_width_mm: Size
    sensor_height_mm: Size
    focal_length_mm: Size
    image_width_px: Pixels
    image_height_px: Pixels
    landscape: bool = True
    """Whether the photo's width is across the line of flight."""


class PhotoCoverage(Model):
    """Overlaps of the photos, and distance of the camera to the surface."""

    camera: CameraModel
    distance_m: Size
    """Distance from the camera to the ground, or to the structure's sides."""
    front_overlap: Overlap = 0.75
    """Overlap of successive photos, as a fraction of the photo."""
    side_overlap: Overlap = 0.65
    """Overlap of neighbouring lines, as a fraction of the photo."""

    def to_coverage(self) -> Coverage:
        """The values that the pattern generators use."""
        camera = Camera(**self.camera.model_dump())
        return Coverage(camera, self.distance_m, self.front_overlap, self.side_overlap)


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


PatternDocument = Annotated[
    SurveyPattern | CorridorPattern | PerimeterPattern | OrbitPattern | StructurePattern,
    Field(discriminator="kind"),
]
"""A pattern of any kind."""
_adapter: TypeAdapter[PatternDocument] = TypeAdapter(PatternDocument)


def read(data: str | bytes) -> PatternDocument:
    """Reads a pattern from JSON.

    Raises:
        PlanError: the pattern is invalid; the error names the field and the fix.
    """
    load(data)
    try:
        return _adapter.validate_json(data)
    except ValidationError as error:
        invalid, field = from_validation(error), _field_of(error)
        place = "the pattern" if field is None else f"field {field}"
        raise PlanError(place, invalid.reason, invalid.fix, field=field) from None


def _field_of(error: ValidationError) -> str | None:
    """The first invalid field, without the kind that Pydantic adds to the path."""
    return field_path(list(error.errors(include_url=False)[0]["loc"][1:])) or None


def make(pattern: PatternDocument) -> Pattern:
    """The items of a pattern.

    Raises:
        PlanError: the pattern cannot be flown: it has no area, too many lines, or an invalid size.
    """
    match pattern:
        case SurveyPattern():
            return survey.make(
                survey.Survey(
                    outer=pattern.outer,
                    holes=pattern.holes,
                    coverage=pattern.coverage.to_coverage(),
                    altitude=pattern.altitude,
                    heading_deg=pattern.heading_deg,
                    turnaround_m=pattern.turnaround_m,
                    crosshatch=pattern.crosshatch,
                    speed_m_s=pattern.speed_m_s,
                )
            )
        case CorridorPattern():
            return corridor.corridor(
                pattern.points,
                pattern.width_m,
                pattern.coverage.to_coverage(),
                pattern.altitude,
                pattern.turnaround_m,
            )
        case PerimeterPattern():
            return rounds.perimeter(pattern.outer, pattern.offset_m, pattern.altitude, pattern.rounds)
        case OrbitPattern():
            return rounds.orbit(
                pattern.center,
                pattern.radius_m,
                pattern.altitude,
                look_at=pattern.look_at,
                rounds=pattern.rounds,
                clockwise=pattern.clockwise,
                start_deg=pattern.start_deg,
            )
        case StructurePattern():
            return rounds.structure(_structure_scan(pattern))


def _structure_scan(pattern: StructurePattern) -> rounds.StructureScan:
    names = [each.name for each in dataclasses.fields(rounds.StructureScan)]
    values: dict[str, Any] = {name: getattr(pattern, name) for name in names}
    values["coverage"] = pattern.coverage.to_coverage()
    return rounds.StructureScan(**values)
