"""The events document, which a ground station uses to decode EVENT messages.

Ids, names, arguments and enumerations are PX4's (`data/event_facts.json`). The texts are not
PX4's: some are in `MESSAGE_BY_NAME`, the others are built from the event's name and arguments.
Format: MAVLink's events metadata schema, version 2.
"""

from __future__ import annotations

import json
from typing import Any

from vehicle_sim.px4_version import DATA_FOLDER, Px4Version

FACTS_FILE = DATA_FOLDER / "event_facts.json"
HIDDEN_ARGUMENT_COUNT = 2
"""The first two arguments of a check (modes, component) do not appear in the message."""

MESSAGE_BY_NAME: dict[str, str] = {
    "commander_armed_by": "Armed ({1})",
    "commander_disarmed_by": "Disarmed ({1})",
    "commander_arm_denied_resolve_failures": "Arming denied: resolve the failed checks first",
    "commander_disarm_denied_not_landed": "Disarming denied: the vehicle is in the air",
    "commander_modeswitch_not_avail": "Mode {1} is not available now",
    "commander_takeoff_detected": "Takeoff detected",
    "commander_landing_detected": "Landing detected",
    "commander_rtl": "Returning to launch",
    "commander_gcs_lost": "Connection to the ground station lost",
    "commander_dl_regained": "Connection to the ground station regained",
    "check_modes_cannot_takeoff": "Takeoff is not possible in this mode",
    "check_modes_mission": "No valid mission available",
    "check_modes_offboard_signal": "No offboard setpoints received",
    "check_modes_manual_control": "No manual control input",
    "check_modes_local_pos": "No valid local position estimate",
    "check_modes_global_pos": "No valid global position estimate",
    "check_battery_low": "Battery {3} is low",
    "check_battery_critical": "Battery {3} is critical",
    "check_battery_emergency": "Battery {3} is dangerously low",
    "check_failure_detector_roll": "Roll angle beyond the limit",
    "check_failure_detector_pitch": "Pitch angle beyond the limit",
    "check_gf_violation_custom_gf": "Geofence breached",
    "check_gf_violation_max_hor_dist": "Geofence breached: maximum distance from home exceeded",
    "check_gf_violation_max_alt": "Geofence breached: maximum altitude above home exceeded",
    "check_rc_dl_no_dllink": "No connection to a ground station",
    "check_wind_too_high": "Wind above the limit",
    "check_flight_time_limit": "Maximum flight time exceeded",
    "check_mission_failure": "Mission failed",
    "mission_execute": "Executing mission",
    "mission_finished": "Mission finished",
    "mission_finished_loiter": "Mission finished, holding position",
}
"""Message texts; {n} is the event's argument n, from 1."""


AUTOPILOT = "1"
"""Component number of the autopilot's events."""
NAVIGATION_MODES = "navigation_mode_t"


def events_document(px4: Px4Version) -> dict[str, Any]:
    """The content of the events document."""
    facts_by_component: dict[str, dict[str, Any]] = json.loads(FACTS_FILE.read_text(encoding="utf-8"))
    autopilot, differences = facts_by_component[AUTOPILOT], px4.differences
    removed = differences.get("removed_events", ())
    autopilot["events"] = {
        event_id: event for event_id, event in autopilot["events"].items() if event[0] not in removed
    } | differences.get("added_events", {})
    autopilot["enums"][NAVIGATION_MODES]["entries"] += differences.get("navigation_modes", [])
    components = {number: _component(facts) for number, facts in facts_by_component.items()}
    return {"version": 2, "components": components}


def _component(facts: dict[str, Any]) -> dict[str, Any]:
    groups: dict[str, dict[str, dict[str, Any]]] = {}
    for event_id, (name, group, arguments) in facts["events"].items():
        event: dict[str, Any] = {"name": name, "message": _message(name, group, arguments)}
        if arguments:
            event["arguments"] = [{"name": argument, "type": type_name} for argument, type_name in arguments]
        groups.setdefault(group, {"events": {}})["events"][event_id] = event
    enums = {
        name: {
            "type": enum["type"],
            "is_bitfield": enum["is_bitfield"],
            "entries": {
                str(value): {"name": entry, "description": _readable(entry)}
                for value, entry in enum["entries"]
            },
        }
        for name, enum in facts["enums"].items()
    }
    keys = ("namespace", "navigation_mode_groups", "supported_protocols")
    return {"enums": enums, "event_groups": groups, **{key: facts[key] for key in keys if key in facts}}


def _message(name: str, group: str, arguments: list[tuple[str, str]]) -> str:
    message = MESSAGE_BY_NAME.get(name)
    if message is not None:
        return message
    first_shown = 0 if group == "default" else HIDDEN_ARGUMENT_COUNT
    values = ", ".join(f"{{{index + 1}}}" for index in range(first_shown, len(arguments)))
    return f"{_readable(name)}: {values}" if values else _readable(name)


def _readable(name: str) -> str:
    """The name as words, such as "Battery low" for "check_battery_low"."""
    return name.removeprefix("check_").replace("_", " ").capitalize()
