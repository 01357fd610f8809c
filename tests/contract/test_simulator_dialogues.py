"""The simulated vehicle against dialogues recorded from a real PX4: same acknowledgements, words and events.

Each dialogue is replayed on a fake clock. Every difference is listed in KNOWN with its reason; one that is
not listed fails, and so does a listed one that has gone.
"""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from sim_station import EVENT_NAMES, HOLD, OFFBOARD, POSITION, Station

NOT_BUILT = "this function is not simulated"
LEFT_OUT = "PX4 left this text out here, and sends it elsewhere for the same refusal"
NO_MISSION = "missions are stored but not flown"

KNOWN: dict[str, str] = {
    "cmd_do_autotune": NOT_BUILT,
    "cmd_fixed_mag_cal_yaw": NOT_BUILT,
    "air_setmode_posctl": LEFT_OUT,
    "air_setmode_posctl_slow": LEFT_OUT,
    "air_setmode_auto_external8": LEFT_OUT,
    "air_setmode_offboard": LEFT_OUT,
    "air_standard_mode_1": LEFT_OUT,
    "air_setmode_auto_none": NO_MISSION,
    "air_setmode_auto_mission": NO_MISSION,
    "air_standard_mode_6": NO_MISSION,
    "air_mission_start_with_mission": NO_MISSION,
}

SKIPPED: dict[str, str] = {
    "arm_before_ready": "needs its own boot; the narrative tests have it",
    "air_takeoff_again": "its altitude is that of the recording's home",
}
"""Dialogues whose precondition this harness cannot make."""

Outcome = tuple[list[tuple[int, int]], list[str], list[str]]
"""Acknowledgements (command, result), texts, names of events."""


def load(shared: Path, group: str) -> list[dict[str, Any]]:
    path = shared / "px4" / "dialogues" / f"{group}.jsonl"
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def worth_comparing(text: str) -> bool:
    """Texts of modules that are not simulated, or that tell of sensors, are no part of the dialogue."""
    return not text.startswith(("[logger]", "Preflight Fail", "Takeoff detected", "Landing detected", "RTL:"))


def worth_comparing_event(name: str) -> bool:
    """Check reports repeat by their own clock, and what is left out as text is left out as event."""
    reports = ("check_", "commander_arming_check_summary", "commander_health_summary")
    left_out = ("logger_", "rtl_land", "commander_takeoff_detected", "commander_landing_detected")
    return not name.startswith(reports + left_out)


def recorded(dialogue: dict[str, Any], window_s: float) -> Outcome:
    acks: list[tuple[int, int]] = []
    texts: dict[int, str] = {}
    events: list[str] = []
    for entry in dialogue["received"]:
        if "link" in entry or entry["dt_s"] > window_s:
            continue
        fields = entry["fields"]
        if entry["msg"] == "COMMAND_ACK":
            acks.append((fields["command"], fields["result"]))
        elif entry["msg"] == "STATUSTEXT":
            texts[fields["id"]] = texts.get(fields["id"], "") + fields["text"]
        elif entry["msg"] == "EVENT":
            events.append(entry["decoded"]["name"])
    return (
        acks,
        [text for text in texts.values() if worth_comparing(text)],
        [name for name in events if worth_comparing_event(name)],
    )


def replay(s: Station, dialogue: dict[str, Any], window_s: float) -> Outcome:
    start_s = s.now_s
    for entry in dialogue["send"]:
        if entry["msg"] not in ("COMMAND_LONG", "COMMAND_INT", "SET_MODE") and "GIMBAL" not in entry["msg"]:
            pytest.fail(f"{dialogue['id']} sends {entry['msg']}, which this test does not know")
        due_s = start_s + entry["dt_s"]
        if due_s > s.now_s + 0.02:
            s.run(due_s - s.now_s)
        fields = {k: _value(v) for k, v in entry["fields"].items() if k != "int_value"}
        if fields.get("target_system") == dialogue["vehicle_system_id"]:
            fields["target_system"] = s.system_id
        s.send(entry["msg"], via=dialogue["link"], sender=tuple(entry.get("src", (255, 190))), **fields)
    s.run(window_s - (s.now_s - start_s))
    via, since_s = dialogue["link"], start_s + 0.001
    acks = [(m.command, m.result) for m in s.heard("COMMAND_ACK", via, since_s)]
    texts = [text for text in s.texts(since_s, via) if worth_comparing(text)]
    events = [EVENT_NAMES[m.values["id"]] for m in s.heard("EVENT", via, since_s)]
    return acks, texts, [name for name in events if worth_comparing_event(name)]


def _value(value: Any) -> Any:
    if value is None:
        return math.nan
    if value in ("inf", "-inf"):
        return float(value)
    return [_value(each) for each in value] if isinstance(value, list) else value


def bring_to(s: Station, armed: bool, custom_mode: int) -> None:
    """On the ground: armed or not, in a mode."""
    if s.armed != armed or (armed and s.flown_mode != custom_mode):
        s.command(400, 0)
        s.run(0.1)
        if armed:
            s.command(176, 1, 4, 3)
            s.run(0.1)
            s.command(400, 1)
            s.run(0.1)
            assert s.armed
    if s.flown_mode != custom_mode:
        s.command(176, 1, custom_mode >> 16 & 0xFF, custom_mode >> 24)
    s.run(0.1)
    assert (s.armed, s.flown_mode) == (armed, custom_mode)


def compare(outcomes: dict[str, tuple[Outcome, Outcome]]) -> None:
    new = {name: pair for name, pair in outcomes.items() if pair[0] != pair[1] and name not in KNOWN}
    gone = [name for name, pair in outcomes.items() if pair[0] == pair[1] and name in KNOWN]
    lines = [f"{name}: PX4 {pair[0]}, simulator {pair[1]}" for name, pair in new.items()]
    assert not lines, "\n".join(lines)
    assert not gone, f"these no longer differ, take them out of KNOWN: {gone}"


@pytest.mark.parametrize("group", ["arming", "mode", "command", "armed_ground"])
def test_on_the_ground(shared: Path, group: str) -> None:
    s = Station()
    s.run_until(lambda: s.ready, 15)
    outcomes: dict[str, tuple[Outcome, Outcome]] = {}
    for dialogue in load(shared, group):
        if dialogue["id"] in SKIPPED or not _commands_only(dialogue):
            continue
        if dialogue.get("state", {}).get("landed_state", 1) != 1:
            continue
        window_s = min(0.6 if group == "arming" else 0.3, dialogue["window_s"])
        asked = "requested" in dialogue["precondition"] and not dialogue["state_after"]["armed"]
        state = dialogue["state_after" if asked else "state"]
        bring_to(s, dialogue["state"]["armed"], state["custom_mode"])
        outcomes[dialogue["id"]] = recorded(dialogue, window_s), replay(s, dialogue, window_s)
    assert len(outcomes) > 5
    compare(outcomes)


def test_in_the_air(shared: Path) -> None:
    s = Station()
    s.fly_to(10)
    outcomes: dict[str, tuple[Outcome, Outcome]] = {}
    for dialogue in load(shared, "air"):
        if dialogue["id"] in SKIPPED or not _commands_only(dialogue):
            continue
        s.command(176, 1, 4, 3)
        s.run(0.3)
        assert s.flown_mode == HOLD
        window_s = min(0.3, dialogue["window_s"])
        outcomes[dialogue["id"]] = recorded(dialogue, window_s), replay(s, dialogue, window_s)
    assert len(outcomes) > 40
    compare(outcomes)


@pytest.mark.parametrize("group", ["gimbal", "message_interval"])
def test_in_their_own_order(shared: Path, group: str) -> None:
    """Each of these builds on the one before."""
    s = Station()
    s.run_until(lambda: s.ready, 15)
    outcomes: dict[str, tuple[Outcome, Outcome]] = {}
    for dialogue in load(shared, group):
        _gimbal_owner(s, dialogue)
        window_s = min(0.3, dialogue["window_s"])
        outcomes[dialogue["id"]] = recorded(dialogue, window_s), replay(s, dialogue, window_s)
    assert len(outcomes) > 10
    compare(outcomes)


def test_the_autopilot_version_is_the_real_ones(shared: Path) -> None:
    """Every field, on any instance: clients tell simulators by it."""
    dialogue = next(d for d in load(shared, "request_message") if d["id"] == "request_148_autopilot_version")
    real = next(e["fields"] for e in dialogue["received"] if e["msg"] == "AUTOPILOT_VERSION")
    for instance in (0, 6):
        s = Station(first_instance=instance)
        s.run(0.5)
        s.command(512, 148)
        s.run(0.1)
        ours = s.heard("AUTOPILOT_VERSION")[0]
        fields = {name: _plain(ours.values[name]) for name in real}
        assert fields == real
        assert ours.system_id == instance + 1


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple | bytes) else value


def _gimbal_owner(s: Station, dialogue: dict[str, Any]) -> None:
    words = dialogue["precondition"]
    for owner in ((255, 190), (42, 99), (7, 8)):
        if f"{owner[0]}/{owner[1]} in control" in words or f"{owner[0]}/{owner[1]} primary" in words:
            s.sim.autopilots[0].gimbal.primary = owner
    if "nobody in control" in words:
        s.sim.autopilots[0].gimbal.primary = (0, 0)


def _commands_only(dialogue: dict[str, Any]) -> bool:
    return bool(dialogue["send"]) and all(
        entry["msg"] in ("COMMAND_LONG", "COMMAND_INT", "SET_MODE") for entry in dialogue["send"]
    )


STREAMS = (
    "sp_mask_position_yaw_0x9f8", "sp_mask_velocity_0xdc7", "sp_mask_yaw_only_0x9ff", "sp_frame_2_mission",
    "sp_frame_8_body_acceleration", "sp_nan_position", "gsp_frame5", "gsp_frame0", "sp_att_mask_128_rates",
    "sp_target_wrong_system", "sp_target_system_0",
)  # fmt: skip


def test_offboard_streams(shared: Path) -> None:
    """A good stream at 10 m, then the recorded one: the same kinds of text, and the same mode afterwards."""
    s = Station()
    s.fly_to(10)
    dialogues = {dialogue["id"]: dialogue for dialogue in load(shared, "offboard")}
    wrong: list[str] = []
    for name in STREAMS:
        dialogue = dialogues[name]
        _hold_offboard(s)
        entry = dialogue["send"][0]
        fields = {k: _value(v) for k, v in entry["fields"].items()}
        if fields.get("target_system") == dialogue["vehicle_system_id"]:
            fields["target_system"] = s.system_id
        start_s = s.now_s
        period_s = 1.0 / entry["streamed_hz"]
        s.run(entry["duration_s"], lambda: s.send(entry["msg"], via="api", **fields), tick_s=period_s)  # noqa: B023
        _, said, _ = recorded(dialogue, entry["duration_s"])
        ours = (set(s.texts(since_s=start_s + 0.001)), s.flown_mode)
        theirs = (set(said), dialogue["state_after"]["custom_mode"])
        if "received_total" in dialogue:  # thinned: a single text in the middle may be missing
            ours = (ours[0] - {"Failsafe activated\t"}, ours[1])
            theirs = (theirs[0] - {"Failsafe activated\t"}, theirs[1])
        if name in ("sp_nan_position", "sp_mask_yaw_only_0x9ff", "sp_frame_2_mission", "gsp_frame0"):
            theirs = (theirs[0], ours[1])  # the recording ends near the change to Position
            assert ours[1] == POSITION
        if ours != theirs:
            wrong.append(f"{name}: PX4 {theirs}, simulator {ours}")
    assert not wrong, "\n".join(wrong)


def _hold_offboard(s: Station) -> None:
    def stream() -> None:
        s.send(
            "SET_POSITION_TARGET_LOCAL_NED", via="api", target_system=1, target_component=1,
            coordinate_frame=1, type_mask=2552, z=-10.0,
        )  # fmt: skip

    s.run(1.1, stream, tick_s=0.1)
    s.command(176, 1, 6)
    s.run(0.4, stream, tick_s=0.1)
    assert s.flown_mode == OFFBOARD
