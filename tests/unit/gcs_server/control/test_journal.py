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


def test_a_full_file_becomes_the_one_before_and_two_are_kept(tmp_path):
    journal = Journal(SystemClock(), tmp_path / "journal.jsonl", max_bytes=1000)
    for number in range(40):
        add(journal, f"command-{number}")
        journal.flush()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["journal.1.jsonl", "journal.jsonl"]
    kept = [
        json.loads(line)["command"]
        for name in ("journal.1.jsonl", "journal.jsonl")
        for line in (tmp_path / name).read_text().splitlines()
    ]
    assert kept == [f"command-{number}" for number in range(40 - len(kept), 40)]
    assert all(p.stat().st_size < 1200 for p in tmp_path.iterdir())
