"""Logs are read in processes of their own: their results, and a log that takes too much costs only itself."""

import asyncio
import json
import os
import select
import sys
from pathlib import Path

import pytest

from gcs_server.errors import InvalidRequest, LogUnusable
from gcs_server.logbook import work
from gcs_server.logbook.work import LogWork
from tests.unit.gcs_server.logbook.generated_ulogs import MAGIC, message, ulog
from tests.unit.gcs_server.replay.generated_logs import flight, log_bytes


def run(scenario):
    log_work = LogWork()
    try:
        return asyncio.run(scenario(log_work))
    finally:
        log_work.close()


def serve_with(monkeypatch, limits):
    """Replaces the worker by one with other limits: memory, processor time, time."""
    program = f"""
import sys
from gcs_server.logbook import tasks, ulog
from gcs_server.operations.fork_server import TaskLimits, serve_tasks
serve_tasks(int(sys.argv[-1]), tasks.answer_request, TaskLimits({limits}))
"""
    monkeypatch.setattr(work, "COMMAND", (sys.executable, "-c", program))


def test_logs_are_read_and_plotted(tmp_path):
    (tmp_path / "a.ulg").write_bytes(ulog())
    (tmp_path / "b.tlog").write_bytes(log_bytes(flight(seconds=5)))

    async def scenario(log_work):
        first = await log_work.read(tmp_path / "a.ulg", tmp_path / "columns-a")
        second = await log_work.read(tmp_path / "b.tlog", tmp_path / "columns-b")
        plotted = await log_work.plot(tmp_path / "columns-a", ["all_types:0/float_value"], 0, 5, 100)
        with pytest.raises(InvalidRequest, match="no field 'none'"):
            await log_work.plot(tmp_path / "columns-a", ["all_types:0/none"], None, None, 100)
        with pytest.raises(LogUnusable, match="not a telemetry log"):
            (tmp_path / "c.tlog").write_bytes(b"no log" * 1000)
            await log_work.read(tmp_path / "c.tlog", tmp_path / "columns-c")
        with pytest.raises(LogUnusable, match="cannot read"):
            await log_work.read(tmp_path / "missing.ulg", tmp_path / "columns-c")
        return json.loads(first), json.loads(second), json.loads(plotted)

    first, second, plotted = run(scenario)
    assert (first["kind"], second["kind"]) == ("ulog", "tlog")
    assert len(plotted["series"][0]["t_s"]) == 52
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} == {"columns-a", "columns-b"}


def bomb():
    """A format that is nested so that a row has 4 billion fields."""
    nested = b"".join(message("F", f"t{i}:t{i + 1}[9999] f;".encode()) for i in range(4))
    formats = nested + message("F", b"t4:float x;") + message("F", b"bomb:uint64_t timestamp;t0[9999] f;")
    return MAGIC + bytes(8) + message("B", bytes(40)) + formats + message("A", bytes(3) + b"bomb")


@pytest.mark.parametrize("limits", ["400_000_000, 60, 60", "8_000_000_000, 1, 60", "8_000_000_000, 60, 2"])
def test_a_log_that_needs_too_much_memory_or_time_costs_only_itself(tmp_path, monkeypatch, limits):
    serve_with(monkeypatch, limits)
    (tmp_path / "bomb.ulg").write_bytes(bomb())
    (tmp_path / "good.ulg").write_bytes(ulog(steps=20))

    async def scenario(log_work):
        async def fails():
            with pytest.raises(LogUnusable, match="more memory"):
                await log_work.read(tmp_path / "bomb.ulg", tmp_path / "columns-bomb")

        async def succeeds():
            return await log_work.read(tmp_path / "good.ulg", tmp_path / "columns-good")

        _, good = await asyncio.gather(fails(), succeeds())
        return json.loads(good)

    assert run(scenario)["kind"] == "ulog"
    assert not (tmp_path / "columns-bomb").exists()


def children(pid):
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def test_an_export_is_sent_in_pieces_and_its_process_ends_with_its_reader(tmp_path):
    (tmp_path / "a.ulg").write_bytes(ulog(steps=20_000))
    folder = tmp_path / "columns"

    async def scenario(log_work):
        await log_work.read(tmp_path / "a.ulg", folder)
        request = {"format": "csv", "topics": ["all_types:0"]}
        pieces = [piece async for piece in log_work.export(folder, "a", request)]
        assert pieces[0] == b""
        assert b"".join(pieces).count(b"\n") == 20_001
        with pytest.raises(InvalidRequest, match="no topic"):
            await anext(log_work.export(folder, "a", {"format": "csv", "topics": ["none:0"]}))
        half_read = log_work.export(folder, "a", request)
        await anext(half_read)
        (fork_server,) = children(os.getpid())
        (writing,) = children(fork_server)
        has_ended = os.pidfd_open(writing)
        await half_read.aclose()
        assert select.select([has_ended], [], [], 10.0)[0]
        os.close(has_ended)

    run(scenario)


def test_an_export_whose_process_dies_ends_with_an_error(tmp_path):
    (tmp_path / "a.ulg").write_bytes(ulog(steps=20_000))
    folder = tmp_path / "columns"

    async def scenario(log_work):
        await log_work.read(tmp_path / "a.ulg", folder)
        export = log_work.export(folder, "a", {"format": "csv", "topics": ["all_types:0"]})
        assert await anext(export) == b""
        (folder / "columns.bin").write_bytes(b"")  # the file shrinks under the process that reads it
        with pytest.raises(LogUnusable, match="more memory"):
            async for _ in export:
                pass

    run(scenario)
