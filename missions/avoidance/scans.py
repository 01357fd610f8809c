"""Measurements of distance sensors around a vehicle, independent of the messages."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from missions.frames import Vector3, wrap_pi

LEVEL_MAX_SINE = 0.7
"""Largest vertical component of a ray that measures obstacles (sine of 45°). A steeper ray measures the
height above the ground or below a ceiling."""
DEFAULT_HALF_ANGLE_RAD = math.radians(15.0)
"""Half angle assumed for a sensor that does not report its field of view."""


@dataclass(frozen=True, slots=True)
class Scan:
    """One measurement of one sensor. Rays without a valid value are left out."""

    measured_s: float
    """Monotonic time of the measurement."""
    directions_ned: tuple[Vector3, ...]
    """Unit vectors of the rays, in the attitude of that time."""
    distances_m: tuple[float | None, ...]
    """Distance along each ray; None: nothing within the range."""
    range_m: float
    """Maximum range of the sensor."""
    half_angle_rad: float = 0.0
    """Half angle of each ray; 0: not reported."""

    @property
    def plausible(self) -> bool:
        """Whether all numbers are in their possible ranges."""
        return (
            math.isfinite(self.measured_s)
            and 0.0 < self.range_m <= 1e4
            and len(self.directions_ned) == len(self.distances_m)
            and all(abs(math.hypot(*each) - 1.0) < 0.1 for each in self.directions_ned)
            and all(each is None or 0.0 <= each <= 1e4 for each in self.distances_m)
        )


def recent_scans(scans: Iterable[Scan], now_s: float, within_s: float) -> tuple[Scan, ...]:
    """The scans of the last `within_s` seconds."""
    return tuple(scan for scan in scans if now_s - scan.measured_s <= within_s)


def measures_level(scan: Scan) -> bool:
    """Whether at least one ray is within 45° of horizontal."""
    return any(abs(direction[2]) <= LEVEL_MAX_SINE for direction in scan.directions_ned)


def measures_outwards(scan: Scan) -> bool:
    """Whether at least one ray is level, upward, or less than 45° downward."""
    return any(direction[2] <= LEVEL_MAX_SINE for direction in scan.directions_ned)


def measures_down(scan: Scan) -> bool:
    """Whether at least one ray points more than 45° downward."""
    return any(direction[2] > LEVEL_MAX_SINE for direction in scan.directions_ned)


def sensor_range_m(scans: Iterable[Scan], heading_rad: float, yaw_change_rad: float = 0.0) -> float | None:
    """Maximum range of the sensors along a heading; None: no sensor measures in this direction.

    Args:
        scans: the current scans.
        heading_rad: clockwise from north.
        yaw_change_rad: assumed change of the vehicle's yaw before the sensors measure.
    """
    best: float | None = None
    for scan in scans:
        half_rad = max(scan.half_angle_rad, DEFAULT_HALF_ANGLE_RAD)
        for north, east, down in scan.directions_ned:
            if abs(down) > LEVEL_MAX_SINE:
                continue
            difference_rad = abs(wrap_pi(math.atan2(east, north) + yaw_change_rad - heading_rad))
            if difference_rad <= half_rad and (best is None or scan.range_m > best):
                best = scan.range_m
    return best
