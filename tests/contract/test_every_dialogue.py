"""Replays every recorded dialogue to the simulated vehicle: only explained differences occur.

A test fails for a difference without a row in `explained.tsv`, and for a row without a difference. `python -m
tests.contract.table [group or session…]` prints the table.
"""

import itertools
import os
from collections import Counter
from pathlib import Path

import pytest

from tests.contract.compare import compare, same
from tests.contract.driver import DialoguePlayer
from tests.contract.explained import EXPLAINED_DIFFERENCES, DifferenceKey, explained_count, key_of
from tests.contract.recordings import Dialogue, needs_logs, sessions
from tests.contract.rules import ParameterHashes

REPOSITORY = Path(__file__).resolve().parent.parent.parent
RECORDINGS_FOLDER = REPOSITORY.parent / "shared" / "px4" / "dialogues"
USE_ALL_DIALOGUES = RECORDINGS_FOLDER.is_dir() and os.environ.get("ALL_DIALOGUES") == "1"
SESSIONS: dict[str, list[Dialogue]] = dict(
    sessions(RECORDINGS_FOLDER if USE_ALL_DIALOGUES else Path(__file__).resolve().parent / "data")
)
"""The first few dialogues of most groups; in `make nightly` all dialogues, if the recordings are beside
the checkout."""
LONG_SESSIONS = {
    "air-0",
    "arming-0",
    "arming_denied-0",
    "arming_denied-1",
    "armed_ground-1",
    "calibration-1",
    "termination-0",
}
"""Each of these sessions takes as long as ten others: only `make nightly` replays them."""
DIALOGUE_COUNT = 602
MAX_ROWS = 40
RATE_HZ_TOLERANCE = 0.1


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "session",
    [pytest.param(name, marks=pytest.mark.broad if name in LONG_SESSIONS else ()) for name in SESSIONS],
)
def test_dialogues_of_a_session_have_only_explained_differences(session: str) -> None:
    """One test per session, since each dialogue starts in the state in which the previous one ended."""
    dialogues, hashes = SESSIONS[session], ParameterHashes()
    player = DialoguePlayer(log=needs_logs(dialogues))
    counts: Counter[DifferenceKey] = Counter()
    unexplained: list[str] = []
    for dialogue, next_dialogue in itertools.zip_longest(dialogues, dialogues[1:]):
        for difference in compare(dialogue, player.play(dialogue, next_dialogue), hashes):
            key = key_of(session, difference)
            counts[key] += 1
            if counts[key] > explained_count(key):
                unexplained.append(str(difference)[:300])
    assert not unexplained, "\n".join(unexplained)
    dialogue_ids = {dialogue["id"] for dialogue in dialogues}
    stale_rows = [row for row in EXPLAINED_DIFFERENCES if row[:2] in {(session, d) for d in dialogue_ids}
             and counts[row] < explained_count(row)]  # fmt: skip
    assert not stale_rows, f"no longer a difference, delete these rows: {stale_rows}"


def test_all_recorded_dialogues_are_replayed(recordings_folder: Path) -> None:
    assert recordings_folder == RECORDINGS_FOLDER.parent
    assert sum(len(dialogues) for dialogues in SESSIONS.values()) == DIALOGUE_COUNT


def test_the_comparison_finds_a_missing_message_a_changed_result_and_a_changed_value() -> None:
    dialogue = next(d for d in SESSIONS["request_message-0"] if d["id"] == "request_1_sys_status")
    result = DialoguePlayer().play(dialogue)
    assert not compare(dialogue, result)
    for entry in dialogue["received"]:
        without_entry = {**dialogue, "received": [e for e in dialogue["received"] if e is not entry]}
        assert compare(without_entry, result) or entry["msg"] == "SYS_STATUS"
        field = "result" if entry["msg"] == "COMMAND_ACK" else "onboard_control_sensors_health"
        changed_entry = {**entry, "fields": {**entry["fields"], field: 3}}
        changed = {**dialogue, "received": [changed_entry if e is entry else e for e in dialogue["received"]]}
        assert [d.field for d in compare(changed, result)] != []
    assert same([1.0, float("nan")], [1.0000001, float("nan")])
    assert not same(1.0, 1.01)
    assert same(1.0, 1.01, 0.02)


def test_the_documentation_explains_exactly_the_causes_of_the_table() -> None:
    text = (REPOSITORY / "docs" / "simulator.md").read_text(encoding="utf-8")
    section = text.split("## Differences in the recorded dialogues")[1].split("\n## ")[0]
    table = [line.split("|")[1].strip() for line in section.splitlines() if line.startswith("| ")]
    assert sorted(table[1:]) == sorted({row.cause for row in EXPLAINED_DIFFERENCES.values()})


def test_the_table_is_short_and_each_row_belongs_to_a_recorded_dialogue(reference_data: Path) -> None:
    recorded = {
        (name, d["id"])
        for name, dialogues in sessions(reference_data / "px4" / "dialogues")
        for d in dialogues
    }
    assert len(EXPLAINED_DIFFERENCES) <= MAX_ROWS
    assert {key[:2] for key in EXPLAINED_DIFFERENCES} <= recorded
    assert all(
        row.count > 0 and not set("*?") & set("".join(key)) for key, row in EXPLAINED_DIFFERENCES.items()
    )


@pytest.mark.parametrize(("part", "begin_s"), [("after_200000us", 0), ("after_0", 4.5)])
def test_a_stream_has_the_requested_rate(reference_data: Path, part: str, begin_s: float) -> None:
    """Counts the messages of the last four seconds, as the recording did."""
    dialogues = dict(sessions(reference_data / "px4" / "dialogues"))["message_interval-0"]
    dialogue = next(d for d in dialogues if "measured_hz" in d)
    end_s = begin_s + 4.5
    sent = [e for e in dialogue["send"] if e["dt_s"] < end_s]
    result = DialoguePlayer(("ATTITUDE",)).play({**dialogue, "send": sent, "window_s": end_s})
    before = DialoguePlayer(("ATTITUDE",)).play({**dialogue, "send": sent, "window_s": end_s - 4.0})
    counted_hz = (result.message_counts["ATTITUDE"] - before.message_counts["ATTITUDE"]) / 4.0
    assert counted_hz == pytest.approx(dialogue["measured_hz"][part], rel=RATE_HZ_TOLERANCE)
