"""MCAP files: each layout of PX4's messages is found from its definition, a recording has topics, track,
modes and times as a ULog, our own files open again as they were, and damaged ones are read in part or
refused."""

import contextlib
import json
import random

import numpy as np
import pytest
from mcap.writer import CompressionType

from gcs_server.logbook import overview, tasks
from gcs_server.logbook.columns import load
from gcs_server.logbook.exports.tracks import tracks
from gcs_server.logbook.findings.table import findings
from gcs_server.logbook.log import UnreadableLog
from gcs_server.logbook.logged_flights import flights_of
from gcs_server.logbook.mcap_log import read_mcap
from gcs_server.logbook.ros2_layout import NoLayout, layout_of
from gcs_server.ros2.message_types import VERSIONS
from tests.unit.gcs_server.logbook.generated_mcaps import BEGIN_NS, Recording, definition, flight
from tests.unit.gcs_server.logbook.generated_ulogs import mutated, ulog
from tests.unit.gcs_server.replay.generated_logs import flight as recorded
from tests.unit.gcs_server.replay.generated_logs import log_bytes


def read(folder, content, name="log.mcap"):
    path = folder / name
    path.write_bytes(content)
    return read_mcap(path)


def flat(values):
    for name, value in values.items():
        if isinstance(value, tuple):
            yield from ((f"{name}[{i}]", each) for i, each in enumerate(value))
        else:
            yield name, value


@pytest.mark.parametrize("version", list(VERSIONS))
def test_every_layout_of_px4_is_found_from_its_definition(version):
    rng = random.Random(version)
    for message in VERSIONS[version].values():
        layout = layout_of(definition(message))
        body = bytes(rng.choice((0, 1)) for _ in range(message.size))  # also a bool is then one
        row = np.frombuffer(body, layout.dtype("<"))[0]
        decoded = message.decode(bytes([0, 1, 0, 0]) + body)
        assert layout.size == message.size, message.name
        assert {name: row[name].item() for name in layout.names} == dict(flat(decoded)), message.name


def test_a_recording_has_the_topics_times_modes_and_track_of_a_flight(tmp_path):
    log = read(tmp_path, flight().content())
    assert log.problems == []
    assert (log.kind, log.start_unix_s) == ("mcap", pytest.approx(BEGIN_NS / 1e9 + 0.01))
    assert [topic.id for topic in log.topics] == [
        "vehicle_attitude:0",
        "vehicle_global_position:0",
        "vehicle_land_detected:0",
        "vehicle_local_position:0",
        "vehicle_status:0",
    ]
    position = next(topic for topic in log.topics if topic.name == "vehicle_local_position")
    assert np.array_equal(position.columns["x"], (np.arange(400) / 10).astype(np.float32))
    assert np.allclose(np.diff(position.times_s), 0.1, atol=1e-9)
    assert "timestamp" not in position.columns
    (vehicle,) = log.vehicles
    assert [span.name for span in vehicle.modes] == ["Position", "Hold"]
    assert vehicle.id == "7"
    (found,) = flights_of(log)
    assert (found.begin_s, found.ended, found.vehicle) == (pytest.approx(5.0), "landed", "7")
    assert found.begin_boot_s == pytest.approx(55.0, abs=0.02)
    assert not found.by_gps
    (track,) = tracks(log)
    assert track.alt_amsl_m.max() == pytest.approx(498.0)
    assert {each["kind"] for each in findings(log)["not_judged"]} != set()


def test_two_vehicles_of_one_recording_are_kept_apart(tmp_path):
    recording = flight("/px4_1", 11)
    log = read(tmp_path, flight("/px4_2", 12, recording, seconds=20).content())
    assert [vehicle.id for vehicle in log.vehicles] == ["11", "12"]
    assert {topic.instance for topic in log.topics} == {"11", "12"}
    assert [each.vehicle for each in flights_of(log)] == ["11", "12"]
    assert flights_of(log)[1].ended == "log_ends"
    assert [track.vehicle for track in tracks(log)] == ["11", "12"]


def test_a_vehicle_whose_clock_jumps_is_shown_at_the_recorders_times(tmp_path):
    recording = Recording()
    for step in range(100):
        jump_s = 500.0 if step > 50 else 0.0
        recording.add(
            "/fmu/out/vehicle_attitude", "VehicleAttitude", step / 10, {}, own_t_s=step / 10 + jump_s
        )
    log = read(tmp_path, recording.content())
    assert np.allclose(log.topics[0].times_s, np.arange(100) / 10)
    assert log.start_boot_s is None


def test_what_is_not_px4s_is_shown_or_left_out_in_words(tmp_path):
    recording = flight(seconds=2)
    vector = b"float64 x\nfloat64 y\n"
    point = recording.channel("/tool/point", "cdr", "ros2msg", vector)
    text = recording.channel("/tool/text", "cdr", "ros2msg", b"string data\n")
    proto = recording.channel("/tool/other", "protobuf", "protobuf", b"\0")
    recording.raw(point, 1.0, b"\x00\x00\x00\x00" + np.array([1.5, 2.5], ">f8").tobytes())
    recording.raw(point, 1.1, b"\x00\x01")
    recording.raw(text, 1.0, b"\x00\x01\x00\x00abc")
    recording.raw(proto, 1.0, b"abc")
    log = read(tmp_path, recording.content())
    tool = next(topic for topic in log.topics if topic.name == "tool.point")
    assert tool.columns["y"].tolist() == [2.5]
    said = " ".join(log.problems)
    assert "1 messages or chunks are damaged" in said
    assert "have texts or sequences, which are not plotted are left out: /tool/text." in said
    assert "/tool/other" in said


@pytest.mark.parametrize("compression", list(CompressionType))
def test_every_compression_is_read(tmp_path, compression):
    log = read(tmp_path, flight(recording=Recording(compression), seconds=3).content())
    assert len(log.topics) == 5


@pytest.mark.parametrize("source", [("a.ulg", ulog(steps=200)), ("b.tlog", log_bytes(recorded(seconds=20)))])
def test_our_own_mcap_opens_again_as_it_was(tmp_path, source):
    name, content = source
    (tmp_path / name).write_bytes(content)
    tasks.read(str(tmp_path / name), str(tmp_path / "columns"))
    before = load(tmp_path / "columns")
    pieces = []
    tasks.export(str(tmp_path / "columns"), name, {"format": "mcap"})(pieces.append)
    (tmp_path / "again.mcap").write_bytes(b"".join(pieces))
    tasks.read(str(tmp_path / "again.mcap"), str(tmp_path / "again"))
    after = load(tmp_path / "again")
    assert (after.kind, after.firmware) == (before.kind, before.firmware)
    assert after.parameters == before.parameters
    assert after.vehicles == before.vehicles or [v.modes for v in after.vehicles] == [
        v.modes for v in before.vehicles
    ]
    assert [(m.severity, m.text) for m in after.messages] == [(m.severity, m.text) for m in before.messages]
    assert {t.id for t in after.topics} == {t.id for t in before.topics}
    topics = {t.id: t for t in after.topics}
    for topic in before.topics:
        again = topics[topic.id]
        assert np.allclose(again.times_s, topic.times_s, atol=2e-6)
        assert again.units == topic.units
        for field, values in topic.columns.items():
            if values.dtype.kind == "S":
                continue
            assert again.columns[field].dtype.kind == values.dtype.kind, (topic.id, field)
            assert np.array_equal(
                again.columns[field],
                np.where(np.isfinite(values), values, np.nan) if values.dtype.kind == "f" else values,
                equal_nan=values.dtype.kind == "f",
            ), (topic.id, field)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("string name", "no fixed size"),
        ("float32[] values", "no fixed size"),
        ("float32[<=4] values", "no fixed size"),
        ("other/Thing thing", "not defined"),
        ("uint8[99999] values", "more than"),
        ("", "no fields"),
        ("x" * 300_000, "too long"),
        ("a/T t\n" + "=" * 80 + "\nMSG: a/T\nT t", "nested too deep"),
        (
            "a/T[9] t\n" + "=" * 80 + "\nMSG: a/T\nb/U[999] u\n" + "=" * 80 + "\nMSG: b/U\nuint8[999] x",
            "more than",
        ),
    ],
)
def test_definitions_without_a_bounded_layout_have_none(text, words):
    with pytest.raises(NoLayout, match=words):
        layout_of(text)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not an MCAP"),
        (b"no mcap at all", "not an MCAP"),
        (b"\x89MCAP0\r\n", "no messages that are known"),
        (Recording().content(), "no messages that are known"),
    ],
)
def test_what_has_no_values_is_refused_in_words(tmp_path, content, words):
    with pytest.raises(UnreadableLog, match=words):
        read(tmp_path, content)


def test_a_truncated_recording_gives_what_came_before(tmp_path):
    content = flight(seconds=30).content()
    log = read(tmp_path, content[: len(content) // 2])
    assert 5 < log.duration_s < 29
    assert "ends early" in log.problems[0]


def test_a_chunk_that_says_it_is_gigantic_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr("gcs_server.logbook.mcap_log.MAX_CHUNK_BYTES", 1000)
    recording = flight(seconds=1)
    with pytest.raises(UnreadableLog, match="damaged"):
        read(tmp_path, recording.content())


def test_only_so_many_values_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("gcs_server.logbook.mcap_log.MAX_VALUE_BYTES", 100_000)
    log = read(tmp_path, flight().content())
    assert log.duration_s < 30
    assert "Only the first" in log.problems[0]


def require_read_or_refused(folder, seeds):
    """Number of damaged files that are read in part; all others are refused in words."""
    (folder / "a.ulg").write_bytes(ulog(steps=30))
    tasks.read(str(folder / "a.ulg"), str(folder / "columns"))
    pieces = []
    tasks.export(str(folder / "columns"), "a", {"format": "mcap"})(pieces.append)
    plain = flight(recording=Recording(CompressionType.NONE), seconds=2).content()
    sources = (plain, flight(seconds=2).content(), b"".join(pieces))
    read_count = 0
    for seed in seeds:
        with contextlib.suppress(UnreadableLog):
            log = read(folder, mutated(sources[seed % 3], seed))
            json.loads(overview.encode(log))
            read_count += 1
    return read_count


def test_of_damaged_files_each_is_read_in_part_or_refused(tmp_path):
    assert (
        require_read_or_refused(tmp_path, range(150)) > 10
    )  # damage costs a chunk, and these files have few


@pytest.mark.broad
def test_of_many_damaged_files_each_is_read_in_part_or_refused(tmp_path):
    assert require_read_or_refused(tmp_path, range(1000, 6000)) > 300
