"""Flights over HTTP: listed, added in parts, read, plotted and deleted; bad files and names are refused in
words, and the oldest files make room for new ones, which is said."""

import json
import math
import os
import sqlite3

import pytest

from gcs_server.logbook import uploads
from missions.offboard.document import write as write_mission
from missions.plan import write
from tests.support.api_client import api_client
from tests.support.flown_mission import flown_mission, flown_offboard, square
from tests.support.offboard_missions import mission
from tests.unit.gcs_server.logbook.autotuned_ulog import autotuned_ulog
from tests.unit.gcs_server.logbook.generated_ulogs import UTC_US, ulog
from tests.unit.gcs_server.replay.generated_logs import BEGIN_US, flight, log_bytes

API = "/api/v1"
RECORDING = "20260711-080000-udpin-127.0.0.1-14550.tlog"
DOWNLOADED = "vehicle-1-1795222005-3-9000.ulg"


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    (data / "recordings").mkdir()
    (data / "logs").mkdir()
    (data / "recordings" / RECORDING).write_bytes(log_bytes(flight(seconds=10)))
    (data / "logs" / DOWNLOADED).write_bytes(ulog())
    (data / "secret.ulg").write_bytes(ulog())
    return data


@pytest.fixture(scope="module")
def client(data):
    with api_client(data) as client:
        yield client


def listed(client):
    response = client.get(f"{API}/flights")
    assert response.status_code == 200, response.text
    return {each["name"]: each for each in response.json()["files"]}


def add(client, name, content, part_bytes=4000):
    response = client.post(f"{API}/flights/uploads", json={"name": name, "bytes": len(content)})
    assert response.status_code == 201, response.text
    upload = response.json()
    for begin in range(0, len(content), part_bytes):
        response = send(client, upload["id"], begin, content[begin : begin + part_bytes])
        assert response.status_code == 200, response.text
    return response.json()["flight"]


def send(client, upload, offset_bytes, part):
    headers = {"content-type": "application/octet-stream"}
    url = f"{API}/flights/uploads/{upload}?offset_bytes={offset_bytes}"
    return client.post(url, content=part, headers=headers)


def delete(client, flight_id):
    return client.delete(f"{API}/flights/{flight_id}", params={"confirm": f"flight {flight_id} is deleted"})


def test_recordings_and_logs_are_listed_and_say_more_once_they_are_read(client):
    flights = listed(client)
    recording, log = flights[RECORDING], flights[DOWNLOADED]
    assert (recording["source"], recording["kind"], recording["vehicles"]) == (
        "recording",
        "tlog",
        ["1", "7"],
    )
    assert (recording["start_unix_s"], recording["running"]) == (BEGIN_US / 1e6, False)
    assert (log["source"], log["kind"], log["start_unix_s"], log["read"]) == ("vehicle", "ulog", None, False)
    overview = client.get(f"{API}/flights/{log['id']}").json()
    assert overview["start_unix_s"] == pytest.approx(UTC_US / 1e6)
    log = listed(client)[DOWNLOADED]
    assert (log["read"], log["vehicles"], log["firmware"]) == (True, ["7"], "PX4 v1.16.0")
    assert log["duration_s"] == pytest.approx(19.9, abs=0.01)
    assert client.get(f"{API}/flights/{recording['id']}").json()["kind"] == "tlog"
    kinds = [o["kind"] for o in client.get(f"{API}/operations").json()["operations"]]
    assert kinds.count("flights/read") == 2


def test_an_added_log_is_received_in_parts_plotted_and_deleted(client, data):
    flight_id = add(client, "my flight.ulg", ulog(steps=300))
    assert listed(client)["my flight.ulg"]["source"] == "file"
    fields = ["all_types:0/float_value", "degrees({all_types:0/float_value})"]
    plotted = client.get(
        f"{API}/flights/{flight_id}/series", params={"field": fields, "from_s": 2, "to_s": 4, "points": 500}
    ).json()["series"]
    assert [each["field"] for each in plotted] == fields
    assert plotted[0]["t_s"][0] == pytest.approx(1.9)
    assert plotted[1]["unit"] == "°"
    file = client.get(f"{API}/flights/{flight_id}/file")
    assert file.content == ulog(steps=300)
    assert "attachment" in file.headers["content-disposition"]
    refused = client.delete(f"{API}/flights/{flight_id}", params={"confirm": "yes"})
    assert (refused.status_code, refused.json()["field"]) == (422, "confirm")
    assert delete(client, flight_id).status_code == 204
    assert client.get(f"{API}/flights/{flight_id}").status_code == 404
    assert not list((data / "cache/flights").glob(f"{flight_id}-*"))
    assert "my flight.ulg" not in listed(client)
    entries = client.get(f"{API}/journal").json()["entries"]
    assert {"flights/add", "flights/delete"} <= {entry["command"] for entry in entries}
    assert "my flight" not in str(entries)


def test_a_log_is_shown_as_a_table_and_written_for_other_programs(client):
    flight_id = add(client, 'x";y=$(rm) ü.ulg', ulog(steps=300))
    url = f"{API}/flights/{flight_id}"
    table = client.get(f"{url}/table", params={"topic": "all_types:0", "at_s": 2.0, "rows": 5}).json()
    assert (table["t_s"][0], len(table["rows"]), table["samples"]) == (2.0, 5, 300)
    csv = client.get(f"{url}/export", params={"format": "csv", "topic": "all_types:0"})
    assert csv.headers["content-type"].startswith("text/csv")
    assert csv.headers["content-disposition"] == 'attachment; filename="x_y__rm-all_types_0.csv"'
    assert len(csv.text.splitlines()) == 301
    mcap = client.get(f"{url}/export", params={"format": "mcap"})
    assert mcap.content[:5] == mcap.content[-8:-3] == b"\x89MCAP"
    again = add(client, "again.mcap", mcap.content, part_bytes=500_000)
    assert client.get(f"{API}/flights/{again}").json()["firmware"] == "PX4 v1.16.0"
    assert listed(client)["again.mcap"]["kind"] == "mcap"
    assert delete(client, again).status_code == 204
    fields = {
        "format": "csv",
        "field": ["all_types:0/float_value", "vehicle_status:0/nav_state"],
        "rate_hz": 1,
    }
    assert client.get(f"{url}/export", params=fields).status_code == 200
    for params, field in (
        ({"format": "csv", "topic": "none:0"}, "topic"),
        ({"format": "csv", "field": "all_types:0/none"}, "field"),
        ({"format": "csv"}, "topic"),
        ({"format": "geojson"}, "format"),
        ({"format": "xls"}, "format"),
        ({"format": "csv", "field": "all_types:0/float_value", "rate_hz": 0}, "rate_hz"),
    ):
        refused = client.get(f"{url}/export", params=params)
        assert (refused.status_code, refused.json()["field"]) == (422, field), refused.text
    assert delete(client, flight_id).status_code == 204


def test_a_spectrum_shows_the_frequency_of_a_value(client):
    flight_id = add(client, "tone.ulg", ulog(steps=600))
    url = f"{API}/flights/{flight_id}/spectrum"
    answer = client.get(url, params={"field": "all_types:0/float_value"}).json()  # sin(step / 10), 10 steps/s
    density = answer["density"]
    strongest_hz = answer["frequencies_hz"][density.index(max(density))]
    assert strongest_hz == pytest.approx(1 / (2 * math.pi), abs=1 / answer["segment_s"])
    assert (answer["rate_hz"], answer["gaps"]) == (pytest.approx(10, rel=0.01), pytest.approx(0, abs=2))
    assert len(answer["decibels"]) == len(answer["t_s"])
    for params in ({"field": "none:0/x"}, {"field": "all_types:0/float_value", "from_s": 1, "to_s": 1.05}):
        refused = client.get(url, params=params)
        assert (refused.status_code, refused.json()["field"]) in {(422, "field"), (422, "from_s")}, (
            refused.text
        )
    assert delete(client, flight_id).status_code == 204


def test_the_responses_of_the_loops_or_why_there_are_none(client):
    flight_id = add(client, "loops.ulg", ulog(steps=200))
    url = f"{API}/flights/{flight_id}/loops"
    answer = client.get(url, params={"from_s": 1, "to_s": 9})
    assert answer.status_code == 200, answer.text
    loops = answer.json()["loops"]
    assert [(each["loop"], each["axis"]) for each in loops][::3] == [("rate", "roll"), ("attitude", "roll")]
    assert loops[0]["step"] is None
    assert loops[0]["notes"] == ["The topic vehicle_rates_setpoint is not logged."]
    assert answer.json()["autotune"] is None
    assert client.get(f"{API}/flights/none/loops").status_code == 404
    assert client.get(url, params={"from_s": "x"}).status_code == 422
    assert delete(client, flight_id).status_code == 204


def test_the_gains_of_autotune_are_parameters_that_may_be_proved(client):
    flight_id = add(client, "autotune.ulg", autotuned_ulog())
    found = client.get(f"{API}/flights/{flight_id}/loops").json()["autotune"]
    assert [each["axis"] for each in found["axes"]] == ["roll", "pitch", "yaw"]
    assert found["axes"][0]["parameters"]["MC_ROLL_P"] == 5.5
    assert delete(client, flight_id).status_code == 204


def test_a_log_says_what_it_means_also_before_it_was_read(client):
    flight_id = add(client, "meaning.ulg", ulog(steps=200))
    answer = client.get(f"{API}/flights/{flight_id}/findings")
    assert answer.status_code == 200, answer.text
    (failsafe,) = [each for each in answer.json()["findings"] if each["kind"] == "failsafe"]
    assert failsafe["text"] == ("Failsafe in Hold: the log does not say why. The vehicle stayed in its mode.")
    assert (failsafe["begin_s"], failsafe["vehicle"]) == (pytest.approx(10.0), "7")
    assert failsafe["panes"] == [["vehicle_status:0/nav_state"]]
    reasons = {each["kind"]: each["reason"] for each in answer.json()["not_judged"]}
    assert reasons["vibration"] == "The topic vehicle_imu_status is not logged."
    assert client.get(f"{API}/flights/none/findings").status_code == 404
    assert delete(client, flight_id).status_code == 204


@pytest.mark.parametrize(
    ("field", "words"),
    [
        ("all_types:0/none", "no field"),
        ("none:0/x", "no topic"),
        ("open({all_types:0/float_value})", "no function"),
        ("x", "topic:instance/field"),
    ],
)
def test_a_wrong_field_is_refused_in_words(client, field, words):
    flight_id = listed(client)[DOWNLOADED]["id"]
    response = client.get(f"{API}/flights/{flight_id}/series", params={"field": field})
    assert (response.status_code, response.json()["field"]) == (422, "field")
    assert words in response.json()["detail"]


def test_a_file_that_is_no_log_is_listed_with_the_reason_and_costs_nothing_else(client):
    flight_id = add(client, "letter.ulg", b"Dear reader, this is not a log." * 100)
    response = client.get(f"{API}/flights/{flight_id}")
    assert (response.status_code, response.json()["code"]) == (409, "log_unusable")
    assert "not a ULog" in response.json()["detail"]
    assert "not a ULog" in listed(client)["letter.ulg"]["problem"]
    assert delete(client, flight_id).status_code == 204


@pytest.mark.parametrize(
    "name", ["../../evil.ulg", "a\0b.ulg", "x" * 300 + ".ulg", "a.txt", ".ulg", "ü/é \u202e.ulg", ""]
)
def test_a_hostile_name_is_refused_or_becomes_a_name_in_the_folder(client, data, name):
    response = client.post(f"{API}/flights/uploads", json={"name": name, "bytes": 4})
    if response.status_code == 201:
        finished = send(client, response.json()["id"], 0, b"ULog").json()
        assert delete(client, finished["flight"]).status_code == 204
    else:
        assert (response.status_code, response.json()["field"]) == (422, "name")
    assert {path.name for path in (data / "logs").iterdir()} == {DOWNLOADED}
    assert not (data.parent / "evil.ulg").exists()


def test_two_logs_of_one_name_are_two_files(client):
    ids = {add(client, "same.ulg", ulog(steps=20)), add(client, "same.ulg", ulog(steps=30))}
    assert {"same.ulg", "same-2.ulg"} <= set(listed(client))
    assert {delete(client, each).status_code for each in ids} == {204}


def test_parts_must_follow_each_other_within_the_given_size(client, data, monkeypatch):
    upload = client.post(f"{API}/flights/uploads", json={"name": "a.ulg", "bytes": 100}).json()
    for offset, part, words in (
        (50, b"x", "begins at 0"),
        (0, b"", "1 to"),
        (0, b"x" * 101, "within the size"),
    ):
        response = send(client, upload["id"], offset, part)
        assert response.status_code == 422
        assert words in response.json()["detail"]
    assert send(client, upload["id"], 0, b"x" * 60).json()["received_bytes"] == 60
    assert send(client, upload["id"], 0, b"x" * 60).status_code == 422  # sent twice
    assert client.delete(f"{API}/flights/uploads/{upload['id']}").status_code == 204
    assert send(client, upload["id"], 60, b"x").status_code == 404
    assert not list((data / "logs").glob(".upload*"))
    too_large = client.post(f"{API}/flights/uploads", json={"name": "a.ulg", "bytes": 10**9})
    assert (too_large.status_code, too_large.json()["field"]) == (422, "bytes")
    monkeypatch.setattr(uploads, "MAX_OPEN", 0)
    assert client.post(f"{API}/flights/uploads", json={"name": "a.ulg", "bytes": 9}).status_code == 409
    monkeypatch.setattr(uploads, "KEEP_FREE_BYTES", 10**18)
    monkeypatch.setattr(uploads, "MAX_OPEN", 8)
    full = client.post(f"{API}/flights/uploads", json={"name": "a.ulg", "bytes": 9})
    assert (full.status_code, "too little room" in full.json()["detail"]) == (409, True)


def test_a_log_that_cannot_be_flown_again_says_why(client):
    flight_id = add(client, "no-flight.ulg", ulog())
    response = client.post(f"{API}/flights/{flight_id}/rerun", json={"from_s": 1.0})
    assert response.status_code == 422
    assert "vehicle_local_position" in response.text
    for body in (
        {"from_s": -1.0},
        {"from_s": 1.0, "duration_s": 1e4},
        {"from_s": 1.0, "parameters": {"lower case": 1.0}},
        {"from_s": 1.0, "wind_ned_m_s": [1.0, 2.0]},
        {"from_s": 1.0, "motor_health": [1.0, 1.0, 1.0, 2.0]},
        {"from_s": 1.0, "duration_s": 121.0},
        {"from_s": 1.0, "lost": ["gps"]},
        {"from_s": 1.0, "battery_percent": 0.0},
        {"from_s": 1.0, "item": {"number": 1}},
        {"from_s": 1.0, "step": {"place": "step 1"}},
        {"from_s": 1.0, "flown_by": "autopilot", "step": {"place": "1"}},
        {"from_s": 1.0, "flown_by": "pilot"},
        {"from_s": 1.0, "flown_by": "autopilot", "lost": ["wings"]},
        {"from_s": 1.0, "flown_by": "autopilot", "battery_percent": 101.0},
        {"from_s": 1.0, "flown_by": "autopilot", "item": {"number": 0}},
        {"from_s": 1.0, "flown_by": "autopilot", "item": {"number": 1, "then": "vanish"}},
        {"from_s": 1.0, "flown_by": "autopilot", "plan": "../secret"},
    ):
        response = client.post(f"{API}/flights/{flight_id}/rerun", json=body)
        assert response.status_code == 422, body
    by_autopilot = {"from_s": 1.0, "flown_by": "autopilot"}
    response = client.post(f"{API}/flights/{flight_id}/rerun", json=by_autopilot)
    assert (response.status_code, "home_position" in response.text) == (422, True)
    response = client.post(f"{API}/flights/{flight_id}/rerun", json=by_autopilot | {"plan": "0" * 12})
    assert response.status_code == 404
    for body in ({"from_s": 1.0}, by_autopilot):
        assert client.post(f"{API}/flights/unknown/rerun", json=body).status_code == 404
    delete(client, flight_id)


@pytest.mark.flight
def test_the_simulated_px4_flies_on_with_a_plan_of_this_server(client, tmp_path):
    _, moment_s = flown_mission(tmp_path, square(), until_item=2, fly_on_s=6.0)
    (log,) = tmp_path.rglob("*.ulg")
    flight_id = add(client, "mission.ulg", log.read_bytes(), part_bytes=1_000_000)
    url, body = f"{API}/flights/{flight_id}/rerun", {"from_s": moment_s, "flown_by": "autopilot"}
    unknown = client.post(url, json=body)
    assert (unknown.status_code, unknown.json()["field"]) == (422, "plan")
    assert "does not know the plan" in unknown.json()["detail"]
    document = json.loads(write(square()))
    plan = client.post(f"{API}/plans", json={"name": "square", "plan": document}).json()["id"]
    body |= {"plan": plan, "duration_s": 6.0}
    refused = client.post(url, json=body | {"item": {"number": 9}})
    assert (refused.status_code, refused.json()["field"]) == (422, "item")
    answer = client.post(url, json=body | {"battery_percent": 3.0, "parameters": {"COM_LOW_BAT_ACT": 2}})
    assert answer.status_code == 200, answer.text
    result = answer.json()
    assert result["max_error_m"] < 0.5
    assert [each["text"] for each in result["unchanged"]["modes"]] == ["Mission"]
    assert "Land" in [each["text"] for each in result["changed"]["modes"]]
    assert result["changed"]["warnings"]
    delete(client, flight_id)


@pytest.mark.flight
def test_an_offboard_mission_of_this_server_flies_on_with_a_changed_step(client, tmp_path):
    fly = "- {step: fly, speed_m_s: 4, points: [{offset_ned_m: [40, 0, -6]}]}\n"
    flown = mission("- {step: take_off, height_m: 6}\n" + fly)
    _, begin_s = flown_offboard(tmp_path, flown, for_s=22.0)
    (log,) = tmp_path.rglob("*.ulg")
    flight_id = add(client, "offboard.ulg", log.read_bytes(), part_bytes=1_000_000)
    url, body = f"{API}/flights/{flight_id}/rerun", {"from_s": begin_s + 14.0, "flown_by": "autopilot"}
    unknown = client.post(url, json=body)
    assert (unknown.status_code, unknown.json()["field"]) == (422, "plan")
    plan = {"name": "Out", "plan": json.loads(write_mission(flown))}
    body |= {"plan": client.post(f"{API}/plans", json=plan).json()["id"], "duration_s": 7.0}
    refused = client.post(url, json=body | {"step": {"place": "step 3", "speed_m_s": 2.0}})
    assert (refused.status_code, refused.json()["field"]) == (422, "step")
    answer = client.post(url, json=body | {"step": {"place": "step 2", "speed_m_s": 1.0}})
    assert answer.status_code == 200, answer.text
    result = answer.json()
    assert result["max_error_m"] < 0.5
    assert [each["text"] for each in result["changed"]["steps"]] == ["Step 2: Fly"]
    ends_m = [result[name]["position_ned_m"][-1][0] for name in ("unchanged", "changed")]
    assert ends_m[0] - ends_m[1] > 10.0
    delete(client, flight_id)


def test_two_flights_are_laid_over_each_other_and_what_cannot_be_compared_says_why(client):
    recording = listed(client)[RECORDING]["id"]
    client.get(f"{API}/flights/{recording}")
    url = f"{API}/flights/{recording}/beside"
    same = client.get(url, params={"other": recording, "align": "fit"})
    assert same.status_code == 200, same.text
    answer = same.json()
    assert (answer["align"], answer["offset_s"], answer["max_m"]) == ("fit", pytest.approx(0, abs=0.01), 0)
    assert answer["first"] == answer["second"]
    assert len(answer["t_s"]) == len(answer["distance_m"]) > 10
    log = listed(client)[DOWNLOADED]["id"]
    for params, field in (
        ({"other": log, "align": "fit"}, "other"),
        ({"other": recording, "align": "offset", "offset_s": 500}, "offset_s"),
        ({"other": recording, "align": "later"}, "align"),
        ({"other": recording, "offset_s": 1e9}, "offset_s"),
        ({}, "other"),
    ):
        refused = client.get(url, params=params)
        assert (refused.status_code, refused.json()["field"]) == (422, field), refused.text
    assert client.get(url, params={"other": "none-0"}).status_code == 404


@pytest.mark.parametrize("flight_id", ["nothing", "..%2F..%2Fsecret", "%00", "a" * 300, "uploads"])
def test_an_unknown_id_is_not_found(client, flight_id):
    for call in ("", "/file", "/series?field=a:0/b", "/table?topic=a:0", "/export?format=kml"):
        assert client.get(f"{API}/flights/{flight_id}{call}").status_code == 404


def test_a_recording_that_is_replayed_is_not_deleted(client):
    recording = listed(client)[RECORDING]["id"]
    replay = client.post(f"{API}/replays", json={"recording": RECORDING}).json()
    assert delete(client, recording).status_code == 409
    client.delete(f"{API}/replays/{replay['name']}")


def test_ids_last_over_a_restart_and_a_damaged_index_is_made_again(tmp_path):
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "a.ulg").write_bytes(ulog(steps=20))
    with api_client(tmp_path) as client:
        first = listed(client)["a.ulg"]["id"]
        client.get(f"{API}/flights/{first}")
    with api_client(tmp_path) as client:
        assert (listed(client)["a.ulg"]["id"], listed(client)["a.ulg"]["read"]) == (first, True)
    (tmp_path / "flights.sqlite").write_bytes(b"no database at all" * 1000)
    with api_client(tmp_path) as client:
        found = listed(client)["a.ulg"]
        assert (found["id"] != first, found["read"]) == (True, False)
        assert client.get(f"{API}/flights/{found['id']}").status_code == 200
    assert sqlite3.connect(tmp_path / "flights.sqlite").execute("SELECT count(*) FROM files").fetchone() == (
        1,
    )


def test_the_oldest_files_make_room_and_that_is_said(tmp_path):
    (tmp_path / "logs").mkdir()
    for age, name in enumerate(("new.ulg", "old.ulg", "older.ulg")):
        path = tmp_path / "logs" / name
        path.write_bytes(ulog(steps=20))
        os.utime(path, (1e9 - 1000 * age,) * 2)
    with api_client(tmp_path) as client:
        logbook = client.app.state.station.logbook
        logbook.max_bytes = 3 * len(ulog(steps=20))
        assert len(listed(client)) == 3
        add(client, "added.ulg", ulog(steps=20))
        answer = client.get(f"{API}/flights").json()
        assert {each["name"] for each in answer["files"]} == {"added.ulg", "new.ulg", "old.ulg"}
        assert [each["name"] for each in answer["removed"]] == ["older.ulg"]
        assert answer["total_bytes"] <= answer["max_bytes"]
        (entry,) = [e for e in client.get(f"{API}/journal").json()["entries"] if e["client"] == "server"]
        assert "older.ulg" in entry["detail"]


def test_a_grown_recording_is_read_again_and_plotted_as_far_as_it_was_read(client, data):
    path = data / "recordings" / "growing.tlog"
    path.write_bytes(log_bytes(flight(seconds=3)))
    flight_id = listed(client)["growing.tlog"]["id"]
    first = client.get(f"{API}/flights/{flight_id}").json()
    path.write_bytes(log_bytes(flight(seconds=6)))
    field = {"field": "ATTITUDE_QUATERNION:1.1/q1"}
    plotted = client.get(f"{API}/flights/{flight_id}/series", params=field).json()["series"][0]
    assert plotted["samples"] == 30
    assert client.get(f"{API}/flights/{flight_id}").json()["duration_s"] > first["duration_s"] + 2
    assert client.get(f"{API}/flights/{flight_id}/series", params=field).json()["series"][0]["samples"] == 60
    assert delete(client, flight_id).status_code == 204
