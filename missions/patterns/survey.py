"""Survey of an area: parallel lines with overlapping photos."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from shapely.geometry import Polygon

from missions.items import ChangeSpeed
from missions.patterns.camera import AnyCoverage
from missions.patterns.ground import Map
from missions.patterns.result import Pattern, photo_count, photo_path_items, within_item_limit
from missions.patterns.sweep import Line, Sweep, sweep
from missions.plan import SimpleItem
from missions.values import Altitude, Point


@dataclass(frozen=True, slots=True)
class Survey:
    """Settings of a survey."""

    outer: Sequence[Point]
    coverage: AnyCoverage
    altitude: Altitude
    """Altitude of the flight; `coverage.distance_m` is the camera's distance to the ground."""
    holes: Sequence[Sequence[Point]] = ()
    """Areas that need no photos; the vehicle may fly over them."""
    heading_deg: float | None = None
    """Direction of the lines, clockwise from north; None: the direction with the shortest path."""
    turnaround_m: float = 0.0
    """Straight extension before and after each line."""
    crosshatch: bool = False
    """Whether to fly a second set of lines at right angles."""
    speed_m_s: float | None = None


def lines_of(survey: Survey) -> tuple[Map, Polygon, list[Sweep]]:
    """The flat map and the area of a survey, and its lines: one sweep, or two of a crosshatch.

    Raises:
        PlanError: The area is invalid, or there would be too many lines.
    """
    corners = [*survey.outer, *(point for hole in survey.holes for point in hole)]
    flat_map = Map.centred_on(corners, "the area", "outer")
    area = flat_map.polygon_with_holes(survey.outer, survey.holes)
    sweeps: list[Sweep] = [sweep(area, survey.coverage.spacing_m, survey.heading_deg)]
    if survey.crosshatch:
        first_sweep_end = sweeps[0].lines[-1][1]
        sweeps.append(sweep(area, survey.coverage.spacing_m, sweeps[0].heading_deg + 90.0, first_sweep_end))
    return flat_map, area, sweeps


def items_of(survey: Survey, flat_map: Map, lines: Iterable[Line]) -> list[SimpleItem]:
    """The items that fly these lines, in this order and direction."""
    items: list[SimpleItem] = []
    if survey.speed_m_s is not None:
        items.append(ChangeSpeed(speed_m_s=survey.speed_m_s))
    for line in lines:
        items += photo_path_items(line, flat_map, survey.altitude, survey.coverage, survey.turnaround_m)
    return items


def make(survey: Survey) -> Pattern:
    """The items of a survey.

    Raises:
        PlanError: The area is invalid, or there would be too many lines.
    """
    flat_map, area, sweeps = lines_of(survey)
    coverage = survey.coverage
    lines = [line for each in sweeps for line in each.lines]
    return Pattern(
        items=within_item_limit(items_of(survey, flat_map, lines)),
        lines=tuple((flat_map.point(start), flat_map.point(end)) for start, end in lines),
        lines_length_m=sum(each.length_m for each in sweeps),
        lower_bound_m=len(sweeps) * area.area / coverage.spacing_m,
        photos=sum(photo_count(Sweep((line,), 0.0).length_m, coverage) for line in lines),
        spacing_m=coverage.spacing_m,
        trigger_m=coverage.trigger_m,
        resolution_m_px=coverage.resolution_m_px,
        heading_deg=sweeps[0].heading_deg,
        area_m2=area.area,
    )
