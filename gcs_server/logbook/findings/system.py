"""Findings of computer, log and link: load, memory, dropouts, lost connection."""

from __future__ import annotations

import numpy as np

from gcs_server.logbook.findings.model import (
    MAX_OF_A_KIND,
    Finding,
    Flight,
    NotJudged,
    Signal,
    highest,
    longest,
    spans,
    total_s,
)
from gcs_server.logbook.states import AUTOPILOT_INVALID

LOAD_PERCENT = 95.0
"""Where COM_CPU_MAX and COM_RAM_MAX do not say it."""
LOAD_S = 2.0
DROPOUT_LONGEST_S, DROPOUT_SHARE = 0.5, 0.01
HEARTBEAT_GAP_S = 3.0
"""Three heartbeats; the station then calls the link lost."""


def load(flight: Flight) -> list[Finding]:
    """Load of processor and memory while armed."""
    found: list[Finding] = []
    for fields, factor, name, what in (
        (
            ("cpuload/load", "SYS_STATUS/load"),
            0.1 if flight.is_tlog else 100.0,
            "COM_CPU_MAX",
            "The autopilot's processor was loaded too much",
        ),
        (("cpuload/ram_usage",), 100.0, "COM_RAM_MAX", "The autopilot's memory was too full"),
    ):
        signal = flight.signal(*fields) if name == "COM_CPU_MAX" else flight.optional(*fields)
        limit = flight.parameter(name, -1.0)
        limit = limit if 0.0 < limit <= 100.0 else LOAD_PERCENT
        if signal is None:
            continue
        percent = Signal(signal.field, signal.times_s, signal.values * factor)
        mask = (percent.values > limit) & flight.armed(percent.times_s)
        if full := spans(percent.times_s, mask, float(percent.times_s[-1]), LOAD_S):
            span = longest(full)
            found.append(
                Finding(
                    "warning", span.begin_s, span.end_s,
                    f"{what}: {highest(percent, span):.0f} %, for {total_s(full):.0f} s.",
                    f"At most {limit:.0f} % ({name}, or 95 % where it is off).",
                    "Log and send less, switch off modules that are not used, or lower IMU_GYRO_RATEMAX.",
                    [[signal.field]],
                )
            )  # fmt: skip
    return found


def dropouts(flight: Flight) -> list[Finding]:
    """Gaps in which the vehicle could not write its log."""
    if flight.is_tlog:
        raise NotJudged("A telemetry log does not have what this needs; the vehicle's own log has.")
    gaps = [(t_s, length_s) for t_s, length_s in flight.log.dropouts if np.isfinite(t_s) and length_s > 0.0]
    if not gaps:
        return []
    worst_s, longest_s = max(gaps, key=lambda gap: gap[1])
    lost_s = sum(length_s for _, length_s in gaps)
    if longest_s < DROPOUT_LONGEST_S and lost_s < DROPOUT_SHARE * flight.log.duration_s:
        return []
    return [
        Finding(
            "caution", worst_s - longest_s, worst_s + longest_s,
            f"The log has {len(gaps)} gaps of {lost_s:.1f} s together, the longest {longest_s:.1f} s: the "
            "vehicle could not write in time.",
            f"Shorter than {DROPOUT_LONGEST_S:.1f} s and less than {100 * DROPOUT_SHARE:.0f} % of the log "
            "(limit of this station; PX4 recommends a fast card).",
            "Use a faster memory card, or log fewer topics (SDLOG_PROFILE). What happened in the gaps is "
            "not known.",
        )
    ]  # fmt: skip


def link(flight: Flight) -> list[Finding]:
    """Connection to the ground station: lost by the vehicle's own account, or no heartbeat received."""
    if flight.is_tlog:
        return _heartbeat_gaps(flight)
    lost = flight.signal("vehicle_status/gcs_connection_lost")
    times_s, seen = lost.times_s, lost.values == 0
    # a vehicle that never had a connection did not lose it
    first_seen = int(np.argmax(seen)) if np.any(seen) else len(times_s)
    mask = ~seen & flight.armed(times_s)
    mask[:first_seen] = False
    return [
        Finding(
            "caution", span.begin_s, span.end_s,
            f"The vehicle had no connection to the ground station for {span.end_s - span.begin_s:.0f} s, "
            f"after {flight.parameter('COM_DL_LOSS_T', 10):.0f} s without a heartbeat.",
            "The connection should hold for the whole flight (COM_DL_LOSS_T).",
            "Check range, antennas and what else transmits; the vehicle then does what NAV_DLL_ACT says.",
            [[lost.field]],
        )
        for span in spans(times_s, mask, flight.log.duration_s, 1.0)[:MAX_OF_A_KIND]
    ]  # fmt: skip


def _heartbeat_gaps(flight: Flight) -> list[Finding]:
    topic = next(t for t in flight.topics("HEARTBEAT") if t.columns["autopilot"][0] != AUTOPILOT_INVALID)
    times_s = topic.times_s
    gaps = np.flatnonzero((np.diff(times_s) > HEARTBEAT_GAP_S) & flight.armed(times_s[:-1]))
    return [
        Finding(
            "caution", float(times_s[k]), float(times_s[k + 1]),
            f"Nothing of the vehicle's heartbeats was received for {float(times_s[k + 1] - times_s[k]):.1f} "
            "s.",
            f"One a second; a gap of {HEARTBEAT_GAP_S:.0f} s is a lost link.",
            "Check range, antennas and what else transmits.",
            [[f"{topic.id}/custom_mode"]],
        )
        for k in gaps[:MAX_OF_A_KIND]
    ]  # fmt: skip
