"""The flights in one log: for each vehicle the times from arming to disarming, what the list of flights
says of them, and by what they are recognised in another log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.log import Log, Span, Topic, VehicleStates

Ended = Literal["landed", "disarmed", "disarmed_in_air", "log_ends"]
Values = NDArray[np.float64]

MAX_FLIGHTS = 500
"""Maximum number of flights of one log."""
STEP_S = 0.2
"""Time between two positions of which the distance is added up."""
MIN_STEP_M = 0.5
"""Shorter steps are the noise of the position estimate."""
EDGE_S = 1.5
"""A flight that begins this close to its log's start began before it: a HEARTBEAT comes once a second."""
UTC_US = (1e15, 1e16)
"""Range of plausible times [us since 1970], 2001 to 2286."""
_BOOT_TIMES = ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ATTITUDE", "ATTITUDE_QUATERNION", "SYSTEM_TIME")
"""Messages with the time since the boot, `time_boot_ms`."""
_LANDED = (("vehicle_land_detected", "landed"), ("EXTENDED_SYS_STATE", "landed_state"))
"""Field that is 1 on the ground (MAV_LANDED_STATE_ON_GROUND)."""
_POSITIONS = ("vehicle_local_position", "LOCAL_POSITION_NED")


@dataclass(frozen=True, slots=True)
class LoggedFlight:
    """One flight of one vehicle, as one log has it."""

    vehicle: str
    """MAVLink system id; empty: not known."""
    uid: str | None
    """Hexadecimal uid of the autopilot; None: not known."""
    begin_s: float
    """Arming [s since the log's start]."""
    end_s: float
    """Disarming, or the log's end."""
    begin_unix_s: float | None
    """Arming [s since 1970 UTC]; None: not known."""
    by_gps: bool
    """Whether `begin_unix_s` is the vehicle's own time; otherwise that of the server which recorded it."""
    begin_boot_s: float | None
    """Arming by the vehicle's clock [s since its boot]; None: not known."""
    duration_s: float
    """By the vehicle's clock if it is known: that of a server may have been set in flight."""
    distance_m: float | None
    """Length of the flown path over ground; None: no position."""
    height_m: float | None
    """Greatest height above the place of arming; None: no position."""
    modes: tuple[str, ...]
    """Modes in the order in which they were first flown."""
    failsafes: int
    """Number of times in which the vehicle was in a failsafe."""
    ended: Ended
    starts_armed: bool
    """Whether the vehicle was armed already when the log began."""


def flights_of(log: Log) -> tuple[LoggedFlight, ...]:
    """The flights of all vehicles of a log, in order of time."""
    flights = [
        _flight(log, vehicle, span) for vehicle in log.vehicles for span in vehicle.armed[:MAX_FLIGHTS]
    ]
    return tuple(sorted(flights, key=lambda each: (each.begin_s, each.vehicle)))


def _flight(log: Log, vehicle: VehicleStates, armed: Span) -> LoggedFlight:
    topics = own_topics(log, vehicle.id)
    begin_s, end_s = armed.begin_s, armed.end_s
    boot_s = [_boot_s(log, topics, at_s) for at_s in (begin_s, end_s)]
    begin_boot_s, end_boot_s = boot_s
    duration_s = end_s - begin_s
    if begin_boot_s is not None and end_boot_s is not None and end_boot_s > begin_boot_s:
        duration_s = end_boot_s - begin_boot_s
    begin_unix_s, by_gps = _unix_s(log, topics, begin_s)
    distance_m, height_m = _extent(topics, begin_s, end_s)
    modes = [s.name for s in vehicle.modes if s.end_s > begin_s and s.begin_s < end_s]
    return LoggedFlight(
        vehicle=vehicle.id,
        uid=vehicle.uid,
        begin_s=begin_s,
        end_s=end_s,
        begin_unix_s=begin_unix_s,
        by_gps=by_gps,
        begin_boot_s=begin_boot_s,
        duration_s=duration_s,
        distance_m=distance_m,
        height_m=height_m,
        modes=tuple(dict.fromkeys(modes))[:40],
        failsafes=sum(1 for s in vehicle.failsafe if s.end_s > begin_s and s.begin_s < end_s),
        ended=_ended(log, topics, end_s),
        starts_armed=begin_s < EDGE_S,
    )


def own_topics(log: Log, vehicle: str) -> list[Topic]:
    """The topics of a vehicle's autopilot: of a telemetry log those of its first component."""
    if log.kind == "ulog" or (log.kind == "mcap" and len(log.vehicles) <= 1):
        return log.topics
    if log.kind == "mcap":
        return [topic for topic in log.topics if topic.instance == vehicle]
    return [topic for topic in log.topics if topic.instance.split(".")[:2] == [vehicle, "1"]]


def _column(topics: Sequence[Topic], name: str, field: str) -> tuple[Values, Values] | None:
    """Times and values of a field of the first topic with this name that has it."""
    for topic in topics:
        if topic.name == name and (values := topic.columns.get(field)) is not None:
            return topic.times_s, np.asarray(values).astype(np.float64)
    return None


def _boot_s(log: Log, topics: Sequence[Topic], at_s: float) -> float | None:
    """The vehicle's own time since its boot."""
    if log.kind != "tlog":
        return None if log.start_boot_s is None else log.start_boot_s + at_s
    for name in _BOOT_TIMES:
        if (found := _column(topics, name, "time_boot_ms")) is not None:
            times_s, boot_ms = found
            nearest = int(np.clip(np.searchsorted(times_s, at_s), 0, len(times_s) - 1))
            part = slice(max(0, nearest - 10), nearest + 10)  # a radio delays some messages
            return float(np.median(boot_ms[part] / 1e3 - times_s[part])) + at_s
    return None


def _unix_s(log: Log, topics: Sequence[Topic], at_s: float) -> tuple[float | None, bool]:
    """The time of day, and whether it is the vehicle's own."""
    if log.kind != "tlog":  # of an MCAP file it is the clock of the computer that recorded it
        return (None if log.start_unix_s is None else log.start_unix_s + at_s), log.kind == "ulog"
    found = _column(topics, "SYSTEM_TIME", "time_unix_usec")
    if found is not None:
        times_s, utc_us = found
        known = (utc_us > UTC_US[0]) & (utc_us < UTC_US[1])
        if np.any(known):
            times_s, utc_s = times_s[known], utc_us[known] / 1e6
            nearest = int(np.clip(np.searchsorted(times_s, at_s), 0, len(times_s) - 1))
            return float(utc_s[nearest] + at_s - times_s[nearest]), True
    return (None if log.start_unix_s is None else log.start_unix_s + at_s), False


def _extent(topics: Sequence[Topic], begin_s: float, end_s: float) -> tuple[float | None, float | None]:
    """Distance over ground and greatest height, by the estimate of the local position."""
    for name in _POSITIONS:
        found = [_column(topics, name, axis) for axis in ("x", "y", "z")]
        if any(each is None for each in found):
            continue
        (times_s, north), (_, east), (_, down) = (each for each in found if each is not None)
        inside = (times_s >= begin_s) & (times_s <= end_s)
        inside &= np.isfinite(north) & np.isfinite(east) & np.isfinite(down)
        if not np.any(inside):
            continue
        times_s, north, east, down = times_s[inside], north[inside], east[inside], down[inside]
        spaced = np.unique(np.searchsorted(times_s, np.arange(times_s[0], times_s[-1], STEP_S)))
        points = np.stack((north[spaced], east[spaced]), axis=1)
        return path_length_m(points), max(0.0, float(down[0] - np.min(down)))
    return None, None


def path_length_m(points: Values) -> float:
    """Length of a path (N, 2) [m], of steps that are longer than the noise."""
    length_m, previous = 0.0, points[0] if len(points) else None
    for point in points[1:]:
        step_m = float(np.hypot(*(point - previous)))
        if step_m >= MIN_STEP_M:
            length_m += step_m
            previous = point
    return length_m


def _ended(log: Log, topics: Sequence[Topic], end_s: float) -> Ended:
    if end_s >= log.duration_s - EDGE_S / 10:
        return "log_ends"
    for name, field in _LANDED:
        found = _column(topics, name, field)
        if found is None:
            continue
        times_s, states = found
        at = int(np.searchsorted(times_s, end_s + EDGE_S, "right")) - 1
        if at >= 0:
            return "landed" if states[at] == 1 else "disarmed_in_air"
    return "disarmed"
