"""Modes, armed and failsafe spans of a vehicle, from the topics of its log."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.log import MAX_SPANS, Span, Times, Topic, VehicleStates
from gcs_server.vehicle.px4.modes import BY_NAV_STATE, mode_name

ARMED_STATE = 2
"""`arming_state` of vehicle_status: armed."""
DESCEND = 12
"""Navigation state of PX4 that nobody chooses: it sinks without a position."""
SAFETY_ARMED = 128
"""MAV_MODE_FLAG_SAFETY_ARMED."""
AUTOPILOT_INVALID, AUTOPILOT_PX4 = 8, 12
CRITICAL = 5
"""MAV_STATE_CRITICAL; a larger one is worse: PX4 reports it in a failsafe."""

States = NDArray[np.int64]


def _spans(times_s: Times, states: States, end_s: float, name_of: Callable[[int], str | None]) -> list[Span]:
    """The spans of equal states with a name."""
    if not len(times_s):
        return []
    begins = np.concatenate(([0], np.flatnonzero(np.diff(states)) + 1))
    ends_s = [*(float(times_s[i]) for i in begins[1:]), max(end_s, float(times_s[-1]))]
    spans: list[Span] = []
    for begin, until_s in zip(begins, ends_s, strict=True):
        name = name_of(int(states[begin]))
        if name is not None and len(spans) < MAX_SPANS:
            spans.append(Span(float(times_s[begin]), until_s, name))
    return spans


def _numbers(topic: Topic, field: str) -> States | None:
    values = topic.columns.get(field)
    return None if values is None else np.asarray(values).astype(np.int64)


def _px4_mode(nav_state: int) -> str:
    if nav_state == DESCEND:
        return "Descend"
    mode = BY_NAV_STATE.get(nav_state)
    return mode.label if mode is not None else f"PX4 mode {nav_state}"


def ulog_states(topics: list[Topic], vehicle: str, end_s: float) -> VehicleStates:
    """The states by `vehicle_status`."""
    states = VehicleStates(vehicle)
    topic = next((each for each in topics if each.name == "vehicle_status"), None)
    if topic is None:
        return states
    if (modes := _numbers(topic, "nav_state")) is not None:
        states.modes = _spans(topic.times_s, modes, end_s, _px4_mode)
    if (arming := _numbers(topic, "arming_state")) is not None:
        states.armed = _spans(topic.times_s, arming, end_s, lambda s: "Armed" if s == ARMED_STATE else None)
    if (failsafe := _numbers(topic, "failsafe")) is not None:
        states.failsafe = _spans(topic.times_s, failsafe, end_s, lambda s: "Failsafe" if s else None)
    return states


def heartbeat_states(topics: list[Topic], end_s: float) -> list[VehicleStates]:
    """The states of each vehicle by its autopilot's HEARTBEAT."""
    vehicles: dict[str, VehicleStates] = {}
    for topic in topics:
        if topic.name != "HEARTBEAT":
            continue
        autopilots, modes = _numbers(topic, "autopilot"), _numbers(topic, "custom_mode")
        base, status = _numbers(topic, "base_mode"), _numbers(topic, "system_status")
        if autopilots is None or modes is None or base is None or status is None:
            continue
        autopilot = int(autopilots[0])
        system = topic.instance.split(".", 1)[0]
        if autopilot == AUTOPILOT_INVALID or system in vehicles:
            continue

        def label(mode: int, autopilot: int = autopilot) -> str:
            return mode_name(mode)[1] if autopilot == AUTOPILOT_PX4 else f"Mode {mode}"

        vehicles[system] = VehicleStates(
            system,
            _spans(topic.times_s, modes, end_s, label),
            _spans(topic.times_s, base & SAFETY_ARMED, end_s, lambda s: "Armed" if s else None),
            _spans(
                topic.times_s,
                (status >= CRITICAL).astype(np.int64),
                end_s,
                lambda s: "Failsafe" if s else None,
            ),
        )
    return [vehicles[system] for system in sorted(vehicles, key=int)]
