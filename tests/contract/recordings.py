"""The recorded dialogues: their sessions, their preconditions, and the messages that they send to the
vehicle."""

from __future__ import annotations

import itertools
import json
import math
import re
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from vehicle_sim.mavlink.dialect import BY_NAME, LAYOUTS
from vehicle_sim.mavlink.link import API, INTEGRITY_HZ

Dialogue = dict[str, Any]
SentMessage = tuple[float, str, str, dict[str, Any], tuple[int, int]]
"""Seconds since the dialogue began, link, message, fields, sender."""

STATE_MESSAGES = frozenset(
    {"HEARTBEAT", "CURRENT_MODE", "EXTENDED_SYS_STATE", "MISSION_CURRENT", "GIMBAL_MANAGER_STATUS",
     "HOME_POSITION", "GIMBAL_DEVICE_ATTITUDE_STATUS"}
)  # fmt: skip
"""The recordings keep each of these messages only when its content changed."""
REAL_TIME_FACTOR = 0.995
"""Speed of the recorded simulation: seconds of the vehicle's clock per second of the station's clock."""
STREAMED_TO_THE_END = frozenset(
    {"offboard_disarmed_stream_1hz", "offboard_disarmed_stream_2hz", "offboard_air_enter_exit"}
)
"""Dialogues whose stream continued to their end: the vehicle stays in Offboard for some seconds after the
last listed message."""
METRE_NORTH_E7 = math.degrees(1.0 / 6_371_000.0) * 1e7
METRE_EAST_E7 = METRE_NORTH_E7 / math.cos(math.radians(47.3977423))
"""One metre of latitude, and one metre of longitude at the recorded home [1e-7 degrees]."""
LISTED_STREAMS = {"timesync": "TIMESYNC", "current_event_sequence": "CURRENT_EVENT_SEQUENCE"}
"""Telemetry that is compared in the dialogues whose ids begin with these texts."""
REQUEST_MESSAGE = 512
"""MAV_CMD_REQUEST_MESSAGE; param1 is the message id."""
TELEMETRY = (frozenset(API | INTEGRITY_HZ) | {"SYSTEM_TIME"}) - STATE_MESSAGES - {"ORBIT_EXECUTION_STATUS"}
"""Streamed messages that are compared only in dialogues that request or list them."""


def folder_of_1_17(reference_data: Path) -> Path:
    """The recordings of PX4 v1.17."""
    path = reference_data / "px4" / "v1.17"
    if not (path / "dialogues-differ.jsonl").is_file():
        pytest.skip("the recordings of PX4 v1.17 are not beside this checkout")
    return path


def load_dialogues(path: Path) -> list[Dialogue]:
    """The dialogues of one group."""
    return [with_all_items(json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]


def with_all_items(dialogue: Dialogue) -> Dialogue:
    """Adds the items that the recorded upload of 200 items omits; PX4's checksum confirms them. Returns any
    other dialogue unchanged."""
    if dialogue["id"] != "mission_upload_200_items":
        return dialogue
    send = [*dialogue["send"][:1]]
    send += [
        {"dt_s": 0.0004 + 0.001 * item["seq"], "msg": "MISSION_ITEM_INT", "fields": item}
        for item in mission_of_200_items()
    ]
    requests = [e for e in dialogue["received"] if e["msg"] == "MISSION_REQUEST_INT"]
    other_messages = [e for e in dialogue["received"] if e["msg"] != "MISSION_REQUEST_INT"]
    repeated_requests = [{**requests[0], "fields": {**requests[0]["fields"], "seq": n}} for n in range(200)]
    return {**dialogue, "send": send, "received": repeated_requests + other_messages}


def mission_of_200_items() -> list[dict[str, Any]]:
    """A take-off and 199 waypoints in rows of 20, 1 m between waypoints and rows, from 10 m north of home."""
    common = {"frame": 6, "autocontinue": 1, "param1": 0.0, "param2": 0.0, "param3": 0.0, "param4": None,
             "z": 10.0, "mission_type": 0, "target_component": 1}  # fmt: skip
    items: list[dict[str, Any]] = []
    for n in range(200):
        north_m, east_m = (10.0 + n % 20, float(n // 20)) if n else (0.0, 0.0)
        items.append(common | {"seq": n, "command": 16 if n else 22, "current": int(n == 0),
                              "x": 473977423 + int(north_m * METRE_NORTH_E7),
                              "y": 85455936 + int(east_m * METRE_EAST_E7)})  # fmt: skip
    return items


def sessions(folder: Path) -> Iterator[tuple[str, list[Dialogue]]]:
    """Name and dialogues of each session: the dialogues of a group with one vehicle, in order from its
    boot."""
    for path in sorted(folder.glob("*.jsonl")):
        by_vehicle = itertools.groupby(load_dialogues(path), key=lambda d: d.get("vehicle_system_id"))
        for number, (_, dialogues) in enumerate(by_vehicle):
            yield f"{path.stem}-{number}", list(dialogues)


def needs_logs(dialogues: list[Dialogue]) -> bool:
    """Whether a dialogue of the session concerns the onboard log."""
    return any(
        each["msg"].startswith("LOG_") or "logger" in json.dumps(each)
        for dialogue in dialogues
        for each in (*dialogue["send"], *dialogue["received"])
    )


def python_value(value: Any) -> Any:
    """A recorded value as a Python value."""
    if value is None:
        return math.nan
    if value in ("inf", "-inf"):
        return float(value)
    return [python_value(each) for each in value] if isinstance(value, list) else value


def message_id(name: str) -> int:
    """The id of a message."""
    return BY_NAME[name].id


def requested_message_ids(dialogue: Dialogue) -> set[int]:
    """Ids of the telemetry that is part of this dialogue: requested by it, or listed by the recording."""
    ids = {
        int(entry["fields"]["param1"] or 0)
        for entry in dialogue["send"]
        if entry["msg"] == "COMMAND_LONG" and entry["fields"]["command"] == REQUEST_MESSAGE
    }
    ids |= {message_id(name) for prefix, name in LISTED_STREAMS.items() if dialogue["id"].startswith(prefix)}
    return {msg_id for msg_id in ids if msg_id in LAYOUTS}


def sends_message(dialogue: Dialogue, name: str) -> bool:
    """Whether a dialogue sends a message of this name."""
    return any(entry["msg"] == name for entry in dialogue["send"])


def requires_boot(precondition: str) -> bool:
    """Whether the vehicle must be started with the parameters of this precondition."""
    return "fresh boot" in precondition or "MNT_MODE_IN -1" in precondition


def parameters_in(precondition: str) -> dict[str, float]:
    """The parameters in a precondition, with their values."""
    found = re.findall(r"\b([A-Z][A-Z0-9]*_[A-Z0-9_]+)(?: set to |=| )(-?\d+(?:\.\d+)?)", precondition)
    return {name: float(value) if "." in value else int(value) for name, value in found}


def uploaded_mission(dialogue: Dialogue) -> list[dict[str, Any]]:
    """The items of the mission that a dialogue uploads; empty if PX4 did not accept the mission."""
    items = {e["fields"]["seq"]: e["fields"] for e in dialogue["send"] if e["msg"] == "MISSION_ITEM_INT"}
    accepted = any(e["msg"] == "MISSION_ACK" and e["fields"]["type"] == 0 for e in dialogue["received"])
    mission = [items[seq] for seq in sorted(items)]
    complete = [item["seq"] for item in mission] == list(range(len(mission)))
    return mission if accepted and complete and mission and mission[0]["mission_type"] == 0 else []


def timed_messages(
    dialogue: Dialogue, system_id: int, late_s: Mapping[tuple[str, int], float] | None = None
) -> list[SentMessage]:
    """The messages that a dialogue sends, by time, each message of a stream separately.

    Args:
        dialogue: the recorded dialogue.
        system_id: system id of the receiving vehicle.
        late_s: delay of the n-th message of each stream.
    """
    messages: list[SentMessage] = []
    for entry in dialogue["send"]:
        if entry["msg"] not in BY_NAME:
            continue  # the entry "stream stops" is no message
        fields = {k: python_value(v) for k, v in entry["fields"].items()}
        fields = _packable_fields(entry["msg"], fields, system_id)
        source = entry.get("src", (255, 190))
        link = entry.get("link", dialogue["link"])
        hz, duration_s = entry.get("streamed_hz", 0), entry.get("duration_s", 0)
        match = re.search(rf"{entry['msg']} .* at (\d+) Hz for (\d+) s", dialogue.get("note", ""))
        if match and entry is dialogue["send"][-1]:
            hz, duration_s = float(match.group(1)), float(match.group(2)) - entry["dt_s"]
        count = max(1, round(hz * duration_s))
        if hz and dialogue["id"] in STREAMED_TO_THE_END:
            count = int(hz * (dialogue["window_s"] - entry["dt_s"])) + 1
        for n in range(count):
            dt_s = entry["dt_s"] + (n / hz * REAL_TIME_FACTOR if count > 1 else 0.0)
            dt_s += (late_s or {}).get((dialogue["id"], n), 0.0)
            messages.append((dt_s, link, entry["msg"], fields, (source[0], source[1])))
    return sorted(messages, key=lambda each: each[0])


def _packable_fields(name: str, fields: dict[str, Any], system_id: int) -> dict[str, Any]:
    """Recorded fields in the form that the dialect packs. A message without a recorded target gets this
    vehicle as its target."""
    if "target_system" in BY_NAME[name].fields:
        fields = {"target_system": system_id, "target_component": 1} | fields
    if name == "PARAM_SET" and ("int_value" in fields or fields.get("value") is not None):
        number = fields.get("int_value", fields.get("value"))
        if isinstance(number, int):
            fields["param_value"] = struct.unpack("<f", struct.pack("<I", number & 0xFFFFFFFF))[0]
            fields.setdefault("param_type", 6)
        else:
            fields["param_value"], fields["param_type"] = number, 9
    if name == "FILE_TRANSFER_PROTOCOL":
        ftp = fields["payload"]
        ftp_header = struct.pack(
            "<HBBBBBBI", ftp["seq_number"], ftp["session"], ftp["opcode"], ftp["size"], ftp["req_opcode"],
            ftp["burst_complete"], ftp["padding"], ftp["offset"],
        )  # fmt: skip
        fields["payload"] = list((ftp_header + bytes.fromhex(ftp["data_hex"])).ljust(251, b"\0"))
    if name == "SERIAL_CONTROL" and "text" in fields:
        raw = fields["text"].encode()
        fields["count"] = fields.get("count", len(raw))
        fields["data"] = list(raw.ljust(70, b"\0"))
    return {key: value for key, value in fields.items() if key in BY_NAME[name].fields}
