"""Samples a compiled mission for display before the flight: segments as lines, and durations of steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3
from missions.offboard.segments import CurveSegment, Segment, TableSegment, VelocitySegment, WaitSegment
from missions.offboard.timeline import Timeline

SPACING_S = 0.5
MAX_POINTS = 3000
"""Maximum number of points of all segments together; longer missions are sampled less often."""
MIN_POINTS = 2
"""Minimum number of points of one segment."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One segment as a line."""

    place: str
    """The step: "step 3", "step 4.2"."""
    title: str
    """The step's name if it has one, otherwise its kind."""
    start_s: float
    """Planned start time."""
    duration_s: float
    main: bool
    """Whether the leg is on the longest path through the branches."""
    points: tuple[tuple[float, float, float, float], ...]
    """Time since the start of the leg [s], and north, east, down [m]."""
    role: str | None = None
    """The role that flies the leg; null: the mission has one vehicle."""


@dataclass(frozen=True, slots=True)
class StepTime:
    """Duration of one step on the longest path through the mission, summed over all repeats."""

    place: str
    start_s: float
    """Planned start time of the step; of a repeated step, the start of its first round."""
    duration_s: float
    length_m: float
    photos: int


def path_along(segment: Segment, start_ned_m: Vector3, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions along a segment, (N, 3), in the local frame [m]; for a segment without a path, its start and
    end."""
    if isinstance(segment, CurveSegment):
        return segment.curve.sample(times_s).position_ned_m
    if isinstance(segment, TableSegment):
        return segment.path.sample(times_s)[0]
    if isinstance(segment, VelocitySegment):
        return segment.line.sample(times_s).position_ned_m
    return np.array([start_ned_m, segment.end_ned_m])


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a timeline, from one decision to the next."""

    timeline: Timeline
    start_s: float
    """Planned start time."""
    start_ned_m: Vector3
    """Start position."""
    main: bool
    """Whether the part is on the longest path."""


def parts(timeline: Timeline, start_ned_m: Vector3) -> Iterator[Part]:
    """All parts of a timeline; each part comes before its continuations."""
    yield from _parts(Part(timeline, 0.0, start_ned_m, main=True))


def _parts(part: Part) -> Iterator[Part]:
    yield part
    timeline = part.timeline
    if timeline.then is None or timeline.otherwise is None:
        return
    end_s = part.start_s + timeline.own_duration_s
    end_ned_m = timeline.segments[-1].end_ned_m if timeline.segments else part.start_ned_m
    then_is_longer = timeline.then.duration_s >= timeline.otherwise.duration_s
    yield from _parts(Part(timeline.then, end_s, end_ned_m, main=part.main and then_is_longer))
    yield from _parts(Part(timeline.otherwise, end_s, end_ned_m, main=part.main and not then_is_longer))


def legs(timeline: Timeline, start_ned_m: Vector3, role: str | None = None) -> tuple[Leg, ...]:
    """The legs of all segments, in order; for a branch, the legs of `then` and of `otherwise`."""
    all_parts = list(parts(timeline, start_ned_m))
    point_count = sum(
        MIN_POINTS + each.duration_s / SPACING_S for part in all_parts for each in part.timeline.segments
    )
    spacing_s = SPACING_S * max(1.0, point_count / MAX_POINTS)
    result: list[Leg] = []
    for part in all_parts:
        position_ned_m = part.start_ned_m
        for start_s, segment in zip(part.timeline.starts_s, part.timeline.segments, strict=True):
            times = np.linspace(0.0, segment.duration_s, MIN_POINTS + int(segment.duration_s / spacing_s))
            path = path_along(segment, position_ned_m, times)
            if len(path) != len(times):
                times = np.array([0.0, segment.duration_s])
            rows = np.round(np.column_stack((times, path)), 3).tolist()
            planned_s = part.start_s + start_s
            result.append(
                Leg(
                    segment.place, segment.title, planned_s, segment.duration_s, part.main,
                    tuple((t, n, e, d) for t, n, e, d in rows), role,
                )
            )  # fmt: skip
            position_ned_m = segment.end_ned_m
    return tuple(result)


def step_times(timeline: Timeline) -> tuple[StepTime, ...]:
    """The duration of each step on the longest path, in flight order."""
    steps: dict[str, StepTime] = {}
    for part in parts(timeline, (0.0, 0.0, 0.0)):
        if not part.main:
            continue
        for start_s, segment in zip(part.timeline.starts_s, part.timeline.segments, strict=True):
            earlier = steps.get(segment.place) or StepTime(segment.place, part.start_s + start_s, 0.0, 0.0, 0)
            steps[segment.place] = StepTime(
                segment.place,
                earlier.start_s,
                earlier.duration_s + segment.duration_s,
                earlier.length_m + segment.length_m,
                earlier.photos + sum(event.kind == "photo" for event in segment.events),
            )
    return tuple(steps.values())


def setpoint_time_s(timeline: Timeline) -> float:
    """Planned time of the steps that are flown by setpoints, on the longest path [s]. PX4's own take-off and
    landing and steps on the ground do not count."""
    segments = [
        each for part in parts(timeline, (0.0, 0.0, 0.0)) if part.main for each in part.timeline.segments
    ]
    kinds = [each.kind if isinstance(each, WaitSegment) else None for each in segments]
    # A mission starts in the air unless a take-off is its first take-off or landing.
    in_air = next((kind for kind in kinds if kind in ("take_off", "land")), "land") == "land"
    flown_s = 0.0
    for segment, kind in zip(segments, kinds, strict=True):
        if kind in ("take_off", "land"):
            in_air = kind == "take_off"
        elif in_air:
            flown_s += segment.duration_s
    return flown_s
