"""Between a vehicle's local NED frame and the earth, flat about the frame's origin."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs_server.streamer.setpoints import Vector3
from gcs_server.vehicle.geodesy import EARTH_RADIUS_M


@dataclass(frozen=True, slots=True)
class Origin:
    """Where on the earth the local frame has its zero."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float

    @classmethod
    def from_pair(cls, lat_deg: float, lon_deg: float, alt_amsl_m: float, ned_m: Vector3) -> Origin:
        """From one place known in both."""
        lat0 = lat_deg - math.degrees(ned_m[0] / EARTH_RADIUS_M)
        lon0 = lon_deg - math.degrees(ned_m[1] / (EARTH_RADIUS_M * math.cos(math.radians(lat0))))
        return cls(lat0, lon0, alt_amsl_m + ned_m[2])

    def to_ned(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Vector3:
        """A place's north, east, down."""
        north = math.radians(lat_deg - self.lat_deg) * EARTH_RADIUS_M
        turn = math.remainder(lon_deg - self.lon_deg, 360.0)
        east = math.radians(turn) * EARTH_RADIUS_M * math.cos(math.radians(self.lat_deg))
        return (north, east, self.alt_amsl_m - alt_amsl_m)

    def into(self, other: Origin, ned_m: Vector3) -> Vector3:
        """A place of this frame in another vehicle's, a few kilometres away at most."""
        n, e, d = other.to_ned(self.lat_deg, self.lon_deg, self.alt_amsl_m)
        return (ned_m[0] + n, ned_m[1] + e, ned_m[2] + d)
