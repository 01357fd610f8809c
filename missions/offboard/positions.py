"""Positions in an offboard mission, and their conversion to the vehicle's local frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, model_validator

from missions.fence import Circle, FenceArea, Polygon, Region
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.trajectory.points import MAX_COORDINATE_M
from missions.values import AltitudeM, FenceCircle, FenceZone, LatDeg, LonDeg, Model

LocalM = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M, allow_inf_nan=False)]
Ned = tuple[LocalM, LocalM, LocalM]
FENCE_NAME = "the mission's geofence"


class MissionPosition(Model):
    """A local position, an offset from the start of the mission, or latitude, longitude and altitude."""

    position_ned_m: Ned | None = None
    """Position relative to the vehicle's local origin."""
    offset_ned_m: Ned | None = None
    """Position relative to the start of the mission."""
    lat_deg: LatDeg | None = None
    lon_deg: LonDeg | None = None
    alt_amsl_m: AltitudeM | None = None
    alt_home_m: AltitudeM | None = None

    @model_validator(mode="after")
    def _check_form(self) -> MissionPosition:
        geodetic = (self.lat_deg, self.lon_deg, self.alt_amsl_m, self.alt_home_m)
        forms = [
            self.position_ned_m is not None,
            self.offset_ned_m is not None,
            any(v is not None for v in geodetic),
        ]
        if sum(forms) != 1:
            raise ValueError(
                "give one of position_ned_m, offset_ned_m, or lat_deg with lon_deg and an altitude"
            )
        if forms[2]:
            if self.lat_deg is None or self.lon_deg is None:
                raise ValueError("give both lat_deg and lon_deg")
            if (self.alt_amsl_m is None) == (self.alt_home_m is None):
                raise ValueError("give exactly one of alt_amsl_m and alt_home_m")
        return self


@dataclass(frozen=True, slots=True)
class Start:
    """State of the vehicle at the start of the mission or of its remaining part."""

    position_ned_m: Vector3 = (0.0, 0.0, 0.0)
    yaw_ned_rad: float = 0.0
    origin: LocalOrigin | None = None
    """Origin of the local frame; None: unknown, so geodetic positions cannot be converted."""
    home_alt_amsl_m: float | None = None
    in_air: bool = False
    mission_start_ned_m: Vector3 | None = None
    """Start position of the whole mission if only its remaining part is compiled; None: `position_ned_m`."""

    @property
    def reference_ned_m(self) -> Vector3:
        """The position to which offsets are relative; the ground is assumed to be at this altitude."""
        return self.position_ned_m if self.mission_start_ned_m is None else self.mission_start_ned_m


class MissingReference(Exception):
    """A position cannot be converted because a value is unknown.

    Attributes:
        missing: "global_position" or "home".
    """

    def __init__(self, missing: str) -> None:
        super().__init__(missing)
        self.missing = missing


def to_local(position: MissionPosition, start: Start) -> Vector3:
    """A position in the local frame.

    Args:
        position: the position as given in the document.
        start: the vehicle's position and origin, and the mission's start.

    Raises:
        MissingReference: The origin or the altitude of home is unknown.
    """
    if position.position_ned_m is not None:
        return position.position_ned_m
    if position.offset_ned_m is not None:
        n, e, d = position.offset_ned_m
        from_n, from_e, from_d = start.reference_ned_m
        return (from_n + n, from_e + e, from_d + d)
    if start.origin is None:
        raise MissingReference("global_position")
    amsl_m = position.alt_amsl_m
    if amsl_m is None:
        if start.home_alt_amsl_m is None:
            raise MissingReference("home")
        amsl_m = start.home_alt_amsl_m + (position.alt_home_m or 0.0)
    return start.origin.to_ned(position.lat_deg or 0.0, position.lon_deg or 0.0, amsl_m)


def fence_area(zones: Sequence[FenceZone], origin: LocalOrigin) -> FenceArea | None:
    """The geofence of a document in the local frame; None: no zones."""
    if not zones:
        return None
    inclusions, exclusions = Region(), list[Region]()
    for zone in zones:
        shape = _region(zone, origin)
        if zone.inclusion:
            circles, polygons = inclusions.circles + shape.circles, inclusions.polygons + shape.polygons
            inclusions = Region(circles=circles, polygons=polygons)
        else:
            exclusions.append(shape)
    return FenceArea(inclusions, tuple(exclusions))


def _region(zone: FenceZone, origin: LocalOrigin) -> Region:
    if isinstance(zone, FenceCircle):
        north, east, _ = origin.to_ned(zone.center.lat_deg, zone.center.lon_deg, 0.0)
        return Region(circles=(Circle((north, east), zone.radius_m, FENCE_NAME),))
    corners = [origin.to_ned(point.lat_deg, point.lon_deg, 0.0) for point in zone.polygon]
    return Region(polygons=(Polygon(tuple((north, east) for north, east, _ in corners), FENCE_NAME),))
