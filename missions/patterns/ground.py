"""Areas and lines on a flat map for shapely: x is east and y is north of an origin [m]."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely.geometry import LineString, Polygon

from missions.errors import PlanError
from missions.geodesy import LocalOrigin
from missions.items import Waypoint
from missions.pattern_settings import MAX_POINTS
from missions.values import Altitude, Point

EastNorth = tuple[float, float]
"""East, north [m]."""
MAX_EXTENT_M = 50_000.0
"""Maximum extent; over this distance the flat map has an error of 0.3 %."""


@dataclass(frozen=True, slots=True)
class Map:
    """A flat map around an origin."""

    origin: LocalOrigin

    @classmethod
    def centred_on(cls, points: Sequence[Point], subject: str, field: str) -> Map:
        """A map whose origin is the centre of some points.

        Args:
            points: the points.
            subject: the name of the points in errors.
            field: the field of the pattern that contains them.

        Raises:
            PlanError: There are too many points, or they are too far apart.
        """
        if not 1 <= len(points) <= MAX_POINTS:
            raise PlanError(
                subject,
                f"it has {len(points)} points, but 1 to {MAX_POINTS} are allowed",
                "Draw it again.",
                field=field,
            )
        first_lon_deg = points[0].lon_deg
        lons = [first_lon_deg + math.remainder(each.lon_deg - first_lon_deg, 360.0) for each in points]
        lats = [each.lat_deg for each in points]
        middle_lon_deg = math.remainder((min(lons) + max(lons)) / 2.0, 360.0)
        flat_map = cls(LocalOrigin((min(lats) + max(lats)) / 2.0, middle_lon_deg, 0.0))
        if max(abs(lat) for lat in lats) > 85.0:
            raise PlanError(
                subject, "it is beyond 85 degrees of latitude", "Choose another area.", field=field
            )
        if max(math.hypot(*flat_map.local(each)) for each in points) > MAX_EXTENT_M:
            reason = f"it extends more than {MAX_EXTENT_M / 1000:.0f} km from its centre"
            raise PlanError(subject, reason, "Split it into smaller ones.", field=field)
        return flat_map

    def local(self, point: Point) -> EastNorth:
        """Converts a point to east and north of the origin [m]."""
        north, east, _ = self.origin.to_ned(point.lat_deg, point.lon_deg, 0.0)
        return (east, north)

    def point(self, position: EastNorth) -> Point:
        """The inverse of `local`."""
        lat_deg, lon_deg, _ = self.origin.to_geodetic((position[1], position[0], 0.0))
        return Point(lat_deg=lat_deg, lon_deg=lon_deg)

    def waypoint(self, position: EastNorth, altitude: Altitude, yaw_ned_deg: float | None = None) -> Waypoint:
        """A waypoint that the vehicle passes without waiting."""
        point = self.point(position)
        return Waypoint(
            lat_deg=point.lat_deg, lon_deg=point.lon_deg, altitude=altitude, yaw_ned_deg=yaw_ned_deg
        )

    def polygon(self, outer: Sequence[Point], *, field: str = "outer") -> Polygon:
        """An area without holes.

        Raises:
            PlanError: The sides of the polygon cross, or the polygon has no area.
        """
        return self._area(outer, "the area", field)

    def polygon_with_holes(self, outer: Sequence[Point], holes: Sequence[Sequence[Point]]) -> Polygon:
        """An area with holes.

        Raises:
            PlanError: The sides of a polygon cross, a polygon has no area, or a hole is not inside the area.
        """
        area = self.polygon(outer)
        for number, hole in enumerate(holes, 1):
            hole_area = self._area(hole, f"hole {number}", "holes")
            if not area.contains(hole_area):
                reason = "it is not completely inside the area"
                raise PlanError(f"hole {number}", reason, "Move its corners into the area.", field="holes")
        shape = Polygon(area.exterior, [[self.local(each) for each in hole] for hole in holes])
        if not shape.is_valid:
            reason = "they overlap, or touch each other or the edge of the area"
            raise PlanError("the holes", reason, "Move them apart.", field="holes")
        return shape

    def _area(self, outline: Sequence[Point], subject: str, field: str) -> Polygon:
        if len(outline) < 3:
            raise PlanError(
                subject, "its outline has fewer than 3 corners", "Add corners to the outline.", field=field
            )
        shape = Polygon([self.local(each) for each in outline])
        if not shape.is_valid:
            reason = f"its sides cross or touch ({shapely.is_valid_reason(shape)})"
            raise PlanError(subject, reason, "Move its corners.", field=field)
        if shape.area < 1.0:
            raise PlanError(subject, "it is smaller than 1 m²", "Draw it larger.", field=field)
        return shape

    def line(self, points: Sequence[Point]) -> LineString:
        """A line through some points.

        Raises:
            PlanError: The line has no length.
        """
        if len(points) < 2:
            raise PlanError("the line", "it has fewer than 2 points", "Add points to it.", field="points")
        shape = LineString([self.local(each) for each in points])
        if shape.length < 1.0:
            raise PlanError("the line", "it is shorter than 1 m", "Draw it again.", field="points")
        return shape


def heading_deg(start: EastNorth, end: EastNorth) -> float:
    """Direction from one position to another, clockwise from north, 0 to 360."""
    return math.degrees(math.atan2(end[0] - start[0], end[1] - start[1])) % 360.0
