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


def recorder(folder, **options):
    return TlogRecorder(folder, **{"max_bytes": 10_000_000, "keep_free_bytes": 0, **options})


def files(folder):
    return sorted(folder.glob("*.tlog"))


def test_appended_records_are_read_back(tmp_path):
    tlogs = recorder(tmp_path / "logs")
    channel = tlogs.channel("udpin-127.0.0.1/14550")
    for n in range(100):
        channel.append(stamp(NOW_US + n), FRAME)
    tlogs.close()
    (path,) = files(tmp_path / "logs")
    assert path.name == "20231114-221320-udpin-127.0.0.1_14550.tlog"
    assert list(read_tlog(path)) == [(NOW_US + n, FRAME) for n in range(100)]


def test_a_link_without_traffic_creates_no_file(tmp_path):
    tlogs = recorder(tmp_path)
    tlogs.channel("quiet")
    tlogs.close()
    assert files(tmp_path) == []


def test_a_recording_is_rotated_by_size_between_records(tmp_path):
    tlogs = recorder(tmp_path, max_bytes=1000)
    channel = tlogs.channel("a")
    for n in range(100):
        channel.append(stamp(NOW_US + n), FRAME)
        tlogs.flush()
    tlogs.close()
    assert len(files(tmp_path)) > 2
    assert all(path.stat().st_size <= 1000 for path in files(tmp_path))
    assert sorted(t for path in files(tmp_path) for t, _ in read_tlog(path)) == [
        NOW_US + n for n in range(100)
    ]


def test_a_full_disk_stops_the_recording_until_there_is_space(tmp_path, monkeypatch):
    tlogs = recorder(tmp_path)
    channel = tlogs.channel("a")
    channel.append(stamp(NOW_US), FRAME)
    tlogs.flush()
    real_write, full = os.write, True

    def write(descriptor, data):
        if not full:
            return real_write(descriptor, data)
        if len(data) > 10:
            return real_write(descriptor, data[:10])  # an incomplete record, then an error
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tlog_writer.os, "write", write)
    monkeypatch.setattr(tlog_writer, "TRY_AGAIN_FLUSHES", 2)
    channel.append(stamp(NOW_US + 1), FRAME)
    tlogs.flush()
    ((link, problem),) = tlogs.problems()
    assert link == "a"
    assert "No space left" in problem
    channel.append(stamp(NOW_US + 2), FRAME)
    assert channel.backlog_records == 0
    full = False
    tlogs.flush()
    tlogs.flush()
    assert tlogs.problems() == []
    channel.append(stamp(NOW_US + 3), FRAME)
    tlogs.close()
    assert [t for path in files(tmp_path) for t, _ in read_tlog(path)] == [NOW_US, NOW_US + 3]
    assert files(tmp_path)[0].stat().st_size == 8 + len(FRAME)


def test_too_little_disk_space_is_reported_with_the_limit(tmp_path):
    tlogs = recorder(tmp_path, keep_free_bytes=10**18)
    channel = tlogs.channel("a")
    channel.append(stamp(NOW_US), FRAME)
    tlogs.flush()
    assert "are kept free" in tlogs.problems()[0][1]
    assert files(tmp_path) == []
    tlogs.close()


def test_the_backlog_of_a_stalled_disk_is_limited(tmp_path, monkeypatch):
    monkeypatch.setattr(tlog_writer, "BACKLOG_LIMIT_RECORDS", 5)
    tlogs = recorder(tmp_path)
    channel = tlogs.channel("a")
    for n in range(10):
        channel.append(stamp(NOW_US + n), FRAME)
    assert channel.backlog_records == 5
    tlogs.flush()
    assert "too slow" in tlogs.problems()[0][1]
    tlogs.close()


def test_a_removed_link_ends_its_file(tmp_path):
    tlogs = recorder(tmp_path)
    channel = tlogs.channel("a")
    channel.append(stamp(NOW_US), FRAME)
    channel.closing = True
    tlogs.flush()
    assert tlogs._channels == []
    tlogs.close()


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
    until_s = time.monotonic() + 5
    while not channel.info().bytes:
        assert time.monotonic() < until_s
        time.sleep(0.01)
    recorder.close()
    assert faults
