"""The predicted path of a vehicle that flies an offboard mission."""

from __future__ import annotations

from dataclasses import replace

from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.offboard import samples
from missions.offboard.segments import WaitSegment
from missions.offboard.timeline import Timeline
from missions.runner.course import flown_by_px4
from missions.runner.flight import Flight
from missions.traffic.path import BY_MISSION, PredictedLeg, PredictedPath, along_legs

OPEN_WAITS = ("person", "condition", "meet")
"""Waits whose time is not known."""


def predict_mission(vehicle: str, origin: LocalOrigin, flight: Flight, here: Vector3) -> PredictedPath | None:
    """The rest of a mission, with both continuations of each branch; None: nothing is left.

    Args:
        vehicle: id of the vehicle.
        origin: origin of its local frame.
        flight: the mission in flight.
        here: the vehicle's position, where the current segment began or later.
    """
    path = predict_timeline(vehicle, origin, flight.course.remaining_timeline(flight.index), here, flight.t_s)
    # a paused mission continues at an unknown time
    return path.at_any_time() if path is not None and flight.paused else path


def predict_timeline(
    vehicle: str, origin: LocalOrigin, rest: Timeline, here: Vector3, flown_s: float = 0.0
) -> PredictedPath | None:
    """The path of a timeline, with both continuations of each branch; None: it is empty.

    Args:
        vehicle: id of the vehicle.
        origin: origin of its local frame.
        rest: a compiled mission, or the rest of one.
        here: where its first segment begins.
        flown_s: time since the start of the first segment.
    """
    segments = [each for part in samples.parts(rest, here) for each in part.timeline.segments]
    accuracy = BY_MISSION
    if segments:
        flown_s = min(flown_s, segments[0].duration_s)
    if segments and flown_by_px4(segments[0]):  # the progress of a take-off or landing is not known
        accuracy = replace(accuracy, at_once_s=accuracy.at_once_s + segments[0].duration_s)
    legs = [
        PredictedLeg(
            replace(leg, start_s=leg.start_s - flown_s),
            isinstance(segment, WaitSegment) and segment.kind in OPEN_WAITS,
        )
        for leg, segment in zip(samples.legs(rest, here), segments, strict=True)
    ]
    if not legs:
        return None
    lands = any(isinstance(each, WaitSegment) and each.kind == "land" for each in segments[-1:])
    path = along_legs(vehicle, origin, legs, accuracy, ends_in_air=not lands)
    # a branch is decided when its values are known
    return path.at_any_time() if path is not None and rest.decision is not None else path
