"""The known ground of the 3D view: which part is read, how it is placed, and its shape.

**Heights.** The ground is drawn at its altitude above mean sea level, as vehicles are. Elevation data and
the altitude of home differ by some metres, so the ground is shifted to home if they nearly agree
(`missions/floor.py` does the same for targets). If they differ by more, it stays where it is, and a text
says by how much.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_server.scene.frames import enu_from_geodetic, geodetic_from_enu
from gcs_server.scene.model import Mesh, Points
from gcs_server.scene.palette import Rgb
from missions.floor import HOME_TOLERANCE_M
from missions.frames import IDENTITY, Quaternion, Vector3, normalized
from missions.terrain.ground import Floats
from missions.terrain.relief import FINE_STEP_M, Relief, offsets_m

LINES_M = 100.0
"""Distance between the lines on the fine middle of the ground [m]."""
NEAR_LINES_M, NEAR_HALF_M = 10.0, 100.0
"""The same up to this distance from the middle, where height and speed are seen by them."""
SUN_ENU = np.array([-0.5, 0.5, math.sqrt(0.5)])
SHADE = 0.6
"""Part of the colour that depends on the slope."""
LINE_GAP_M = 0.15
"""Height of the lines above the ground, so that they do not flicker [m]."""
UNKNOWN_Z_M = -20_000.0
"""Height of vertices where the ground is unknown; no triangle has them, and the page knows them by it [m]."""
MIN_HEIGHT_RANGE_M = 20.0
"""Smallest range of heights that the colours show [m]: flat ground has one colour."""

ReadRelief = Callable[[float, float], Awaitable[Relief | None]]
"""Reads the ground around a latitude and longitude [deg]; None: not known."""


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """The ground that the view draws."""

    relief: Relief
    shift_m: float = 0.0
    """Added to its altitudes."""
    note: str = ""
    """What a person must know about its heights; empty: nothing."""

    @classmethod
    def at_home(cls, relief: Relief, home_deg_m: Vector3 | None) -> Terrain:
        """The ground, shifted to the home (latitude, longitude, altitude AMSL) if they nearly agree."""
        at_home_m = None if home_deg_m is None else relief.altitude_amsl_m(*home_deg_m[:2])
        if home_deg_m is None or at_home_m is None:
            return cls(relief)
        difference_m = home_deg_m[2] - at_home_m
        if abs(difference_m) <= HOME_TOLERANCE_M:
            return cls(relief, difference_m)
        side = "above" if difference_m > 0.0 else "below"
        return cls(relief, 0.0, f"home is {abs(difference_m):.0f} m {side} the ground of the elevation data")


class TerrainShape:
    """The terrain as shapes in the world's ENU.

    Args:
        terrain: the terrain.
        origin_deg_m: the world's origin: latitude, longitude, altitude AMSL.
    """

    def __init__(self, terrain: Terrain, origin_deg_m: Vector3) -> None:
        self.terrain, self.origin_deg_m = terrain, origin_deg_m
        lats, lons = terrain.relief.positions_deg()
        self._east_m = np.array([self._enu(lats[0], lon, 0.0)[0] for lon in lons])
        self._north_m = np.array([self._enu(lat, lons[0], 0.0)[1] for lat in lats])
        self._up_m = terrain.relief.amsl_m + np.float32(terrain.shift_m - origin_deg_m[2])

    def mesh(self) -> Mesh:
        """Triangles of the known ground. The page reads the vertices, too, so that the plans that it draws
        stand on them (`scene-terrain.ts`)."""
        east, north = np.meshgrid(self._east_m, self._north_m)
        up = np.nan_to_num(self._up_m, nan=UNKNOWN_Z_M)
        vertices = np.stack([east, north, up], axis=-1).reshape(-1, 3)
        rows, columns = self._up_m.shape
        numbers = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
        a, b, c, d = (numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1])
        faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
        known = ~np.isnan(self._up_m).ravel()
        return Mesh(vertices.astype(np.float32), faces[known[faces].all(axis=1)])

    def normals(self) -> Points:
        """(N · N, 3) directions that are perpendicular to the ground at each vertex."""
        up_m = np.nan_to_num(self._up_m, nan=float(np.nanmean(self._up_m))).astype(np.float64)
        north_slope, east_slope = np.gradient(up_m, self._north_m, self._east_m)
        normals = np.stack([-east_slope, -north_slope, np.ones_like(up_m)], axis=-1).reshape(-1, 3)
        return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)

    def colours(self, low: Rgb, high: Rgb) -> NDArray[np.uint8]:
        """(N · N, 3) colour of each vertex: by its height, and darker on slopes that face away from the
        north-west, as on maps."""
        lowest_m, highest_m = (float(np.nanmin(self._up_m)), float(np.nanmax(self._up_m)))
        height_m = np.nan_to_num(self._up_m, nan=lowest_m).reshape(-1, 1) - lowest_m
        share = height_m / max(MIN_HEIGHT_RANGE_M, highest_m - lowest_m)
        blend = np.asarray(low) + share * (np.asarray(high, float) - np.asarray(low))
        light = (self.normals() @ SUN_ENU / SUN_ENU[2]).reshape(-1, 1)
        shaded = blend * (1.0 - SHADE + SHADE * np.clip(light, 0.0, 1.6))
        return np.clip(np.round(shaded), 0, 255).astype(np.uint8)

    def lines(self, step_m: float, half_m: float) -> Points:
        """(K, 2, 3) lines on the ground in the fine middle, one each `step_m` north and east up to
        `half_m`."""
        numbers = np.flatnonzero(np.abs(offsets_m()) <= half_m + FINE_STEP_M / 2)
        chosen = numbers[:: round(step_m / FINE_STEP_M)]
        east, north = np.meshgrid(self._east_m, self._north_m)
        grid = np.stack([east, north, self._up_m + LINE_GAP_M], axis=-1)
        parts = [grid[number, numbers] for number in chosen] + [grid[numbers, number] for number in chosen]
        segments = np.concatenate([np.stack([part[:-1], part[1:]], axis=1) for part in parts])
        return segments[~np.isnan(segments).any(axis=(1, 2))].astype(np.float32)

    def z_at(self, east_m: float, north_m: float) -> float | None:
        """Height of the ground at a point of the world; None: unknown."""
        z = float(self._z(np.array([east_m]), np.array([north_m]))[0])
        return None if math.isnan(z) else z

    def tilt_at(self, east_m: float, north_m: float) -> Quaternion:
        """Rotation that lays a mark on the ground at a point; none where the ground is unknown."""
        d = FINE_STEP_M / 2
        heights = [self.z_at(east_m + x, north_m + y) for x, y in ((-d, 0.0), (d, 0.0), (0.0, -d), (0.0, d))]
        west, east, south, north = (0.0 if None in heights else z or 0.0 for z in heights)
        east_slope, north_slope = (east - west) / (2 * d), (north - south) / (2 * d)
        # Half way from straight up to the direction that is perpendicular to the ground.
        length = math.sqrt(1.0 + east_slope**2 + north_slope**2)
        return normalized((length + 1.0, north_slope, -east_slope, 0.0)) or IDENTITY

    def hit(self, eye_enu_m: Vector3, ray_enu: Vector3, reach_m: float) -> Vector3 | None:
        """The first point of a ray on the known ground; None: it meets none."""
        distances_m = np.geomspace(0.2, 1.5 * reach_m, 4000)
        points = np.asarray(eye_enu_m) + distances_m[:, None] * np.asarray(ray_enu)
        above_m = points[:, 2] - self._z(points[:, 0], points[:, 1])
        below = np.flatnonzero((above_m[1:] <= 0.0) & (above_m[:-1] > 0.0))
        if not len(below):
            return None
        i = int(below[0])
        share = above_m[i] / (above_m[i] - above_m[i + 1])
        x, y, z = (float(value) for value in points[i] + share * (points[i + 1] - points[i]))
        return (x, y, z) if math.hypot(x - eye_enu_m[0], y - eye_enu_m[1]) <= reach_m else None

    def _z(self, east_m: Floats, north_m: Floats) -> Floats:
        lat_0, lon_0, alt_0 = self.origin_deg_m
        # Linear in both directions, as `enu_from_geodetic` is.
        lat_1, lon_1, _ = geodetic_from_enu((1.0, 1.0, 0.0), origin_deg_m=self.origin_deg_m)
        lats, lons = (
            lat_0 + north_m * (lat_1 - lat_0),
            lon_0 + east_m * ((lon_1 - lon_0 + 180.0) % 360.0 - 180.0),
        )
        return self.terrain.relief.altitudes_amsl_m(lats, lons) + (self.terrain.shift_m - alt_0)

    def _enu(self, lat_deg: float, lon_deg: float, alt_m: float) -> Vector3:
        return enu_from_geodetic(lat_deg, lon_deg, alt_m, origin_deg_m=self.origin_deg_m)
