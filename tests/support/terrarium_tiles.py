"""Tiles of heights in the Terrarium encoding, for a local tile server."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from tests.support.elevation_files import Elevation


def tile(heights_m: np.ndarray) -> bytes:
    """The PNG of a tile with these heights [m]; written apart from the server's own code."""
    high, rest = np.divmod(heights_m + 32768.0, 256.0)
    low, part = np.divmod(rest, 1.0)
    pixels = np.stack([high, low, np.floor(part * 256.0)], axis=-1).astype(np.uint8)
    content = io.BytesIO()
    Image.fromarray(pixels, "RGB").save(content, "PNG")
    return content.getvalue()


def tile_at(elevation: Elevation, zoom: int, x: int, y: int, side: int = 256) -> bytes:
    """The tile with the heights that a function of latitude and longitude [deg] gives."""
    pixel = (np.arange(side) + 0.5) / side
    lons, norths = np.meshgrid(
        (x + pixel) / 2**zoom * 360.0 - 180.0, np.pi * (1.0 - 2.0 * (y + pixel) / 2**zoom)
    )
    return tile(elevation(np.degrees(np.arctan(np.sinh(norths))), lons))
