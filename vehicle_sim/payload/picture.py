"""Draws the pictures of the simulated camera (sky, ground with lines every metre, obstacles) with one ray per
pixel."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vehicle_sim.frames import rotation_matrix
from vehicle_sim.world.raycast import GROUND, NOTHING, RayCaster
from vehicle_sim.world.world import World

FloatArray = NDArray[np.float64]

WIDTH, HEIGHT = 320, 240
"""Picture size in pixels; a picture takes about 30 ms of computing time."""
FLAT_RANGE_M = 3000.0
TERRAIN_RANGE_M = 600.0
HAZE_M = 900.0
"""Distance at which 1/e of a surface's colour remains in the haze."""
JPEG_QUALITY = 85
PRISM_GREY = 150.0
_ZENITH_COLOUR, _HORIZON_COLOUR = np.array([70.0, 120.0, 190.0]), np.array([190.0, 205.0, 215.0])
_DARK_GREEN, _LIGHT_GREEN, _LINE_COLOUR = (
    np.array([92.0, 122.0, 70.0]),
    np.array([112.0, 128.0, 84.0]),
    np.array([205.0, 205.0, 190.0]),
)
_EXIF_GPS = 0x8825
_EXIF_MODEL, _EXIF_TIME = 0x0110, 0x0132


@dataclass(frozen=True, slots=True)
class ExifPosition:
    """The position in a picture's EXIF data."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


class Painter:
    """Draws pictures of one world."""

    def __init__(self, world: World) -> None:
        self._caster = RayCaster(world)
        self._range_m = FLAT_RANGE_M if world.terrain.flat else TERRAIN_RANGE_M
        self._world = world

    def draw(
        self, position_ned_m: FloatArray, q_ned_camera: FloatArray, hfov_rad: float
    ) -> NDArray[np.uint8]:
        """RGB picture (HEIGHT, WIDTH, 3) from a position (3,), attitude (4,) and horizontal field of view."""
        rays = self._ray_directions(q_ned_camera, hfov_rad)
        origin = np.broadcast_to(position_ned_m, rays.shape)
        hits = self._caster.cast(origin, rays, self._range_m)
        colour = _sky_colours(rays)
        sky = colour.copy()
        is_hit = hits.target != NOTHING
        points = origin[is_hit] + rays[is_hit] * hits.distance_m[is_hit, None]
        target = hits.target[is_hit]
        distance_m = hits.distance_m[is_hit]
        surface = np.where((target == GROUND)[:, None], _ground_colours(points, distance_m), PRISM_GREY)
        for number in range(len(self._world.boxes)):
            on_box = target == number
            if on_box.any():
                surface[on_box] = self._box_colours(number, points[on_box])
        surface_share = np.exp(-distance_m / HAZE_M)[:, None]
        colour[is_hit] = surface_share * surface + (1.0 - surface_share) * sky[is_hit]
        return np.clip(np.rint(colour), 0, 255).astype(np.uint8).reshape(HEIGHT, WIDTH, 3)

    def _ray_directions(self, q_ned_camera: FloatArray, hfov_rad: float) -> FloatArray:
        focal = 0.5 * WIDTH / math.tan(0.5 * hfov_rad)
        right = (np.arange(WIDTH) + 0.5 - 0.5 * WIDTH) / focal
        down = (np.arange(HEIGHT) + 0.5 - 0.5 * HEIGHT) / focal
        rays = np.ones((HEIGHT, WIDTH, 3))
        rays[:, :, 1] = right[None, :]
        rays[:, :, 2] = down[:, None]
        rays = rays.reshape(-1, 3) / np.linalg.norm(rays.reshape(-1, 3), axis=1, keepdims=True)
        return rays @ rotation_matrix(q_ned_camera[None, :])[0].T

    def _box_colours(self, number: int, points: FloatArray) -> FloatArray:
        """Colours of points on a box: a hue for each box, a shade for each face, a line at every metre of
        height."""
        box = self._world.boxes[number]
        c, s = math.cos(box.yaw_ned_rad), math.sin(box.yaw_ned_rad)
        north, east = points[:, 0] - box.north_m, points[:, 1] - box.east_m
        x = np.abs(c * north + s * east) / (0.5 * box.length_m)
        y = np.abs(c * east - s * north) / (0.5 * box.width_m)
        height = -points[:, 2] - box.base_alt_home_m
        on_roof = height > box.height_m - 1e-3
        brightness = np.where(on_roof, 1.0, np.where(x > y, 0.8, 0.62))
        brightness = brightness * np.where(~on_roof & (np.mod(height, 1.0) < 0.06), 0.75, 1.0)
        hue = 2.4 * number
        tint = np.array(
            [170 + 50 * math.cos(hue), 140 + 40 * math.cos(hue + 2.1), 120 + 50 * math.cos(hue + 4.2)]
        )
        return brightness[:, None] * tint


def jpeg(pixels: NDArray[np.uint8], position: ExifPosition | None, time_unix_s: float) -> bytes:
    """Encodes a picture as JPEG, with position and time in the EXIF data."""
    picture = Image.fromarray(pixels)
    exif = Image.Exif()
    exif[_EXIF_MODEL] = "Simulated camera"
    exif[_EXIF_TIME] = datetime.fromtimestamp(time_unix_s, UTC).strftime("%Y:%m:%d %H:%M:%S")
    if position is not None:
        exif.get_ifd(_EXIF_GPS).update(
            {
                1: "N" if position.lat_deg >= 0 else "S",
                2: _degrees_minutes_seconds(position.lat_deg),
                3: "E" if position.lon_deg >= 0 else "W",
                4: _degrees_minutes_seconds(position.lon_deg),
                5: 0 if position.alt_amsl_m >= 0 else 1,
                6: round(abs(position.alt_amsl_m), 3),
            }
        )
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=JPEG_QUALITY, exif=exif)
    return file.getvalue()


def _degrees_minutes_seconds(angle_deg: float) -> tuple[float, float, float]:
    """Converts degrees to degrees, minutes and seconds, without sign."""
    minutes, seconds = divmod(abs(angle_deg) * 3600.0, 60.0)
    degrees, minutes = divmod(minutes, 60.0)
    return degrees, minutes, round(seconds, 5)


def _sky_colours(rays: FloatArray) -> FloatArray:
    elevation_share = np.clip(-rays[:, 2], 0.0, 1.0)[:, None] ** 0.5
    return (1.0 - elevation_share) * _HORIZON_COLOUR + elevation_share * _ZENITH_COLOUR


def _ground_colours(points: FloatArray, distance_m: FloatArray) -> FloatArray:
    """Squares of 10 m in two greens with lines between them; near the camera also a line every metre."""
    north, east = points[:, 0], points[:, 1]
    is_dark_square = np.mod(np.floor(north / 10.0) + np.floor(east / 10.0), 2.0)[:, None]
    colour = is_dark_square * _DARK_GREEN + (1.0 - is_dark_square) * _LIGHT_GREEN
    for spacing, half_width, farthest in ((1.0, 0.03, 25.0), (10.0, 0.12, 250.0)):
        on_line = np.minimum(_distance_to_line(north, spacing), _distance_to_line(east, spacing)) < half_width
        on_line &= distance_m < farthest
        colour = np.where(on_line[:, None], 0.5 * colour + 0.5 * _LINE_COLOUR, colour)
    return colour


def _distance_to_line(coordinate: FloatArray, spacing: float) -> FloatArray:
    return np.abs(coordinate - spacing * np.rint(coordinate / spacing))
