"""Parallel lines that cover an area, and the order in which they are flown.

The area is cut into bands as wide as the spacing. In each band, every connected piece of the area gets a line
along the band's middle as long as the piece, so that the strips cover all of the area, whatever its shape.
With A the area, s the spacing and P the length of all edges, the lines' length L is bounded on both sides:
A / s ≤ L ≤ A / s + P (where a piece does not fill its band, an edge runs through it).
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
from missions.patterns.ground import East, heading_deg

MAX_LINES = 1500
MAX_ANGLES = 12
TURN_M = 20.0
"""What a turn counts for in metres when angles are compared: about the way lost by slowing down for it."""
_SLIVER_M2 = 1e-6

Line = tuple[East, East]


@dataclass(frozen=True, slots=True)
class Sweep:
    """Lines in the order and direction they are flown."""

    lines: tuple[Line, ...]
    heading_deg: float
    """Of the lines, clockwise from north, 0 to 180."""

    @property
    def length_m(self) -> float:
        """Of all lines, without the ways between them [m]."""
        return sum(math.dist(start, end) for start, end in self.lines)


def sweep(area: Polygon, spacing_m: float, heading: float | None, start: East | None = None) -> Sweep:
    """Lines over an area; without a heading, the one with the shortest way is found.

    Raises:
        PlanError: There would be too many lines.
    """
    angles = [heading % 180.0] if heading is not None else list(_candidates(area))
    best: Sweep | None = None
    for angle in angles:
        found = Sweep(tuple(_lines(area, spacing_m, angle)), angle)
        if best is None or _cost(found, spacing_m) < _cost(best, spacing_m):
            best = found
    assert best is not None
    return Sweep(tuple(_ordered(best.lines, start)), best.heading_deg)


def _cost(found: Sweep, spacing_m: float) -> float:
    """The whole way, about: the lines, and from each one to the next [m]."""
    return found.length_m + (spacing_m + TURN_M) * len(found.lines)


def _candidates(area: Polygon) -> Iterator[float]:
    """Along the edges of the convex hull: a convex area is narrowest across one of them."""
    ring = area.convex_hull.exterior  # type: ignore[attr-defined]
    corners: list[East] = [(float(x), float(y)) for x, y in ring.coords]
    edges = sorted(pairwise(corners), key=_shortness)
    seen: set[int] = set()
    for a, b in edges:
        angle = heading_deg(a, b) % 180.0
        if round(angle) not in seen:
            seen.add(round(angle))
            yield angle
        if len(seen) >= MAX_ANGLES:
            return


def _shortness(edge: tuple[East, East]) -> float:
    return -math.dist(*edge)


def _lines(area: Polygon, spacing_m: float, angle: float) -> Iterator[Line]:
    """The lines of one heading, from one side of the area to the other."""
    turn_deg = angle - 90.0
    turned = affinity.rotate(area, turn_deg, origin=(0.0, 0.0))
    x_min, y_min, x_max, y_max = turned.bounds
    count = max(1, math.ceil((y_max - y_min) / spacing_m - 1e-9))
    if count > MAX_LINES:
        fix = "Fly higher, reduce the overlap, or split the area."
        raise PlanError("the lines", f"there would be {count} of them, the maximum is {MAX_LINES}", fix)
    first = (y_min + y_max) / 2.0 - (count - 1) * spacing_m / 2.0
    back = math.radians(-turn_deg)
    cos, sin = math.cos(back), math.sin(back)
    total = 0
    for number in range(count):
        y = first + number * spacing_m
        band = shapely.box(x_min - 1.0, y - spacing_m / 2.0, x_max + 1.0, y + spacing_m / 2.0)
        for low, high in _extents(turned.intersection(band)):
            total += 1
            if total > MAX_LINES:
                fix = "Fly higher, reduce the overlap, or split the area."
                raise PlanError("the lines", f"there are more than {MAX_LINES} of them", fix)
            yield (
                (low * cos - y * sin, low * sin + y * cos),
                (high * cos - y * sin, high * sin + y * cos),
            )


def _extents(pieces: BaseGeometry) -> list[tuple[float, float]]:
    """From where to where the pieces reach in x; pieces side by side are one."""
    parts = [part for part in shapely.get_parts(pieces) if part.area > _SLIVER_M2]
    found: list[tuple[float, float]] = []
    for low, high in sorted((part.bounds[0], part.bounds[2]) for part in parts):
        if found and low <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], high))
        else:
            found.append((low, high))
    return found


def _ordered(lines: tuple[Line, ...], start: East | None) -> Iterator[Line]:
    """Always on to the nearest end of a line that is left: back and forth where nothing is in the way."""
    ends = np.array(lines, dtype=np.float64)
    """(N, 2, 2): line, end, east and north."""
    here = np.array(lines[0][0] if start is None else start)
    for _ in lines:
        distances = np.hypot(*np.moveaxis(ends - here, 2, 0))
        index, end = np.unravel_index(int(distances.argmin()), distances.shape)
        line = lines[index] if end == 0 else (lines[index][1], lines[index][0])
        ends[index] = np.inf
        here = np.array(line[1])
        yield line
