"""The ground below a flight, for the altitude chart."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from missions.geodesy import LocalOrigin, distance_m
from missions.items import PlacedItem
from missions.offboard.samples import Leg
from missions.plan import Plan
from missions.route import is_flown_to
from missions.terrain.ground import Floats, Ground, line_positions

MAX_POINTS = 600
"""Maximum number of points of a profile."""

Profile = tuple[tuple[float, float | None], ...]
"""Distance along the flight [m], and altitude of the ground above home or the start [m]; None: unknown."""


@dataclass(frozen=True, slots=True)
class PlanGround:
    """The ground below a plan."""

    profile: Profile = ()
    not_known: tuple[str, ...] = ()
    """Messages about missing elevation data."""
    known_places: frozenset[int | str] = frozenset()
    """Rows of items, and steps of missions, below which the whole ground is known."""


def plan_profile(plan: Plan, ground: Ground) -> Profile:
    """Ground below the lines from home through all items that are flown to; empty: no planned home."""
    home = plan.planned_home
    if home is None:
        return ()
    positions = [(home.lat_deg, home.lon_deg)]
    positions += [
        (item.lat_deg, item.lon_deg)
        for _, item in plan.simple_items()
        if isinstance(item, PlacedItem) and is_flown_to(item)
    ]
    return _reduced(_lines(positions, ground), home.alt_amsl_m)


def mission_profile(legs: Sequence[Leg], origin: LocalOrigin, start_down_m: float, ground: Ground) -> Profile:
    """Ground below the longest path through the branches of a mission; altitudes are above the start."""
    rows = [point[1:] for leg in legs if leg.main for point in leg.points]
    if not rows:
        return ()
    positions = np.array(rows)
    steps_m = np.hypot(*np.diff(positions[:, :2], axis=0).T)
    lat_deg, lon_deg, _ = origin.to_geodetic_arrays(positions)
    along_m = np.concatenate(([0.0], np.cumsum(steps_m)))
    return _reduced([(along_m, ground.altitudes_amsl_m(lat_deg, lon_deg))], origin.alt_amsl_m - start_down_m)


def _lines(positions: Sequence[tuple[float, float]], ground: Ground) -> Iterable[tuple[Floats, Floats]]:
    along_m = 0.0
    for start, end in itertools.pairwise(positions):
        line = line_positions(start, end, ground.spacing_m)
        length_m = distance_m(*start, *end)
        yield along_m + line[:, 2] * length_m, ground.altitudes_amsl_m(line[:, 0], line[:, 1])
        along_m += length_m


def _reduced(lines: Iterable[tuple[Floats, Floats]], zero_amsl_m: float) -> Profile:
    """Reduces a profile to at most `MAX_POINTS` points; each remaining point is the highest of a group
    of points."""
    parts = list(lines)
    if not parts:
        return ()
    along_m = np.concatenate([along for along, _ in parts])
    altitudes_m = np.concatenate([amsl for _, amsl in parts]) - zero_amsl_m
    group = max(1, -(-len(along_m) // MAX_POINTS))
    found: list[tuple[float, float | None]] = []
    for first in range(0, len(along_m), group):
        part = altitudes_m[first : first + group]
        highest = None if np.isnan(part).all() else int(np.nanargmax(part))
        at_m = float(along_m[first + (highest or 0)])
        found.append((round(at_m, 1), None if highest is None else round(float(part[highest]), 1)))
    return tuple(found)
