"""A journal that cannot be written costs its lines on disk, never a command."""

import json

from gcs_server.clock import SystemClock
from gcs_server.control.journal import Journal


def add(journal, command="arm"):
    return journal.add("me", command, "1", {}, "ok", None, 0.1)


def test_lines_are_json_newest_first_in_the_tail(tmp_path):
    journal = Journal(SystemClock(), tmp_path / "journal.jsonl")
    for command in ("arm", "takeoff", "land"):
        add(journal, command)
    journal.flush()
    lines = [json.loads(line) for line in (tmp_path / "journal.jsonl").read_text().splitlines()]
    assert [line["command"] for line in lines] == ["arm", "takeoff", "land"]
    assert [entry.command for entry in journal.tail(2)] == ["land", "takeoff"]


def test_a_refusing_disk_is_a_warning_and_heals(tmp_path):
    path = tmp_path / "gone" / "journal.jsonl"
    journal = Journal(SystemClock(), path)
    add(journal)
    journal.flush()
    assert journal.warning is not None
    assert "journal" in journal.warning
    assert [entry.command for entry in journal.tail(5)] == ["arm"]
    path.parent.mkdir()
    journal.flush()
    assert journal.warning is None
    assert len(path.read_text().splitlines()) == 1
