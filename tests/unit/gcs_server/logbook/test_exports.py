"""What a log has, as files of other programs: their own readers find the values of the log, a window is that
window, tracks say their altitude, and hostile names stay text."""

import csv
import io
import json
import math
import xml.etree.ElementTree as ElementTree

import arro3.io
import numpy as np
import pytest
from mcap.reader import make_reader

from gcs_server.logbook import overview, tasks
from gcs_server.logbook.columns import UnknownField, write
from gcs_server.logbook.exports import mcap_file
from gcs_server.logbook.exports.sink import BadExport
from gcs_server.logbook.log import Log, Message, Topic, VehicleStates

START_UNIX_S = 1_780_000_000.25
TIMES_S = np.arange(0.0, 100.0, 0.01)
HALF = math.sqrt(0.5)


def topics():
    slow_s = np.arange(0.5, 100.0, 1.0)
    turned = {
        f"q[{i}]": np.full(len(slow_s), value, np.float32) for i, value in enumerate((HALF, 0, 0, HALF))
    }
    return [
        Topic(
            "fast",
            "0",
            TIMES_S,
            {
                "x": np.sin(TIMES_S).astype(np.float32),
                "count": np.arange(len(TIMES_S), dtype=np.uint64) + 2**60,
                "is_on": TIMES_S > 50,
                "esc[0].rpm": np.arange(len(TIMES_S), dtype=np.int32),
                "esc[1].rpm": np.arange(len(TIMES_S), dtype=np.int32) * 2,
                "=HYPERLINK": np.zeros(len(TIMES_S), np.int8),
                "y": np.where(TIMES_S < 1, np.nan, TIMES_S),
            },
            {"x": "m"},
        ),
        Topic("vehicle_attitude", "0", slow_s, turned, {}),
        Topic("vehicle_local_position", "0", slow_s, {"x": slow_s, "y": slow_s * 0, "z": -slow_s}, {}),
        Topic(
            "vehicle_global_position",
            "0",
            slow_s,
            {
                "lat": np.where(slow_s < 2, 0.0, 47.0 + slow_s * 1e-5),
                "lon": np.where(slow_s < 2, 0.0, 8.0 + slow_s * 1e-5),
                "alt": (488.0 + slow_s).astype(np.float32),
            },
            {},
        ),
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    log = Log("ulog", START_UNIX_S, 100.0, topics(), [VehicleStates("7")], parameters={"MPC_XY_P": 0.95})
    log.messages = [Message(3.0, 4, "Low battery")]
    path = tmp_path_factory.mktemp("columns") / "log"
    write(log, overview.encode(log), path)
    return path


def exported(folder, **request):
    pieces = []
    tasks.export(str(folder), "a & b.ulg", request)(pieces.append)
    return b"".join(pieces)


def rows(folder, **request):
    return list(csv.reader(io.StringIO(exported(folder, format="csv", **request).decode())))


def test_a_topic_as_csv_has_the_logged_values(folder):
    header, *found = rows(folder, topics=["fast:0"], from_s=0.5, to_s=2.0)
    assert header[:4] == ["t_s", "unix_s", "x [m]", "count"]
    assert "'=HYPERLINK" in header
    assert len(found) == 151
    assert [row[0] for row in found[:2]] == ["0.500000", "0.510000"]
    assert float(found[0][1]) == START_UNIX_S + 0.5
    assert np.float32(found[7][2]) == np.float32(np.sin(TIMES_S[57]))
    assert int(found[7][3]) == 2**60 + 57
    y = header.index("y")
    assert found[0][y] == ""
    assert float(found[-1][y]) == TIMES_S[200]


def test_fields_at_common_times_have_their_newest_values(folder):
    fields = ["fast:0/count", "vehicle_local_position:0/x", "derivative({vehicle_local_position:0/x})"]
    header, *found = rows(folder, fields=fields, rate_hz=2)
    assert header[2:] == fields
    assert [row[0] for row in found[:4]] == ["0.000000", "0.500000", "1.000000", "1.500000"]
    assert [row[3] for row in found[:4]] == ["", "0.5", "0.5", "1.5"]
    assert {row[4] for row in found[2:]} == {"1"}
    assert len(found) == 200


def test_fields_without_a_rate_have_a_row_at_each_sample_of_the_first(folder):
    _, *found = rows(folder, fields=["vehicle_attitude:0/q[0]", "fast:0/x"])
    assert len(found) == 100
    assert np.float32(found[3][3]) == np.float32(np.sin(3.5))


def test_parquet_has_the_values_in_their_types(folder):
    content = exported(folder, format="parquet", topics=["fast:0"])
    table = arro3.io.read_parquet(io.BytesIO(content)).read_all()
    assert table.column_names[:4] == ["t_s", "x", "count", "is_on"]
    assert table.num_rows == len(TIMES_S)
    column = table.column("count").combine_chunks().to_numpy()
    assert column.dtype == np.uint64
    assert column[-1] == 2**60 + len(TIMES_S) - 1
    assert np.array_equal(table.column("x").combine_chunks().to_numpy(), np.sin(TIMES_S).astype(np.float32))
    assert b"unit of x" in content


def test_parquet_without_its_package_is_refused_with_what_to_install(folder, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "arro3.io", None)
    with pytest.raises(BadExport, match="pip install") as raised:
        exported(folder, format="parquet", topics=["fast:0"])
    assert raised.value.field == "format"


def test_the_track_as_geojson_says_its_altitude_and_times(folder):
    (feature,) = json.loads(exported(folder, format="geojson", from_s=10))["features"]
    assert feature["properties"]["vehicle"] == "7"
    assert "AMSL" in feature["properties"]["altitude"]
    first = feature["geometry"]["coordinates"][0]
    assert first == [pytest.approx(8.000105), pytest.approx(47.000105), 498.5]
    assert feature["properties"]["coordTimes"][0] == "2026-05-28T20:26:50.750Z"
    assert len(feature["properties"]["t_s"]) == len(feature["geometry"]["coordinates"]) == 90


def test_the_track_as_kml_is_absolute_and_leaves_out_what_is_no_position(folder):
    root = ElementTree.fromstring(exported(folder, format="kml"))
    names = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
    assert root.find("k:Document/k:name", names).text == "a & b.ulg"
    line = root.find(".//k:LineString", names)
    assert line.find("k:altitudeMode", names).text == "absolute"
    points = line.find("k:coordinates", names).text.split()
    assert len(points) == 98
    assert points[0] == "8.00002500,47.00002500,490.500"
    track = root.find(".//gx:Track", names)
    assert len(track.findall("k:when", names)) == len(track.findall("gx:coord", names)) == 98


def test_mcap_is_in_the_order_of_time_and_has_what_foxglove_draws(folder, monkeypatch):
    monkeypatch.setattr(mcap_file, "WINDOW_MESSAGES", 700)
    reader = make_reader(io.BytesIO(exported(folder, format="mcap")), validate_crcs=True)
    found = [
        (schema.name, channel, message)
        for schema, channel, message in reader.iter_messages(log_time_order=False)
    ]
    times = [message.log_time for _, _, message in found]
    assert times == sorted(times)
    assert len(found) == len(TIMES_S) + 3 * 100 + 98 + 100 + 1
    by_topic = {channel.topic: (name, json.loads(message.data)) for name, channel, message in found}
    name, last = by_topic["/fast"]
    assert (name, last["count"]) == ("fast", 2**60 + len(TIMES_S) - 1)
    assert last["esc"] == [{"rpm": 9999}, {"rpm": 19998}]
    assert last["x"] == pytest.approx(np.sin(TIMES_S[-1]), abs=1e-7)
    name, fix = by_topic["/track"]
    assert name == "foxglove.LocationFix"
    assert fix["timestamp"] == {"sec": 1_780_000_099, "nsec": 750_000_000}
    name, pose = by_topic["/tf"]
    assert name == "foxglove.FrameTransform"
    assert pose["translation"] == {"x": 0.0, "y": 99.5, "z": 99.5}  # north is y, up is z
    assert pose["rotation"] == pytest.approx(
        {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}, abs=1e-6
    )  # to the east
    assert by_topic["/log"][1]["message"] == "Low battery"
    parameters = next(each for each in reader.iter_metadata() if each.name == mcap_file.PARAMETERS)
    assert parameters.metadata == {"MPC_XY_P": "0.95"}


def test_chosen_topics_and_a_window_of_mcap(folder):
    content = exported(folder, format="mcap", topics=["fast:0"], from_s=1.0, to_s=2.0)
    channels = [channel.topic for _, channel, _ in make_reader(io.BytesIO(content)).iter_messages()]
    assert channels == ["/fast"] * 101


@pytest.mark.parametrize(
    ("request_", "error", "words"),
    [
        ({"format": "csv"}, BadExport, "exactly one topic"),
        ({"format": "csv", "topics": ["fast:0", "vehicle_attitude:0"]}, BadExport, "exactly one topic"),
        ({"format": "csv", "topics": ["none:0"]}, BadExport, "no topic 'none:0'"),
        ({"format": "mcap", "topics": ["none:0"]}, BadExport, "no topic 'none:0'"),
        ({"format": "csv", "topics": ["fast:0"], "fields": ["fast:0/x"]}, BadExport, "not both"),
        ({"format": "parquet", "fields": ["fast:0/none"]}, UnknownField, "no field"),
        ({"format": "csv", "fields": ["norm(1)"]}, UnknownField, "not of the form"),
        ({"format": "csv", "fields": ["fast:0/x"], "rate_hz": 1e6}, BadExport, "rows are too many"),
        ({"format": "kml", "from_s": 5000}, BadExport, "no track"),
    ],
)
def test_what_the_log_has_not_is_refused_before_anything_is_written(folder, request_, error, words):
    with pytest.raises(error, match=words):
        tasks.export(str(folder), "a.ulg", request_)


def test_a_page_of_a_table(folder):
    page = json.loads(tasks.table(str(folder), "fast:0", None, 50.0, 3))
    assert (page["from_row"], page["samples"], page["t_s"]) == (5000, 10_000, [50.0, 50.01, 50.02])
    names = [column["name"] for column in page["columns"]]
    first = dict(zip(names, page["rows"][0], strict=True))
    assert (first["count"], first["is_on"], page["rows"][1][names.index("is_on")]) == (
        2**60 + 5000,
        False,
        True,
    )
    last = json.loads(tasks.table(str(folder), "fast:0", 10**9, None, 100))
    assert (last["from_row"], len(last["rows"])) == (9999, 1)
    start = json.loads(tasks.table(str(folder), "fast:0", 0, None, 1))
    assert start["rows"][0][names.index("y")] is None
    with pytest.raises(BadExport, match="no topic"):
        tasks.table(str(folder), "none:0", 0, None, 1)
