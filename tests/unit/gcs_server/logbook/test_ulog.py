"""ULogs: all values equal pyulog's own, for every type of field; damaged and cut logs give what can be read,
or say why nothing can."""

import gzip
import json

import numpy as np
import pytest
from pyulog import ULog

from gcs_server.logbook import overview
from gcs_server.logbook.log import Log, UnreadableLog
from gcs_server.logbook.ulog import read_ulog
from tests.unit.gcs_server.logbook.generated_ulogs import UTC_US, appended, definitions, mutated, ulog
from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.storage.files import VehicleFiles


def read(folder, content) -> Log:
    path = folder / "log.ulg"
    path.write_bytes(content)
    return read_ulog(path)


def read_or_reason(folder, content) -> Log | str:
    try:
        return read(folder, content)
    except UnreadableLog as error:
        return str(error)


def require_equal_to_pyulog(log, path):
    topics = {topic.id: topic for topic in log.topics}
    compared = 0
    for data in ULog(str(path)).data_list:
        stamps = data.data["timestamp"]
        known = stamps > 0
        if not known.any():
            assert f"{data.name}:{data.multi_id}" not in topics
            continue
        topic = topics[f"{data.name}:{data.multi_id}"]
        order = np.argsort(stamps[known], kind="stable")
        assert set(topic.columns) == set(data.data) - {"timestamp"}
        for name, values in topic.columns.items():
            assert values.dtype == data.data[name].dtype
            np.testing.assert_array_equal(values, data.data[name][known][order])
            compared += 1
    return compared


def test_values_of_every_type_equal_pyulogs(tmp_path):
    log = read(tmp_path, ulog())
    assert require_equal_to_pyulog(log, tmp_path / "log.ulg") == 12 + 12 + 3 + 7 + 2
    nested = next(topic for topic in log.topics if topic.name == "path")
    assert list(nested.columns)[:4] == ["points[0].x", "points[0].yz[0]", "points[0].yz[1]", "points[1].x"]


def test_the_overview_says_what_was_logged(tmp_path):
    found = json.loads(overview.encode(read(tmp_path, ulog())))
    assert (found["kind"], found["firmware"], found["hardware"]) == ("ulog", "PX4 v1.16.0", "TEST_BOARD")
    assert found["start_unix_s"] == pytest.approx(UTC_US / 1e6, abs=1e-3)
    assert found["duration_s"] == pytest.approx(19.9, abs=0.01)
    topics = {topic["id"]: topic for topic in found["topics"]}
    assert topics["all_types:0"]["rate_hz"] == pytest.approx(10)
    assert topics["all_types:1"]["samples"] == 100
    assert {"name": "double_value", "unit": None, "type": "float64"} in topics["all_types:0"]["fields"]
    assert {"name": "MPC_XY_VEL_MAX", "value": 12.0} in found["parameters"]
    (change,) = found["parameter_changes"]
    assert change == {"t_s": pytest.approx(6.0, abs=0.11), "name": "MPC_XY_VEL_MAX", "value": 5.0}
    assert [m["text"] for m in found["messages"]] == ["logger started", "Low battery"]
    assert (found["messages"][1]["severity"], found["messages"][1]["t_s"]) == (4, pytest.approx(6.0))
    assert found["dropouts"] == [{"t_s": pytest.approx(12.0, abs=0.1), "duration_s": 0.25}]
    (vehicle,) = found["vehicles"]
    assert vehicle["id"] == "7"
    assert [(m["name"], round(m["begin_s"]), round(m["end_s"])) for m in vehicle["modes"]] == [
        ("Hold", 0, 5),
        ("Take off", 5, 8),
        ("Hold", 8, 20),
    ]
    assert [(round(s["begin_s"]), round(s["end_s"])) for s in vehicle["armed"]] == [(5, 15)]
    assert [(round(s["begin_s"]), round(s["end_s"])) for s in vehicle["failsafe"]] == [(10, 12)]
    assert found["problems"] == []


def test_appended_data_are_read(tmp_path):
    log = read(tmp_path, appended())
    assert log.messages[-1].text == "appended text"
    assert require_equal_to_pyulog(log, tmp_path / "log.ulg") == 36


def test_a_log_cut_at_every_kilobyte_gives_the_part_before_the_cut_or_says_why_not(tmp_path):
    content = ulog(steps=400)
    samples = []
    for size in range(0, len(content), 1000):
        found = read_or_reason(tmp_path, content[:size])
        if isinstance(found, str):
            assert size <= 2000
            assert found.endswith(".")
        else:
            require_equal_to_pyulog(found, tmp_path / "log.ulg")
            samples.append(len(found.topics[0].times_s))
    assert samples == sorted(samples)
    assert samples[-1] > 380


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a ULog"),
        (b"Dear reader", "not a ULog"),
        (definitions(), "has no data"),
        (definitions()[:12], "Header too short"),
        (definitions().replace(bytes(40), bytes(8) + b"\x04" + bytes(31)), "incompatible flag"),
    ],
)
def test_what_is_no_ulog_is_refused_in_words(tmp_path, content, words):
    with pytest.raises(UnreadableLog, match=words):
        read(tmp_path, content)


def test_samples_with_a_damaged_time_are_left_out_and_counted(tmp_path):
    content = bytearray(ulog())
    at = content.index(b"D", content.index(b"logger started")) + 3
    content[at + 7] = 0x7F
    log = read(tmp_path, bytes(content))
    assert log.duration_s < 20
    assert any("1 samples have no usable time" in problem for problem in log.problems)


def test_a_damaged_definition_at_the_end_of_the_file_is_stepped_over(tmp_path):
    for size in (200, 9_000, 60_000):  # pyulog alone goes back before the file's start
        damaged = definitions() + size.to_bytes(2, "little") + b"?" + b"F" * 40
        with pytest.raises(UnreadableLog, match="has no data"):
            read(tmp_path, damaged)


def require_read_or_refused(folder, seeds):
    content = ulog(steps=60)
    read_logs = 0
    for seed in seeds:
        found = read_or_reason(folder, mutated(content, seed))
        if isinstance(found, str):
            assert len(found) < 600
        else:
            read_logs += 1
            json.loads(overview.encode(found))
            assert all(np.all(np.diff(topic.times_s) >= 0) for topic in found.topics)
    return read_logs


def test_of_damaged_ulogs_each_is_read_in_part_or_refused(tmp_path):
    assert require_read_or_refused(tmp_path, range(300)) > 100


@pytest.mark.broad
def test_of_many_damaged_ulogs_each_is_read_in_part_or_refused(tmp_path):
    assert require_read_or_refused(tmp_path, range(1000, 6000)) > 1000


@pytest.mark.flight
def test_a_log_of_the_simulated_vehicle_equals_pyulogs(tmp_path):
    station = Station(log=True, files=[VehicleFiles(tmp_path)])
    station.run(12.0)
    station.command(400, 1)
    station.run(3.0)
    station.command(400, 0)
    station.run(1.3)
    path = tmp_path / station.sim.loggers[0].path
    log = read_ulog(path)
    assert require_equal_to_pyulog(log, path) > 300
    assert log.vehicles[0].modes[0].name
    assert log.vehicles[0].armed


def test_the_recorded_log_of_a_real_px4_equals_pyulogs(reference_data, tmp_path):
    path = tmp_path / "short.ulg"
    path.write_bytes(gzip.decompress((reference_data / "px4/logs/flight-short.ulg.gz").read_bytes()))
    log = read_ulog(path)
    assert require_equal_to_pyulog(log, path) > 1500
    assert log.firmware == "PX4 v1.16.0"
    assert [span.name for span in log.vehicles[0].modes] == ["Hold", "Take off", "Hold", "Land", "Hold"]
    assert log.problems == []
