"""The document of a pattern: its geometry and settings, by `kind`; `make` returns the items."""

from __future__ import annotations

import dataclasses
from typing import Any

from pydantic import TypeAdapter, ValidationError

from missions.bounded_json import load
from missions.errors import PlanError, field_path, from_validation
from missions.pattern_settings import (
    CorridorPattern,
    OrbitPattern,
    PatternDocument,
    PerimeterPattern,
    PhotoCoverage,
    StructurePattern,
    SurveyPattern,
)
from missions.patterns import corridor, rounds, survey
from missions.patterns.camera import AnyCoverage, Camera, Coverage, GivenCoverage
from missions.patterns.result import Pattern

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
            return survey.make(survey_of(pattern))
        case CorridorPattern():
            return corridor.corridor(
                pattern.points,
                pattern.width_m,
                coverage_of(pattern.coverage),
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


def survey_of(pattern: SurveyPattern) -> survey.Survey:
    """The settings that the survey's generator uses."""
    return survey.Survey(
        outer=pattern.outer,
        holes=pattern.holes,
        coverage=coverage_of(pattern.coverage),
        altitude=pattern.altitude,
        heading_deg=pattern.heading_deg,
        turnaround_m=pattern.turnaround_m,
        crosshatch=pattern.crosshatch,
        speed_m_s=pattern.speed_m_s,
    )


def _structure_scan(pattern: StructurePattern) -> rounds.StructureScan:
    names = [each.name for each in dataclasses.fields(rounds.StructureScan)]
    values: dict[str, Any] = {name: getattr(pattern, name) for name in names}
    values["coverage"] = coverage_of(pattern.coverage)
    return rounds.StructureScan(**values)


def coverage_of(settings: PhotoCoverage) -> AnyCoverage:
    """The values that the pattern generators use."""
    if settings.camera is None:
        return GivenCoverage(settings.distance_m, settings.spacing_m or 0.0, settings.trigger_m or 0.0)
    camera = Camera(**settings.camera.model_dump())
    return Coverage(camera, settings.distance_m, settings.front_overlap, settings.side_overlap)
