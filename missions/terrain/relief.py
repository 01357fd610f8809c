"""The ground around a position on a grid that is fine in the middle and coarse at the edge: for a view of
it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.geodesy import EARTH_RADIUS_M
from missions.terrain.ground import Floats

FINE_HALF_M, FINE_STEP_M = 400.0, 10.0
"""Half the side of the fine middle, and its step [m]."""
COARSE_COUNT, COARSE_GROWTH = 60, 1.041
"""Number of coarser steps on each side, and how much each is longer than the one before; the edge is 3 km
away."""


def offsets_m() -> Floats:
    """(N,) distances of the grid's lines from its middle [m], in both directions, ascending."""
    fine = np.arange(0.0, FINE_HALF_M + 1.0, FINE_STEP_M)
    coarse = FINE_HALF_M + np.cumsum(FINE_STEP_M * COARSE_GROWTH ** np.arange(1, COARSE_COUNT + 1))
    positive = np.concatenate([fine, coarse])
    return np.concatenate([-positive[:0:-1], positive])


@dataclass(frozen=True, slots=True, eq=False)
class Relief:
    """Altitudes of the ground around a position."""

    lat_deg: float
    lon_deg: float
    amsl_m: NDArray[np.float32]
    """(N, N): rows go north, columns go east, at `offsets_m`; NaN: unknown."""

    def positions_deg(self) -> tuple[Floats, Floats]:
        """(N,) latitudes of the rows and (N,) longitudes of the columns."""
        return axes_deg(self.lat_deg, self.lon_deg)

    def altitudes_amsl_m(self, lat_deg: Floats, lon_deg: Floats) -> Floats:
        """(M,) altitudes at positions, interpolated; NaN: unknown.

        Args:
            lat_deg: (M,) latitudes.
            lon_deg: (M,) longitudes.
        """
        lats, lons = self.positions_deg()
        row, down = _place(lats, lat_deg)
        column, right = _place(lons, self.lon_deg + (lon_deg - self.lon_deg + 180.0) % 360.0 - 180.0)
        a = self.amsl_m
        lower = a[row, column] * (1.0 - right) + a[row, column + 1] * right
        upper = a[row + 1, column] * (1.0 - right) + a[row + 1, column + 1] * right
        inside = (down >= 0.0) & (down <= 1.0) & (right >= 0.0) & (right <= 1.0)
        return np.where(inside, lower * (1.0 - down) + upper * down, np.nan)

    def altitude_amsl_m(self, lat_deg: float, lon_deg: float) -> float | None:
        """The altitude at one position; None: unknown."""
        altitude_m = float(self.altitudes_amsl_m(np.array([lat_deg]), np.array([lon_deg]))[0])
        return None if math.isnan(altitude_m) else altitude_m


def axes_deg(lat_deg: float, lon_deg: float) -> tuple[Floats, Floats]:
    """(N,) latitudes and (N,) longitudes of the grid's lines around a position."""
    offsets = np.degrees(offsets_m() / EARTH_RADIUS_M)
    return lat_deg + offsets, lon_deg + offsets / max(0.05, math.cos(math.radians(lat_deg)))


def _place(lines: Floats, values: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Index of the line before each value, and how far the value is to the next line (0 to 1 inside)."""
    index = np.clip(np.searchsorted(lines, values, side="right") - 1, 0, len(lines) - 2)
    return index, (values - lines[index]) / (lines[index + 1] - lines[index])
