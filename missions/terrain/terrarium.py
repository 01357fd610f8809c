"""Heights in tiles of the Terrarium encoding (PNG), and elevation files made of them.

The height of a pixel is red · 256 + green + blue / 256 - 32768 metres above sea level. The tiles come from
outside, so a process with limits reads them.
"""

from __future__ import annotations

import io
import math
import os
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rasterio.io import MemoryFile
from rasterio.transform import Affine
from rasterio.windows import Window

from missions.errors import PlanError
from missions.terrain.files import FROM_TILES, MAX_ALT_AMSL_M
from missions.terrain.ground import Floats

ZERO = 32768.0
HALF_WORLD_M = 20_037_508.342789244
"""Half of the side of the world in the web's Mercator projection."""
SIDES_PX = (256, 512)
MAX_PIXELS = 400 * 256 * 256
DEEPEST_M = -12_000.0
MAX_IMPLAUSIBLE = 0.01
"""Part of a tile with impossible heights from which the tile is an ordinary picture."""
STEP_M = 1.0 / 16.0
"""Heights are rounded to this, so that the file is small; no such data are as exact."""
FIX = "Choose a source of tiles in the Terrarium encoding."

Heights = NDArray[np.float32]


def heights_of(tile: bytes, place: str = "a tile") -> Heights:
    """The heights in a tile [m]; NaN: unknown.

    Raises:
        PlanError: it is no tile of heights.
    """
    try:
        image = Image.open(io.BytesIO(tile), formats=("PNG",))
        if image.size not in {(side, side) for side in SIDES_PX} or image.mode not in ("RGB", "RGBA"):
            raise ValueError(f"{image.size[0]} by {image.size[1]} pixels, {image.mode}")
        pixels = np.asarray(image.convert("RGB"), dtype=np.float32)
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
        raise PlanError(place, f"it cannot be read ({error})", FIX) from error
    heights_m = pixels @ np.array([256.0, 1.0, 1.0 / 256.0], np.float32) - np.float32(ZERO)
    wrong = (heights_m < DEEPEST_M) | (heights_m > MAX_ALT_AMSL_M)
    if wrong.mean() > MAX_IMPLAUSIBLE:
        raise PlanError(place, f"it shows no heights (one would be {heights_m[wrong][0]:,.0f} m)", FIX)
    return np.where(wrong, np.nan, heights_m).astype(np.float32)


def tile_of(heights_m: Heights) -> bytes:
    """The tile with these heights as PNG. Unknown ones are as low as the lowest known one: there is at least
    one."""
    lowest_m = float(np.nanmin(heights_m))
    units = np.round((np.nan_to_num(heights_m, nan=lowest_m).astype(np.float64) + ZERO) * 256.0).astype(
        np.uint32
    )
    channels = [units >> 16 & 255, units >> 8 & 255, units & 255]
    content = io.BytesIO()
    Image.fromarray(np.stack(channels, axis=-1).astype(np.uint8), "RGB").save(
        content, "PNG", compress_level=4
    )
    return content.getvalue()


def pixel_positions(zoom: int, x: int, y: int, side: int) -> tuple[Floats, Floats]:
    """(side, side) latitudes and longitudes [deg] of the middles of a tile's pixels, y counted from the
    north."""
    middles = (np.arange(side) + 0.5) / side
    columns, rows = np.meshgrid((x + middles) / (1 << zoom), (y + middles) / (1 << zoom))
    return np.degrees(np.arctan(np.sinh(math.pi * (1.0 - 2.0 * rows)))), columns * 360.0 - 180.0


@dataclass(frozen=True, slots=True)
class _Tile:
    x: int
    y: int
    """From the north."""
    content: bytes


def write_file(tiles: Path, file: Path, attribution: str) -> None:
    """Writes the heights in the tiles of an MBTiles file with one zoom as a GeoTIFF file.

    The sea counts as 0 m: tiles often have the sea floor there. So does land below sea level.

    Raises:
        PlanError: the tiles cannot be used, or the file cannot be written.
    """
    place = f"the elevation file {file.name}"
    zoom, found = _tiles(tiles)
    side = heights_of(found[0].content).shape[0]
    left, top = min(each.x for each in found), min(each.y for each in found)
    columns, rows = (max(each.x for each in found) - left + 1, max(each.y for each in found) - top + 1)
    if columns * rows * side * side > MAX_PIXELS:
        raise PlanError(place, f"it would have more than {MAX_PIXELS:,} heights", "Choose a smaller area.")
    step_m = 2.0 * HALF_WORLD_M / ((1 << zoom) * side)
    west_m, north_m = left * side * step_m - HALF_WORLD_M, HALF_WORLD_M - top * side * step_m
    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff", width=columns * side, height=rows * side, count=1, dtype="float32",
            crs="EPSG:3857", transform=Affine(step_m, 0.0, west_m, 0.0, -step_m, north_m), nodata=np.nan,
            tiled=True, blockxsize=256, blockysize=256, compress="deflate", predictor=3, sparse_ok=True,
        ) as data:  # fmt: skip
            data.update_tags(TIFFTAG_SOFTWARE=FROM_TILES, TIFFTAG_COPYRIGHT=attribution)
            for each in found:
                heights_m = heights_of(each.content, f"the tile {zoom}/{each.x}/{each.y}")
                if heights_m.shape[0] != side:
                    raise PlanError(place, "the source has tiles of two sizes", FIX)
                rounded_m = np.round(np.maximum(heights_m, 0.0) / STEP_M) * STEP_M
                window = Window((each.x - left) * side, (each.y - top) * side, side, side)  # pyright: ignore[reportCallIssue]
                data.write(rounded_m.astype(np.float32), 1, window=window)
        _write(file, memory.read(), place)


def _tiles(path: Path) -> tuple[int, list[_Tile]]:
    """The zoom and the tiles of an MBTiles file, whose rows count from the south."""
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        rows = database.execute("SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles").fetchall()
    zoom = rows[0][0]
    return zoom, [_Tile(x, (1 << zoom) - 1 - y, content) for _, x, y, content in rows]


def _write(file: Path, content: bytes, place: str) -> None:
    """Writes through Python, which reports a full disk; GDAL may only log it."""
    try:
        with file.open("wb") as output:
            output.write(content)
            output.flush()
            os.fsync(output.fileno())
    except OSError as error:
        reason = f"it cannot be written ({error.strerror or error})"
        raise PlanError(place, reason, "Make room on the server's disk. Nothing was saved.") from error
