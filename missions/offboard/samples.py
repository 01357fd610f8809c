"""A compiled mission sampled for drawing before the flight: its segments as lines, and the duration of its
steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3
from missions.offboard.segments import CurveSegment, Segment, TableSegment, VelocitySegment
from missions.offboard.timeline import Timeline

SPACING_S = 0.5
MAX_POINTS = 3000
"""Of all segments together; more of them are sampled farther apart."""
LEAST_POINTS = 2
"""Of one segment."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One segment as a line."""

    place: str
    """Which step: "step 3", "step 4.2"."""
    title: str
    """For people: the step's name, or what it is."""
    start_s: float
    """By plan."""
    duration_s: float
    main: bool
    """On the way that takes longest; false: after a branch, on the other one."""
    points: tuple[tuple[float, float, float, float], ...]
    """t_s since the leg began, and north, east, down of the local origin [m]."""


@dataclass(frozen=True, slots=True)
class StepTime:
    """The duration of one step on the longest path through the mission, all repeats together."""

    place: str
    start_s: float
    """When it begins for the first time, by plan."""
    duration_s: float
    length_m: float
    photos: int


def path_along(segment: Segment, before_ned_m: Vector3, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places along a segment, (N, 3) [m]; of one without a path, where it begins and where it ends."""
    if isinstance(segment, CurveSegment):
        return segment.curve.many(times_s).position_ned_m
    if isinstance(segment, TableSegment):
        return segment.path.many(times_s)[0]
    if isinstance(segment, VelocitySegment):
        return segment.line.many(times_s).position_ned_m
    return np.array([before_ned_m, segment.end_ned_m])


@dataclass(frozen=True, slots=True)
class Way:
    """A part of a timeline: from one decision to the next."""

    timeline: Timeline
    start_s: float
    """When it begins, by plan."""
    before_ned_m: Vector3
    """Where it begins."""
    main: bool
    """On the way that takes longest."""


def ways(timeline: Timeline, start_ned_m: Vector3) -> Iterator[Way]:
    """Each part of a timeline, what follows a decision after it."""
    yield from _ways(Way(timeline, 0.0, start_ned_m, main=True))


def _ways(way: Way) -> Iterator[Way]:
    yield way
    part = way.timeline
    if part.then is None or part.otherwise is None:
        return
    after_s = way.start_s + part.own_duration_s
    end = part.segments[-1].end_ned_m if part.segments else way.before_ned_m
    then_first = part.then.duration_s >= part.otherwise.duration_s
    yield from _ways(Way(part.then, after_s, end, main=way.main and then_first))
    yield from _ways(Way(part.otherwise, after_s, end, main=way.main and not then_first))


def legs(timeline: Timeline, start_ned_m: Vector3) -> tuple[Leg, ...]:
    """All segments as lines, in order; what follows a branch one way after the other."""
    parts = list(ways(timeline, start_ned_m))
    wanted = sum(
        LEAST_POINTS + each.duration_s / SPACING_S for way in parts for each in way.timeline.segments
    )
    spacing_s = SPACING_S * max(1.0, wanted / MAX_POINTS)
    found: list[Leg] = []
    for way in parts:
        before = way.before_ned_m
        for start_s, segment in zip(way.timeline.starts_s, way.timeline.segments, strict=True):
            times = np.linspace(0.0, segment.duration_s, LEAST_POINTS + int(segment.duration_s / spacing_s))
            path = path_along(segment, before, times)
            if len(path) != len(times):
                times = np.array([0.0, segment.duration_s])
            rows = np.round(np.column_stack((times, path)), 3).tolist()
            begins_s = way.start_s + start_s
            found.append(
                Leg(
                    segment.place, segment.title, begins_s, segment.duration_s, way.main,
                    tuple((t, n, e, d) for t, n, e, d in rows),
                )
            )  # fmt: skip
            before = segment.end_ned_m
    return tuple(found)


def step_times(timeline: Timeline) -> tuple[StepTime, ...]:
    """Of each step on the way that takes longest, in the order in which they begin."""
    found: dict[str, StepTime] = {}
    for way in ways(timeline, (0.0, 0.0, 0.0)):
        if not way.main:
            continue
        for start_s, segment in zip(way.timeline.starts_s, way.timeline.segments, strict=True):
            old = found.get(segment.place) or StepTime(segment.place, way.start_s + start_s, 0.0, 0.0, 0)
            found[segment.place] = StepTime(
                segment.place,
                old.start_s,
                old.duration_s + segment.duration_s,
                old.length_m + segment.length_m,
                old.photos + sum(event.kind == "photo" for event in segment.events),
            )
    return tuple(found.values())
