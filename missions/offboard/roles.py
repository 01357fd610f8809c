"""A mission of several vehicles: each role's timeline, and how near the vehicles come to each other by plan.

All roles begin together, and go on together after each meeting: by plan, once the last one has come. Of a
branch the longest way counts.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.errors import PlanError
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.offboard import samples
from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.findings import MissionFinding
from missions.offboard.places import Start
from missions.offboard.segments import Segment, WaitSegment
from missions.offboard.state import MissionVehicle
from missions.offboard.timeline import Timeline
from missions.separation import kept_apart_m, planned_margin_m

Array = NDArray[np.float64]
SPACING_S = 0.25
MAX_SAMPLES = 20_000
"""Of the whole mission; a longer one is sampled farther apart."""


@dataclass(frozen=True, slots=True)
class CompiledRoles:
    """All roles, ready to be flown."""

    timelines: dict[str, Timeline]
    findings: tuple[MissionFinding, ...]
    """Of all roles, and of their separation."""
    duration_s: float
    """Of the whole by plan, waiting for each other included."""


def planned_starts(mission: OffboardMission) -> dict[str, Start]:
    """Where each role's vehicle is planned to stand; at home where the role does not say."""
    found: dict[str, Start] = {}
    for name, role in mission.roles.items():
        home, here = mission.home, role.start_ned_m or (0.0, 0.0, 0.0)
        origin = None if home is None else LocalOrigin(home.lat_deg, home.lon_deg, home.alt_amsl_m)
        alt_m = None if home is None else home.alt_amsl_m - here[2]
        found[name] = Start(position_ned_m=here, origin=origin, home_alt_amsl_m=alt_m)
    return found


def compile_roles(
    mission: OffboardMission, vehicles: Mapping[str, MissionVehicle], starts: Mapping[str, Start]
) -> CompiledRoles:
    """The timelines of all roles, and all findings.

    Args:
        mission: with roles.
        vehicles: by role.
        starts: by role, each in its vehicle's local frame.

    Raises:
        PlanError: A role has no vehicle, or is larger than what can be compiled.
    """
    missing = [role for role in mission.roles if role not in starts]
    if missing:
        raise PlanError("vehicles", f"role {missing[0]!r} has no vehicle", "Name a vehicle for each role.")
    timelines = {
        role: compile_mission(mission, vehicles[role], starts[role], role=role) for role in mission.roles
    }
    blocks = {role: _blocks(timeline) for role, timeline in timelines.items()}
    begins_s, duration_s = _begins(blocks)
    findings = [finding for timeline in timelines.values() for finding in timeline.findings]
    places = _places_in_common_frame(mission, starts)
    if places is None:
        message = "Where the vehicles stand is not known, so their separation is not checked."
        fix = "Choose a vehicle for each role, or give each role `start_ned_m` and the mission a home."
        findings.append(MissionFinding("separation_unknown", message, None, fix))
    else:
        findings += _too_near(mission, blocks, begins_s, duration_s, starts, places)
    return CompiledRoles(timelines, tuple(findings), duration_s)


def _places_in_common_frame(
    mission: OffboardMission, starts: Mapping[str, Start]
) -> dict[str, Vector3] | None:
    """By role what is to be added to its places; None: not known."""
    first = next(iter(starts.values())).origin
    found: dict[str, Vector3] = {}
    planned = all(start.origin is None for start in starts.values())
    if planned and all(role.start_ned_m is not None for role in mission.roles.values()):
        return dict.fromkeys(starts, (0.0, 0.0, 0.0))
    for role, start in starts.items():
        if start.origin is None or first is None:
            return None
        found[role] = start.origin.to_frame_of(first, (0.0, 0.0, 0.0))
    at = {tuple(a + b for a, b in zip(found[r], starts[r].position_ned_m, strict=True)) for r in starts}
    return found if len(at) == len(starts) else None  # at one place: where they stand is not said


@dataclass(frozen=True, slots=True)
class _Flown:
    segment: Segment
    before_ned_m: Vector3


def _blocks(timeline: Timeline) -> list[list[_Flown]]:
    """The longest way, divided by the meetings."""
    blocks: list[list[_Flown]] = [[]]
    for way in samples.ways(timeline, (0.0, 0.0, 0.0)):
        if not way.main:
            continue
        before = way.before_ned_m
        for segment in way.timeline.segments:
            blocks[-1].append(_Flown(segment, before))
            before = segment.end_ned_m
            if isinstance(segment, WaitSegment) and segment.kind == "meet":
                blocks.append([])
    return blocks


def _begins(blocks: Mapping[str, list[list[_Flown]]]) -> tuple[list[float], float]:
    """When each block begins by plan, and when the last one ends."""
    begins_s, now_s = list[float](), 0.0
    for together in zip(*blocks.values(), strict=True):
        begins_s.append(now_s)
        now_s += max(sum(each.segment.duration_s for each in block) for block in together)
    return begins_s, now_s


def _sampled(
    blocks: list[list[_Flown]], begins_s: list[float], times_s: Array, start: Vector3
) -> tuple[Array, list[tuple[float, str]]]:
    """Places at these times, (N, 3), and when each step begins."""
    places = np.tile(np.array(start), (len(times_s), 1))
    steps: list[tuple[float, str]] = []
    before: Vector3 = start
    for begin_s, block in zip(begins_s, blocks, strict=True):
        now_s = begin_s
        for flown in block:
            segment = flown.segment
            steps.append((now_s, segment.place))
            first, end = np.searchsorted(times_s, (now_s, now_s + segment.duration_s)).tolist()
            within_s = times_s[first:end] - now_s
            path = samples.path_along(segment, before, within_s)
            if len(path) != len(within_s) or path.shape[0] == 2:
                share = within_s / max(segment.duration_s, 1e-9)
                path = np.array(before) + share[:, None] * (np.array(segment.end_ned_m) - np.array(before))
            places[first:end] = path
            places[end:] = segment.end_ned_m
            before, now_s = segment.end_ned_m, now_s + segment.duration_s
    return places, steps


def _too_near(
    mission: OffboardMission,
    blocks: Mapping[str, list[list[_Flown]]],
    begins_s: list[float],
    duration_s: float,
    starts: Mapping[str, Start],
    frames: Mapping[str, Vector3],
) -> Iterator[MissionFinding]:
    """The first moment at which two roles are too near, for each two."""
    count = int(min(MAX_SAMPLES, 2 + duration_s / SPACING_S))
    times_s = np.linspace(0.0, max(duration_s, SPACING_S), count)
    tracks: dict[str, tuple[Array, Array]] = {}
    steps: dict[str, list[tuple[float, str]]] = {}
    for role in blocks:
        places, steps[role] = _sampled(blocks[role], begins_s, times_s, starts[role].position_ned_m)
        tracks[role] = places + np.array(frames[role]), np.gradient(places, times_s, axis=0)
    margin_m = planned_margin_m()
    least_m = mission.separation_m + margin_m
    for one, other in itertools.combinations(tracks, 2):
        kept = kept_apart_m(*tracks[one], *tracks[other], least_m)
        near = np.flatnonzero(kept < least_m)
        if not len(near):
            continue
        begin = int(near[0])
        after = np.flatnonzero(kept[begin:] >= least_m)
        end = begin + int(after[0]) if len(after) else len(kept)
        worst = begin + int(kept[begin:end].argmin())
        t_s = float(times_s[worst])
        place, there = _step_at(steps[one], t_s), _step_at(steps[other], t_s)
        n, e, d = (tracks[one][0][worst] - np.array(frames[one])).tolist()
        message = (
            f"After {t_s:.0f} s by plan the vehicles of {one} and {other} come within {kept[worst]:.1f} m of "
            f"each other, braking included ({place}; {there}): {one} at {n:.0f} m north, {e:.0f} m east, "
            f"{d:.0f} m down. {mission.separation_m:g} m are to be kept, and {margin_m:.1f} m of margin."
        )
        fix = "Move their paths apart, let them meet before, or lower minimum_separation_m."
        yield MissionFinding("separation", message, place, fix)


def _step_at(steps: list[tuple[float, str]], t_s: float) -> str:
    return next(place for begin_s, place in reversed(steps) if begin_s <= t_s or begin_s == steps[0][0])
