"""Replays the recorded dialogues to a simulated PX4 v1.17: it answers as recorded from v1.17.

The recordings of v1.17 list the dialogues of v1.16 that it answers differently, by facet. Every other
dialogue is answered as by v1.16, but for what the version itself says (numbers, modes, indices), which is
compared with the values of v1.17, and the rows of `explained_1_17.tsv`.
"""

from __future__ import annotations

import itertools
import json
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.contract.compare import Difference, compare
from tests.contract.driver import DialoguePlayer, DialogueResult
from tests.contract.explained import explained_count, key_of, rows_of_1_17
from tests.contract.recordings import Dialogue, folder_of_1_17, needs_logs, sessions
from tests.contract.rules import ParameterHashes
from vehicle_sim.px4_version import V1_17

QUICK_SESSIONS = frozenset(
    {"message_interval-0", "mission-1", "mode-1", "offboard-1", "param-0", "request_message-0", "shell-0"}
)
"""Sessions that `make test` replays."""
SESSION_NAMES = (
    "air-0", "armed_ground-0", "armed_ground-1", "arming-0", "arming-1", "arming_denied-0", "arming_denied-1",
    "calibration-0", "calibration-1", "command-0", "command-1", "command-2", "events-0", "fence-0", "ftp-0",
    "ftp-1", "gimbal-0", "gimbal_off-0", "link-0", "log-0", "message_interval-0", "mission-0", "mission-1",
    "mode-0", "mode-1", "offboard-0", "offboard-1", "param-0", "reboot-0", "request_message-0", "shell-0",
    "takeoff-0", "takeoff-1", "termination-0", "termination-1", "time-0", "time-1",
)  # fmt: skip
MAX_ROWS = 25
ALTITUDE_CRUISE_BIT = 1 << 8
TRANSFERRED = ("data_hex", "size", "opcode", "offset", "seq_number", "req_opcode", "(extra)")
_ALTITUDE = re.compile(r"-?\d+ m")


def _arming_summary(difference: Difference) -> bool:
    """Whether only the bits of Altitude Cruise differ: the mode needs sticks."""
    recorded, simulated = (
        struct.unpack_from("<BIIII", bytes(int(value) for value in side))
        for side in (difference.px4, difference.simulated)
    )
    cleared = [value & ~ALTITUDE_CRUISE_BIT for value in recorded[3:]]
    return recorded[:3] == simulated[:3] and cleared == list(simulated[3:])


def _always(_: Difference) -> bool:
    return True


def _is(expected: Any) -> Callable[[Difference], bool]:
    return lambda difference: difference.simulated == expected


OF_THE_VERSION: dict[tuple[str, str], Callable[[Difference], bool]] = {
    ("AUTOPILOT_VERSION", "flight_sw_version"): _is(17891583),
    ("AUTOPILOT_VERSION", "middleware_sw_version"): _is(17891583),
    ("AUTOPILOT_VERSION", "flight_custom_version"): _is([0, 0, 0, 196, 209, 42, 241, 214]),
    ("AUTOPILOT_VERSION", "middleware_custom_version"): _is([0, 0, 0, 196, 209, 42, 241, 214]),
    ("PROTOCOL_VERSION", "max_version"): _is(203),
    ("PROTOCOL_VERSION", "library_version_hash"): _is([9, 111, 236, 37, 13, 32, 175, 51]),
    ("AVAILABLE_MODES", "number_modes"): _is(26),
    ("AVAILABLE_MODES", "custom_mode"): _always,
    ("AVAILABLE_MODES", "mode_name"): _always,
    ("COMPONENT_INFORMATION", "general_metadata_file_crc"): _is(700027457),
    ("COMPONENT_METADATA", "file_crc"): _is(700027457),
    ("VFR_HUD", "airspeed"): lambda difference: difference.simulated != difference.simulated,
    ("MISSION_CURRENT", "mission_state"): lambda difference: difference.simulated in (1, 2, 3, 4, 5),
    ("MISSION_CURRENT", "mission_mode"): lambda difference: difference.simulated in (1, 2),
    ("EVENT", "[commander_arming_check_summary].arguments"): _arming_summary,
    ("LOG_DATA", "data"): _always,
    ("SERIAL_CONTROL", "text"): _always,
}
"""Fields that say the version, or that follow from its list of modes, and whether the value is that of v1.17;
the log and the console contain the version's name, and modes are compared by themselves."""


def is_of_the_version(difference: Difference) -> bool:
    if difference.field.endswith((".param_index", ".param_count")):
        return True
    if difference.message == "FILE_TRANSFER_PROTOCOL":
        return difference.field in TRANSFERRED  # the files of the build are longer
    check = OF_THE_VERSION.get((difference.message, difference.field))
    return check is not None and check(difference)


def facets(result: DialogueResult) -> dict[str, Any]:
    """What the recordings of v1.17 say of a dialogue."""
    received = [(m.name, m.values) for m in result.received]
    parameters = [v for name, v in received if name == "PARAM_VALUE" and v["param_id"] != "_HASH_CHECK"]
    return {
        "ack": [[v["command"], v["result"]] for name, v in received if name == "COMMAND_ACK"],
        "text": {_ALTITUDE.sub("", text) for text in _texts(result)},
        "mission": [
            [name, v["type" if name == "MISSION_ACK" else "seq"], v["mission_type"]]
            for name, v in received
            if name in ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK")
        ],
        "param": {(v["param_id"], v["param_type"], v["param_index"]) for v in parameters},
        "other": {str((name, v["command"])) for name, v in received if name == "COMMAND_LONG"}
        | {
            str((name, v["message_id"], v["interval_us"]))
            for name, v in received
            if name == "MESSAGE_INTERVAL"
        },
    }


def _texts(result: DialogueResult) -> list[str]:
    texts: dict[int, str] = {}
    for number, message in enumerate(result.received):
        if message.name == "STATUSTEXT":
            key = message.values["id"] or -number
            texts[key] = texts.get(key, "") + message.values["text"]
    return [text.rstrip("\t") for text in texts.values()]


def facet_problems(recorded: dict[str, Any], result: DialogueResult) -> list[str]:
    """The facets of a dialogue that are not those of v1.17; a state may be seen up to a second late."""
    simulated = facets(result)
    problems: list[str] = []
    for name, values in ((name, sides["v1.17"]) for name, sides in recorded.items()):
        if name == "ftp":
            continue  # the files themselves are compared in the other dialogues
        if name == "state":
            states = [[each[k] for k in ("armed", "custom_mode", "landed_state")] for each in result.states]
            is_equal = [values[:2]] == [state[:2] for state in states if state[:2] == values[:2]][:1]
        elif name == "text":
            is_equal = {_ALTITUDE.sub("", text) for text in values} <= simulated["text"]
        elif name == "param":
            rows = [re.match(r"\('(\w+)', .*, (\d+), (\d+)\)", row) for row in values]
            expected = {(row[1], int(row[2]), int(row[3])) for row in rows if row is not None}
            is_equal = expected <= simulated["param"]
        elif name == "other":
            is_equal = set(values) <= simulated["other"]
        else:
            is_equal = values == simulated[name]
        if not is_equal:
            problems.append(f"{name}: {values} | {simulated.get(name, result.states)}")
    return problems


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "session",
    [pytest.param(each, marks=() if each in QUICK_SESSIONS else pytest.mark.broad) for each in SESSION_NAMES],
)
def test_the_dialogues_of_a_session_are_answered_as_by_v1_17(session: str, reference_data: Path) -> None:
    path = folder_of_1_17(reference_data) / "dialogues-differ.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines()
    differing: dict[str, dict[str, Any]] = {each["id"]: each for each in map(json.loads, lines)}
    dialogues: list[Dialogue] = dict(sessions(reference_data / "px4" / "dialogues"))[session]
    player, hashes = DialoguePlayer(log=needs_logs(dialogues), px4=V1_17), ParameterHashes()
    explained, unexplained = rows_of_1_17(), list[str]()
    unused = {each["id"] for each in dialogues} & explained.keys()
    for dialogue, next_dialogue in itertools.zip_longest(dialogues, dialogues[1:]):
        name, result = dialogue["id"], player.play(dialogue, next_dialogue)
        recorded = differing.get(name)
        if recorded is not None and recorded["certainty"] == "sure":
            problems = facet_problems(recorded["facets"], result)
            if problems:
                unused.discard(name)
            if name not in explained:
                unexplained += [f"{name} | {problem}" for problem in problems]
            continue
        for difference in compare(dialogue, result, hashes):
            if is_of_the_version(difference) or explained_count(key_of(session, difference)):
                continue
            unused.discard(name)
            if name not in explained:
                unexplained.append(str(difference)[:300])
    assert not unexplained, "\n".join(unexplained)
    assert not unused, f"no longer a difference, delete these rows: {unused}"


def test_every_recorded_session_is_replayed(reference_data: Path) -> None:
    folder_of_1_17(reference_data)
    assert {name for name, _ in sessions(reference_data / "px4" / "dialogues")} == set(SESSION_NAMES)
    assert len(rows_of_1_17()) <= MAX_ROWS
