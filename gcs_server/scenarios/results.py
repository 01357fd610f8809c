"""The result of one flight of a scenario: what held, what did not, where and why."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace

import numpy as np

from gcs_server.scenarios.checks import Broken
from gcs_server.scenarios.flown import Flown, VehicleFlight
from gcs_server.scenarios.scenario import Cell, Scenario
from missions.dry_run.setup import Obstacle

Line = tuple[tuple[float, float], ...]
"""North and east of points [m]."""


@dataclass(frozen=True, slots=True)
class FlownCell:
    """A flight and its conditions."""

    cell: Cell
    flown: Flown
    recording: bytes | None = None
    """What the vehicles sent (tlog); None: not recorded."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of one check in one flight."""

    title: str
    broken: tuple[Broken, ...]
    """How it did not hold; empty: it held."""


@dataclass(frozen=True, slots=True)
class FlightResult:
    """One flight, judged."""

    scenario: str
    """Name of the scenario."""
    file: str
    """Its file, as it was given."""
    cell: Cell
    duration_s: float
    """Time from arming to the end, simulated [s]."""
    checks: tuple[CheckResult, ...]
    vehicles: tuple[VehicleFlight, ...]
    outlines: tuple[Line, ...] = ()
    """Obstacles and fence, for drawings."""
    recording: bytes | None = None
    """What the vehicles sent (tlog); None: not recorded."""

    @property
    def passed(self) -> bool:
        """Whether all checks held."""
        return not any(each.broken for each in self.checks)

    @property
    def name(self) -> str:
        """The flight in files and reports."""
        return f"{self.scenario} [{self.cell.text}]"

    @property
    def track_sha256(self) -> str:
        """A fingerprint of the flown paths: equal for equal flights."""
        digest = hashlib.sha256()
        for each in self.vehicles:
            digest.update(np.ascontiguousarray(each.t_s).tobytes() + each.position_ned_m.tobytes())
        return digest.hexdigest()

    def with_recording(self, recording: bytes | None) -> FlightResult:
        """The same result with what the vehicles sent."""
        return replace(self, recording=recording)


def judge(scenario: Scenario, cell: Cell, flown: Flown) -> FlightResult:
    """Judges a flight by the checks of its scenario."""
    first = flown.vehicles[0].name
    flew = [CheckResult("the vehicle flies to an end", tuple(Broken(text, first) for text in flown.faults))]
    checks = [
        CheckResult(check.title(), tuple(check.judge(flown)))
        for check in scenario.checks
        if check.in_faults is None or cell.faults in check.in_faults
    ]
    return FlightResult(
        scenario.document.name,
        str(scenario.path),
        cell,
        flown.duration_s,
        (*flew, *checks),
        flown.vehicles,
        _outlines(flown),
    )


def _outlines(flown: Flown) -> tuple[Line, ...]:
    lines: list[Line] = []
    for each in flown.obstacles:
        corners = _box_corners(each) if isinstance(each, Obstacle) else each.corners_ne_m
        lines.append((*corners, corners[0]))
    area = None if flown.fence is None else flown.fence.area
    for polygon in getattr(area, "geoms", [area] if area is not None else []):
        for ring in (polygon.exterior, *polygon.interiors) if not polygon.is_empty else ():
            lines.append(tuple((float(n), float(e)) for n, e in ring.coords))
    return tuple(lines)


def _box_corners(box: Obstacle) -> list[tuple[float, float]]:
    c, s = math.cos(box.yaw_ned_rad), math.sin(box.yaw_ned_rad)
    halves = [(x * box.length_m / 2, y * box.width_m / 2) for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    return [(box.north_m + c * x - s * y, box.east_m + s * x + c * y) for x, y in halves]
