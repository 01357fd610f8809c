"""The journal: its files, limits and disk errors; a disk error never fails a command."""

import asyncio
import json
import os
import threading

import pytest

from gcs_server.clock import SystemClock
from gcs_server.control.journal import MAX_REFUSED_BYTES, MAX_TEXT_LENGTH, Journal
from gcs_server.supervise import Supervisor


def add_command(journal, command="arm"):
    return journal.add("me", command, "1", {}, "ok", None, 0.1)


def add_refusal(journal, detail="alt_home_m: no number", client="me"):
    return journal.add(client, "takeoff", "1", {}, "invalid_request", detail, 0.0)


class FakeClock:
    """A clock that the test advances."""

    def __init__(self):
        self.now_s = 1000.0

    def unix_s(self):
        return self.now_s

    def monotonic_s(self):
        return self.now_s


def count_complete_lines(path):
    """Number of complete lines, also while the next line is being written."""
    return path.read_bytes().count(b"\n") if path.exists() else 0


def lines_of(path):
    text = path.read_text() if path.exists() else ""
    return [json.loads(line) for line in text.splitlines()]


def test_lines_are_json_and_the_newest_entries_are_read_first(tmp_path):
    journal = Journal(SystemClock(), tmp_path / "journal.jsonl")
    for command in ("arm", "takeoff", "land"):
        add_command(journal, command)
    journal.flush()
    lines = [json.loads(line) for line in (tmp_path / "journal.jsonl").read_text().splitlines()]
    assert [line["command"] for line in lines] == ["arm", "takeoff", "land"]
    assert [entry.command for entry in journal.tail(2)] == ["land", "takeoff"]


def test_a_disk_error_is_a_warning_until_writing_works_again(tmp_path):
    path = tmp_path / "missing" / "journal.jsonl"
    journal = Journal(SystemClock(), path)
    add_command(journal)
    journal.flush()
    assert journal.warning is not None
    assert "journal" in journal.warning
    assert [entry.command for entry in journal.tail(5)] == ["arm"]
    path.parent.mkdir()
    journal.flush()
    assert journal.warning is None
    assert len(path.read_text().splitlines()) == 1


def test_a_full_file_is_rotated_and_two_files_are_kept(tmp_path):
    journal = Journal(SystemClock(), tmp_path / "journal.jsonl", max_bytes=1000)
    for number in range(40):
        add_command(journal, f"command-{number}")
        journal.flush()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["journal.1.jsonl", "journal.jsonl"]
    kept_commands = [
        json.loads(line)["command"]
        for name in ("journal.1.jsonl", "journal.jsonl")
        for line in (tmp_path / name).read_text().splitlines()
    ]
    assert kept_commands == [f"command-{number}" for number in range(40 - len(kept_commands), 40)]
    assert all(p.stat().st_size < 1200 for p in tmp_path.iterdir())


def test_refusals_do_not_displace_commands(tmp_path):
    journal = Journal(SystemClock(), tmp_path / "journal.jsonl", max_bytes=100_000)
    for number in range(50):
        add_command(journal, f"command-{number}")
    for number in range(5000):
        add_refusal(journal, f"{number}: " + ("x" * 5_000_000 if number < 5 else "y" * 2000))
        if number % 500 == 0:
            journal.flush()
    journal.flush()
    assert len(lines_of(tmp_path / "journal.jsonl")) == 50
    assert [entry.command for entry in journal.tail(1050)[-50:]] == [
        f"command-{n}" for n in range(49, -1, -1)
    ]
    refused = [path for path in tmp_path.iterdir() if "refused" in path.name]
    assert sum(path.stat().st_size for path in refused) < 2 * MAX_REFUSED_BYTES + 1_500_000
    assert max(len(line["detail"]) for line in lines_of(refused[0])) < MAX_TEXT_LENGTH + 50


def test_large_arguments_are_cut(tmp_path):
    journal = Journal(SystemClock(), tmp_path / "journal.jsonl")
    journal.add("me" * 10_000, "goto", "1", {"points": ["x" * 100] * 10_000}, "ok", None, 0.0)
    journal.flush()
    assert (tmp_path / "journal.jsonl").stat().st_size < 3000


def test_equal_refusals_of_one_client_are_written_once_and_then_counted_in_one_line(tmp_path):
    clock = FakeClock()
    journal = Journal(clock, tmp_path / "journal.jsonl")
    for number in range(1000):
        clock.now_s = 1000.0 + number * 0.005
        add_refusal(journal)
    add_refusal(journal, client="another")
    assert [(e.client, e.repeated) for e in journal.tail(10)] == [("another", 1), ("me", 1)]
    clock.now_s += 20.0
    assert sorted((e.client, e.repeated) for e in journal.tail(10)) == [
        ("another", 1),
        ("me", 1),
        ("me", 999),
    ]
    journal.flush()
    assert len(lines_of(tmp_path / "journal-refused.jsonl")) == 3


def test_a_restart_reads_earlier_lines_and_repairs_an_incomplete_line(tmp_path):
    path = tmp_path / "journal.jsonl"
    journal = Journal(SystemClock(), path)
    for command in ("arm", "takeoff"):
        add_command(journal, command)
    add_refusal(journal)
    journal.flush()
    with path.open("ab") as file:
        file.write(b'{"unix_s": 5, "client": "torn by a cra')

    async def restart():
        reopened = Journal(SystemClock(), path)
        await reopened.load()
        return reopened

    reopened = asyncio.run(restart())
    assert [entry.result for entry in reopened.tail(10)] == ["invalid_request", "ok", "ok"]
    assert [entry.command for entry in reopened.tail(10)] == ["takeoff", "takeoff", "arm"]
    add_command(reopened, "land")
    reopened.flush()
    assert [line["command"] for line in lines_of(path)] == ["arm", "takeoff", "land"]


@pytest.mark.parametrize("line", [b"[" * 100_000, b"null", b'{"unix_s": "x"}', b"\xff\xfe", b'{"a": 1}', b""])
def test_an_invalid_line_is_skipped(tmp_path, line):
    path = tmp_path / "journal.jsonl"
    journal = Journal(SystemClock(), path)
    add_command(journal, "arm")
    journal.flush()
    path.write_bytes(path.read_bytes() + line + b"\n")
    reopened = Journal(SystemClock(), path)
    asyncio.run(reopened.load())
    assert [entry.command for entry in reopened.tail(10)] == ["arm"]


def test_a_partial_write_leaves_no_incomplete_line(tmp_path, monkeypatch):
    path = tmp_path / "journal.jsonl"
    journal = Journal(SystemClock(), path)
    add_command(journal, "arm")
    journal.flush()
    content, real_write = path.read_bytes(), os.write
    monkeypatch.setattr(os, "write", lambda fd, data: real_write(fd, data[: len(data) // 2]))
    add_command(journal, "land")
    journal.flush()
    assert path.read_bytes() == content
    assert "No space left" in journal.warning
    monkeypatch.setattr(os, "write", real_write)
    journal.flush()
    assert [line["command"] for line in lines_of(path)] == ["arm", "land"]
    assert journal.warning is None


def test_the_event_loop_never_waits_for_the_journal_on_disk(tmp_path, monkeypatch):
    disk_ready, real_fsync = threading.Event(), os.fsync
    monkeypatch.setattr(os, "fsync", lambda fd: (disk_ready.wait(5), real_fsync(fd)))

    async def run():
        clock = SystemClock()
        supervisor = Supervisor(clock)
        journal = Journal(clock, tmp_path / "journal.jsonl")
        journal.start(supervisor)
        for number in range(3000):
            add_command(journal, f"command-{number}")
            if number % 100 == 0:
                await asyncio.sleep(0)  # the writer is blocked; the loop is not
        assert len(journal.tail(1000)) == 1000
        assert not disk_ready.is_set()
        disk_ready.set()
        while count_complete_lines(tmp_path / "journal.jsonl") < 2000:  # noqa: ASYNC110 a file has no notification
            await asyncio.sleep(0.01)
        await supervisor.close()
        return journal

    asyncio.run(asyncio.wait_for(run(), 10))  # noqa: TID251 time limit of a test
