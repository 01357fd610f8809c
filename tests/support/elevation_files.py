"""Generates elevation files for tests: a hill, a slope, a hole."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import Affine

LAT_DEG, LON_DEG = 47.4, 8.5
"""Centre of the files and summit of the hills, by default."""
STEP_DEG = 0.0003
"""Size of a cell; about 33 m from north to south."""

Elevation = Callable[[np.ndarray, np.ndarray], np.ndarray]


def write_elevation_file(
    path: Path,
    elevation: Elevation,
    *,
    west_deg: float = LON_DEG - 0.03,
    north_deg: float = LAT_DEG + 0.03,
    cells: int = 200,
    step_deg: float = STEP_DEG,
    driver: str = "GTiff",
    **options: object,
) -> Path:
    """Writes a file of ground altitudes.

    Args:
        path: the file.
        elevation: altitude AMSL [m] of the cells' centres; gets their latitudes and longitudes [deg].
        west_deg: western edge, in units of the file's coordinate system: degrees unless `crs` is given.
        north_deg: northern edge, in the same units.
        cells: number of cells on each side.
        step_deg: size of a cell, in the same units.
        driver: GDAL's name of the file format.
        options: other fields of rasterio's profile, such as `crs` or `count`.
    """
    row_lat = north_deg - (np.arange(cells) + 0.5) * step_deg
    column_lon = west_deg + (np.arange(cells) + 0.5) * step_deg
    cell_lons, cell_lats = np.meshgrid(column_lon, row_lat)
    values = elevation(cell_lats, cell_lons).astype("float32")
    profile = {
        "count": 1,
        "crs": "EPSG:4326",
        "transform": Affine(step_deg, 0.0, west_deg, 0.0, -step_deg, north_deg),
        "nodata": -9999.0,
        **options,
    }
    with rasterio.open(
        path, "w", driver=driver, width=cells, height=cells, dtype="float32", **profile
    ) as dataset:
        dataset.write(values, 1)
    return path


def flat_elevation(amsl_m: float) -> Elevation:
    """The same altitude everywhere."""
    return lambda lat, lon: np.full_like(lat, amsl_m)


def hill_elevation(
    amsl_m: float,
    height_m: float,
    *,
    lat_deg: float = LAT_DEG,
    lon_deg: float = LON_DEG,
    width_deg: float = 0.002,
) -> Elevation:
    """A Gaussian hill on flat ground.

    Args:
        amsl_m: altitude AMSL of the flat ground.
        height_m: height of the summit above the flat ground.
        lat_deg: latitude of the summit.
        lon_deg: longitude of the summit.
        width_deg: standard deviation of the Gaussian.
    """
    return lambda lat, lon: (
        amsl_m + height_m * np.exp(-(((lat - lat_deg) ** 2 + (lon - lon_deg) ** 2) / (2 * width_deg**2)))
    )
