"""Conversions to ENU and FLU, which only the scene uses; all other code uses NED and FRD.

Vectors are `(x, y, z)` tuples [m], quaternions `(w, x, y, z)` tuples. The name of a quaternion contains both
frames: `q_enu_flu` transforms FLU vectors to ENU. Values are Python floats, which are faster than NumPy for
one pose.
"""

from __future__ import annotations

import math

from missions.frames import Quaternion, Vector3, multiply, q_from_yaw

Q_ENU_NED: Quaternion = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)
"""Half a turn about the axis between north and east: (n, e, d) becomes (e, n, -d)."""
Q_FRD_FLU: Quaternion = (0.0, 1.0, 0.0, 0.0)
"""Half a turn about the forward axis."""

WGS84_SEMI_MAJOR_M = 6378137.0
WGS84_FLATTENING = 1.0 / 298.257223563


def enu_from_ned(v_ned: Vector3) -> Vector3:
    """The same vector with east first and up positive."""
    return (v_ned[1], v_ned[0], -v_ned[2])


def q_enu_flu_from_q_ned_frd(q_ned_frd: Quaternion) -> Quaternion:
    """An attitude for the scene: FLU → FRD → NED → ENU."""
    return multiply(multiply(Q_ENU_NED, q_ned_frd), Q_FRD_FLU)


def yaw_enu_from_ned(yaw_ned_rad: float) -> float:
    """Clockwise from north becomes anticlockwise from east [rad]."""
    return math.pi / 2 - yaw_ned_rad


def q_ned_camera(q: Quaternion, *, yaw_in_earth_frame: bool, vehicle_yaw_ned_rad: float) -> Quaternion:
    """A gimbal's attitude relative to the earth.

    In MAVLink roll and pitch are always relative to the horizon; yaw is relative to north or to the vehicle's
    heading (GIMBAL_DEVICE_ATTITUDE_STATUS). Only in the second case the heading is added.
    """
    return q if yaw_in_earth_frame else multiply(q_from_yaw(vehicle_yaw_ned_rad), q)


def enu_from_geodetic(
    lat_deg: float, lon_deg: float, alt_m: float, *, origin_deg_m: tuple[float, float, float]
) -> Vector3:
    """A position in the tangent plane of `origin_deg_m` (lat_deg, lon_deg, alt_m).

    Uses the two radii of curvature of WGS84 at the origin. Within 5 km the error is below 2 m, which is not
    visible.
    """
    lat_0_deg, lon_0_deg, alt_0_m = origin_deg_m
    radius_north_m, radius_parallel_m = _radii_m(lat_0_deg)
    delta_lon_deg = (lon_deg - lon_0_deg + 180.0) % 360.0 - 180.0
    return (
        math.radians(delta_lon_deg) * radius_parallel_m,
        math.radians(lat_deg - lat_0_deg) * radius_north_m,
        alt_m - alt_0_m,
    )


def geodetic_from_enu(
    point_enu_m: Vector3, *, origin_deg_m: tuple[float, float, float]
) -> tuple[float, float, float]:
    """The inverse of `enu_from_geodetic`: (lat_deg, lon_deg, alt_m)."""
    lat_0_deg, lon_0_deg, alt_0_m = origin_deg_m
    radius_north_m, radius_parallel_m = _radii_m(lat_0_deg)
    lon_deg = lon_0_deg + math.degrees(point_enu_m[0] / radius_parallel_m)
    return (
        lat_0_deg + math.degrees(point_enu_m[1] / radius_north_m),
        (lon_deg + 180.0) % 360.0 - 180.0,
        alt_0_m + point_enu_m[2],
    )


def _radii_m(lat_deg: float) -> tuple[float, float]:
    """WGS84's radius of curvature along the meridian, and the radius of the parallel."""
    lat_rad = math.radians(lat_deg)
    e2 = WGS84_FLATTENING * (2 - WGS84_FLATTENING)
    w2 = 1 - e2 * math.sin(lat_rad) ** 2
    radius_east_m = WGS84_SEMI_MAJOR_M / math.sqrt(w2)
    return radius_east_m * (1 - e2) / w2, radius_east_m * math.cos(lat_rad)
