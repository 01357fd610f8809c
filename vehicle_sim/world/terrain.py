"""The shape of the ground: flat as in PX4's simulation, plus hills or a grid of altitudes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Hill:
    """A round hill with a raised cosine profile."""

    north_m: float
    east_m: float
    height_m: float
    radius_m: float


@dataclass(frozen=True, slots=True)
class HeightGrid:
    """Altitudes on a square grid, with bilinear interpolation. Outside the grid, the altitude is that of the
    nearest position in the grid."""

    north_m: float
    east_m: float
    """North and east of the south-west corner, from home."""
    spacing_m: float
    heights_m: FloatArray
    """(rows to the north, columns to the east) altitude above home."""


@dataclass(frozen=True, slots=True)
class Terrain:
    """Altitudes of the ground above home: the grid (or 0) plus all hills."""

    hills: tuple[Hill, ...] = ()
    grid: HeightGrid | None = None

    @property
    def flat(self) -> bool:
        """Whether the altitude is 0 everywhere."""
        return not self.hills and self.grid is None

    @property
    def highest_m(self) -> float:
        """Upper bound of the altitude above home."""
        highest_of_grid_m = 0.0 if self.grid is None else max(0.0, float(self.grid.heights_m.max()))
        return highest_of_grid_m + sum(max(0.0, hill.height_m) for hill in self.hills)

    def alt_home_m(self, north_m: FloatArray, east_m: FloatArray) -> FloatArray:
        """Altitude above home at positions of any array shape."""
        alt_m = np.zeros(np.shape(north_m))
        if self.grid is not None:
            alt_m = alt_m + _bilinear(self.grid, north_m, east_m)
        for hill in self.hills:
            fraction = np.hypot(north_m - hill.north_m, east_m - hill.east_m) / hill.radius_m
            alt_m = alt_m + 0.5 * hill.height_m * (1.0 + np.cos(np.pi * np.minimum(fraction, 1.0)))
        return alt_m

    def slope(self, north_m: FloatArray, east_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Increase of the altitude per metre to the north and per metre to the east."""
        d = 0.1
        rise_north = self.alt_home_m(north_m + d, east_m) - self.alt_home_m(north_m - d, east_m)
        rise_east = self.alt_home_m(north_m, east_m + d) - self.alt_home_m(north_m, east_m - d)
        return rise_north / (2 * d), rise_east / (2 * d)


def _bilinear(grid: HeightGrid, north_m: FloatArray, east_m: FloatArray) -> FloatArray:
    """Interpolated altitudes above home."""
    heights = grid.heights_m
    row = np.clip((north_m - grid.north_m) / grid.spacing_m, 0.0, heights.shape[0] - 1.0)
    column = np.clip((east_m - grid.east_m) / grid.spacing_m, 0.0, heights.shape[1] - 1.0)
    r = np.minimum(row.astype(np.int64), heights.shape[0] - 2)
    c = np.minimum(column.astype(np.int64), heights.shape[1] - 2)
    v, u = row - r, column - c
    alt_south = heights[r, c] * (1 - u) + heights[r, c + 1] * u
    alt_north = heights[r + 1, c] * (1 - u) + heights[r + 1, c + 1] * u
    return alt_south * (1 - v) + alt_north * v
