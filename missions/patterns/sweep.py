"""Parallel lines that cover an area, and the order in which they are flown.

The area is cut into bands as wide as the spacing. Each connected piece of the area in a band gets one line
along the centre of the band, as long as the piece. This covers areas of any shape. With A the area, s the
spacing and P the length of all edges, the length L of the lines is within A / s ≤ L ≤ A / s + P.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from missions.errors import PlanError
from missions.patterns.ground import EastNorth, heading_deg

MAX_LINES = 1500
MAX_HEADINGS = 12
TURN_M = 20.0
"""Length that is added for each turn when headings are compared [m]; it stands for the time to brake and
accelerate at the turn."""
_SLIVER_M2 = 1e-6

Line = tuple[EastNorth, EastNorth]


@dataclass(frozen=True, slots=True)
class Sweep:
    """Lines in flight order and direction."""

    lines: tuple[Line, ...]
    heading_deg: float
    """Direction of the lines, clockwise from north, 0 to 180."""

    @property
    def length_m(self) -> float:
        """Length of all lines, without the paths between them [m]."""
        return sum(math.dist(start, end) for start, end in self.lines)


def sweep(
    area: Polygon, spacing_m: float, given_heading_deg: float | None, start: EastNorth | None = None
) -> Sweep:
    """Lines over an area. If `given_heading_deg` is None, the heading with the shortest path is used.

    Raises:
        PlanError: There would be too many lines.
    """
    headings_deg = (
        [given_heading_deg % 180.0] if given_heading_deg is not None else list(_candidate_headings(area))
    )
    best: Sweep | None = None
    for line_heading_deg in headings_deg:
        candidate = Sweep(tuple(_lines(area, spacing_m, line_heading_deg)), line_heading_deg)
        if best is None or _cost(candidate, spacing_m) < _cost(best, spacing_m):
            best = candidate
    assert best is not None
    return Sweep(tuple(_in_flight_order(best.lines, start)), best.heading_deg)


def _cost(candidate: Sweep, spacing_m: float) -> float:
    """Approximate length of the whole path: the lines and the turns between them [m]."""
    return candidate.length_m + (spacing_m + TURN_M) * len(candidate.lines)


def _candidate_headings(area: Polygon) -> Iterator[float]:
    """Headings along the edges of the convex hull, because the smallest width of a convex area is at right
    angles to one of the edges."""
    ring = area.convex_hull.exterior  # type: ignore[attr-defined]
    corners: list[EastNorth] = [(float(x), float(y)) for x, y in ring.coords]
    edges = sorted(pairwise(corners), key=_negative_length)
    yielded: set[int] = set()
    for a, b in edges:
        line_heading_deg = heading_deg(a, b) % 180.0
        if round(line_heading_deg) not in yielded:
            yielded.add(round(line_heading_deg))
            yield line_heading_deg
        if len(yielded) >= MAX_HEADINGS:
            return


def _negative_length(edge: tuple[EastNorth, EastNorth]) -> float:
    return -math.dist(*edge)


def _lines(area: Polygon, spacing_m: float, line_heading_deg: float) -> Iterator[Line]:
    """The lines of one heading, from one side of the area to the other."""
    turn_deg = line_heading_deg - 90.0
    rotated = affinity.rotate(area, turn_deg, origin=(0.0, 0.0))
    x_min, y_min, x_max, y_max = rotated.bounds
    count = max(1, math.ceil((y_max - y_min) / spacing_m - 1e-9))
    if count > MAX_LINES:
        fix = "Fly higher, reduce the overlap, or split the area."
        reason = f"{count} lines are needed, the maximum is {MAX_LINES}"
        raise PlanError("the lines", reason, fix, field="coverage")
    first_y = (y_min + y_max) / 2.0 - (count - 1) * spacing_m / 2.0
    back_rad = math.radians(-turn_deg)
    cos, sin = math.cos(back_rad), math.sin(back_rad)
    total = 0
    for number in range(count):
        y = first_y + number * spacing_m
        band = shapely.box(x_min - 1.0, y - spacing_m / 2.0, x_max + 1.0, y + spacing_m / 2.0)
        for x_low, x_high in _extents(rotated.intersection(band)):
            total += 1
            if total > MAX_LINES:
                fix = "Fly higher, reduce the overlap, or split the area."
                reason = f"more than {MAX_LINES} lines are needed"
                raise PlanError("the lines", reason, fix, field="coverage")
            yield (
                (x_low * cos - y * sin, x_low * sin + y * cos),
                (x_high * cos - y * sin, x_high * sin + y * cos),
            )


def _extents(pieces: BaseGeometry) -> list[tuple[float, float]]:
    """The x ranges of the pieces; overlapping ranges are merged."""
    parts = [part for part in shapely.get_parts(pieces) if part.area > _SLIVER_M2]
    ranges: list[tuple[float, float]] = []
    for x_low, x_high in sorted((part.bounds[0], part.bounds[2]) for part in parts):
        if ranges and x_low <= ranges[-1][1]:
            ranges[-1] = (ranges[-1][0], max(ranges[-1][1], x_high))
        else:
            ranges.append((x_low, x_high))
    return ranges


def _in_flight_order(lines: tuple[Line, ...], start: EastNorth | None) -> Iterator[Line]:
    """The lines in flight order. The next line is always the line with the nearest end, which gives a
    back-and-forth path."""
    ends = np.array(lines, dtype=np.float64)
    """(N, 2, 2): line; end of the line; east and north."""
    position = np.array(lines[0][0] if start is None else start)
    for _ in lines:
        distances = np.hypot(*np.moveaxis(ends - position, 2, 0))
        index, end = np.unravel_index(int(distances.argmin()), distances.shape)
        line = lines[index] if end == 0 else (lines[index][1], lines[index][0])
        ends[index] = np.inf
        position = np.array(line[1])
        yield line
