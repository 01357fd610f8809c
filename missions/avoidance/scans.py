"""What distance sensors measured around a vehicle, whatever message carried it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from missions.frames import Vector3, wrap_pi

STEEP = 0.7
"""A ray whose vertical share is larger (45°) measures the height above the ground or below a ceiling."""
NARROWEST_RAD = math.radians(15.0)
"""A sensor that does not tell its field of view is taken to look into this half angle."""


@dataclass(frozen=True, slots=True)
class Scan:
    """One measurement of one sensor. Rays that the sensor does not know are left out."""

    heard_s: float
    """When (monotonic)."""
    directions_ned: tuple[Vector3, ...]
    """Unit vectors from the vehicle, as it lay then."""
    distances_m: tuple[float | None, ...]
    """Along each; None: nothing within the range."""
    range_m: float
    """How far the sensor sees."""
    half_angle_rad: float = 0.0
    """Of each ray; 0: the sensor does not tell."""

    @property
    def plausible(self) -> bool:
        """Whether all its numbers can be."""
        return (
            math.isfinite(self.heard_s)
            and 0.0 < self.range_m <= 1e4
            and len(self.directions_ned) == len(self.distances_m)
            and all(abs(math.hypot(*each) - 1.0) < 0.1 for each in self.directions_ned)
            and all(each is None or 0.0 <= each <= 1e4 for each in self.distances_m)
        )


def fresh(scans: Iterable[Scan], now_s: float, within_s: float) -> tuple[Scan, ...]:
    """Those measured no longer ago than `within_s`."""
    return tuple(scan for scan in scans if now_s - scan.heard_s <= within_s)


def looks_level(scan: Scan) -> bool:
    """Whether one of its rays looks rather to a side than up or down."""
    return any(abs(direction[2]) <= STEEP for direction in scan.directions_ned)


def looks_out(scan: Scan) -> bool:
    """Whether one of its rays does not look at the ground below."""
    return any(direction[2] <= STEEP for direction in scan.directions_ned)


def looks_down(scan: Scan) -> bool:
    """Whether one of its rays measures what is below."""
    return any(direction[2] > STEEP for direction in scan.directions_ned)


def seen_m(scans: Iterable[Scan], heading_rad: float, turned_rad: float = 0.0) -> float | None:
    """How far the sensors see along a heading; None: none of them looks there.

    Args:
        scans: of now.
        heading_rad: clockwise from north.
        turned_rad: asks as if the vehicle had turned by so much since.
    """
    best: float | None = None
    for scan in scans:
        half_rad = max(scan.half_angle_rad, NARROWEST_RAD)
        for north, east, down in scan.directions_ned:
            if abs(down) > STEEP:
                continue
            off_rad = abs(wrap_pi(math.atan2(east, north) + turned_rad - heading_rad))
            if off_rad <= half_rad and (best is None or scan.range_m > best):
                best = scan.range_m
    return best
