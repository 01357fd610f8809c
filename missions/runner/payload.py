"""Photo and gimbal requests during the flight."""

from __future__ import annotations

import math

from missions.frames import wrap_pi
from missions.runner.flight import Flight
from missions.runner.requests import Photo, PointGimbal, ReleaseGimbal, Request
from missions.runner.script import ScriptProgress
from missions.setpoints import Position

LEAD_S = 0.05
"""Half of the update period: with this lead, photos are early as often as late."""
UNCHANGED_RAD = math.radians(0.2)
"""A gimbal direction that differs less from the last request counts as unchanged."""
REPEAT_S = 1.0
"""Period in which an unchanged gimbal request is repeated, because a request may be lost."""


def photos_due(flight: Flight) -> list[Request]:
    """Requests for the photos that are due at the current mission time and not yet taken."""
    requests: list[Request] = []
    segments = flight.course.segments
    while flight.photo_index < len(segments) and flight.photo_index <= flight.index:
        is_current = flight.photo_index == flight.index
        photos = [e for e in segments[flight.photo_index].events if e.kind == "photo"]
        due_count = sum(e.t_s <= flight.t_s + LEAD_S for e in photos) if is_current else len(photos)
        requests += [Photo(e.component) for e in photos[flight.photos_taken : due_count]]
        flight.photos_taken = max(due_count, flight.photos_taken)
        if is_current:
            break
        flight.photo_index, flight.photos_taken = flight.photo_index + 1, 0
    return requests


def point_gimbal(flight: Flight, progress: ScriptProgress, now_s: float) -> list[Request]:
    """The gimbal request of the current track, if it has changed or must be repeated."""
    segment = flight.segment
    if segment is None:
        return []
    if segment.gimbal is None:
        return release_gimbal(flight)
    setpoint = segment.at(flight.t_s)
    if progress.position_ned_m is not None and (progress.approaching or progress.diverted):
        setpoint = Position(progress.position_ned_m, getattr(setpoint, "yaw_ned_rad", None))
    pitch_rad, yaw_rad = segment.gimbal.at(flight.t_s, setpoint, segment.end_yaw_ned_rad)
    if flight.last_gimbal_request is not None:
        pitch_before_rad, yaw_before_rad, requested_s = flight.last_gimbal_request
        turned_rad = max(abs(pitch_rad - pitch_before_rad), abs(wrap_pi(yaw_rad - yaw_before_rad)))
        if turned_rad < UNCHANGED_RAD and now_s - requested_s < REPEAT_S:
            return []
    flight.last_gimbal_request = (pitch_rad, yaw_rad, now_s)
    return [PointGimbal(pitch_rad, yaw_rad)]


def release_gimbal(flight: Flight) -> list[Request]:
    """Releases the gimbal if the mission has commanded it."""
    if flight.last_gimbal_request is None:
        return []
    flight.last_gimbal_request = None
    return [ReleaseGimbal()]
