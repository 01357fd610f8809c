"""The predicted path of a vehicle that flies an offboard mission."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.offboard import samples
from missions.offboard.segments import WaitSegment
from missions.offboard.timeline import Timeline
from missions.runner.course import flown_by_px4
from missions.runner.flight import Flight
from missions.traffic.path import MISSION_ACCURACY, PredictedLeg, PredictedPath, path_along_legs

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
