"""The operator's elevation files (GeoTIFF, HGT): the area of each file, and the ground altitudes in an area.

Altitudes are metres above mean sea level, as in SRTM, Copernicus DEM and national models. GDAL (rasterio)
reads the files. It resamples files in other coordinate systems to latitude and longitude.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.crs import CRS
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.transform import Affine
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform_bounds

from missions.errors import PlanError
from missions.geodesy import EARTH_RADIUS_M
from missions.terrain.ground import Ground

MAX_CELLS = 4_000_000
"""Maximum number of cells of one `Ground`; a larger area is read with a coarser grid."""
MARGIN_CELLS = 2
MAX_ATTRIBUTION = 300
MIN_ALT_AMSL_M, MAX_ALT_AMSL_M = -1_000.0, 9_000.0
"""Range of land altitudes on earth; a value outside means no data."""
WGS84 = CRS.from_epsg(4326)
DRIVERS = {".tif": "GTiff", ".tiff": "GTiff", ".hgt": "SRTMHGT"}
"""GDAL driver by suffix. Other drivers are not used, because some of them follow links to other files."""
FROM_TILES = "offboard-gcs: from tiles"
"""Software that a GeoTIFF file names if it was made of tiles."""
FIX = "Use a GeoTIFF or HGT file with one band of altitudes in metres."


@dataclass(frozen=True, slots=True)
class ElevationFile:
    """One elevation file: name, covered area and spacing of the grid."""

    name: str
    west_deg: float
    south_deg: float
    east_deg: float
    north_deg: float
    spacing_m: float
    """Distance between two rows."""
    from_tiles: bool = False
    """Whether it was saved from tiles. Such tiles are often drawn from coarser data than they look."""
    attribution: str | None = None
    """Attribution that the file asks for."""


@dataclass(frozen=True, slots=True)
class BoundingBox:
    """A box of latitude and longitude; `west_deg` is less than `east_deg`, which may be more than 180."""

    west_deg: float
    south_deg: float
    east_deg: float
    north_deg: float

    @property
    def side_m(self) -> float:
        """The longer side, in metres on the ground."""
        middle_rad = math.radians((self.south_deg + self.north_deg) / 2)
        width_rad = math.radians(self.east_deg - self.west_deg) * math.cos(middle_rad)
        return max(width_rad, math.radians(self.north_deg - self.south_deg)) * EARTH_RADIUS_M

    @classmethod
    def around_positions(
        cls, positions: Iterable[tuple[float, float]], margin_m: float
    ) -> BoundingBox | None:
        """The box around positions (latitude, longitude) plus a margin; None without positions."""
        lat_lon_deg = list(positions)
        if not lat_lon_deg:
            return None
        first_lon_deg = lat_lon_deg[0][1]
        lats = [lat for lat, _ in lat_lon_deg]
        lons = [first_lon_deg + math.remainder(lon - first_lon_deg, 360.0) for _, lon in lat_lon_deg]
        margin_lat_deg = math.degrees(margin_m / EARTH_RADIUS_M)
        margin_lon_deg = margin_lat_deg / max(0.05, math.cos(math.radians(max(map(abs, lats)))))
        return cls(
            min(lons) - margin_lon_deg,
            min(lats) - margin_lat_deg,
            max(lons) + margin_lon_deg,
            max(lats) + margin_lat_deg,
        )


def inspect(path: Path) -> ElevationFile:
    """Reads the area that a file covers.

    Raises:
        PlanError: the file cannot be read, has no coordinate system, or more than one band.
    """
    with _open(path) as data:
        west, south, east, north = transform_bounds(data.crs, WGS84, *data.bounds)
        spacing_m = math.radians((north - south) / data.height) * EARTH_RADIUS_M
        tags: dict[str, str] = data.tags()
        from_tiles = tags.get("TIFFTAG_SOFTWARE") == FROM_TILES
        attribution = tags.get("TIFFTAG_COPYRIGHT", "")[:MAX_ATTRIBUTION] or None
        return ElevationFile(path.name, west, south, east, north, spacing_m, from_tiles, attribution)


@dataclass(frozen=True, slots=True)
class Elevation:
    """The operator's readable elevation files."""

    files: tuple[tuple[Path, ElevationFile], ...]
    """The operator's own files, then those that were saved from tiles; each from the finest grid to the
    coarsest."""
    problems: tuple[str, ...]
    """Messages about files that cannot be used."""

    @classmethod
    def from_files(cls, paths: Iterable[Path]) -> Elevation:
        """Inspects each file and sorts the files; unreadable files become problems."""
        files: list[tuple[Path, ElevationFile]] = []
        problems: list[str] = []
        for path in paths:
            try:
                files.append((path, inspect(path)))
            except PlanError as error:
                problems.append(
                    f"{error.place[0].upper()}{error.place[1:]} is not used: {error.reason}. {error.fix}"
                )
        files.sort(key=lambda each: (each[1].from_tiles, each[1].spacing_m, each[1].name))
        return cls(tuple(files), tuple(problems))

    def ground(self, area: BoundingBox, max_cells: int = MAX_CELLS) -> Ground | None:
        """The ground of an area; each cell is taken from the first file that covers it. None: no file covers
        the area.

        Args:
            area: the area.
            max_cells: maximum number of cells of the result; a larger area is read with a coarser grid.

        Raises:
            PlanError: a file cannot be read.
        """
        covering = [(path, file) for path, file in self.files if _overlaps(file, area)]
        if not covering:
            return None
        step_deg = math.degrees(min(file.spacing_m for _, file in covering) / EARTH_RADIUS_M)
        width_deg, height_deg = area.east_deg - area.west_deg, area.north_deg - area.south_deg
        step_deg = max(step_deg, math.sqrt(width_deg * height_deg / max_cells))
        grid = _Grid(
            area.west_deg - MARGIN_CELLS * step_deg, area.north_deg + MARGIN_CELLS * step_deg, step_deg,
            2 * MARGIN_CELLS + 1 + math.ceil(height_deg / step_deg),
            2 * MARGIN_CELLS + 1 + math.ceil(width_deg / step_deg),
        )  # fmt: skip
        altitudes_amsl_m = np.full((grid.rows, grid.columns), np.nan, dtype=np.float32)
        for path, file in covering:
            if not np.isnan(altitudes_amsl_m).any():
                break
            altitudes_amsl_m = np.where(np.isnan(altitudes_amsl_m), _read(path, file, grid), altitudes_amsl_m)
        return Ground(
            grid.north_deg - step_deg / 2, grid.west_deg + step_deg / 2, step_deg, step_deg, altitudes_amsl_m
        )


@dataclass(frozen=True, slots=True)
class _Grid:
    """A grid of square cells; west and north are the edges of the grid, not centres of cells."""

    west_deg: float
    north_deg: float
    step_deg: float
    rows: int
    columns: int


def _overlaps(file: ElevationFile, area: BoundingBox) -> bool:
    """Whether a file and an area overlap, even if their longitudes differ by 360 degrees."""
    if file.north_deg < area.south_deg or file.south_deg > area.north_deg:
        return False
    return any(
        file.west_deg + shift_deg <= area.east_deg and file.east_deg + shift_deg >= area.west_deg
        for shift_deg in (-360.0, 0.0, 360.0)
    )


def _read(path: Path, file: ElevationFile, grid: _Grid) -> NDArray[np.float32]:
    """Reads a grid from one file; NaN where the file has no data."""
    middle_deg = grid.west_deg + grid.columns * grid.step_deg / 2
    shift_deg = 360.0 * round((middle_deg - (file.west_deg + file.east_deg) / 2) / 360.0)
    options: dict[str, Any] = {
        "crs": WGS84,
        "transform": Affine(
            grid.step_deg, 0.0, grid.west_deg - shift_deg, 0.0, -grid.step_deg, grid.north_deg
        ),
        "width": grid.columns,
        "height": grid.rows,
        "resampling": Resampling.bilinear,
        "dtype": "float32",
        "nodata": math.nan,
    }
    with _open(path) as data:
        if data.nodata is not None:
            options["src_nodata"] = data.nodata
        try:
            with WarpedVRT(data, **options) as view:
                values = view.read(1).astype(np.float32)
        except RasterioError as error:
            raise PlanError(f"the elevation file {path.name}", f"it cannot be read ({error})", FIX) from error
        values = (values * data.scales[0] + data.offsets[0]).astype(np.float32)
    values[(values < MIN_ALT_AMSL_M) | (values > MAX_ALT_AMSL_M)] = np.nan
    return values


def _open(path: Path) -> Any:
    """Opens a dataset, which is a context manager and closes itself.

    Raises:
        PlanError: the file cannot be used.
    """
    place = f"the elevation file {path.name}"
    try:
        data = rasterio.open(path, driver=DRIVERS[path.suffix.lower()])
    except RasterioError as error:
        raise PlanError(place, f"it cannot be read ({error})", FIX) from error
    if data.crs is None or data.count != 1:
        reason = "it has no coordinate system" if data.crs is None else f"it has {data.count} bands"
        data.close()
        raise PlanError(place, reason, FIX)
    return data
