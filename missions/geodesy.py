"""Latitude, longitude and the local NED frame, a flat projection around its origin.

The earth is a sphere with PX4's radius (`CONSTANTS_RADIUS_OF_EARTH`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3

EARTH_RADIUS_M = 6_371_000.0


def distance_m(lat1_deg: float, lon1_deg: float, lat2_deg: float, lon2_deg: float) -> float:
    """Great-circle distance over the ground (haversine formula)."""
    lat1, lat2 = math.radians(lat1_deg), math.radians(lat2_deg)
    half_lat, half_lon = (lat2 - lat1) / 2, math.radians(lon2_deg - lon1_deg) / 2
    h = math.sin(half_lat) ** 2 + math.cos(lat1) * math.cos(lat2) * math.sin(half_lon) ** 2
    return 2 * EARTH_RADIUS_M * math.asin(min(1.0, math.sqrt(h)))


@dataclass(frozen=True, slots=True)
class LocalOrigin:
    """Position of the origin of a local NED frame."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float

    @classmethod
    def from_position(
        cls, lat_deg: float, lon_deg: float, alt_amsl_m: float, position_ned_m: Vector3
    ) -> LocalOrigin:
        """Computes the origin from one position, given in global and in local coordinates."""
        lat_0_deg = lat_deg - math.degrees(position_ned_m[0] / EARTH_RADIUS_M)
        radius_m = EARTH_RADIUS_M * math.cos(math.radians(lat_0_deg))
        lon_0_deg = lon_deg - math.degrees(position_ned_m[1] / radius_m)
        return cls(lat_0_deg, lon_0_deg, alt_amsl_m + position_ned_m[2])

    def to_ned(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Vector3:
        """Converts a global position to north, east, down relative to the origin [m]."""
        north = math.radians(lat_deg - self.lat_deg) * EARTH_RADIUS_M
        delta_lon_deg = math.remainder(lon_deg - self.lon_deg, 360.0)
        east = math.radians(delta_lon_deg) * EARTH_RADIUS_M * math.cos(math.radians(self.lat_deg))
        return (north, east, self.alt_amsl_m - alt_amsl_m)

    def to_geodetic(self, position_ned_m: Vector3) -> Vector3:
        """The inverse of `to_ned`: latitude [deg], longitude [deg], altitude AMSL [m]."""
        north, east, down = position_ned_m
        radius_m = EARTH_RADIUS_M * math.cos(math.radians(self.lat_deg))
        lon_deg = math.remainder(self.lon_deg + math.degrees(east / radius_m), 360.0)
        return (self.lat_deg + math.degrees(north / EARTH_RADIUS_M), lon_deg, self.alt_amsl_m - down)

    def to_geodetic_arrays(
        self, positions_ned_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """`to_geodetic` of local positions (N, 3): latitudes, longitudes [deg], altitudes AMSL [m]."""
        radius_m = EARTH_RADIUS_M * math.cos(math.radians(self.lat_deg))
        lat_deg = self.lat_deg + np.degrees(positions_ned_m[:, 0] / EARTH_RADIUS_M)
        lon_deg = self.lon_deg + np.degrees(positions_ned_m[:, 1] / radius_m)
        return lat_deg, (lon_deg + 180.0) % 360.0 - 180.0, self.alt_amsl_m - positions_ned_m[:, 2]

    def to_frame_of(self, other: LocalOrigin, position_ned_m: Vector3) -> Vector3:
        """Converts a position to the frame of another origin, which may be a few kilometres away."""
        n, e, d = other.to_ned(self.lat_deg, self.lon_deg, self.alt_amsl_m)
        return (position_ned_m[0] + n, position_ned_m[1] + e, position_ned_m[2] + d)
