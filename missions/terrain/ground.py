"""The ground as a grid of altitudes, and positions along a line over the ground."""

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
    """Difference between two rows, positive."""
    step_lon_deg: float
    """Difference between two columns, positive."""
    amsl_m: NDArray[np.float32]
    """(rows, columns) altitude, at least 2 x 2; NaN: unknown."""

    @property
    def spacing_m(self) -> float:
        """Distance between two rows in metres on the ground."""
        return math.radians(self.step_lat_deg) * EARTH_RADIUS_M

    def altitudes_amsl_m(self, lat_deg: Floats, lon_deg: Floats) -> Floats:
        """Altitudes AMSL of the ground [m], interpolated between four grid points; NaN: outside the grid, or
        the altitude of a grid point is unknown.

        Args:
            lat_deg: (N,) latitudes.
            lon_deg: (N,) longitudes.
        """
        row = (self.north_deg - lat_deg) / self.step_lat_deg
        column = ((lon_deg - self.west_deg) % 360.0) / self.step_lon_deg
        rows, columns = self.amsl_m.shape
        inside = (row >= 0.0) & (row <= rows - 1) & (column >= 0.0) & (column <= columns - 1)
        top = np.clip(np.floor(np.where(inside, row, 0.0)).astype(np.intp), 0, rows - 2)
        left = np.clip(np.floor(np.where(inside, column, 0.0)).astype(np.intp), 0, columns - 2)
        down, right = row - top, column - left
        altitudes = self.amsl_m
        upper = altitudes[top, left] * (1.0 - right) + altitudes[top, left + 1] * right
        lower = altitudes[top + 1, left] * (1.0 - right) + altitudes[top + 1, left + 1] * right
        return np.where(inside, upper * (1.0 - down) + lower * down, np.nan)

    def altitude_amsl_m(self, lat_deg: float, lon_deg: float) -> float | None:
        """Altitude AMSL of the ground at one position [m]; None: unknown."""
        altitude_m = float(self.altitudes_amsl_m(np.array([lat_deg]), np.array([lon_deg]))[0])
        return None if math.isnan(altitude_m) else altitude_m

    def unknown_at(self, lat_deg: Sequence[float], lon_deg: Sequence[float]) -> bool:
        """Whether the ground is unknown at one of these positions."""
        return bool(np.isnan(self.altitudes_amsl_m(np.array(lat_deg), np.array(lon_deg))).any())


def line_positions(start: tuple[float, float], end: tuple[float, float], spacing_m: float) -> Floats:
    """Positions on the straight line from `start` to `end`, both included: (N, 3) latitude, longitude [deg]
    and fraction of the line (0 to 1).

    Args:
        start: latitude, longitude [deg].
        end: latitude, longitude [deg].
        spacing_m: maximum distance between two positions; exceeded if the line would otherwise have more
            than MAX_SAMPLES positions.
    """
    length_m = distance_m(*start, *end)
    count = min(MAX_SAMPLES, 2 + math.ceil(length_m / max(spacing_m, MIN_SPACING_M)))
    fraction = np.linspace(0.0, 1.0, count)
    delta_lon_deg = math.remainder(end[1] - start[1], 360.0)
    return np.column_stack(
        (start[0] + (end[0] - start[0]) * fraction, start[1] + delta_lon_deg * fraction, fraction)
    )
