"""Records are read from damaged files, and their times are corrected."""

import gzip
import io
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_server.replay.records import (
    Batch,
    Cursor,
    message_id,
    open_log,
    parse,
    read_batch,
    read_tlog,
    system_id,
)
from tests.unit.gcs_server.replay.generated_logs import BEGIN_US, flight, log_bytes, record

DAY_US = 86_400_000_000
FLIGHT = flight(seconds=6)
DATA = log_bytes(FLIGHT)


def parse_all(data):
    return parse(data, Cursor(), is_last=True)


def test_every_record_is_read_with_its_sender():
    batch = parse_all(DATA)
    assert [(r.time_us, r.raw) for r in batch.records] == FLIGHT
    assert batch.bytes_skipped == 0
    assert {system_id(r.key) for r in batch.records} == {1, 7, 255}
    assert {message_id(r.key) for r in batch.records} >= {0, 31, 33}
    assert all(DATA[r.offset + 8 :].startswith(r.raw) for r in batch.records)


@settings(deadline=None)
@given(st.lists(st.integers(1, len(DATA) - 1), max_size=5))
def test_records_are_equal_for_any_read_size(read_ends):
    cursor, records = Cursor(), []
    for end in [*sorted(read_ends), len(DATA)]:
        batch = parse(DATA[cursor.offset : end], cursor, is_last=end == len(DATA))
        records += batch.records
        cursor = batch.after
    assert [(r.time_us, r.raw) for r in records] == FLIGHT
    assert cursor.offset == len(DATA)


@settings(deadline=None)
@given(st.integers(0, len(DATA)), st.binary(min_size=1, max_size=60))
def test_garbage_affects_only_the_records_around_it(index, garbage):
    batch = parse_all(DATA[:index] + garbage + DATA[index:])
    lost = Counter(raw for _, raw in FLIGHT) - Counter(r.raw for r in batch.records)
    assert lost.total() <= 8  # the damaged record, and records in up to 290 bytes after a false header
    times = [r.time_us for r in batch.records]
    assert times == sorted(times)
    assert FLIGHT[0][0] <= times[0]
    assert times[-1] <= FLIGHT[-1][0] + DAY_US


@settings(deadline=None)
@given(st.binary(max_size=4000))
def test_random_bytes_raise_no_error(random_bytes):
    batch = parse_all(random_bytes)
    assert batch.after.offset == len(random_bytes)
    assert batch.bytes_skipped + sum(len(r.raw) + 8 for r in batch.records) == len(random_bytes)


@pytest.mark.parametrize("jump_us", [-3_600_000_000, 400 * DAY_US])
def test_a_clock_change_in_flight_does_not_change_durations(jump_us):
    half = len(FLIGHT) // 2
    changed_flight = FLIGHT[:half] + [(time_us + jump_us, raw) for time_us, raw in FLIGHT[half:]]
    batch = parse_all(log_bytes(changed_flight))
    assert [r.raw for r in batch.records] == [raw for _, raw in FLIGHT]
    times = [r.time_us for r in batch.records]
    assert times == sorted(times)
    assert abs(times[-1] - FLIGHT[-1][0]) < 1_000_000


def test_a_pause_of_hours_is_kept_and_jitter_is_smoothed():
    raw = FLIGHT[0][1]
    times = [BEGIN_US, BEGIN_US + 50, BEGIN_US + 20, BEGIN_US + 7_200_000_000]
    batch = parse_all(b"".join(record(t, raw) for t in times))
    assert [r.time_us - BEGIN_US for r in batch.records] == [0, 50, 50, 7_200_000_000]


def test_compressed_and_truncated_files_are_read(tmp_path):
    plain, compressed, truncated, truncated_gzip = (
        tmp_path / n for n in ("a.tlog", "b.tlog.gz", "c.tlog", "d.tlog.gz")
    )
    plain.write_bytes(DATA)
    compressed.write_bytes(gzip.compress(DATA))
    truncated.write_bytes(DATA[:-5])
    truncated_gzip.write_bytes(gzip.compress(DATA)[:-200])
    assert list(read_tlog(plain)) == list(read_tlog(compressed)) == FLIGHT
    assert list(read_tlog(truncated)) == FLIGHT[:-1]
    read_records = list(read_tlog(truncated_gzip))
    assert read_records == FLIGHT[: len(read_records)]
    false_gzip = tmp_path / "false_gzip.tlog.gz"
    false_gzip.write_bytes(b"not packed at all")
    with pytest.raises(OSError, match="gzip"):
        open_log(false_gzip)


def test_a_long_file_is_read_in_bounded_pieces(tmp_path):
    path = tmp_path / "long.tlog"
    long_flight = flight(seconds=400)
    path.write_bytes(log_bytes(long_flight))
    assert path.stat().st_size > 2 << 18  # more than two batches
    with open_log(path) as file:
        batch, batch_count, record_count = Batch([], Cursor(), at_end=False, bytes_skipped=0), 0, 0
        while not batch.at_end:
            batch = read_batch(file, batch.after)
            batch_count, record_count = batch_count + 1, record_count + len(batch.records)
        assert file.seek(0, io.SEEK_CUR) == 0
    assert (record_count, batch.bytes_skipped) == (len(long_flight), 0)
    assert batch_count >= 3
