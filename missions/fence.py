"""Fence geometry: fences in global coordinates, and the allowed region in the vehicle's local NED frame.

Horizontal positions are (north, east) of the local origin [m]. Horizontal and vertical limits are separate,
because a vehicle brakes for each separately.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from missions.geodesy import LocalOrigin

NorthEast = tuple[float, float]
"""North, east [m]."""
INSET_M = 0.5
"""A position outside a fence is replaced by a position this far inside the edge [m]."""
CHECK_EVERY_M, MAX_CHECKS = 0.5, 4000
"""Spacing [m] and maximum number of the points at which a straight line is checked."""


@dataclass(frozen=True, slots=True)
class PolygonFence:
    """An inclusion polygon in global coordinates."""

    points_deg: tuple[tuple[float, float], ...]
    """Latitude, longitude of each corner, in order."""
    kind: str = "polygon"

    def to_local(self, origin: LocalOrigin, name: str) -> Polygon:
        """The same polygon in a local frame."""
        corners = [origin.to_ned(lat, lon, 0.0) for lat, lon in self.points_deg]
        return Polygon(tuple((n, e) for n, e, _ in corners), name)

    def region(self, origin: LocalOrigin, name: str) -> Region:
        """The region inside, in a local frame."""
        return Region(polygons=(self.to_local(origin, name),))


@dataclass(frozen=True, slots=True)
class CircleFence:
    """An inclusion circle in global coordinates."""

    lat_deg: float
    lon_deg: float
    radius_m: float
    kind: str = "circle"

    def to_local(self, origin: LocalOrigin, name: str) -> Circle:
        """The same circle in a local frame."""
        n, e, _ = origin.to_ned(self.lat_deg, self.lon_deg, 0.0)
        return Circle((n, e), self.radius_m, name)

    def region(self, origin: LocalOrigin, name: str) -> Region:
        """The region inside, in a local frame."""
        return Region(circles=(self.to_local(origin, name),))


Fence = PolygonFence | CircleFence


def fence_from_json(values: Mapping[str, Any]) -> Fence:
    """The fence with the fields of a JSON object."""
    if values["kind"] == "circle":
        return CircleFence(**values)
    return PolygonFence(tuple((lat, lon) for lat, lon in values["points_deg"]))


@dataclass(frozen=True, slots=True)
class Circle:
    """All positions within a radius."""

    center_ne_m: NorthEast
    radius_m: float
    name: str
    """Name in messages: "the operator's fence"."""


@dataclass(frozen=True, slots=True)
class Polygon:
    """All positions within a closed line; the last corner joins the first."""

    corners_ne_m: tuple[NorthEast, ...]
    name: str


@dataclass(frozen=True, slots=True)
class Region:
    """The allowed region: inside all circles and polygons, and between two altitudes."""

    down_min_m: float = -math.inf
    """The upper altitude limit; down is negative above the origin."""
    down_max_m: float = math.inf
    """The lower altitude limit."""
    circles: tuple[Circle, ...] = ()
    polygons: tuple[Polygon, ...] = ()

    @property
    def is_limited_horizontally(self) -> bool:
        """Whether there is any horizontal limit."""
        return bool(self.circles or self.polygons)

    @property
    def is_limited_vertically(self) -> bool:
        """Whether there is any vertical limit."""
        return math.isfinite(self.down_min_m) or math.isfinite(self.down_max_m)

    def breach(self, p: NorthEast) -> str | None:
        """The name of a limit that the position violates; None: the position is inside all limits."""
        for circle in self.circles:
            if math.dist(p, circle.center_ne_m) > circle.radius_m:
                return circle.name
        return next((polygon.name for polygon in self.polygons if not _within(p, polygon.corners_ne_m)), None)

    def are_outside(self, positions_ne_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each of the positions (N, 2) violates a limit."""
        outside = np.zeros(len(positions_ne_m), dtype=bool)
        north, east = positions_ne_m[:, 0], positions_ne_m[:, 1]
        for circle in self.circles:
            center = circle.center_ne_m
            outside |= np.hypot(north - center[0], east - center[1]) > circle.radius_m
        for polygon in self.polygons:
            inside = np.zeros(len(positions_ne_m), dtype=bool)
            a_is_east = polygon.corners_ne_m[0][1] > east
            for a, b in _edges(polygon.corners_ne_m):
                b_is_east = b[1] > east
                # edges that cross the position's east coordinate
                between = np.flatnonzero(a_is_east != b_is_east)
                a_is_east = b_is_east
                if len(between):
                    crossing = (b[0] - a[0]) * (east[between] - a[1]) / (b[1] - a[1]) + a[0]
                    inside[between] ^= north[between] < crossing
            outside |= ~inside
        return outside

    def distance_to_edge_m(self, p: NorthEast, direction: NorthEast) -> float:
        """Distance from a position inside to the first edge along a unit direction [m]."""
        distance = math.inf
        for circle in self.circles:
            n, e = p[0] - circle.center_ne_m[0], p[1] - circle.center_ne_m[1]
            along = n * direction[0] + e * direction[1]
            half_chord_2 = along**2 - (n**2 + e**2 - circle.radius_m**2)
            distance = min(distance, max(0.0, -along + math.sqrt(max(0.0, half_chord_2))))
        for polygon in self.polygons:
            distance = min(distance, _crossing_m(p, direction, polygon.corners_ne_m))
        return distance

    def edges(self, p: NorthEast) -> list[tuple[float, NorthEast]]:
        """For each limit, the distance to its edge (negative: outside) and the outward unit direction."""
        edges: list[tuple[float, NorthEast]] = []
        for circle in self.circles:
            out = (p[0] - circle.center_ne_m[0], p[1] - circle.center_ne_m[1])
            edges.append((circle.radius_m - math.hypot(*out), _unit(out)))
        for polygon in self.polygons:
            q = _nearest_edge_point(p, polygon.corners_ne_m)
            distance_m = math.dist(p, q)
            if _within(p, polygon.corners_ne_m):
                edges.append((distance_m, _unit((q[0] - p[0], q[1] - p[1]))))
            else:
                edges.append((-distance_m, _unit((p[0] - q[0], p[1] - q[1]))))
        return edges

    def position_inside(self, p: NorthEast) -> NorthEast | None:
        """A position inside all limits, near `p`; None: no such position was found."""
        for _ in range(12):
            if self.breach(p) is None:
                return p
            for circle in self.circles:
                p = _into_circle(p, circle)
            for polygon in self.polygons:
                p = _into_polygon(p, polygon.corners_ne_m)
        return None

    def last_position_inside(self, start: NorthEast, target: NorthEast) -> NorthEast | None:
        """The last position inside on the straight line from `start` to a target.

        If `start` is outside: a position inside near `start`; None: no such position was found.
        """
        if self.breach(start) is not None:
            return self.position_inside(start)
        end = self.position_inside(target) or start
        distance_m = math.dist(start, end)
        if distance_m < 1e-6:
            return end
        direction = ((end[0] - start[0]) / distance_m, (end[1] - start[1]) / distance_m)
        edge_m = self.distance_to_edge_m(start, direction)
        if distance_m <= edge_m:
            return end
        stop_m = max(0.0, edge_m - INSET_M)
        return (start[0] + direction[0] * stop_m, start[1] + direction[1] * stop_m)

    def clamp_down_m(self, down_m: float) -> float:
        """The down coordinate, limited to the range between the two vertical limits."""
        return min(max(down_m, self.down_min_m), self.down_max_m)


@dataclass(frozen=True, slots=True)
class FenceArea:
    """The geofence of a mission, in the local frame."""

    inclusions: Region
    """The vehicle stays inside all of these limits."""
    exclusions: tuple[Region, ...] = ()
    """The vehicle stays outside all of these regions; one region for each zone."""

    def are_outside(self, positions_ne_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each of the positions (N, 2) is outside the allowed area."""
        outside = self.inclusions.are_outside(positions_ne_m)
        for zone in self.exclusions:
            outside |= ~zone.are_outside(positions_ne_m)
        return outside

    def line_leaves(self, start: NorthEast, end: NorthEast) -> bool:
        """Whether the straight line leaves the area; a line that only enters the area is allowed."""
        count = 2 + min(MAX_CHECKS, int(math.dist(start, end) / CHECK_EVERY_M))
        outside = self.are_outside(np.linspace(start, end, count))
        return bool(outside[int((~outside).argmax()) :].any())


def _edges(corners: tuple[NorthEast, ...]) -> zip[tuple[NorthEast, NorthEast]]:
    return zip(corners, (*corners[1:], corners[0]), strict=True)


def _within(p: NorthEast, corners: tuple[NorthEast, ...]) -> bool:
    """Whether a position is inside a polygon, by the even-odd rule."""
    inside = False
    for a, b in _edges(corners):
        if (a[1] > p[1]) != (b[1] > p[1]) and p[0] < (b[0] - a[0]) * (p[1] - a[1]) / (b[1] - a[1]) + a[0]:
            inside = not inside
    return inside


def _crossing_m(p: NorthEast, u: NorthEast, corners: tuple[NorthEast, ...]) -> float:
    """Distance along the direction `u` to the first edge."""
    nearest = math.inf
    for a, b in _edges(corners):
        edge = (b[0] - a[0], b[1] - a[1])
        cross = u[0] * edge[1] - u[1] * edge[0]
        if abs(cross) < 1e-12:
            continue
        to_a = (a[0] - p[0], a[1] - p[1])
        along = (to_a[0] * edge[1] - to_a[1] * edge[0]) / cross
        on_edge = (to_a[0] * u[1] - to_a[1] * u[0]) / cross
        if along >= 0.0 and -1e-9 <= on_edge <= 1.0 + 1e-9:
            nearest = min(nearest, along)
    return nearest


def _into_circle(p: NorthEast, circle: Circle) -> NorthEast:
    distance_m = math.dist(p, circle.center_ne_m)
    if distance_m <= circle.radius_m:
        return p
    scale = max(circle.radius_m - INSET_M, circle.radius_m / 2) / distance_m
    c = circle.center_ne_m
    return (c[0] + (p[0] - c[0]) * scale, c[1] + (p[1] - c[1]) * scale)


def _into_polygon(p: NorthEast, corners: tuple[NorthEast, ...]) -> NorthEast:
    if _within(p, corners):
        return p
    q = _nearest_edge_point(p, corners)
    outside_m = math.dist(p, q)
    directions = [(q[0] - p[0], q[1] - p[1])] if outside_m > 1e-9 else []
    directions += [(-1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0)]
    for inset_m in (INSET_M, INSET_M / 10, INSET_M / 1000):
        for direction in directions:
            length_m = math.hypot(*direction)
            tried = (q[0] + direction[0] / length_m * inset_m, q[1] + direction[1] / length_m * inset_m)
            if _within(tried, corners):
                return tried
    return q


def _unit(vector: NorthEast) -> NorthEast:
    size = math.hypot(*vector)
    return (0.0, 0.0) if size < 1e-9 else (vector[0] / size, vector[1] / size)


def _nearest_edge_point(p: NorthEast, corners: tuple[NorthEast, ...]) -> NorthEast:
    points = [_nearest_on(p, a, b) for a, b in _edges(corners)]
    return min(points, key=lambda point: math.dist(point, p))


def _nearest_on(p: NorthEast, a: NorthEast, b: NorthEast) -> NorthEast:
    edge = (b[0] - a[0], b[1] - a[1])
    length_2 = edge[0] ** 2 + edge[1] ** 2
    if length_2 == 0.0:
        return a
    t = min(1.0, max(0.0, ((p[0] - a[0]) * edge[0] + (p[1] - a[1]) * edge[1]) / length_2))
    return (a[0] + edge[0] * t, a[1] + edge[1] * t)
