"""Recorded ROS 2 dialogues in flight: the simulated vehicle is first brought into the initial state."""

from __future__ import annotations

import math
from typing import Any

from tests.contract.ros2_dialogues import (
    CHECK_REPLY,
    CHECK_REQUEST,
    GCS,
    TOLERANCE_S,
    VEHICLE_STATUS,
    Dialogue,
    Ros2DialoguePlayer,
    TimedDialogue,
    recorded_changes,
    recorded_modes,
)
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.external_modes.registry import EXECUTOR_COMPONENT
from vehicle_sim.external_modes.slots import FIRST_MODE, LAST_MODE
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import frame_v2
from vehicle_sim.ros2.topics import EXECUTOR_COMMAND

GROUPS = ("component_lost_in_flight", "executor", "overrides", "mode_replacement", "mode_flight")
RTL, LAND_COMMAND, TAKEOFF_COMMAND, ARM, SET_NAV_STATE = 5, 21, 22, 400, 100_001
CONTROLLERS = ("position", "velocity", "altitude", "climb_rate", "acceleration", "attitude", "rates")
ALL_CONTROLLERS_ENABLED = {f"flag_control_{name}_enabled": True for name in (*CONTROLLERS, "allocation")}
TAKEOFF_S = 9.0
"""Shortest time from the take-off command to Hold."""
MIN_CLIMB_M = 2.5
HEARTBEAT_S = 1.0
STEP_S = 0.02
LANDING_S = 12.0
"""Longest time for which a replayed landing may continue after the recorded end of its dialogue."""
ARMING_STATE_DISARMED = 1
FIRST_EXTERNAL_MODE_INDEX = 18
"""`mode_index` of the first external mode in AVAILABLE_MODES."""


class Ros2FlightPlayer(Ros2DialoguePlayer):
    """Plays dialogues that begin in flight, with the heartbeats of a ground station."""

    def __init__(self) -> None:
        super().__init__()
        self._heartbeat_gaps: list[tuple[float, float]] = []
        """Periods without heartbeats, in time since boot."""
        self._next_heartbeat_s = 0.0
        self._replied_count = 0
        self._is_preparing = False

    def _boot(self) -> None:
        self._heartbeat_gaps, self._next_heartbeat_s = [], 0.0

    def _prepare(self, dialogue: Dialogue) -> None:
        """Brings the vehicle into the state in which the dialogue began."""
        state = dialogue["state"]
        self._is_preparing, self._replied_count = True, len(self.vehicle.received_messages)
        missing = state["can_set_nav_states_mask"] & ~self._status()["can_set_nav_states_mask"]
        for mode in range(FIRST_MODE, LAST_MODE + 1):
            if missing >> mode & 1:
                self._register(dialogue, mode)
        landed = self.vehicle.sim.autopilots[0].commander.landed
        if landed and not state["landed"]:
            self._take_off(-state["z"])
        elif state["landed"] and not landed:
            self.vehicle.command(LAND_COMMAND)
            self._run(20.0)
        if self._status()["nav_state_user_intention"] != state["nav_state_user_intention"]:
            self.vehicle.command(SET_NAV_STATE, float(state["nav_state_user_intention"]))
            self._run(1.0)
        self._activate_executor(state["executor_in_charge"])
        self._is_preparing = False

    def _activate_executor(self, executor: int) -> None:
        """Activates an executor: selects its mode; the executor then selects the previous mode again."""
        status = self._status()
        if executor and not status["executor_in_charge"]:
            intended = float(status["nav_state_user_intention"])
            self.vehicle.command(SET_NAV_STATE, float(FIRST_MODE - 1 + executor))
            self._run(0.2)
            self.vehicle.command(
                SET_NAV_STATE,
                intended,
                topic=EXECUTOR_COMMAND,
                source_component=EXECUTOR_COMPONENT + executor,
            )
            self._run(1.0)

    def _status(self) -> dict[str, Any]:
        self._run(0.6)
        return self.vehicle.newest_fields(VEHICLE_STATUS)

    def _register(self, dialogue: Dialogue, mode: int) -> None:
        removed = [message["fields"] for message in dialogue["send"] if "unregister" in message["topic"]]
        entry = mode - FIRST_MODE + FIRST_EXTERNAL_MODE_INDEX
        listed = [m for m in recorded_modes(dialogue) if m["mode_index"] == entry]
        names = [message["name"] for message in removed if message["mode_id"] == mode]
        names += [m["mode_name"] for m in listed if not m["properties"]] + ["Lost Mode"]
        replaces = not dialogue["state"]["can_set_nav_states_mask"] >> RTL & 1
        request = {
            "name": names[0], "register_arming_check": True, "register_mode": True,
            "register_mode_executor": _has_executor(dialogue), "enable_replace_internal_mode": replaces,
            "replace_internal_mode": RTL if replaces else 0,
        }  # fmt: skip
        self.vehicle.send("/fmu/in/register_ext_component_request", request)
        self._run(0.1)
        self.vehicle.send("/fmu/in/config_control_setpoints", {"source_id": mode} | ALL_CONTROLLERS_ENABLED)
        self._run(0.5)

    def _take_off(self, climb_m: float) -> None:
        autopilot = self.vehicle.sim.autopilots[0]
        altitude_m = autopilot.view.estimate.alt_amsl_m + max(MIN_CLIMB_M, climb_m)
        self.vehicle.command(ARM, 1.0)
        self.vehicle.command(TAKEOFF_COMMAND, *[math.nan] * 6, altitude_m)
        self._run(TAKEOFF_S)
        while autopilot.commander.active is NavState.TAKEOFF:
            self._run(1.0)

    def _ends_with_landing(self, dialogue: Dialogue) -> bool:
        changes = recorded_changes(dialogue, VEHICLE_STATUS, "arming_state")
        return any(after == ARMING_STATE_DISARMED for _, (_, after) in changes)

    def _has_ended(self, now_s: float, timed_dialogue: TimedDialogue) -> bool:
        if now_s < timed_dialogue.duration_s:
            return False
        if (
            self._ends_with_landing(timed_dialogue.dialogue)
            and self.vehicle.sim.autopilots[0].commander.armed
        ):
            self._until_s = self.vehicle.sim.time_s + TOLERANCE_S
        return self.vehicle.sim.time_s >= self._until_s or now_s >= timed_dialogue.duration_s + LANDING_S

    def _begin(self, dialogue: Dialogue) -> None:
        marks = {each["text"]: self.began_s + each["dt_s"] for each in dialogue.get("marks") or []}
        if "GCS heartbeats stop" in marks:
            self._heartbeat_gaps = [
                (marks["GCS heartbeats stop"], marks.get("GCS heartbeats back", math.inf))
            ]

    def _run(self, seconds: float) -> None:
        end_s = self.vehicle.sim.time_s + seconds - 1e-6
        while self.vehicle.sim.time_s < end_s:
            now_s = self.vehicle.sim.time_s
            if now_s >= self._next_heartbeat_s:
                self._next_heartbeat_s = now_s + HEARTBEAT_S
                if not any(begin_s <= now_s < until_s for begin_s, until_s in self._heartbeat_gaps):
                    self._send_heartbeat()
            if self._is_preparing:
                self._reply_to_requests()
            super()._run(min(STEP_S, end_s - now_s + 1e-6))

    def _send_heartbeat(self) -> None:
        layout, payload = pack("HEARTBEAT", type=6, autopilot=8, mavlink_version=3)
        self.vehicle.sim.feed(0, "gcs", frame_v2(layout, payload, 0, *GCS))

    def _reply_to_requests(self) -> None:
        for _, topic, fields in self.vehicle.received_messages[self._replied_count :]:
            if topic == CHECK_REQUEST:
                for registration_id in range(2):
                    reply = {"request_id": fields["request_id"], "registration_id": registration_id}
                    self.vehicle.send(CHECK_REPLY, reply, can_arm_and_run=True, mode_req_local_position=True)
        self._replied_count = len(self.vehicle.received_messages)


def first_landing_s(dialogue: Dialogue) -> float:
    """Recorded time of the first landing; infinite if none was recorded."""
    texts = [message for message in dialogue["received"] if message.get("msg") == "STATUSTEXT"]
    landings = [text["dt_s"] for text in texts if "Landing detected" in text["fields"]["text"]]
    return min(landings, default=math.inf)


def _has_executor(dialogue: Dialogue) -> bool:
    state = dialogue["state"]
    overrides = [message["fields"] for message in dialogue["send"] if "config_overrides" in message["topic"]]
    sources = [each.get("source_type") for each in overrides]
    return bool(state["executor_in_charge"]) or 1 in sources or "exec" in dialogue["id"]
