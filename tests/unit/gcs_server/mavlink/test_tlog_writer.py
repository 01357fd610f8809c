"""Recordings of telemetry: format, rotation, and behaviour with a full or slow disk."""

import errno
import os
import time

from gcs_server.mavlink import tlog_writer
from gcs_server.mavlink.codec import encode_frame
from gcs_server.mavlink.tlog_writer import TlogRecorder, stamp
from gcs_server.replay.records import read_tlog

NOW_US = 1_700_000_000_000_000
FRAME = encode_frame(0, b"\x01" * 9, 0, 1, 1)


def make_recorder(folder, **options):
    return TlogRecorder(folder, **{"max_bytes": 10_000_000, "keep_free_bytes": 0, **options})


def tlog_files(folder):
    return sorted(folder.glob("*.tlog"))


def test_appended_records_are_read_back(tmp_path):
    recorder = make_recorder(tmp_path / "logs")
    channel = recorder.channel("udpin-127.0.0.1/14550")
    for n in range(100):
        channel.append(stamp(NOW_US + n), FRAME)
    recorder.close()
    (path,) = tlog_files(tmp_path / "logs")
    assert path.name == "20231114-221320-udpin-127.0.0.1_14550.tlog"
    assert list(read_tlog(path)) == [(NOW_US + n, FRAME) for n in range(100)]


def test_a_link_without_traffic_creates_no_file(tmp_path):
    recorder = make_recorder(tmp_path)
    recorder.channel("quiet")
    recorder.close()
    assert tlog_files(tmp_path) == []


def test_a_recording_is_rotated_by_size_between_records(tmp_path):
    recorder = make_recorder(tmp_path, max_bytes=1000)
    channel = recorder.channel("a")
    for n in range(100):
        channel.append(stamp(NOW_US + n), FRAME)
        recorder.flush()
    recorder.close()
    assert len(tlog_files(tmp_path)) > 2
    assert all(path.stat().st_size <= 1000 for path in tlog_files(tmp_path))
    assert sorted(time_us for path in tlog_files(tmp_path) for time_us, _ in read_tlog(path)) == [
        NOW_US + n for n in range(100)
    ]


def test_a_full_disk_stops_the_recording_until_there_is_space(tmp_path, monkeypatch):
    recorder = make_recorder(tmp_path)
    channel = recorder.channel("a")
    channel.append(stamp(NOW_US), FRAME)
    recorder.flush()
    real_write, disk_full = os.write, True

    def write(descriptor, data):
        if not disk_full:
            return real_write(descriptor, data)
        if len(data) > 10:
            return real_write(descriptor, data[:10])  # an incomplete record, then an error
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tlog_writer.os, "write", write)
    monkeypatch.setattr(tlog_writer, "TRY_AGAIN_FLUSHES", 2)
    channel.append(stamp(NOW_US + 1), FRAME)
    recorder.flush()
    ((link, problem),) = recorder.problems()
    assert link == "a"
    assert "No space left" in problem
    channel.append(stamp(NOW_US + 2), FRAME)
    assert channel.backlog_records == 0
    disk_full = False
    recorder.flush()
    recorder.flush()
    assert recorder.problems() == []
    channel.append(stamp(NOW_US + 3), FRAME)
    recorder.close()
    assert [time_us for path in tlog_files(tmp_path) for time_us, _ in read_tlog(path)] == [
        NOW_US,
        NOW_US + 3,
    ]
    assert tlog_files(tmp_path)[0].stat().st_size == 8 + len(FRAME)  # one record: its time and its frame


def test_too_little_disk_space_is_reported_with_the_limit(tmp_path):
    recorder = make_recorder(tmp_path, keep_free_bytes=10**18)
    channel = recorder.channel("a")
    channel.append(stamp(NOW_US), FRAME)
    recorder.flush()
    assert "are kept free" in recorder.problems()[0][1]
    assert tlog_files(tmp_path) == []
    recorder.close()


def test_the_backlog_of_a_stalled_disk_is_limited(tmp_path, monkeypatch):
    monkeypatch.setattr(tlog_writer, "BACKLOG_LIMIT_RECORDS", 5)
    recorder = make_recorder(tmp_path)
    channel = recorder.channel("a")
    for n in range(10):
        channel.append(stamp(NOW_US + n), FRAME)
    assert channel.backlog_records == 5
    recorder.flush()
    assert "too slow" in recorder.problems()[0][1]
    recorder.close()


def test_the_file_of_a_removed_link_is_closed(tmp_path):
    recorder = make_recorder(tmp_path)
    channel = recorder.channel("a")
    channel.append(stamp(NOW_US), FRAME)
    channel.closing = True
    recorder.flush()
    assert recorder._channels == []
    recorder.close()


def test_the_recorders_thread_continues_after_a_fault(tmp_path, monkeypatch):
    monkeypatch.setattr(tlog_writer, "FLUSH_INTERVAL_S", 0.01)
    recorder = TlogRecorder(tmp_path, max_bytes=1 << 20, keep_free_bytes=0)
    real_flush, faults = TlogRecorder.flush, []

    def flush(self):
        if not faults:
            faults.append(1)
            raise OverflowError("once")
        real_flush(self)

    monkeypatch.setattr(TlogRecorder, "flush", flush)
    recorder.start()
    channel = recorder.channel("l")
    channel.append(tlog_writer.stamp(1_700_000_000_000_000), b"frame")
    deadline_s = time.monotonic() + 5
    while not channel.info().bytes:
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    recorder.close()
    assert faults
