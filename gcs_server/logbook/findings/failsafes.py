"""Failsafes: which, why, what the vehicle was told to do, and what it did."""

from __future__ import annotations

import numpy as np

from gcs_server.logbook.findings.model import MAX_OF_A_KIND, Finding, Flight, Signal
from gcs_server.logbook.log import Span

NEAR_S = 1.5
"""A cause is reported within this time around the begin of a failsafe; a telemetry log has one heartbeat a
second."""
EVENTS = {30481910: 7, 26528394: 5}
"""PX4's events of a failsafe with a cause (v1.16): which byte of the arguments has it."""
CAUSES = {
    1: "the manual control was lost",
    2: "the connection to the ground station was lost",
    3: "the battery was low",
    4: "the battery was critically low",
    5: "the battery was almost empty",
    6: "the remaining flight time was too short",
}
"""PX4's failsafe_cause_t."""
FLAGS: tuple[tuple[str, str, str], ...] = (
    ("battery_warning", "the battery was low", "COM_LOW_BAT_ACT"),
    ("geofence_breached", "the geofence was violated", "GF_ACTION"),
    ("gcs_connection_lost", "the connection to the ground station was lost", "NAV_DLL_ACT"),
    ("manual_control_signal_lost", "the manual control was lost", "NAV_RCL_ACT"),
    ("offboard_control_signal_lost", "the setpoints in Offboard ended", "COM_OBL_RC_ACT"),
    ("local_position_invalid", "the position was lost", "COM_POSCTL_NAVL"),
    ("global_position_invalid", "the position was lost", "COM_POSCTL_NAVL"),
    ("fd_motor_failure", "a motor failed", "COM_ACT_FAIL_ACT"),
    ("fd_imbalanced_prop", "a propeller was not balanced", "COM_IMB_PROP_ACT"),
    ("fd_critical_failure", "the attitude was out of control", "CBRK_FLIGHTTERM"),
    ("wind_limit_exceeded", "the wind was too strong", "COM_WIND_MAX_ACT"),
    ("flight_time_limit_exceeded", "the flight time was over", "COM_FLT_TIME_MAX"),
    ("battery_unhealthy", "the battery reported a fault", ""),
    ("mission_failure", "the mission could not be flown", ""),
)
"""Flags of failsafe_flags that newly stand at a failsafe's begin, the reason, and the parameter that says
what to do."""
PARAMETER_OF = {reason: parameter for _, reason, parameter in FLAGS} | {
    CAUSES[4]: "COM_LOW_BAT_ACT",
    CAUSES[5]: "COM_LOW_BAT_ACT",
}
MODES_OF_ACTION: dict[str, dict[int, tuple[str, ...]]] = {
    "NAV_DLL_ACT": {1: ("Hold",), 2: ("Return",), 3: ("Land",)},
    "NAV_RCL_ACT": {1: ("Hold",), 2: ("Return",), 3: ("Land",)},
    "COM_LOW_BAT_ACT": {2: ("Land",), 3: ("Return", "Land")},
    "GF_ACTION": {2: ("Hold",), 3: ("Return",), 5: ("Land",)},
    "COM_OBL_RC_ACT": {0: ("Position",), 1: ("Altitude",), 3: ("Return",), 4: ("Land",), 5: ("Hold",)},
    "COM_WIND_MAX_ACT": {2: ("Hold",), 3: ("Return",), 5: ("Land",)},
}
"""Which modes a value of a parameter asks for (PX4 v1.16, its parameter metadata); a battery at the
emergency level is landed
where a critical one returns."""
MAX_MODES = 4


def failsafes(flight: Flight) -> list[Finding]:
    """Each failsafe while armed."""
    if not flight.states.modes:
        raise flight.not_logged("HEARTBEAT" if flight.is_tlog else "vehicle_status")
    found: list[Finding] = []
    for span in flight.states.failsafe:
        if any(armed.begin_s <= span.begin_s < armed.end_s for armed in flight.states.armed):
            found.append(_finding(flight, span))
    return found[:MAX_OF_A_KIND]


def _finding(flight: Flight, span: Span) -> Finding:
    reasons = _reasons(flight, span)
    reason = reasons[0] if reasons else None
    before = flight.mode_at(span.begin_s - NEAR_S)
    later = [m.name for m in flight.states.modes if span.begin_s - NEAR_S < m.begin_s < span.end_s - 0.01]
    took = [name for k, name in enumerate(later) if name != (before if k == 0 else later[k - 1])][:MAX_MODES]
    sentences = [
        f"Failsafe in {before or 'an unknown mode'}: {', '.join(reasons) or 'the log does not say why'}."
    ]
    if voltage := _voltage(flight, span.begin_s):
        sentences.append(voltage)
    sentences.append(
        f"The vehicle changed to {', '.join(took)}." if took else "The vehicle stayed in its mode."
    )
    name = PARAMETER_OF.get(reason or "", "")
    value = flight.log.parameters.get(name)
    wanted = () if value is None else MODES_OF_ACTION.get(name, {}).get(int(value), ())
    words = ", ".join(wanted)
    if value is None:
        limit = "The parameter for it is not in the log."
    elif not wanted:
        limit = f"{name} is {value:g}."
    elif any(mode in took or mode == before for mode in wanted):
        limit = f"{name} is {value:g}: {words}, as the vehicle did."
    else:
        limit = f"{name} is {value:g}: {words}, which the vehicle did not do."
    return Finding(
        "warning", span.begin_s, span.end_s, " ".join(sentences), limit,
        "Remove the cause, and check in a dry run that the action is the right one at that place.",
        _panes(flight, reason or ""),
    )  # fmt: skip


def _reasons(flight: Flight, span: Span) -> list[str]:
    """Why it began, and what came later in it."""
    t_s = span.begin_s
    if causes := _causes_of_events(flight, span):
        return causes
    if (cause := _cause_of_flags(flight, t_s)) is not None:
        return [cause]
    texts = [
        message.text
        for message in flight.log.messages
        if abs(message.t_s - t_s) <= NEAR_S and message.severity <= 3 and "ailsafe" not in message.text
    ]
    if any("eofence" in text for text in texts):
        return ["the geofence was violated"]
    if texts:
        return [f"“{texts[-1][:120]}”"]
    # In Offboard, all other failsafes have a reason of their own.
    ended = flight.is_tlog and flight.mode_at(t_s - NEAR_S) == "Offboard"
    return ["the setpoints in Offboard ended"] if ended else []


def _causes_of_events(flight: Flight, span: Span) -> list[str]:
    ids = flight.optional("event/id", "EVENT/id")
    if ids is None:
        return []
    topic = ids.field.split(":")[0]
    causes: list[str] = []
    for k in np.flatnonzero((ids.times_s >= span.begin_s - NEAR_S) & (ids.times_s <= span.end_s)):
        byte = EVENTS.get(int(ids.values[k]) & 0xFFFFFFFF)
        argument = None if byte is None else flight.optional(f"{topic}/arguments[{byte}]")
        if argument is not None:
            cause = CAUSES.get(int(argument.at(ids.times_s[k : k + 1])[0]))
            if (
                cause is not None
                and cause not in causes
                and (causes or ids.times_s[k] <= span.begin_s + NEAR_S)
            ):
                causes.append(cause)
    return causes[:3]


def _cause_of_flags(flight: Flight, t_s: float) -> str | None:
    """The first flag that was set at that time and was not before."""
    if not flight.has("failsafe_flags"):
        return None
    for name, reason, _ in FLAGS:
        flag = flight.optional(f"failsafe_flags/{name}")
        if flag is None:
            continue
        before, after = flag.at(np.array([t_s - NEAR_S, t_s + 0.5]))
        if after > before:
            return reason
    return None


def _voltage(flight: Flight, t_s: float) -> str | None:
    voltage = flight.optional("battery_status/voltage_v", "SYS_STATUS/voltage_battery")
    if voltage is None:
        return None
    volts = float(voltage.at(np.array([t_s]))[0]) / (1000.0 if flight.is_tlog else 1.0)
    cells = flight.optional("battery_status/cell_count")
    count = float(np.median(cells.values)) if cells is not None else flight.parameter("BAT1_N_CELLS", 0)
    if count > 0 and volts > 0:
        return f"The battery had {volts:.2f} V, {volts / count:.2f} V a cell."
    return f"The battery had {volts:.2f} V." if volts > 0 else None


def _panes(flight: Flight, reason: str) -> list[list[str]]:
    candidates: list[Signal | None] = [flight.optional("vehicle_status/nav_state", "HEARTBEAT/custom_mode")]
    if "battery" in reason:
        candidates.append(flight.optional("battery_status/voltage_v", "SYS_STATUS/voltage_battery"))
        candidates.append(flight.optional("battery_status/remaining", "SYS_STATUS/battery_remaining"))
    else:
        flags = next((name for name, text, _ in FLAGS if text == reason), None)
        if flags is not None:
            candidates.append(flight.optional(f"failsafe_flags/{flags}"))
    return [[each.field] for each in candidates if each is not None]
