"""Recording and vehicle's log of one flight are one flight over HTTP, whichever comes first; it is named,
separated, joined again and deleted; two vehicles of one recording are two flights."""

import pytest

from gcs_server.logbook.logged_flights import LoggedFlight
from gcs_server.logbook.notes import NotesHead, NotesStore
from tests.support.api_client import api_client
from tests.unit.gcs_server.logbook.generated_ulogs import START_US, UTC_US, ulog
from tests.unit.gcs_server.replay.generated_logs import HOLD, FrameSource, heartbeat, log_bytes
from vehicle_sim.mavlink import generated_dialect as sim_dialect

API = "/api/v1"
RECORDING = "20261121-080000-udpin-127.0.0.1-14550.tlog"
DOWNLOADED = "vehicle-7-1795222020-1-9000.ulg"
ARMED_S = {7: (5, 15), 1: (3, 12)}
"""Arming and disarming of each vehicle, after the recording's start; that of vehicle 7 as in its ULog."""
NOTES = "n0123456789abcdef"


def recording():
    """Vehicles 7 and 1 on one link, by a server whose clock is 0.8 s late."""
    records = []
    for system_id, (begin_s, end_s) in ARMED_S.items():
        autopilot = FrameSource(system_id)
        for step in range(180):
            at_s = step / 10
            boot_ms = START_US // 1000 + step * 100 + (0 if system_id == 7 else 700_000)
            at_us = UTC_US + 800_000 + step * 100_000 + system_id
            armed = begin_s <= at_s < end_s
            flown_m = max(0.0, min(at_s, end_s) - begin_s)
            frames = [
                sim_dialect.MAVLink_local_position_ned_message(boot_ms, 2 * flown_m, 0, -flown_m, 0, 0, 0)
            ]
            if step % 10 == 0:
                frames.append(heartbeat(HOLD, armed=armed))
                frames.append(sim_dialect.MAVLink_extended_sys_state_message(0, 2 if armed else 1))
            records += [(at_us, autopilot.frame(frame)) for frame in frames]
    return log_bytes(sorted(records, key=lambda each: each[0]))


def notes():
    """Of vehicle 7, with commands and parameters."""
    flight = LoggedFlight(
        vehicle="7", uid=None, begin_s=0.0, end_s=10.0, begin_unix_s=UTC_US / 1e6 + 5.8, by_gps=False,
        begin_boot_s=7.0, duration_s=10.0, distance_m=None, height_m=None, modes=("Hold",), failsafes=0,
        ended="landed", starts_armed=False,
    )  # fmt: skip
    details = (
        b'{"parameters": {"MPC_XY_VEL_MAX": 12.0}, "plan": {"kind": "waypoint_plan", "name": "Bridge",'
        b'"id": null, "version": null, "dry_run": null, "flown": null}, "commands": ['
        b'{"unix_s": %.3f, "client": "Ann", "command": "arm", "vehicle": "7",'
        b'"arguments": {}, "result": "ok", "detail": null}]}'
    ) % (UTC_US / 1e6 + 5.5)
    return NotesHead(NOTES, "7", (RECORDING,), flight, "Bridge"), details


@pytest.fixture
def data(tmp_path):
    for folder in ("recordings", "logs"):
        (tmp_path / folder).mkdir()
    return tmp_path


def add_recording(data):
    (data / "recordings" / RECORDING).write_bytes(recording())


def add_log(data):
    (data / "logs" / DOWNLOADED).write_bytes(ulog())


def read_all(client):
    """The flights, after each file was opened."""
    for file in client.get(f"{API}/flights").json()["files"]:
        assert client.get(f"{API}/flights/{file['id']}").status_code == 200
    return client.get(f"{API}/flights").json()["flights"]


def by_vehicle(flights):
    found = {flight["vehicle"]: flight for flight in flights}
    assert len(found) == len(flights)
    return found


@pytest.mark.parametrize("order", [(add_recording, add_log), (add_log, add_recording)])
def test_recording_and_log_become_one_flight_in_either_order(data, order):
    with api_client(data) as client:
        for add in order:
            add(data)
            flights = by_vehicle(read_all(client))
        assert set(flights) == {"7", "1"}
        flight = flights["7"]
        assert [part["source"] for part in flight["parts"]] == ["vehicle", "recording"]
        # both times are the same moment: 0.8 s of the recording's clock do not count
        assert flight["parts"][1]["offset_s"] == pytest.approx(0.0, abs=0.01)
        assert "time since its boot" in flight["parts"][1]["why"]
        assert flight["start_unix_s"] == pytest.approx(UTC_US / 1e6 + 5)
        assert flight["distance_m"] == pytest.approx(20.0, abs=1.0)  # only the recording has positions
        assert flight["height_m"] == pytest.approx(10.0, abs=0.5)
        assert (flight["ended"], flight["failsafes"], flight["modes"][0]) == ("landed", 1, "Take off")
        other = flights["1"]
        assert (len(other["parts"]), other["duration_s"]) == (1, pytest.approx(9.0, abs=0.1))


def test_a_flight_is_named_separated_joined_again_and_deleted(data):
    add_recording(data)
    add_log(data)
    with api_client(data) as client:
        flight = by_vehicle(read_all(client))["7"]
        named = client.post(f"{API}/flights/{flight['id']}/name", json={"name": " Bridge, second try "})
        assert named.json()["name"] == "Bridge, second try"
        hidden = client.post(f"{API}/flights/{flight['id']}/name", json={"name": "a\u202eb"})
        assert (hidden.status_code, hidden.json()["field"]) == (422, "name")
        main, recorded = (part["id"] for part in flight["parts"])
        parts = f"{API}/flights/{main}/parts"
        apart = client.post(parts, json={"part": recorded, "joined": False}).json()
        assert [part["id"] for part in apart["parts"]] == [main]
        assert len(client.get(f"{API}/flights").json()["flights"]) == 3
        again = client.post(parts, json={"part": recorded, "joined": True}).json()
        assert again["parts"][1]["why"] == "joined by a person"
        for wrong, words in (("nothing-0", 404), (main, 422)):
            body = {"part": wrong, "joined": wrong != main}
            single = f"{API}/flights/{by_vehicle(client.get(f'{API}/flights').json()['flights'])['1']['id']}"
            assert client.post(f"{single}/parts", json=body).status_code == words
        entries = client.get(f"{API}/journal").json()["entries"]
        assert "Bridge" not in str(entries)
    (data / "flights.sqlite").unlink()  # names outlive the index
    with api_client(data) as client:
        flight = by_vehicle(read_all(client))["7"]
        assert flight["name"] == "Bridge, second try"
        url = f"{API}/flights/{flight['id']}"
        assert client.delete(url, params={"confirm": "yes"}).status_code == 422
        confirm = {"confirm": f"flight {flight['id']} is deleted"}
        assert client.delete(url, params=confirm).status_code == 204
        assert not (data / "logs" / DOWNLOADED).exists()
        assert (data / "recordings" / RECORDING).exists()  # it has a flight of vehicle 1, too
        left = by_vehicle(client.get(f"{API}/flights").json()["flights"])["7"]
        url, confirm = f"{API}/flights/{left['id']}", {"confirm": f"flight {left['id']} is deleted"}
        refused = client.delete(url, params=confirm)
        assert (refused.status_code, "other flights" in refused.json()["detail"]) == (409, True)


def test_the_record_of_a_flight_has_its_notes_and_no_others(data):
    add_recording(data)
    add_log(data)
    NotesStore(data / "flight_notes").write(*notes())
    with api_client(data) as client:
        flights = by_vehicle(read_all(client))
        record = client.get(f"{API}/flights/{flights['7']['id']}/joined").json()
        assert [part["source"] for part in record["flight"]["parts"]] == ["vehicle", "recording", "notes"]
        assert (record["plan"]["name"], flights["7"]["plan"]) == ("Bridge", "Bridge")
        (command,) = record["commands"]
        # given 0.3 s before arming, which is at 5 s of the log
        assert (command["client"], command["command"]) == ("Ann", "arm")
        assert command["t_s"] == pytest.approx(4.7, abs=0.01)
        assert record["parameters"] == [{"name": "MPC_XY_VEL_MAX", "value": 12.0}]
        other = client.get(f"{API}/flights/{flights['1']['id']}/joined").json()
        assert (other["commands"], other["parameters"], other["plan"]) == ([], [], None)
        assert client.get(f"{API}/flights/nothing-0/joined").status_code == 404
        confirm = {"confirm": f"flight {flights['7']['id']} is deleted"}
        assert client.delete(f"{API}/flights/{flights['7']['id']}", params=confirm).status_code == 204
        assert not list((data / "flight_notes").iterdir())


def test_damaged_notes_and_names_cost_only_themselves(data):
    add_recording(data)
    NotesStore(data / "flight_notes").write(*notes())
    (data / "flight_notes" / "nbroken.json").write_bytes(b"{")
    (data / "flight_notes" / f"{NOTES}.details.json").unlink()
    (data / "flight_names.json").write_bytes(b"\x00")
    with api_client(data) as client:
        flights = by_vehicle(read_all(client))
        record = client.get(f"{API}/flights/{flights['7']['id']}/joined").json()
        assert (len(record["flight"]["parts"]), record["commands"]) == (2, [])


@pytest.mark.parametrize("kind", [b"waypoint_plan", b"offboard_mission"])
def test_what_if_takes_the_plan_that_was_noted_with_the_flight(data, kind):
    add_recording(data)
    add_log(data)
    head, details = notes()
    noted = details.replace(b'"id": null, "version": null', b'"id": "0123456789ab", "version": 3')
    noted = noted.replace(b"waypoint_plan", kind)
    assert kind in noted
    NotesStore(data / "flight_notes").write(head, noted)
    with api_client(data) as client:
        flight = by_vehicle(read_all(client))["7"]
        body = {"from_s": flight["parts"][0]["begin_s"] + 1.0, "flown_by": "autopilot"}
        gone = client.post(f"{API}/flights/{flight['parts'][0]['file']}/rerun", json=body)
        assert gone.status_code == 404
        assert "no plan '0123456789ab'" in gone.json()["detail"]
