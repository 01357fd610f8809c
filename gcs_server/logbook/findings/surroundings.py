"""Findings of what is around the vehicle and around its setpoints: fence, obstacles, gaps in Offboard."""

from __future__ import annotations

import numpy as np

from gcs_server.logbook.findings.model import (
    MAX_OF_A_KIND,
    Finding,
    Flight,
    longest,
    spans,
    total_s,
)
from gcs_server.logbook.log import Topic

FENCE_MARGIN_M = 5.0
OBSTACLE_M = 2.0
"""Where CP_DIST does not say it."""
NO_OBSTACLE_CM = 65_535
SECTORS = 72
GAP_S = 1.0
"""Where COM_OF_LOSS_T is not in the log: PX4's default."""
OWN_GAP_S = 0.5
"""PX4 leaves Offboard with fewer than two setpoints a second (docs.px4.io, "Offboard Mode")."""
SETPOINTS = (
    "SET_POSITION_TARGET_LOCAL_NED",
    "SET_POSITION_TARGET_GLOBAL_INT",
    "SET_ATTITUDE_TARGET",
)


def fence(flight: Flight) -> list[Finding]:
    """Violated geofence, and flight near the largest distance and height (GF_MAX_HOR_DIST,
    GF_MAX_VER_DIST)."""
    breached = flight.signal("failsafe_flags/geofence_breached", "FENCE_STATUS/breach_status")
    found: list[Finding] = []
    violated = spans(
        breached.times_s, (breached.values > 0) & flight.armed(breached.times_s), flight.log.duration_s
    )
    for span in violated[:MAX_OF_A_KIND]:
        found.append(
            Finding(
                "warning", span.begin_s, span.end_s,
                f"The vehicle was outside its geofence for {span.end_s - span.begin_s:.0f} s.",
                "It should stay inside (the vehicle's own fence).",
                "Plan farther from the fence, or change the fence.",
                [[breached.field], _position_fields(flight)],
            )
        )  # fmt: skip
    return found if violated or flight.is_tlog else found + _near_fence(flight)


def _position_fields(flight: Flight) -> list[str]:
    fields = [flight.optional(f"vehicle_local_position/{k}", f"LOCAL_POSITION_NED/{k}") for k in "xyz"]
    return [each.field for each in fields if each is not None]


def _near_fence(flight: Flight) -> list[Finding]:
    found: list[Finding] = []
    position = [flight.optional(f"vehicle_local_position/{k}") for k in "xyz"]
    home = [flight.optional(f"home_position/{k}") for k in "xyz"]
    x, y, z = position
    if x is None or y is None or z is None or any(each is None for each in home):
        return []
    times_s = x.times_s
    offset = [p.at(times_s) - h.at(times_s) for p, h in zip((x, y, z), home, strict=True) if h is not None]
    for name, distance, what in (
        ("GF_MAX_HOR_DIST", np.hypot(offset[0], offset[1]), "Distance"),
        ("GF_MAX_VER_DIST", -offset[2], "Height"),
    ):
        limit = flight.parameter(name, 0.0)
        if limit <= 2 * FENCE_MARGIN_M:
            continue
        near = spans(
            times_s, (distance > limit - FENCE_MARGIN_M) & flight.in_air(times_s), float(times_s[-1]), 1.0
        )
        if near:
            span = longest(near)
            inside = (times_s >= span.begin_s) & (times_s <= span.end_s)
            found.append(
                Finding(
                    "caution", span.begin_s, span.end_s,
                    f"The vehicle came near the geofence. {what}: {float(np.max(distance[inside])):.0f} m of "
                    f"{limit:.0f} m, for {total_s(near):.0f} s.",
                    f"At least {FENCE_MARGIN_M:.0f} m from it ({name} is {limit:.0f} m).",
                    "Plan farther from the fence: wind or a stop from full speed takes the vehicle out.",
                    [_position_fields(flight)],
                )
            )  # fmt: skip
    return found


def obstacle(flight: Flight) -> list[Finding]:
    """Obstacles nearer than the vehicle is to keep from them (CP_DIST)."""
    topic = flight.topic("obstacle_distance", "OBSTACLE_DISTANCE")
    columns = [topic.columns[f"distances[{k}]"] for k in range(SECTORS) if f"distances[{k}]" in topic.columns]
    if not columns:
        return []
    with np.errstate(all="ignore"):
        rows = np.stack(
            [np.nan_to_num(np.asarray(each).astype(np.float64), nan=NO_OBSTACLE_CM) for each in columns]
        )
    rows = np.where((rows <= 0) | (rows >= NO_OBSTACLE_CM), np.inf, rows)
    nearest_m = np.min(rows, axis=0) / 100.0
    limit = flight.parameter("CP_DIST", -1.0)
    limit = limit if limit > 0 else OBSTACLE_M
    times_s = topic.times_s
    near = spans(times_s, (nearest_m < limit) & flight.in_air(times_s, 2.0), float(times_s[-1]), 0.3)
    if not near:
        return []
    span = longest(near)
    inside = (times_s >= span.begin_s) & (times_s <= span.end_s)
    sector = int(np.argmin(np.min(rows[:, inside], axis=1)))
    return [
        Finding(
            "warning", span.begin_s, span.end_s,
            f"An obstacle was {float(np.min(nearest_m[inside])):.1f} m from the vehicle; for "
            f"{total_s(near):.1f} s one was too near.",
            f"At least {limit:.1f} m (CP_DIST, or {OBSTACLE_M:.0f} m where it is off).",
            "Plan farther from obstacles, fly slower, or switch collision prevention on.",
            [[f"{topic.id}/distances[{sector}]"]],
        )
    ]  # fmt: skip


def setpoint_gaps(flight: Flight) -> list[Finding]:
    """Gaps between setpoints in Offboard, and where they arose."""
    offboard = [span for span in flight.states.modes if span.name == "Offboard"]
    if not offboard:
        return []
    streams = _streams(flight)
    if not streams:
        raise flight.not_logged(SETPOINTS[0] if flight.is_tlog else "offboard_control_mode")
    limit_s = min(flight.parameter("COM_OF_LOSS_T", GAP_S), OWN_GAP_S)
    found: list[Finding] = []
    times_s = np.sort(np.concatenate([topic.times_s for topic in streams]))
    for span in offboard:
        armed = any(a.begin_s < span.end_s and a.end_s > span.begin_s for a in flight.states.armed)
        inside = times_s[(times_s >= span.begin_s) & (times_s <= span.end_s)]
        if len(inside) < 2 or not armed:
            continue
        ends = np.append(inside, span.end_s) if _left_by_failsafe(flight, span.end_s) else inside
        for k in np.flatnonzero(np.diff(ends) > limit_s)[:MAX_OF_A_KIND]:
            found.append(_gap(flight, streams, float(ends[k]), float(ends[k + 1]), limit_s))
    return found[:MAX_OF_A_KIND]


def _left_by_failsafe(flight: Flight, t_s: float) -> bool:
    return any(abs(span.begin_s - t_s) < 1.5 for span in flight.states.failsafe)


def _streams(flight: Flight) -> list[Topic]:
    if not flight.is_tlog:
        return flight.topics("offboard_control_mode") if flight.has("offboard_control_mode") else []
    # setpoints are of other senders than the vehicle
    return [
        topic for topic in flight.log.topics if topic.name in SETPOINTS and _is_for(topic, flight.states.id)
    ]


def _is_for(topic: Topic, vehicle: str) -> bool:
    targets = topic.columns.get("target_system")
    return targets is not None and len(targets) > 0 and str(int(targets[0])) in (vehicle, "0")


def _gap(flight: Flight, streams: list[Topic], begin_s: float, end_s: float, limit_s: float) -> Finding:
    if flight.is_tlog:
        senders = sorted({topic.instance for topic in streams})
        cause = f"The sender {', '.join(senders)} sent none: the gap arose there, and not on the link."
    else:
        cause = (
            "The vehicle's log does not say where; the recording of the same time shows whether they "
            "were sent."
        )
    shown = [f"{streams[0].id}/{name}" for name in streams[0].columns][:1]
    mode = flight.optional("vehicle_status/nav_state", "HEARTBEAT/custom_mode")
    return Finding(
        "warning", begin_s, end_s,
        f"No setpoint came for {end_s - begin_s:.1f} s in Offboard. {cause}",
        f"At least two a second; PX4 leaves Offboard after {flight.parameter('COM_OF_LOSS_T', GAP_S):.1f} s "
        f"(COM_OF_LOSS_T) and a gap of {limit_s:.1f} s is reported.",
        "Send more often and from a machine with time to spare; hold the last setpoint while a program "
        "thinks.",
        [shown, *([[mode.field]] if mode is not None else [])],
    )  # fmt: skip
