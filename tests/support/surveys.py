"""Small surveys for tests, given by north and east of a home."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from missions.geodesy import LocalOrigin
from missions.pattern_settings import PhotoCoverage, SurveyPattern
from missions.patterns.current import pattern_item
from missions.plan import Plan
from missions.values import Altitude, HomePosition, Point

HOME = HomePosition(lat_deg=47.397, lon_deg=8.545, alt_amsl_m=480.0)
ORIGIN = LocalOrigin(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)
FIELD = [(40, -100), (40, 100), (200, 100), (200, -100)]
"""North and east of the corners [m]."""


def point_at(north_m: float, east_m: float) -> Point:
    """A point by north and east of home [m]."""
    lat_deg, lon_deg, _ = ORIGIN.to_geodetic((north_m, east_m, 0.0))
    return Point(lat_deg=lat_deg, lon_deg=lon_deg)


def survey(
    corners: Sequence[tuple[float, float]],
    *,
    spacing_m: float = 12.0,
    holes: Sequence[Sequence[tuple[float, float]]] = (),
    altitude: Altitude | None = None,
    **fields: Any,
) -> SurveyPattern:
    """A survey of an area, 30 m above home."""
    return SurveyPattern(
        kind="survey",
        outer=tuple(point_at(*corner) for corner in corners),
        holes=tuple(tuple(point_at(*corner) for corner in hole) for hole in holes),
        coverage=PhotoCoverage(distance_m=30.0, spacing_m=spacing_m, trigger_m=10.0),
        altitude=altitude or Altitude(value_m=30.0, reference="home"),
        **fields,
    )


def survey_plan(pattern: SurveyPattern) -> Plan:
    """A plan with this survey.

    Raises:
        PlanError: the survey has no path.
    """
    return Plan(planned_home=HOME, items=(pattern_item(pattern),))
