"""Telemetry logs: all values equal those that pymavlink decodes; damaged ones are read in part or refused."""

import contextlib
import gzip
import json
import random

import numpy as np
import pytest

from gcs_server.logbook import overview
from gcs_server.logbook.log import UnreadableLog
from gcs_server.logbook.tlog import _NUMPY_TYPES, read_tlog
from gcs_server.mavlink.tables import LAYOUTS
from tests.unit.gcs_server.logbook.generated_ulogs import mutated
from tests.unit.gcs_server.replay.generated_logs import (
    BEGIN_US,
    FrameSource,
    flight,
    heartbeat,
    log_bytes,
)
from vehicle_sim.mavlink import generated_dialect as sim_dialect


def read(folder, content, name="log.tlog"):
    path = folder / name
    path.write_bytes(content)
    return read_tlog(path)


def decoded(records):
    """Values that pymavlink decodes, by message and sender."""
    found = {}
    decoder = sim_dialect.MAVLink(None)
    decoder.robust_parsing = True
    for _, raw in records:
        for message in decoder.parse_buffer(raw) or ():
            key = f"{message.get_type()}:{message.get_srcSystem()}.{message.get_srcComponent()}"
            found.setdefault(key, []).append(message)
    return found


def test_values_equal_those_that_pymavlink_decodes(tmp_path):
    records = list(flight(seconds=20))
    log = read(tmp_path, log_bytes(records))
    topics = {topic.id: topic for topic in log.topics}
    compared = 0
    for key, messages in decoded(records).items():
        topic = topics.get(key)
        if topic is None:  # with an instance of the message's own
            continue
        assert len(topic.times_s) == len(messages)
        for name in messages[0].get_fieldnames():
            values = [getattr(message, name) for message in messages]
            if isinstance(values[0], str):
                continue
            columns = (
                [topic.columns[f"{name}[{i}]"] for i in range(len(values[0]))]
                if isinstance(values[0], list | tuple)
                else [topic.columns[name]]
            )
            expected = np.array(values).reshape(len(values), -1)
            np.testing.assert_array_equal(np.column_stack(columns), expected)
            compared += 1
    assert compared > 50


def test_the_layout_of_every_message_of_the_dialect_is_known():
    for layout in LAYOUTS.values():
        cls = layout.message_class
        types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
        size = sum(
            np.dtype(_NUMPY_TYPES[types[name]]).itemsize * max(1, count)
            for name, count in zip(cls.ordered_fieldnames, cls.array_lengths, strict=True)
        )
        assert size == layout.unpacker.size, layout.name


def test_vehicles_texts_parameters_and_states(tmp_path):
    source = FrameSource(3)
    frames = [source.frame(heartbeat(4 << 16 | 3 << 24, armed=step >= 5)) for step in range(10)]
    for i, words in enumerate((b"A text that is cut ".ljust(50), b"and continued")):
        frames.insert(4 + i, source.frame(sim_dialect.MAVLink_statustext_message(2, words, 9, i)))
    whole = np.frombuffer(np.int32(50_007).tobytes(), np.float32)[0]
    for value, kind in ((whole, 6), (2.5, 9)):
        name = b"SYS_AUTOSTART" if kind == 6 else b"MPC_Z_VEL_MAX"
        frames.append(source.frame(sim_dialect.MAVLink_param_value_message(name, float(value), kind, 2, 0)))
    frames.append(source.frame(sim_dialect.MAVLink_param_value_message(b"MPC_Z_VEL_MAX", 1.5, 9, 2, 0)))
    frames.append(source.frame(sim_dialect.MAVLink_param_value_message(b"_HASH_CHECK", 7.0, 5, 2, 0)))
    records = [(BEGIN_US + i * 1_000_000, frame) for i, frame in enumerate(frames)]
    found = json.loads(overview.encode(read(tmp_path, log_bytes(records))))
    assert found["start_unix_s"] == BEGIN_US / 1e6
    assert found["messages"] == [{"t_s": 4.0, "severity": 2, "text": "A text that is cutand continued"}]
    values = {p["name"]: p["value"] for p in found["parameters"]}
    assert values == {"SYS_AUTOSTART": 50_007, "MPC_Z_VEL_MAX": 2.5}
    assert found["parameter_changes"] == [{"t_s": 14.0, "name": "MPC_Z_VEL_MAX", "value": 1.5}]
    (vehicle,) = found["vehicles"]
    assert (vehicle["id"], vehicle["modes"][0]["name"]) == ("3", "Hold")
    assert [(s["begin_s"], s["end_s"]) for s in vehicle["armed"]] == [(7.0, 15.0)]


def test_two_vehicles_in_one_log_are_kept_apart_and_a_compressed_log_is_read(tmp_path):
    log = read(tmp_path, gzip.compress(log_bytes(flight(seconds=10))), "log.tlog.gz")
    assert [vehicle.id for vehicle in log.vehicles] == ["1", "7"]
    assert {"HEARTBEAT:1.1", "HEARTBEAT:7.1"} <= {topic.id for topic in log.topics}


def test_a_frame_with_a_wrong_checksum_is_left_out_and_said(tmp_path):
    records = list(flight(seconds=4))
    time_us, raw = records[10]
    records[10] = (time_us, raw[:12] + bytes([raw[12] ^ 1]) + raw[13:])
    log = read(tmp_path, log_bytes(records))
    assert "1 messages have a wrong checksum" in log.problems[0]


@pytest.mark.parametrize(
    ("content", "words"), [(b"", "empty"), (b"Dear reader, no telemetry. " * 99, "not a telemetry log")]
)
def test_what_is_no_tlog_is_refused_in_words(tmp_path, content, words):
    with pytest.raises(UnreadableLog, match=words):
        read(tmp_path, content)


def require_read_or_refused(folder, seeds):
    content = log_bytes(flight(seconds=5))
    read_logs = 0
    for seed in seeds:
        damaged = mutated(content, seed) if seed % 2 else random.Random(seed).randbytes(500) + content[seed:]
        found = None
        with contextlib.suppress(UnreadableLog):
            found = read(folder, damaged)
        if found is not None:
            json.loads(overview.encode(found))
            read_logs += 1
    return read_logs


def test_of_damaged_tlogs_each_is_read_in_part_or_refused(tmp_path):
    assert require_read_or_refused(tmp_path, range(150)) > 100


@pytest.mark.broad
def test_of_many_damaged_tlogs_each_is_read_in_part_or_refused(tmp_path):
    assert require_read_or_refused(tmp_path, range(1000, 4000)) > 2000
