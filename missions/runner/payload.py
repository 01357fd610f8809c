"""Picture and gimbal requests during the flight."""

from __future__ import annotations

import math

from missions.frames import wrap_pi
from missions.runner.flight import Flight
from missions.runner.requests import Photo, PointGimbal, ReleaseGimbal, Request
from missions.runner.script import Played
from missions.setpoints import Position

LEAD_S = 0.05
"""Half of the update period, so that pictures are early and late equally often."""
UNCHANGED_RAD = math.radians(0.2)
REPEAT_S = 1.0
"""Period in which an unchanged gimbal request is repeated, because a request may be lost."""


def photos_due(flight: Flight) -> list[Request]:
    """Requests for the pictures up to the current mission time that have not been taken."""
    requests: list[Request] = []
    segments = flight.course.segments
    while flight.photo_index < len(segments) and flight.photo_index <= flight.index:
        is_current = flight.photo_index == flight.index
        photos = [e for e in segments[flight.photo_index].events if e.kind == "photo"]
        due = sum(e.t_s <= flight.t_s + LEAD_S for e in photos) if is_current else len(photos)
        requests += [Photo(e.component) for e in photos[flight.photos_taken : due]]
        flight.photos_taken = max(due, flight.photos_taken)
        if is_current:
            break
        flight.photo_index, flight.photos_taken = flight.photo_index + 1, 0
    return requests


def point_gimbal(flight: Flight, played: Played, now_s: float) -> list[Request]:
    """The gimbal request of the current track, if it has changed or must be repeated."""
    segment = flight.segment
    if segment is None:
        return []
    if segment.gimbal is None:
        return release_gimbal(flight)
    setpoint = segment.at(flight.t_s)
    if played.position_ned_m is not None and (played.approaching or played.diverted):
        setpoint = Position(played.position_ned_m, getattr(setpoint, "yaw_ned_rad", None))
    pitch_rad, yaw_rad = segment.gimbal.at(flight.t_s, setpoint, segment.end_yaw_ned_rad)
    if flight.pointed is not None:
        pitch_before_rad, yaw_before_rad, at_s = flight.pointed
        turned_rad = max(abs(pitch_rad - pitch_before_rad), abs(wrap_pi(yaw_rad - yaw_before_rad)))
        if turned_rad < UNCHANGED_RAD and now_s - at_s < REPEAT_S:
            return []
    flight.pointed = (pitch_rad, yaw_rad, now_s)
    return [PointGimbal(pitch_rad, yaw_rad)]


def release_gimbal(flight: Flight) -> list[Request]:
    """Releases the gimbal if the mission has pointed it."""
    if flight.pointed is None:
        return []
    flight.pointed = None
    return [ReleaseGimbal()]
