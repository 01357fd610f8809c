"""A mission of several vehicles: each role's timeline, and the planned separation of the vehicles.

All roles start at the same time. After each meeting they continue at the planned arrival of the last role.
The plan follows the longest path of each branch.
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
from missions.offboard.positions import Start
from missions.offboard.segments import Segment, WaitSegment
from missions.offboard.state import MissionVehicle
from missions.offboard.timeline import Timeline
from missions.separation import braking_separation_m, planned_margin_m

Array = NDArray[np.float64]
SPACING_S = 0.25
MAX_SAMPLES = 20_000
"""Maximum number of samples of the whole mission; a longer mission is sampled less often."""


@dataclass(frozen=True, slots=True)
class PlannedDistance:
    """The smallest planned distance of two vehicles."""

    roles: tuple[str, str]
    distance_m: float
    """Distance of the vehicles, without the braking distance of the finding `separation` [m]."""
    t_s: float
    """Planned time since the start."""


@dataclass(frozen=True, slots=True)
class CompiledRoles:
    """The compiled timelines of all roles."""

    timelines: dict[str, Timeline]
    findings: tuple[MissionFinding, ...]
    """Findings about all roles, and about their separation."""
    duration_s: float
    """Planned duration of the whole mission, including waiting for other roles."""
    closest: tuple[PlannedDistance, ...] = ()
    """The smallest planned distance of each pair of roles; empty if the positions are not known."""


def planned_starts(mission: OffboardMission) -> dict[str, Start]:
    """Planned start position of each role; a role without one starts at home."""
    starts: dict[str, Start] = {}
    for name, role in mission.roles.items():
        home, start_ned_m = mission.home, role.start_ned_m or (0.0, 0.0, 0.0)
        origin = None if home is None else LocalOrigin(home.lat_deg, home.lon_deg, home.alt_amsl_m)
        # PX4 sets home at the take-off position, so the altitude of the start counts as the altitude of home.
        home_alt_amsl_m = None if home is None else home.alt_amsl_m - start_ned_m[2]
        starts[name] = Start(position_ned_m=start_ned_m, origin=origin, home_alt_amsl_m=home_alt_amsl_m)
    return starts


def compile_roles(
    mission: OffboardMission, vehicles: Mapping[str, MissionVehicle], starts: Mapping[str, Start]
) -> CompiledRoles:
    """The timelines of all roles, and all findings.

    Args:
        mission: a mission with roles.
        vehicles: limits of the vehicles, by role.
        starts: start states by role, each in its vehicle's local frame.

    Raises:
        PlanError: A role has no vehicle, or is too large.
    """
    missing = [role for role in mission.roles if role not in starts]
    if missing:
        raise PlanError("vehicles", f"role {missing[0]!r} has no vehicle", "Assign a vehicle to each role.")
    timelines = {
        role: compile_mission(mission, vehicles[role], starts[role], role=role) for role in mission.roles
    }
    blocks = {role: _blocks(timeline) for role, timeline in timelines.items()}
    block_starts_s, duration_s = _planned_times(blocks)
    all_findings = (finding for timeline in timelines.values() for finding in timeline.findings)
    # The timeline of each role also has the findings about the whole mission.
    findings = list(dict.fromkeys(all_findings))
    closest: list[PlannedDistance] = []
    offsets = _common_frame_offsets(mission, starts)
    if offsets is None:
        message = "The positions of the vehicles are unknown, so their separation is not checked."
        fix = "Choose a vehicle for each role, or give each role `start_ned_m` and the mission a home."
        findings.append(MissionFinding("separation_unknown", message, None, fix))
    else:
        for distance, finding in _separations(mission, blocks, block_starts_s, duration_s, starts, offsets):
            closest.append(distance)
            findings += [finding] if finding is not None else []
    return CompiledRoles(timelines, tuple(findings), duration_s, tuple(closest))


def _common_frame_offsets(mission: OffboardMission, starts: Mapping[str, Start]) -> dict[str, Vector3] | None:
    """For each role, the offset from its local frame to that of the first role [m]; None: unknown."""
    first_origin = next(iter(starts.values())).origin
    offsets: dict[str, Vector3] = {}
    without_origins = all(start.origin is None for start in starts.values())
    if without_origins and all(role.start_ned_m is not None for role in mission.roles.values()):
        return dict.fromkeys(starts, (0.0, 0.0, 0.0))
    for role, start in starts.items():
        if start.origin is None or first_origin is None:
            return None
        offsets[role] = start.origin.to_frame_of(first_origin, (0.0, 0.0, 0.0))
    positions = {
        tuple(a + b for a, b in zip(offsets[role], start.position_ned_m, strict=True))
        for role, start in starts.items()
    }
    # Two identical positions mean that the real start positions are not given.
    return offsets if len(positions) == len(starts) else None


@dataclass(frozen=True, slots=True)
class _PlacedSegment:
    segment: Segment
    start_ned_m: Vector3


def _blocks(timeline: Timeline) -> list[list[_PlacedSegment]]:
    """The segments of the longest path, divided at the meetings."""
    blocks: list[list[_PlacedSegment]] = [[]]
    for part in samples.parts(timeline, (0.0, 0.0, 0.0)):
        if not part.main:
            continue
        start_ned_m = part.start_ned_m
        for segment in part.timeline.segments:
            blocks[-1].append(_PlacedSegment(segment, start_ned_m))
            start_ned_m = segment.end_ned_m
            if isinstance(segment, WaitSegment) and segment.kind == "meet":
                blocks.append([])
    return blocks


def _planned_times(blocks: Mapping[str, list[list[_PlacedSegment]]]) -> tuple[list[float], float]:
    """Planned start of each block, and planned end of the last block [s]."""
    starts_s, now_s = list[float](), 0.0
    for simultaneous in zip(*blocks.values(), strict=True):
        starts_s.append(now_s)
        now_s += max(sum(each.segment.duration_s for each in block) for block in simultaneous)
    return starts_s, now_s


def _sample_positions(
    blocks: list[list[_PlacedSegment]], block_starts_s: list[float], times_s: Array, start: Vector3
) -> tuple[Array, list[tuple[float, str]]]:
    """Positions at the times (N, 3), in the role's local frame, and the start time and name of each step."""
    positions = np.tile(np.array(start), (len(times_s), 1))
    steps: list[tuple[float, str]] = []
    previous: Vector3 = start
    for block_start_s, block in zip(block_starts_s, blocks, strict=True):
        now_s = block_start_s
        for placed in block:
            segment = placed.segment
            steps.append((now_s, segment.place))
            first, end = np.searchsorted(times_s, (now_s, now_s + segment.duration_s)).tolist()
            within_s = times_s[first:end] - now_s
            path = samples.path_along(segment, previous, within_s)
            if len(path) != len(within_s) or path.shape[0] == 2:  # only start and end: interpolate
                fraction = within_s / max(segment.duration_s, 1e-9)
                start_ned_m, end_ned_m = np.array(previous), np.array(segment.end_ned_m)
                path = start_ned_m + fraction[:, None] * (end_ned_m - start_ned_m)
            positions[first:end] = path
            positions[end:] = segment.end_ned_m
            previous, now_s = segment.end_ned_m, now_s + segment.duration_s
    return positions, steps


def _separations(
    mission: OffboardMission,
    blocks: Mapping[str, list[list[_PlacedSegment]]],
    block_starts_s: list[float],
    duration_s: float,
    starts: Mapping[str, Start],
    offsets: Mapping[str, Vector3],
) -> Iterator[tuple[PlannedDistance, MissionFinding | None]]:
    """The smallest distance of each pair of roles, and a finding about the first time at which their vehicles
    are too close."""
    count = int(min(MAX_SAMPLES, 2 + duration_s / SPACING_S))
    times_s = np.linspace(0.0, max(duration_s, SPACING_S), count)
    tracks: dict[str, tuple[Array, Array]] = {}
    steps: dict[str, list[tuple[float, str]]] = {}
    for role in blocks:
        positions, steps[role] = _sample_positions(
            blocks[role], block_starts_s, times_s, starts[role].position_ned_m
        )
        tracks[role] = positions + np.array(offsets[role]), np.gradient(positions, times_s, axis=0)
    margin_m = planned_margin_m()
    required_m = mission.separation_m + margin_m
    for first_role, second_role in itertools.combinations(tracks, 2):
        separation_m = braking_separation_m(*tracks[first_role], *tracks[second_role], required_m)
        distance_m = np.linalg.norm(tracks[first_role][0] - tracks[second_role][0], axis=1)
        nearest = int(distance_m.argmin())
        distance = PlannedDistance(
            (first_role, second_role), round(float(distance_m[nearest]), 2), round(float(times_s[nearest]), 1)
        )
        too_close = np.flatnonzero(separation_m < required_m)
        if not len(too_close):
            yield distance, None
            continue
        begin = int(too_close[0])
        after = np.flatnonzero(separation_m[begin:] >= required_m)
        end = begin + int(after[0]) if len(after) else len(separation_m)
        worst = begin + int(separation_m[begin:end].argmin())
        t_s = float(times_s[worst])
        step, second_step = _step_at(steps[first_role], t_s), _step_at(steps[second_role], t_s)
        n, e, d = (tracks[first_role][0][worst] - np.array(offsets[first_role])).tolist()
        message = (
            f"As planned, after {t_s:.0f} s the vehicles of {first_role} and {second_role} come within "
            f"{separation_m[worst]:.1f} m of each other, including the distance to brake "
            f"({step}; {second_step}): "
            f"{first_role} at {n:.0f} m north, {e:.0f} m east, {d:.0f} m down. "
            f"The minimum is {mission.separation_m:g} m plus {margin_m:.1f} m of margin."
        )
        fix = "Move their paths apart, add a meeting before this step, or lower minimum_separation_m."
        yield distance, MissionFinding("separation", message, step, fix)


def _step_at(steps: list[tuple[float, str]], t_s: float) -> str:
    """The label of the step at a planned time; before the first step, the first step."""
    return next(place for begin_s, place in reversed(steps) if begin_s <= t_s or begin_s == steps[0][0])
