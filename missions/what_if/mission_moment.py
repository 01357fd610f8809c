"""Finds where in its offboard mission a logged vehicle was, from the setpoints that it followed. Imports no
simulator.

The mission is compiled again, from each place where it may have begun. Then mission time is aligned with the
log: it advances as planned, more slowly in pauses and waits, or jumps forward where a step was skipped.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from missions.errors import PlanError
from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.findings import CODES
from missions.offboard.positions import Start
from missions.offboard.segments import CurveSegment, HoldSegment, Segment, TableSegment, WaitSegment
from missions.offboard.state import MissionVehicle
from missions.offboard.timeline import Timeline
from missions.runner.course import Course, flown_by_px4
from missions.runner.flight import ON_PATH_M
from missions.runner.runner import LOW_BATTERY_SHARE, Runner
from missions.what_if.changed_step import StepChange, changed_mission, number_of
from missions.what_if.flight import STREAM_STEP_S, LoggedStream, MissionBegin, NotFlyable

Values = NDArray[np.float64]

NEAR_M = 1.5
"""Largest distance of the logged setpoint from the mission's at the moment."""
FAR_M = 5.0
"""A logged setpoint is at most taken as this far from the mission's: approaches and detours are not of it."""
SKIP_M = 15.0
"""Cost of a jump in the mission; an error of `FAR_M` for three samples costs as much."""
UNEVEN_M = 0.1
"""Cost of a step of mission time that is no step of the log's."""
MAX_PATHS = 32
MAX_WORK = 1e8
"""So many moments of the log and the mission are compared at most: some seconds of computing."""
STANDS_M_S = 0.3
"""A planned speed below it says nothing of the rate of mission time."""
FINE_S, MAX_FINE = 0.02, 20_000
OTHER_ROUND_M = 2.0
"""Cost of the share of a step by which two of its places are apart: the same one of equal circles goes on."""
NOT_FLOWN = ("step_invalid", "duration_too_short", "estimate_missing")
"""Findings of a step that is left out."""
_PATHS = (CurveSegment, TableSegment)


@dataclass(frozen=True, slots=True)
class MissionMoment:
    """A moment of a compiled mission, at which a vehicle flies on."""

    timeline: Timeline
    choices: tuple[bool, ...]
    """Of each branch before: whether its condition was fulfilled."""
    index: int
    """Index of the segment."""
    t_s: float
    """Time since its start."""
    rate: float | None
    """Rate of mission time; None: the vehicle is not on the path and has to approach it."""

    def segments(self) -> list[Segment]:
        """Those of the course up to the next decision."""
        return self._course().segments

    def _course(self) -> Course:
        course = Course(self.timeline)
        for fulfilled in self.choices:
            course.choose(fulfilled)
        return course

    def places_ahead(self) -> frozenset[str]:
        """The steps from the moment on, in all branches."""
        rest = self._course().remaining_timeline(self.index)
        return frozenset(each.place for _, segments in _paths(rest) for each in segments)


class FlownMission:
    """An offboard mission at a logged moment.

    Args:
        mission: the flown mission.
        stream: the setpoints that the vehicle followed.
        parameters: of the vehicle then.
        home_alt_amsl_m: altitude of its home.

    Raises:
        NotFlyable: it is a mission of several vehicles, or not the one whose setpoints are in the log.
    """

    def __init__(
        self,
        mission: OffboardMission,
        stream: LoggedStream,
        parameters: Mapping[str, float],
        home_alt_amsl_m: float,
    ) -> None:
        if mission.roles:
            text = (
                "The mission is for several vehicles, which wait for each other; it cannot be flown on alone."
            )
            raise NotFlyable(text, "plan")
        self._mission, self._stream, self._parameters = mission, stream, parameters
        self._home_alt_amsl_m = home_alt_amsl_m
        self._vehicle = MissionVehicle.from_parameters(parameters)
        self._start, self.moment = self._found()
        self.notes: list[str] = []
        """What is not flown again, and what the checks of the changed mission find."""
        if self.moment.timeline.avoidance is not None:
            self.notes.append("The mission avoids obstacles; there are none here, so nothing is avoided.")

    def changed(self, change: StepChange) -> MissionMoment:
        """The moment with a changed step.

        Raises:
            NotFlyable: there is no such step, it was flown before, or it cannot be flown with the change.
        """
        mission, now = changed_mission(self._mission, change), self.moment
        if not any(place.startswith(change.place) for place in now.places_ahead()):
            flown = number_of(now.segments()[now.index].place)
            text = f"Step {change.number} was flown before; the vehicle flew step {flown}."
            raise NotFlyable(text, "step")
        timeline = self._compiled(mission, self._start)
        new = [each for each in timeline.findings if each not in now.timeline.findings]
        errors = [each for each in new if CODES[each.code][0] == "error"]
        changed = replace(now, timeline=timeline)
        if not _step_of(changed.segments(), now.segments()[now.index]) or any(
            each.step == change.place and each.code in NOT_FLOWN for each in errors
        ):
            reason = f": {errors[0].message}" if errors else "."
            raise NotFlyable(f"Step {change.number} cannot be flown with the change{reason}", "step")
        for each in errors:
            place = number_of(each.step or change.place)
            self.notes.append(f"With the change, step {place}: {each.message}")
        return self._joined(changed)

    def runner(self, moment: MissionMoment, parameters: Mapping[str, float]) -> Runner:
        """The runner that flies on from a moment, for a vehicle with these parameters."""
        motion, limits = self._vehicle.motion_within(self._mission.limits), self._vehicle.limits
        speed_m_s = min(motion.speed_m_s, self._mission.limits.speed_m_s or limits.vehicle.cruise_m_s)
        low = parameters.get("BAT_LOW_THR", LOW_BATTERY_SHARE)
        runner = Runner(moment.timeline, self._mission.name, replace(motion, speed_m_s=speed_m_s), low)
        for fulfilled in moment.choices:
            runner.flight.course.choose(fulfilled)
        runner.flight.move_to(moment.index)
        runner.flight.t_s, runner.flight.begin_rate = moment.t_s, moment.rate
        return runner

    def _compiled(self, mission: OffboardMission, begin: MissionBegin) -> Timeline:
        start = Start(
            begin.position_ned_m, begin.yaw_ned_rad, self._stream.origin, self._home_alt_amsl_m, begin.in_air
        )
        try:
            return compile_mission(mission, self._vehicle, start)
        except PlanError as error:
            raise NotFlyable(str(error), "plan") from error

    def _found(self) -> tuple[MissionBegin, MissionMoment]:
        """The begin and the moment whose setpoints are nearest to the logged ones."""
        kinds = [step.step for step in self._mission.steps if step.step in ("take_off", "land")]
        in_air = kinds[:1] != ["take_off"]
        best: tuple[float, MissionBegin, MissionMoment] | None = None
        begins = [each for each in self._stream.begins if each.in_air == in_air]
        for begin in begins:
            timeline = self._compiled(self._mission, begin)
            paths = list(itertools.islice(_paths(timeline), MAX_PATHS + 1))
            if len(paths) > MAX_PATHS:
                raise NotFlyable("The mission has too many branches to find its moment in the log.", "plan")
            work = MAX_WORK / (len(begins) * len(paths))
            for choices, segments in paths:
                found = _aligned(segments, self._stream, begin.t_s, work)
                if found is not None and (best is None or found.cost_m < best[0]):
                    index, t_s = _refined(segments, found, self._stream)
                    moment = MissionMoment(timeline, choices, index, t_s, None)
                    best = found.cost_m, begin, moment
        if best is None or self._away_m(best[2]) > NEAR_M:
            text = (
                f"The logged setpoints are then not those of the mission “{self._mission.name}”: it is "
                "another mission, it was changed since, or the vehicle was away from its path."
            )
            raise NotFlyable(text, "plan")
        _, begin, moment = best
        return begin, self._with_rate(moment)

    def _away_m(self, moment: MissionMoment) -> float:
        """Distance of the logged setpoint from the mission's at a moment, at most FAR_M."""
        segment = moment.segments()[moment.index]
        here = _positions(segment, np.array([moment.t_s]))
        return float(_errors_m(here, self._stream.setpoint_ned_m[-1])[0])

    def _with_rate(self, moment: MissionMoment) -> MissionMoment:
        """With the choices before the moment only, and the rate that the logged velocity says."""
        course, choices = Course(moment.timeline), list[bool]()
        for fulfilled in moment.choices:
            if moment.index < len(course.segments):
                break
            course.choose(fulfilled)
            choices.append(fulfilled)
        planned = getattr(course.segments[moment.index].at(moment.t_s), "velocity_ned_m_s", None)
        planned_m_s = 0.0 if planned is None else math.hypot(*(each or 0.0 for each in planned))
        logged_m_s = math.hypot(*self._stream.velocity_ned_m_s)
        rate = 1.0
        if planned_m_s >= STANDS_M_S and math.isfinite(logged_m_s):
            rate = min(1.0, logged_m_s / planned_m_s)
        return replace(moment, choices=tuple(choices), rate=1.0 if rate > 0.9 else rate)

    def _joined(self, moment: MissionMoment) -> MissionMoment:
        """Where the changed mission goes on: on its path, if that passes the same place in the same step;
        otherwise the vehicle approaches the nearest place of it."""
        now, before = self.moment, self.moment.segments()
        here = _positions(before[now.index], np.array([now.t_s]))[0]
        own, new = _step_of(before, before[now.index]), _step_of(moment.segments(), before[now.index])
        same = new.get(now.index)
        if same is not None and np.allclose(_positions(same, np.array([now.t_s]))[0], here, equal_nan=True):
            return replace(moment, t_s=min(now.t_s, same.duration_s))
        if np.isnan(here).any():
            return replace(moment, index=min(new), t_s=0.0)
        flown_s = sum(segment.duration_s for index, segment in own.items() if index < now.index) + now.t_s
        share = flown_s / max(FINE_S, sum(each.duration_s for each in own.values()))
        total_s, passed_s = max(FINE_S, sum(each.duration_s for each in new.values())), 0.0
        best = (math.inf, 0.0, 0, 0.0)
        for index, segment in new.items():
            t_s = np.linspace(0.0, segment.duration_s, 2 + min(MAX_FINE, int(segment.duration_s / FINE_S)))
            distance_m = np.nan_to_num(np.linalg.norm(_positions(segment, t_s) - here, axis=1), nan=np.inf)
            elsewhere_m = OTHER_ROUND_M * np.abs((passed_s + t_s) / total_s - share)
            n = int((distance_m + elsewhere_m).argmin())
            best = min(
                best, (float(distance_m[n] + elsewhere_m[n]), float(distance_m[n]), index, float(t_s[n]))
            )
            passed_s += segment.duration_s
        _, distance_m, index, t_s = best
        return replace(moment, index=index, t_s=t_s, rate=now.rate if distance_m <= ON_PATH_M else None)


def _step_of(segments: list[Segment], like: Segment) -> dict[int, Segment]:
    """The segments of the executed step of `like`, by index."""
    return {n: each for n, each in enumerate(segments) if each.executed_step == like.executed_step}


def _paths(
    timeline: Timeline, choices: tuple[bool, ...] = (), before: tuple[Segment, ...] = ()
) -> Iterator[tuple[tuple[bool, ...], tuple[Segment, ...]]]:
    """The ways through all branches: what was chosen, and the segments."""
    segments = (*before, *timeline.segments)
    if timeline.then is None or timeline.otherwise is None:
        yield choices, segments
        return
    yield from _paths(timeline.then, (*choices, True), segments)
    yield from _paths(timeline.otherwise, (*choices, False), segments)


@dataclass(frozen=True, slots=True)
class _Aligned:
    cost_m: float
    index: int
    t_s: float


def _aligned(
    segments: tuple[Segment, ...], stream: LoggedStream, begin_s: float, work: float
) -> _Aligned | None:
    """Where in these segments the log ends; None: none of them is flown by setpoints.

    Args:
        segments: one way through the mission.
        stream: the logged setpoints.
        begin_s: begin of the mission [s since the log's start].
        work: so many comparisons are made at most; of a long log fewer samples are taken then.
    """
    grid = _grid(segments)
    if grid is None:
        return None
    position_ned_m, index, t_s, stays_m = grid
    every = math.ceil(len(stream.t_s) * len(index) / work)
    logged = stream.setpoint_ned_m[::-every][::-1]
    during = stream.t_s[::-every][::-1] >= begin_s - STREAM_STEP_S
    advances = {every * quarter // 4 for quarter in (1, 2, 3, 8, 12)} | {every - 1, every, every + 1}
    cost = np.full(len(index), SKIP_M)
    cost[0] = 0.0
    for target in logged[during]:
        reached = cost + stays_m
        for steps in advances - {0}:
            advanced = cost[:-steps] + UNEVEN_M * abs(steps - every) / every
            np.minimum(reached[steps:], advanced, out=reached[steps:])
        np.minimum(reached, np.minimum.accumulate(cost) + SKIP_M, out=reached)
        cost = reached + _errors_m(position_ned_m, target)
    last = int(cost.argmin())
    unexplained_m = FAR_M * float(np.count_nonzero(~during))
    return _Aligned(every * (float(cost[last]) + unexplained_m), int(index[last]), float(t_s[last]))


def _grid(segments: tuple[Segment, ...]) -> tuple[Values, NDArray[np.int64], Values, Values] | None:
    """Moments of the mission, each `STREAM_STEP_S`: (M, 3) positions (NaN: none), segments, times in them,
    and the cost of staying there."""
    positions, indices, times, stays = list[Values](), list[Values](), list[Values](), list[Values]()
    for index, segment in enumerate(segments):
        if flown_by_px4(segment):
            continue
        waits = isinstance(segment, WaitSegment)
        t_s = np.zeros(1) if waits else np.arange(0.0, max(segment.duration_s, FINE_S), STREAM_STEP_S)
        positions.append(_positions(segment, t_s))
        indices.append(np.full(len(t_s), index))
        times.append(t_s)
        stays.append(np.full(len(t_s), 0.0 if waits else UNEVEN_M))
    if not positions:
        return None
    return (
        np.concatenate(positions),
        np.concatenate(indices).astype(np.int64),
        np.concatenate(times),
        np.concatenate(stays),
    )


def _errors_m(positions: Values, target: Values) -> Values:
    """(M,) distances of a logged setpoint, at most FAR_M; without a position on both sides none."""
    if not np.isfinite(target).all():
        return np.where(np.isnan(positions[:, 0]), 0.0, FAR_M)
    distance_m = np.linalg.norm(positions - target, axis=1)
    return np.where(np.isnan(distance_m), FAR_M, np.minimum(distance_m, FAR_M))


def _refined(segments: tuple[Segment, ...], found: _Aligned, stream: LoggedStream) -> tuple[int, float]:
    """The nearest moment beside the one of the grid."""
    segment, target = segments[found.index], stream.setpoint_ned_m[-1]
    if not isinstance(segment, _PATHS) or not np.isfinite(target).all():
        return found.index, found.t_s
    low, high = max(0.0, found.t_s - STREAM_STEP_S), min(segment.duration_s, found.t_s + STREAM_STEP_S)
    times = np.arange(low, high, FINE_S)
    if not len(times):
        return found.index, found.t_s
    distance_m = np.linalg.norm(_positions(segment, times) - target, axis=1)
    return found.index, float(times[int(distance_m.argmin())])


def _positions(segment: Segment, t_s: Values) -> Values:
    """(N, 3) position setpoints; NaN: the segment has none."""
    if isinstance(segment, CurveSegment):
        return segment.curve.sample(t_s).position_ned_m
    if isinstance(segment, TableSegment):
        return segment.path.sample(t_s)[0]
    still = segment.end_ned_m if isinstance(segment, HoldSegment | WaitSegment) else (math.nan,) * 3
    return np.tile(np.array(still), (len(t_s), 1))
