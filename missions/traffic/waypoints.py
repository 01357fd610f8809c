"""The predicted path of a vehicle that flies a waypoint plan, or will fly it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.items import Land, ReturnHome
from missions.offboard import samples
from missions.offboard.segments import WaitSegment
from missions.offboard.timeline import Timeline
from missions.plan import Plan
from missions.route import route_of
from missions.runner.course import flown_by_px4
from missions.runner.flight import Flight
from missions.traffic.path import (
    DRY_RUN_ACCURACY,
    ESTIMATE_ACCURACY,
    MISSION_ACCURACY,
    PredictedLeg,
    PredictedPath,
    path_along_legs,
    straight_leg,
)
from missions.waypoints.planned import PlannedPasses


def ends_with_landing(plan: Plan) -> bool:
    """Whether the plan ends with a landing or a return."""
    steps = route_of(plan).steps
    return bool(steps) and isinstance(steps[-1].item, Land | ReturnHome)


def predict_plan(
    vehicle: str,
    origin: LocalOrigin,
    planned: PlannedPasses,
    *,
    ends_in_air: bool,
    index: int = 0,
    t_s: float = 0.0,
    current_position_ned_m: Vector3 | None = None,
    speed_m_s: float = 5.0,
) -> PredictedPath | None:
    """The remaining path of a planned flight; None: no pass remains, or the passes have no path.

    Args:
        vehicle: id of the vehicle.
        origin: origin of the local frame of `planned` and `current_position_ned_m`.
        planned: the whole planned flight.
        ends_in_air: whether the vehicle stays in the air at the end of the plan.
        index: index of the pass that is flown now.
        t_s: planned time of the vehicle's position.
        current_position_ned_m: current position of the vehicle if it is not on the planned path. The vehicle
            then flies straight to the end of the current pass. None: the vehicle is on the path.
        speed_m_s: speed on this straight line.
    """
    remaining = planned.passes[index:]
    if not remaining:
        return None
    legs: list[PredictedLeg] = []
    if current_position_ned_m is not None:
        first_leg = remaining[0].leg
        _, north, east, down = first_leg.points[-1]
        straight = straight_leg(first_leg.place, current_position_ned_m, (north, east, down), speed_m_s)
        legs.append(straight)
        # the remaining path begins at the end of the straight line
        t_s, remaining = first_leg.start_s + first_leg.duration_s - straight.leg.duration_s, remaining[1:]
    legs += [PredictedLeg(replace(each.leg, start_s=each.leg.start_s - t_s)) for each in remaining]
    accuracy = DRY_RUN_ACCURACY if planned.source == "dry_run" else ESTIMATE_ACCURACY
    path = path_along_legs(vehicle, origin, legs, accuracy, ends_in_air=ends_in_air)
    # a plan that repeats without end can be anywhere on its path at any later time
    return path.without_latest_times() if path is not None and planned.duration_s is None else path


OPEN_WAITS = ("person", "condition", "meet")
"""Waits whose duration is not known."""


def predict_mission(
    vehicle: str, origin: LocalOrigin, flight: Flight, position_ned_m: Vector3
) -> Callable[[], PredictedPath | None]:
    """Reads a mission in flight, and returns a function that predicts its remaining path, in any thread: with
    both continuations of each branch; None: no segment remains.

    Args:
        vehicle: id of the vehicle.
        origin: origin of the vehicle's local frame.
        flight: the mission in flight.
        position_ned_m: the vehicle's current position, which counts as the start of the current segment.
    """
    remaining, flown_s = flight.course.remaining_timeline(flight.index), flight.t_s
    paused = flight.paused

    def predict() -> PredictedPath | None:
        path = predict_timeline(vehicle, origin, remaining, position_ned_m, flown_s)
        # a paused mission continues at an unknown time
        return path.without_latest_times() if path is not None and paused else path

    return predict


def predict_timeline(
    vehicle: str, origin: LocalOrigin, remaining: Timeline, position_ned_m: Vector3, flown_s: float = 0.0
) -> PredictedPath | None:
    """The path of a timeline, with both continuations of each branch; None: the timeline is empty.

    Args:
        vehicle: id of the vehicle.
        origin: origin of the vehicle's local frame.
        remaining: a compiled mission, or the remaining part of a mission.
        position_ned_m: position at which the first segment begins.
        flown_s: time since the start of the first segment.
    """
    segments = [each for part in samples.parts(remaining, position_ned_m) for each in part.timeline.segments]
    accuracy = MISSION_ACCURACY
    if segments:
        flown_s = min(flown_s, segments[0].duration_s)
    if segments and flown_by_px4(segments[0]):  # the progress of a take-off or landing is not known
        accuracy = replace(accuracy, initial_s=accuracy.initial_s + segments[0].duration_s)
    legs = [
        PredictedLeg(
            replace(leg, start_s=leg.start_s - flown_s),
            isinstance(segment, WaitSegment) and segment.kind in OPEN_WAITS,
        )
        for leg, segment in zip(samples.legs(remaining, position_ned_m), segments, strict=True)
    ]
    if not legs:
        return None
    ends_with_landing = any(isinstance(each, WaitSegment) and each.kind == "land" for each in segments[-1:])
    path = path_along_legs(vehicle, origin, legs, accuracy, ends_in_air=not ends_with_landing)
    # a branch is decided when its values are known
    return path.without_latest_times() if path is not None and remaining.decision is not None else path
