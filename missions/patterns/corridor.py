"""Survey of a corridor: parallel lines along a road, river or power line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from shapely.geometry import LineString

from missions.errors import PlanError
from missions.patterns.camera import AnyCoverage
from missions.patterns.ground import EastNorth, Map
from missions.patterns.result import Pattern, photo_count, photo_path_items, within_item_limit
from missions.patterns.sweep import MAX_LINES
from missions.plan import SimpleItem
from missions.values import Altitude, Point

MIN_BEND_COSINE = -0.5
"""Cosine of the sharpest allowed bend, 120 degrees."""


def corridor(
    points: Sequence[Point],
    width_m: float,
    coverage: AnyCoverage,
    altitude: Altitude,
    turnaround_m: float = 0.0,
) -> Pattern:
    """Parallel lines over a corridor of this width, flown in alternating directions.

    The lines are evenly spaced around the centre line, at most `spacing_m` apart. In a bend of angle θ, the
    photos show the outer corner if footprint / 2 - trigger distance ≥ spacing / 2 · tan(θ / 2), with the
    footprint along the line. With the usual overlaps, bends of 30 degrees and more are possible.

    Raises:
        PlanError: The line or the width is invalid, or the line bends too sharply for the width.
    """
    if not 0.0 < width_m <= 10_000.0:
        raise PlanError(
            "field width_m",
            f"{width_m:g} m is not above 0 and at most 10,000 m",
            "Correct this value.",
            field="width_m",
        )
    flat_map = Map.centred_on(points, "the line", "points")
    center_line = flat_map.line(points)
    count = max(1, math.ceil(width_m / coverage.spacing_m - 1e-9))
    if count > MAX_LINES:
        reason = f"{count} lines are needed, the maximum is {MAX_LINES}"
        raise PlanError("the lines", reason, "Fly higher.", field="coverage")
    spacing_m = width_m / count
    items: list[SimpleItem] = []
    lines: list[tuple[Point, Point]] = []
    length_m, photos = 0.0, 0
    for number in range(count):
        path = _offset(center_line, (number - (count - 1) / 2.0) * spacing_m)
        path = path if number % 2 == 0 else path[::-1]
        items += photo_path_items(path, flat_map, altitude, coverage, turnaround_m)
        segments = list(pairwise(path))
        lines += [(flat_map.point(a), flat_map.point(b)) for a, b in segments]
        length_m += sum(math.dist(a, b) for a, b in segments)
        photos += photo_count(sum(math.dist(a, b) for a, b in segments), coverage)
    return Pattern(
        items=within_item_limit(items),
        lines=tuple(lines),
        lines_length_m=length_m,
        lower_bound_m=center_line.length * width_m / coverage.spacing_m,
        photos=photos,
        spacing_m=spacing_m,
        trigger_m=coverage.trigger_m,
        resolution_m_px=coverage.resolution_m_px,
        area_m2=center_line.length * width_m,
    )


def _offset(center_line: LineString, offset_m: float) -> list[EastNorth]:
    """A line parallel to the centre line, `offset_m` to the right of it."""
    corners = np.array(center_line.simplify(0.0).coords)
    ahead = np.diff(corners, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    right = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    before, after = np.vstack([right[:1], right]), np.vstack([right, right[-1:]])
    cos_bend = np.sum(before * after, axis=1)
    if cos_bend.min() < MIN_BEND_COSINE:
        reason = "it bends by more than 120 degrees"
        raise PlanError("the line", reason, "Split it at the bend.", field="points")
    parallel = corners + offset_m * (before + after) / (1.0 + cos_bend[:, None])
    if np.sum(np.diff(parallel, axis=0) * ahead, axis=1).min() <= 0.0:
        reason = "it is so wide that the lines on the inside of a bend would run backwards"
        fix = "Make the corridor narrower, or split it at the bend."
        raise PlanError("the corridor", reason, fix, field="width_m")
    return [(float(x), float(y)) for x, y in parallel]
