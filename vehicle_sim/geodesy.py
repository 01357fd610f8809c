"""Conversion between local metres and latitude and longitude.

The projection is PX4's: azimuthal equidistant around a reference point, on a sphere of 6,371,000 m radius.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

EARTH_RADIUS_M = 6371000.0


def to_local(
    lat_deg: FloatArray, lon_deg: FloatArray, origin_lat_deg: FloatArray, origin_lon_deg: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Position of a point north and east of an origin [m]; arrays or floats of one shape."""
    lat, lat0 = np.radians(lat_deg), np.radians(origin_lat_deg)
    d_lon = np.radians(np.asarray(lon_deg) - np.asarray(origin_lon_deg))
    sin_lat, cos_lat = np.sin(lat), np.cos(lat)
    sin_lat0, cos_lat0 = np.sin(lat0), np.cos(lat0)
    cos_d_lon = np.cos(d_lon)
    north = cos_lat0 * sin_lat - sin_lat0 * cos_lat * cos_d_lon
    east = cos_lat * np.sin(d_lon)
    sin_angle = np.hypot(north, east)
    angle = np.arctan2(sin_angle, sin_lat0 * sin_lat + cos_lat0 * cos_lat * cos_d_lon)
    scale = EARTH_RADIUS_M * np.where(sin_angle > 0.0, angle / np.where(sin_angle > 0.0, sin_angle, 1.0), 1.0)
    return scale * north, scale * east


def to_global(
    north_m: FloatArray, east_m: FloatArray, origin_lat_deg: FloatArray, origin_lon_deg: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Latitude and longitude [deg] of a point north and east of an origin [m]; the inverse of `to_local`."""
    north_rad, east_rad = np.asarray(north_m) / EARTH_RADIUS_M, np.asarray(east_m) / EARTH_RADIUS_M
    lat0 = np.radians(origin_lat_deg)
    angle = np.hypot(north_rad, east_rad)
    sin_angle, cos_angle = np.sin(angle), np.cos(angle)
    scale = np.where(angle > 0.0, sin_angle / np.where(angle > 0.0, angle, 1.0), 1.0)
    sin_lat0, cos_lat0 = np.sin(lat0), np.cos(lat0)
    lat = np.arcsin(np.clip(cos_angle * sin_lat0 + north_rad * scale * cos_lat0, -1.0, 1.0))
    d_lon = np.arctan2(east_rad * scale, cos_lat0 * cos_angle - north_rad * scale * sin_lat0)
    return np.degrees(lat), np.asarray(origin_lon_deg) + np.degrees(d_lon)


def is_position(lat_deg: float, lon_deg: float) -> bool:
    """Whether both numbers are finite and the latitude is within ±90°; PX4 ignores other positions."""
    return math.isfinite(lat_deg) and abs(lat_deg) <= 90.0 and math.isfinite(lon_deg)
