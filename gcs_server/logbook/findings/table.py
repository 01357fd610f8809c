"""The kinds of findings, and all findings of a log. A new kind is a function and a row here."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import msgspec
import numpy as np

from gcs_server.logbook.findings import control, estimator, failsafes, power, sensors, surroundings, system
from gcs_server.logbook.findings.model import MAX_OF_A_KIND, Flight, Kind, NotJudged
from gcs_server.logbook.log import Log, VehicleStates

KINDS = (
    Kind("failsafe", "Failsafe", failsafes.failsafes),
    Kind("setpoint_gap", "Gaps between setpoints", surroundings.setpoint_gaps),
    Kind("vibration", "Vibration", sensors.vibration),
    Kind("clipping", "Clipping", sensors.clipping),
    Kind("innovation", "Rejected measurements", estimator.innovations),
    Kind("reset", "Resets of the estimate", estimator.resets),
    Kind("gps_quality", "GPS quality", sensors.gps_quality),
    Kind("gps_interference", "GPS interference", sensors.gps_interference),
    Kind("compass", "Compass and current", sensors.compass),
    Kind("attitude_tracking", "Attitude tracking", control.attitude_tracking),
    Kind("oscillation", "Oscillation", control.oscillation),
    Kind("saturation", "Saturated motors", control.saturation),
    Kind("imbalance", "Imbalance of the motors", control.imbalance),
    Kind("battery_sag", "Battery sag", power.sag),
    Kind("battery_resistance", "Internal resistance", power.resistance),
    Kind("battery_charge", "Battery charge", power.charge),
    Kind("temperature", "Temperature", sensors.thermal),
    Kind("load", "Load of the autopilot", system.load),
    Kind("dropout", "Dropouts of the log", system.dropouts),
    Kind("link", "Connection", system.link),
    Kind("fence", "Geofence", surroundings.fence),
    Kind("obstacle", "Obstacles", surroundings.obstacle),
)


def findings(log: Log) -> dict[str, Any]:
    """All findings of a log, the first in time first, and what could not be judged and why."""
    found: list[dict[str, Any]] = []
    not_judged: list[dict[str, Any]] = []
    vehicles = log.vehicles or [VehicleStates("")]
    for states in vehicles:
        flight = Flight(log, states)
        for kind in KINDS:
            try:
                with np.errstate(all="ignore"):
                    of_kind = kind.find(flight)[:MAX_OF_A_KIND]
            except NotJudged as reason:
                not_judged.append(
                    {"kind": kind.name, "title": kind.title, "vehicle": states.id, "reason": str(reason)}
                )
                continue
            found += [
                {"kind": kind.name, "title": kind.title, "vehicle": states.id, **asdict(each)}
                for each in of_kind
            ]
    found.sort(key=lambda each: each["begin_s"])
    return {"findings": found, "not_judged": not_judged}


def encode(log: Log) -> bytes:
    """The findings as JSON."""
    return msgspec.json.encode(findings(log))
