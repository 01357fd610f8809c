"""The ground of a dry run, from the operator's elevation data."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from missions.dry_run.setup import GroundGrid
from missions.geodesy import LocalOrigin
from missions.terrain.ground import Ground

MARGIN_M = 50.0
"""The grid extends beyond the positions of the plan by this distance."""
MAX_SIDE = 200
"""Maximum number of rows and of columns."""


def ground_grid(
    ground: Ground, origin: LocalOrigin, positions: Sequence[tuple[float, float]]
) -> tuple[GroundGrid | None, list[str]]:
    """The ground around the positions of a plan.

    Ground altitudes are relative to the start, because elevation data and GPS altitudes differ by some
    metres. Where the ground is unknown, the altitude of the start is used.

    Args:
        ground: altitudes from elevation files.
        origin: the start.
        positions: latitude and longitude of the positions [deg]; the start need not be among them.

    Returns:
        The grid (None: the ground at the start is unknown), and sentences about the assumptions.
    """
    start_amsl_m = ground.altitude_amsl_m(origin.lat_deg, origin.lon_deg)
    if start_amsl_m is None:
        return None, ["The elevation files do not cover the start: the dry run flies over level ground."]
    local = [(0.0, 0.0), *(origin.to_ned(lat, lon, origin.alt_amsl_m)[:2] for lat, lon in positions)]
    low, high = np.min(local, axis=0) - MARGIN_M, np.max(local, axis=0) + MARGIN_M
    spacing_m = max(ground.spacing_m, float((high - low).max()) / (MAX_SIDE - 2))
    low = np.floor(low / spacing_m) * spacing_m  # the start is a grid point, so its altitude is exactly 0
    rows, columns = (max(2, 1 + math.ceil(side / spacing_m)) for side in (high - low).tolist())
    north_m, east_m = np.meshgrid(
        low[0] + spacing_m * np.arange(rows), low[1] + spacing_m * np.arange(columns), indexing="ij"
    )
    points = np.column_stack((north_m.ravel(), east_m.ravel(), np.zeros(north_m.size)))
    lat_deg, lon_deg, _ = origin.to_geodetic_arrays(points)
    altitudes_home_m = (ground.altitudes_amsl_m(lat_deg, lon_deg) - start_amsl_m).reshape(north_m.shape)
    assumptions = [
        f"The dry run flies over the ground of the elevation files, on a grid of {spacing_m:.0f} m."
    ]
    unknown = np.isnan(altitudes_home_m)
    if unknown.any():
        altitudes_home_m = np.where(unknown, 0.0, altitudes_home_m)
        assumptions.append("Where the elevation files have no data, the ground is as high as at the start.")
    return GroundGrid(float(low[0]), float(low[1]), spacing_m, altitudes_home_m), assumptions
