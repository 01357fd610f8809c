"""The ground as a grid of altitudes, and positions along a line over it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.geodesy import EARTH_RADIUS_M, distance_m

Floats = NDArray[np.float64]
MAX_SAMPLES = 2_000
"""Maximum number of positions on one line."""
MIN_SPACING_M = 1.0


@dataclass(frozen=True, slots=True)
class Ground:
    """Altitudes of the ground on a grid of latitude and longitude."""

    north_deg: float
    """Latitude of the first row; rows go south."""
    west_deg: float
    """Longitude of the first column; columns go east."""
    step_lat_deg: float
    """Between two rows, positive."""
    step_lon_deg: float
    """Between two columns, positive."""
    amsl_m: NDArray[np.float32]
    """(rows, columns), at least 2 x 2; NaN: unknown."""

    @property
    def spacing_m(self) -> float:
        """Distance between two rows in metres on the ground."""
        return math.radians(self.step_lat_deg) * EARTH_RADIUS_M

    def at(self, lat_deg: Floats, lon_deg: Floats) -> Floats:
        """Altitudes AMSL [m], interpolated between four grid points; NaN outside the grid or if one of the
        four is unknown.

        Args:
            lat_deg: (N,).
            lon_deg: (N,).
        """
        row = (self.north_deg - lat_deg) / self.step_lat_deg
        column = ((lon_deg - self.west_deg) % 360.0) / self.step_lon_deg
        rows, columns = self.amsl_m.shape
        inside = (row >= 0.0) & (row <= rows - 1) & (column >= 0.0) & (column <= columns - 1)
        top = np.clip(np.floor(np.where(inside, row, 0.0)).astype(np.intp), 0, rows - 2)
        left = np.clip(np.floor(np.where(inside, column, 0.0)).astype(np.intp), 0, columns - 2)
        down, right = row - top, column - left
        altitudes = self.amsl_m.astype(np.float64, copy=False)
        upper = altitudes[top, left] * (1.0 - right) + altitudes[top, left + 1] * right
        lower = altitudes[top + 1, left] * (1.0 - right) + altitudes[top + 1, left + 1] * right
        return np.where(inside, upper * (1.0 - down) + lower * down, np.nan)

    def one(self, lat_deg: float, lon_deg: float) -> float | None:
        """Altitude AMSL at one position [m]; None if unknown."""
        found = float(self.at(np.array([lat_deg]), np.array([lon_deg]))[0])
        return None if math.isnan(found) else found

    def unknown_at(self, lat_deg: Sequence[float], lon_deg: Sequence[float]) -> bool:
        """Whether the ground is unknown at one of these positions."""
        return bool(np.isnan(self.at(np.array(lat_deg), np.array(lon_deg))).any())


def between(start: tuple[float, float], end: tuple[float, float], spacing_m: float) -> Floats:
    """Positions on the straight line between two positions, both included: (N, 3) latitude, longitude [deg]
    and fraction of the line (0 to 1).

    Args:
        start: latitude, longitude [deg].
        end: latitude, longitude [deg].
        spacing_m: greatest distance between two positions, unless the line would need more than 2,000.
    """
    length_m = distance_m(*start, *end)
    count = min(MAX_SAMPLES, 2 + math.ceil(length_m / max(spacing_m, MIN_SPACING_M)))
    share = np.linspace(0.0, 1.0, count)
    delta_lon_deg = math.remainder(end[1] - start[1], 360.0)
    return np.column_stack((start[0] + (end[0] - start[0]) * share, start[1] + delta_lon_deg * share, share))
