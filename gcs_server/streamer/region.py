"""Where the vehicle may be: a band of heights, discs and polygons over the ground, all at once.

Places are north, east of the local origin [m]. Over the ground and in height are asked separately, since each
is braked for by itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ground = tuple[float, float]
"""North, east [m]."""
INSET_M = 0.5
"""So far inside lies the place that is flown to instead of one outside."""


@dataclass(frozen=True, slots=True)
class Disc:
    """Within a distance of a place."""

    centre: Ground
    radius_m: float
    name: str
    """For people: "the distance from home"."""


@dataclass(frozen=True, slots=True)
class Polygon:
    """Within a closed line; its last corner joins its first."""

    corners: tuple[Ground, ...]
    name: str


@dataclass(frozen=True, slots=True)
class Region:
    """The allowed space."""

    down_min_m: float = -math.inf
    """Highest: down is negative above."""
    down_max_m: float = math.inf
    discs: tuple[Disc, ...] = ()
    polygons: tuple[Polygon, ...] = ()

    @property
    def bounds_ground(self) -> bool:
        """Whether there is a place over the ground where it may not be."""
        return bool(self.discs or self.polygons)

    @property
    def bounds_height(self) -> bool:
        """Whether there is a height at which it may not be."""
        return math.isfinite(self.down_min_m) or math.isfinite(self.down_max_m)

    def ground_breach(self, p: Ground) -> str | None:
        """What keeps it from being there; None where it may be."""
        for disc in self.discs:
            if math.dist(p, disc.centre) > disc.radius_m:
                return disc.name
        return next((polygon.name for polygon in self.polygons if not _within(p, polygon.corners)), None)

    def ground_breaches(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """For many places (N, 2) at once: whether `ground_breach` has something against each."""
        outside = np.zeros(len(places), dtype=bool)
        north, east = places[:, 0], places[:, 1]
        for disc in self.discs:
            outside |= np.hypot(north - disc.centre[0], east - disc.centre[1]) > disc.radius_m
        for polygon in self.polygons:
            inside = np.zeros(len(places), dtype=bool)
            a_beyond = polygon.corners[0][1] > east
            for a, b in _edges(polygon.corners):
                b_beyond = b[1] > east
                level = np.flatnonzero(a_beyond != b_beyond)  # few: the edge's own stripe
                a_beyond = b_beyond
                if len(level):
                    crossing = (b[0] - a[0]) * (east[level] - a[1]) / (b[1] - a[1]) + a[0]
                    inside[level] ^= north[level] < crossing
            outside |= ~inside
        return outside

    def way_out_m(self, p: Ground, direction: Ground) -> float:
        """From a place inside: how far it may go along a direction (of length 1)."""
        way = math.inf
        for disc in self.discs:
            n, e = p[0] - disc.centre[0], p[1] - disc.centre[1]
            along = n * direction[0] + e * direction[1]
            inside = along**2 - (n**2 + e**2 - disc.radius_m**2)
            way = min(way, max(0.0, -along + math.sqrt(max(0.0, inside))))
        for polygon in self.polygons:
            way = min(way, _crossing(p, direction, polygon.corners))
        return way

    def edges(self, p: Ground) -> list[tuple[float, Ground]]:
        """Of each limit: how far inside its edge a place is (negative: outside), and the direction out."""
        found: list[tuple[float, Ground]] = []
        for disc in self.discs:
            out = (p[0] - disc.centre[0], p[1] - disc.centre[1])
            found.append((disc.radius_m - math.hypot(*out), _unit(out)))
        for polygon in self.polygons:
            q = _nearest_edge_point(p, polygon.corners)
            far_m = math.dist(p, q)
            if _within(p, polygon.corners):
                found.append((far_m, _unit((q[0] - p[0], q[1] - p[1]))))
            else:
                found.append((-far_m, _unit((p[0] - q[0], p[1] - q[1]))))
        return found

    def nearest(self, p: Ground) -> Ground | None:
        """A place inside, as near as can be had; None where none is found."""
        for _ in range(12):
            if self.ground_breach(p) is None:
                return p
            for disc in self.discs:
                p = _into_disc(p, disc)
            for polygon in self.polygons:
                p = _into_polygon(p, polygon.corners)
        return None

    def towards(self, here: Ground, target: Ground) -> Ground | None:
        """How far the straight way to a target leads without leaving; from outside, the way back in."""
        if self.ground_breach(here) is not None:
            return self.nearest(here)
        inside = self.nearest(target) or here
        far_m = math.dist(here, inside)
        if far_m < 1e-6:
            return inside
        direction = ((inside[0] - here[0]) / far_m, (inside[1] - here[1]) / far_m)
        way_m = self.way_out_m(here, direction)
        if far_m <= way_m:
            return inside
        stop_m = max(0.0, way_m - INSET_M)
        return (here[0] + direction[0] * stop_m, here[1] + direction[1] * stop_m)

    def height(self, down_m: float) -> float:
        """The nearest height inside."""
        return min(max(down_m, self.down_min_m), self.down_max_m)


def _edges(corners: tuple[Ground, ...]) -> zip[tuple[Ground, Ground]]:
    return zip(corners, (*corners[1:], corners[0]), strict=True)


def _within(p: Ground, corners: tuple[Ground, ...]) -> bool:
    """Even-odd rule."""
    inside = False
    for a, b in _edges(corners):
        if (a[1] > p[1]) != (b[1] > p[1]) and p[0] < (b[0] - a[0]) * (p[1] - a[1]) / (b[1] - a[1]) + a[0]:
            inside = not inside
    return inside


def _crossing(p: Ground, u: Ground, corners: tuple[Ground, ...]) -> float:
    """Distance along `u` to the first edge."""
    nearest = math.inf
    for a, b in _edges(corners):
        edge = (b[0] - a[0], b[1] - a[1])
        across = u[0] * edge[1] - u[1] * edge[0]
        if abs(across) < 1e-12:
            continue
        to_a = (a[0] - p[0], a[1] - p[1])
        along = (to_a[0] * edge[1] - to_a[1] * edge[0]) / across
        on_edge = (to_a[0] * u[1] - to_a[1] * u[0]) / across
        if along >= 0.0 and -1e-9 <= on_edge <= 1.0 + 1e-9:
            nearest = min(nearest, along)
    return nearest


def _into_disc(p: Ground, disc: Disc) -> Ground:
    far_m = math.dist(p, disc.centre)
    if far_m <= disc.radius_m:
        return p
    scale = max(disc.radius_m - INSET_M, disc.radius_m / 2) / far_m
    c = disc.centre
    return (c[0] + (p[0] - c[0]) * scale, c[1] + (p[1] - c[1]) * scale)


def _into_polygon(p: Ground, corners: tuple[Ground, ...]) -> Ground:
    if _within(p, corners):
        return p
    q = _nearest_edge_point(p, corners)
    gone_m = math.dist(p, q)
    steps = [(q[0] - p[0], q[1] - p[1])] if gone_m > 1e-9 else []
    steps += [(-1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0)]
    for inset_m in (INSET_M, INSET_M / 10, INSET_M / 1000):
        for step in steps:
            long_m = math.hypot(*step)
            tried = (q[0] + step[0] / long_m * inset_m, q[1] + step[1] / long_m * inset_m)
            if _within(tried, corners):
                return tried
    return q


def _unit(vector: Ground) -> Ground:
    size = math.hypot(*vector)
    return (0.0, 0.0) if size < 1e-9 else (vector[0] / size, vector[1] / size)


def _nearest_edge_point(p: Ground, corners: tuple[Ground, ...]) -> Ground:
    points = [_nearest_on(p, a, b) for a, b in _edges(corners)]
    return min(points, key=lambda point: math.dist(point, p))


def _nearest_on(p: Ground, a: Ground, b: Ground) -> Ground:
    edge = (b[0] - a[0], b[1] - a[1])
    long2 = edge[0] ** 2 + edge[1] ** 2
    if long2 == 0.0:
        return a
    t = min(1.0, max(0.0, ((p[0] - a[0]) * edge[0] + (p[1] - a[1]) * edge[1]) / long2))
    return (a[0] + edge[0] * t, a[1] + edge[1] * t)
