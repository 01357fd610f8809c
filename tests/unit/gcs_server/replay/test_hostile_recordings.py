"""Hostile recordings: index, seeking, memory and disk space stay within limits for any content."""

import asyncio
import gzip
import io
import shutil
import struct
from types import SimpleNamespace

import pytest

from gcs_server.errors import UnknownRecording
from gcs_server.replay import index as index_module
from gcs_server.replay import index_process, records
from gcs_server.replay import link as tlog
from gcs_server.replay.catalogue import Catalogue
from gcs_server.replay.index import make_index
from gcs_server.replay.index_process import from_bytes, to_bytes
from gcs_server.replay.link import TlogLink
from gcs_server.replay.playback import state_at
from gcs_server.replay.records import open_log
from tests.unit.gcs_server.replay.generated_logs import (
    BEGIN_US,
    FrameSource,
    flight,
    heartbeat,
    log_bytes,
    record,
)


def log_of_many_senders(count, step_us=100):
    """A log of records, each with another combination of system, component and message."""
    return b"".join(
        record(BEGIN_US + i * step_us, frame(1 + i % 250, i // 250 % 255, 500 + i // 63_750))
        for i in range(count)
    )


def frame(system_id, component_id, message_id):
    head = struct.pack("<BBBBBBB", 0xFD, 1, 0, 0, 0, system_id, component_id)
    return head + message_id.to_bytes(3, "little") + b"\0" + b"\0\0"


@pytest.fixture
def write_log(tmp_path):
    def write(data, name="made.tlog"):
        path = tmp_path / name
        path.write_bytes(data)
        return path

    return write


def index_of(path):
    with open_log(path) as file:
        return make_index(file)


def test_senders_and_messages_beyond_the_limit_are_omitted_and_counted(write_log):
    index = index_of(write_log(log_of_many_senders(index_module.MAX_KEYS + 2000)))
    assert index.left_out == 2000
    assert max(len(c.newest) for c in index.checkpoints) <= 2 * index_module.MAX_KEYS


def test_events_beyond_the_limit_are_omitted_and_counted(write_log, monkeypatch):
    monkeypatch.setattr(index_module, "MAX_EVENT_RECORDS", 30)
    autopilot = FrameSource(1)
    mode_changes = [(BEGIN_US + i, autopilot.frame(heartbeat(i % 2 << 16))) for i in range(100)]
    index = index_of(write_log(log_bytes(mode_changes)))
    assert len(index.changes) == 60  # time and offset of 30 changes
    assert index.left_out == 70


def test_checkpoints_are_limited_and_seeking_restores_every_state(write_log, monkeypatch):
    monkeypatch.setattr(records, "BATCH_BYTES", 8192)
    path = write_log(log_bytes(flight(seconds=120)))
    full_index = index_of(path)
    monkeypatch.setattr(index_module, "MAX_CHECKPOINT_NUMBERS", 200)
    thinned_index = index_of(path)
    assert len(thinned_index.checkpoints) < len(full_index.checkpoints) / 2
    assert sum(len(c.newest) for c in thinned_index.checkpoints) <= 200
    with open_log(path) as file:
        for fraction in (0.0, 0.3, 0.7, 1.0):
            at_us = int(full_index.begin_us + fraction * (full_index.end_us - full_index.begin_us))
            assert newest_frames(state_at(file, thinned_index, at_us)) == newest_frames(
                state_at(file, full_index, at_us)
            )


def newest_frames(state):
    """The last frame of each message that is fed after seeking."""
    # Bytes 5 to 9 of a MAVLink 2 frame are the system, component and message id.
    return {raw[5:10]: raw for raw in (r.raw for r in state.records)}


def test_seeking_restores_a_limited_number_of_changes(write_log, monkeypatch):
    monkeypatch.setattr("gcs_server.replay.playback.CHANGES_RESTORED", 5)
    monkeypatch.setattr("gcs_server.replay.playback.TEXTS_RESTORED", 5)
    autopilot = FrameSource(1)
    heartbeats = (autopilot.frame(heartbeat(i % 2 << 16, armed=i % 2 > 0)) for i in range(500))
    path = write_log(log_bytes([(BEGIN_US + i, raw) for i, raw in enumerate(heartbeats)]))
    index = index_of(path)
    with open_log(path) as file:
        state = state_at(file, index, index.end_us)
    assert len(state.records) <= 11  # both limits, and the last record
    assert state.records[-1].time_us == index.end_us


def test_an_index_is_unchanged_after_its_conversion_to_bytes(write_log):
    index = index_of(write_log(log_bytes(flight(seconds=60))))
    assert from_bytes(to_bytes(index)) == index


def test_a_recording_that_needs_too_much_memory_is_reported_as_text(write_log, monkeypatch):
    def use_too_much_memory(file):
        raise MemoryError

    monkeypatch.setattr(index_process, "make_index", use_too_much_memory)
    with pytest.raises(index_module.UnreadableRecording, match="more memory or time"):
        from_bytes(index_process._output(write_log(b"any")))


def test_a_gzip_bomb_is_refused_in_the_list_and_when_opened(write_log, monkeypatch):
    monkeypatch.setattr(records, "MAX_UNPACKED_BYTES", 1_000_000)
    path = write_log(gzip.compress(bytes(3_000_000)), "bomb.tlog.gz")
    with pytest.raises(OSError, match="unpacks to more than"):
        open_log(path)
    recordings = Catalogue(path.parent).all(frozenset())
    assert "unpacks to more than" in recordings[0].problem


def test_unpacking_leaves_free_disk_space(write_log, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=records.KEEP_FREE_BYTES - 1))
    with pytest.raises(OSError, match="too little free disk space"):
        open_log(write_log(gzip.compress(log_bytes(flight(seconds=2))), "packed.tlog.gz"))


@pytest.mark.parametrize("name", ["a" * 300 + ".tlog", "surrogate \ud800.tlog", "new\0line.tlog", "..", ""])
def test_an_invalid_name_is_an_unknown_recording(tmp_path, name):
    with pytest.raises(UnknownRecording, match="There is no recording"):
        Catalogue(tmp_path).path(name)


def test_a_file_name_that_is_not_text_is_not_listed(tmp_path):
    (tmp_path / "whole.tlog").write_bytes(log_bytes(flight(seconds=2)))
    with open(bytes(tmp_path) + b"/bad\xff.tlog", "wb") as file:  # noqa: PTH123 a name of bytes
        file.write(b"x")
    assert [info.name for info in Catalogue(tmp_path).all(frozenset())] == ["whole.tlog"]


@pytest.mark.parametrize("action", ["fast", "seeking"])
def test_the_number_of_records_per_loop_iteration_is_limited(write_log, monkeypatch, action):
    """A recording with thousands of senders at the same time must not delay real vehicles."""
    monkeypatch.setattr(tlog, "RECORDS_PER_TICK", 50)
    path = write_log(log_of_many_senders(3000, step_us=10))
    records_per_iteration = []

    async def scenario():
        link = TlogLink("made", "tlog:made", path, 50.0, index=index_of(path))
        trace = io.StringIO()  # one dot per record, one bar per iteration of the loop
        link.start(lambda data, peer, at_s: trace.write("."), lambda peer: None, lambda: None)
        await link.opened()
        loop = asyncio.get_running_loop()

        enough_records = asyncio.Event()

        def on_iteration():
            nonlocal handle
            trace.write("|")
            if trace.getvalue().count(".") >= 1000:
                enough_records.set()
            handle = loop.call_soon(on_iteration)

        handle = loop.call_soon(on_iteration)
        if action == "seeking":
            link.pause()
            await link.seek(BEGIN_US + 30_000)
        else:
            async with asyncio.timeout(20):
                await enough_records.wait()
        handle.cancel()
        await link.close()
        records_per_iteration.extend(len(part) for part in trace.getvalue().split("|"))

    asyncio.run(scenario())
    assert sum(records_per_iteration) >= 1000
    assert max(records_per_iteration) <= 50
