"""Replays recorded dialogues to a simulated vehicle on a fake clock and collects its messages."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any

from tests.contract.recordings import (
    STATE_MESSAGES,
    Dialogue,
    message_id,
    parameters_in,
    requested_message_ids,
    requires_boot,
    sends_message,
    timed_messages,
    uploaded_mission,
)
from tests.contract.replay_vehicle import DO_SET_MODE, HOLD_CUSTOM_MODE, Received, Vehicle
from tests.contract.unrecorded_states import RECEPTION_DELAY_S, UNRECORDED_STATES
from vehicle_sim.mavlink.dialect import LAYOUTS
from vehicle_sim.px4_version import V1_16, Px4Version

RIGHT_AFTER_BOOT_S = 0.3
UNAVAILABLE_TEXT = "is currently not available"
STATE_SAMPLE_PERIOD_S = 1.1
"""The recordings sampled the state after a dialogue from messages at 1 Hz."""
OFFBOARD = 0x60000
AIR_MISSION: list[dict[str, Any]] = [
    {"seq": n, "frame": frame, "command": command, "current": n == 0, "autocontinue": 1, "param4": math.nan,
     "x": x, "y": y, "z": z, "mission_type": 0}
    for n, (frame, command, x, y, z) in enumerate(
        ((6, 22, 473977420, 85455940, 10.0), (6, 16, 473979220, 85469220, 10.0),
         (6, 16, 473979220, 85472000, 12.0), (2, 20, 0, 0, 0.0))
    )
]  # fmt: skip
"""A substitute for the mission of the groups "air" and "fence", which no recording contains: a take-off, two
waypoints too far away to be reached, and Return."""
ECHOED_MESSAGES = ("POSITION_TARGET_LOCAL_NED", "ATTITUDE_TARGET", "LOCAL_POSITION_NED")
REQUESTED_MODES = {
    "altctl": (2, 0), "acro": (5, 0), "offboard": (6, 0), "mission": (4, 4), "rtl": (4, 5), "land": (4, 6),
    "takeoff": (4, 2), "termination": (10, 0), "orbit": (3, 1), "follow": (4, 8), "precland": (4, 9),
    "manual": (1, 0), "posctl": (3, 0), "stabilized": (7, 0), "hold": (4, 3),
}  # fmt: skip
CAUSED_BY_PREVIOUS = (
    "in fact armed", "commanded", "running", "sent while", "timed out just before", "flying in RTL",
    "was sent for", "is still open", "battery draining",
)  # fmt: skip
"""Phrases in preconditions. Each describes a state that only the previous dialogue can have caused."""


@dataclass(slots=True)
class DialogueResult:
    """The messages and states of the simulator in one dialogue."""

    received: list[Received] = field(default_factory=list)
    states_before: dict[str, Received] = field(default_factory=dict)
    """Newest sample of each state message before the dialogue."""
    states_after: list[Received] = field(default_factory=list)
    """State messages of the second after the dialogue: the recordings sampled some of them at 1 Hz."""
    earlier_params: frozenset[str] = frozenset()
    """Parameters set by earlier dialogues: PX4 also sends those that it has not saved yet."""
    reports: list[list[Received]] = field(default_factory=list)
    """The arming reports that were valid at some time of the dialogue: the time at which PX4 sends one
    varies."""
    states: list[dict[str, Any]] = field(default_factory=list)
    """Armed, custom_mode and landed_state at times near the end."""
    echoed_fields: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Newest fields of each of `ECHOED_MESSAGES`."""
    message_counts: dict[str, int] = field(default_factory=dict)
    """Number of messages on the ground-station link, by name."""


class DialoguePlayer:
    """Replays the dialogues of one session in order; starts a new vehicle if the present one cannot reach the
    starting state of a dialogue."""

    def __init__(self, listen: tuple[str, ...] = (), *, log: bool = False, px4: Px4Version = V1_16) -> None:
        self._px4 = px4
        self._vehicle: Vehicle | None = None
        self._listen = listen
        """Names of telemetry messages that are compared in addition to the usual ones."""
        self._log = log
        """Whether the vehicle writes onboard logs (`needs_logs`), which take a seventh of the computing
        time."""
        self._earlier_params: frozenset[str] = frozenset()
        self._mission_cleared = False
        self._plan: list[dict[str, Any]] = []
        """The last stored mission, for a new vehicle."""

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle of the last dialogue."""
        assert self._vehicle is not None
        return self._vehicle

    def play(self, dialogue: Dialogue, next_dialogue: Dialogue | None = None) -> DialogueResult:
        """Establishes the starting state, replays the dialogue, and returns the result; `next_dialogue`: the
        dialogue that may follow immediately."""
        vehicle = self._prepare(dialogue)
        precondition = dialogue["precondition"]
        next_follows = next_dialogue is not None and _continues(next_dialogue)
        if "with a 20 Hz position stream" in precondition:
            vehicle.stream_setpoints(True)
            vehicle.run(0.3)
            vehicle.command(DO_SET_MODE, 1, 6)
            vehicle.run(0.2)
        else:
            vehicle.stream_setpoints(False)
        parameters = (
            {}
            if requires_boot(precondition) or sends_message(dialogue, "PARAM_SET")
            else parameters_in(precondition)
        )
        store = vehicle.sim.simulation.parameters[0]
        original_values = {name: store.get(name) for name in parameters if name in store}
        for name in original_values:
            vehicle.set_parameter(name, parameters[name])
        if original_values:
            vehicle.stream_setpoints(vehicle.state()["custom_mode"] == OFFBOARD)
            vehicle.run(2.5)
            vehicle.stream_setpoints(False)
        original_values = {
            name: value for name, value in original_values.items() if not name.startswith("SIM_BAT_")
        }
        stated_defaults = re.findall(r"(\w+) set to \S+ \(default (\S+)\)", precondition)
        original_values |= {name: float(text) for name, text in stated_defaults}
        try:
            result = self._exchange(vehicle, dialogue, next_follows=next_follows)
            parameters_set = {e["fields"]["param_id"] for e in dialogue["send"] if e["msg"] == "PARAM_SET"}
            result.earlier_params = self._earlier_params - parameters_set
            self._earlier_params |= parameters_set
            self._mission_cleared |= sends_message(dialogue, "MISSION_CLEAR_ALL")
            self._plan = uploaded_mission(dialogue) or self._plan
            return result
        finally:
            for name, value in original_values.items():
                store.set(name, value)

    def _prepare(self, dialogue: Dialogue) -> Vehicle:
        precondition, state = dialogue["precondition"], dialogue["state"]
        boot_parameters = parameters_in(precondition) if requires_boot(precondition) else {}
        vehicle = self._vehicle
        is_flying = state.get("landed_state", 1) != 1 or "flying" in precondition
        is_unusable = vehicle is not None and (
            vehicle.commander.terminated
            or (not is_flying and vehicle.altitude_m > 1.0)
            or (is_flying and not vehicle.commander.armed and vehicle.altitude_m > 1.0)
            or (is_flying and vehicle.commander.armed and vehicle.altitude_m < 4.0)
        )
        is_continued = _continues(dialogue)
        if (
            vehicle is None
            or vehicle.parameters != boot_parameters
            or (is_unusable and not is_continued)
            or "right after" in precondition
        ):
            heartbeats = "no GCS heartbeat" not in precondition and "right after" not in precondition
            vehicle = self._vehicle = Vehicle(
                dialogue.get("vehicle_system_id") or 1, boot_parameters, heartbeats=heartbeats, log=self._log,
                px4=self._px4,
            )  # fmt: skip
            vehicle.compared_ids |= {message_id(name) for name in self._listen}
            if "right after" in precondition:
                vehicle.run(RIGHT_AFTER_BOOT_S)
                return vehicle
            vehicle.run(3.0)
            if dialogue.get("group") in ("air", "fence") and not self._mission_cleared:
                vehicle.upload(AIR_MISSION)
            elif "stored" in precondition and self._plan:
                vehicle.upload(self._plan)
            if "GPS_CTRL" not in precondition:
                vehicle.run_until(vehicle.ready, 15)
                vehicle.run(2.5)
            else:
                vehicle.run(12)
        _wait_for_transfers(vehicle)
        if not is_continued:
            self._establish_state(vehicle, dialogue)
        elif "3 s ago" in precondition:
            vehicle.run(0.95)
        if "stored" in precondition or "uploaded with" in precondition:
            _upload_plan(vehicle, dialogue)
        unrecorded = UNRECORDED_STATES.get(dialogue["id"])
        if unrecorded is not None:
            unrecorded.establish(vehicle, dialogue)
        _match_unavailable_reports(vehicle, dialogue)
        return vehicle

    def _establish_state(self, vehicle: Vehicle, dialogue: Dialogue) -> None:
        precondition, state = dialogue["precondition"], dialogue["state"]
        if "in Offboard at" in precondition:
            vehicle.hover_in_offboard()
        elif "flying in Hold" in precondition:
            vehicle.hover_in_hold()
        elif "armed on the ground, Hold" in precondition and not precondition.startswith("disarmed"):
            vehicle.put_on_ground(True, HOLD_CUSTOM_MODE)
        else:
            mode_request = re.search(r"mode (\w+) requested", precondition)
            manual_chosen = "Manual mode chosen" in precondition
            vehicle.put_on_ground(
                state["armed"],
                HOLD_CUSTOM_MODE if mode_request or "Hold mode" in precondition else state["custom_mode"],
            )
            if mode_request or manual_chosen:
                main, sub = REQUESTED_MODES[mode_request.group(1)] if mode_request else (1, 0)
                vehicle.command(DO_SET_MODE, 1, main, sub)
                vehicle.run(0.6)
        gimbal = vehicle.autopilot.gimbal
        for station in ((255, 190), (42, 99), (7, 8)):  # system and component ids
            if (
                f"{station[0]}/{station[1]} in control" in precondition
                or f"{station[0]}/{station[1]} primary" in precondition
            ):
                gimbal.primary = station
        if "nobody in control" in precondition:
            gimbal.primary = (0, 0)

    def _exchange(self, vehicle: Vehicle, dialogue: Dialogue, *, next_follows: bool) -> DialogueResult:
        start_s, window_s = vehicle.now_s, dialogue["window_s"]
        vehicle.log.clear()
        vehicle.message_counts.clear()
        del vehicle.reports[:-1]
        recorded_link = dialogue["link"]
        requested_ids = requested_message_ids(dialogue) | {
            message_id(name) for name in ECHOED_MESSAGES if "echo_at_end" in dialogue
        }
        requested_ids -= vehicle.compared_ids
        vehicle.compared_ids |= requested_ids
        before = {
            name: Received(0.0, name, vehicle.newest_messages[recorded_link, name][1])
            for name in STATE_MESSAGES
            if (recorded_link, name) in vehicle.newest_messages
        }
        for dt_s, link, name, fields, src in timed_messages(dialogue, vehicle.system_id, RECEPTION_DELAY_S):
            if dt_s > window_s:
                break
            if start_s + dt_s > vehicle.now_s + 0.006:
                vehicle.run_to(start_s + dt_s)
            if name == "REQUEST_EVENT" and any(e["msg"] == "EVENT" for e in dialogue["received"]):
                count = fields["last_sequence"] - fields["first_sequence"]
                newest = vehicle.autopilot.announcer.sequence
                fields = fields | {"first_sequence": newest - count, "last_sequence": newest}
            vehicle.send(name, fields, link, src)
        result = DialogueResult(states_before=before)
        vehicle.run_to(start_s + window_s)
        from_s = vehicle.now_s - STATE_SAMPLE_PERIOD_S
        earlier_states = [state for at_s, state in vehicle.states if at_s <= from_s]
        result.states = earlier_states[-1:] + [state for at_s, state in vehicle.states if at_s > from_s]
        result.reports = list(vehicle.reports)
        result.message_counts = {
            LAYOUTS[i].name: count for i, count in vehicle.message_counts.items() if i in LAYOUTS
        }
        for name in ECHOED_MESSAGES if "echo_at_end" in dialogue else ():
            if ("gcs", name) in vehicle.newest_messages:
                result.echoed_fields[name] = vehicle.newest_messages["gcs", name][1]
        result.received = [
            Received(at_s - start_s, name, values)
            for at_s, link, name, values in vehicle.log
            if link == recorded_link and (name != "PING" or values["target_system"] != 0)
        ]
        if any(message["msg"] in STATE_MESSAGES for message in dialogue["received"]) and not next_follows:
            log_length = len(vehicle.log)
            vehicle.run(2.1)
            result.states_after = [
                Received(at_s - start_s, name, values)
                for at_s, link, name, values in vehicle.log[log_length:]
                if link == recorded_link and name in STATE_MESSAGES
            ]
        vehicle.compared_ids -= requested_ids
        return result


def _continues(dialogue: Dialogue) -> bool:
    """Whether the previous dialogue created this dialogue's state."""
    return any(each in dialogue["precondition"] for each in CAUSED_BY_PREVIOUS)


def _match_unavailable_reports(vehicle: Vehicle, dialogue: Dialogue) -> None:
    """Reports an unavailable mode before the dialogue if PX4 had: PX4 sends such a report at most once per
    second."""
    if dialogue["state"].get("armed") and sends_message(dialogue, "COMMAND_LONG"):
        reported = [e for e in dialogue["received"] if UNAVAILABLE_TEXT in str(e["fields"].get("text", ""))]
        refused = any(
            e["msg"] == "COMMAND_ACK" and e["fields"]["command"] == DO_SET_MODE and e["fields"]["result"] == 1
            for e in dialogue["received"]
        )
        if reported or refused:
            vehicle.run(1.1)
        if refused and not reported:
            vehicle.command(DO_SET_MODE, 1, 1)
            vehicle.run(0.1)


def _wait_for_transfers(vehicle: Vehicle) -> None:
    """Waits for the end of mission transfers that the previous dialogue left unfinished, as the recording
    did."""
    for _ in range(12):
        requested_at_s = [
            vehicle.newest_messages.get(("gcs", name), (-9.0,))[0]
            for name in ("MISSION_REQUEST_INT", "MISSION_REQUEST")
        ]
        if vehicle.now_s - max(requested_at_s) > 0.4:
            return
        vehicle.run(0.5)


def _upload_plan(vehicle: Vehicle, dialogue: Dialogue) -> None:
    """Uploads the plan that the recording downloads, unless the previous dialogue stored it."""
    counts = [e["fields"] for e in dialogue["received"] if e["msg"] == "MISSION_COUNT"]
    plan = [e["fields"] for e in dialogue["received"] if e["msg"] == "MISSION_ITEM_INT"]
    if not counts or len(plan) != counts[0]["count"]:
        return
    vehicle.upload(plan, floats="floats" in dialogue["precondition"])
    vehicle.run(2.5)
