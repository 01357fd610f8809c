"""Recordings over HTTP: listed, downloaded, replayed from any time; other files are refused with a reason."""

import gzip
import itertools
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.support.api_client import api_client
from tests.unit.gcs_server.replay.generated_logs import BEGIN_US, flight, log_bytes

BEGIN_S = BEGIN_US / 1e6
NAME = "20260711-080000-udpin-127.0.0.1-14550.tlog"
API = "/api/v1"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    recordings = data / "recordings"
    recordings.mkdir()
    (data / "secret.tlog").write_bytes(log_bytes(flight(seconds=2)))
    (recordings / NAME).write_bytes(log_bytes(flight(seconds=30)))
    return recordings


@pytest.fixture(scope="module")
def server(folder):
    with api_client(folder.parent, static=folder) as client:
        yield client


@pytest.fixture
def client(server):
    yield server
    for replay in server.get(f"{API}/replays").json()["replays"]:
        server.delete(f"{API}/replays/{replay['name']}")


def operations(client):
    return client.get(f"{API}/operations").json()["operations"]


def recordings_by_name(client):
    return {r["name"]: r for r in client.get(f"{API}/recordings").json()["recordings"]}


def control_replay(client, name, **change):
    response = client.post(f"{API}/replays/{name}", json=change)
    assert response.status_code == 200, response.text
    return response.json()


def vehicles_by_id(client):
    return {v["id"]: v for v in client.get(f"{API}/vehicles").json()}


def test_recordings_are_listed_newest_first_and_unusable_files_with_the_reason(client, folder):
    log = log_bytes(flight(seconds=20, begin_us=BEGIN_US + 86_400_000_000))
    (folder / "mine.tlog.gz").write_bytes(gzip.compress(log))
    (folder / "empty.tlog").write_bytes(b"")
    (folder / "letter.tlog").write_bytes(b"Dear reader, this is not a telemetry log at all. " * 40)
    (folder / "damaged.tlog").write_bytes(log[:3000] + b"\x00" * 500 + log[3000:])
    (folder / "torn.tlog").write_bytes(log[:-7])
    (folder / "unpacked.tlog.gz").write_bytes(log)
    (folder / "notes.txt").write_bytes(b"no recording")
    listing = client.get(f"{API}/recordings")
    assert listing.status_code == 200, listing.text
    names = [r["name"] for r in listing.json()["recordings"]]
    assert names.index("mine.tlog.gz") < names.index(NAME) < names.index("empty.tlog")
    recordings = recordings_by_name(client)
    entry = recordings[NAME]
    assert entry["link"] == "udpin-127.0.0.1-14550"
    assert (entry["started_unix_s"], entry["vehicles"], entry["problem"]) == (BEGIN_S, [1, 7], None)
    assert entry["duration_s"] == pytest.approx(29.9, abs=0.1)
    assert entry["bytes"] == (folder / NAME).stat().st_size
    assert not entry["running"]
    assert recordings["mine.tlog.gz"]["link"] is None
    assert recordings["mine.tlog.gz"]["duration_s"] == pytest.approx(19.9, abs=0.1)
    problems = {name: r["problem"] for name, r in recordings.items() if r["problem"]}
    assert set(problems) == {"empty.tlog", "letter.tlog", "damaged.tlog", "torn.tlog", "unpacked.tlog.gz"}
    assert "empty" in problems["empty.tlog"]
    assert "not a telemetry log" in problems["letter.tlog"]
    assert "Damaged" in problems["damaged.tlog"]
    assert "notes.txt" not in recordings


@pytest.mark.parametrize(
    "name",
    [
        "..%2Fsecret.tlog",
        "%2Fetc%2Fpasswd",
        "....tlog",
        ".hidden.tlog",
        "nothing.tlog",
        "notes.txt",
        "a%00.tlog",
        "bad%FF.tlog",
    ],
)
def test_only_files_of_the_folder_are_recordings(client, folder, name):
    (folder / "notes.txt").write_bytes(b"private")
    (folder / ".hidden.tlog").write_bytes(log_bytes(flight(seconds=2)))
    for path in (f"{API}/recordings/{name}", f"{API}/recordings/{name}/index"):
        response = client.get(path)
        assert response.status_code == 404
        assert b"private" not in response.content
    decoded_name = name.replace("%2F", "/").replace("%00", "\0")
    response = client.post(f"{API}/replays", json={"recording": decoded_name})
    assert (response.status_code, response.json()["code"]) == (404, "unknown_recording")


def test_a_name_longer_than_a_file_name_can_be_is_an_unknown_recording(client):
    for path in ("", "/index"):
        response = client.get(f"{API}/recordings/{'a' * 300}.tlog{path}")
        assert (response.status_code, response.json()["code"]) == (404, "unknown_recording")


def test_a_symbolic_link_to_another_file_is_not_a_recording(client, folder):
    (folder / "link.tlog").symlink_to(folder.parent / "secret.tlog")
    assert client.get(f"{API}/recordings/link.tlog").status_code == 404
    assert "link.tlog" not in recordings_by_name(client)


def test_a_recording_is_downloaded_unchanged(client, folder):
    response = client.get(f"{API}/recordings/{NAME}")
    assert response.content == (folder / NAME).read_bytes()
    assert response.headers["content-disposition"] == f'attachment; filename="{NAME}"'


@pytest.mark.parametrize(
    ("content", "text"),
    [(b"", "empty"), (b"\xfd\x09 nothing of the kind" * 30, "not a telemetry log")],
)
def test_files_that_cannot_be_played_are_refused_with_the_reason(client, folder, content, text):
    (folder / "bad.tlog").write_bytes(content)
    for response in (
        client.get(f"{API}/recordings/bad.tlog/index"),
        client.post(f"{API}/replays", json={"recording": "bad.tlog"}),
    ):
        assert (response.status_code, response.json()["code"]) == (409, "recording_unusable")
        assert "bad.tlog" in response.json()["detail"]
        assert text in response.json()["detail"]
    assert client.get(f"{API}/replays").json() == {"replays": []}


def test_indexing_is_one_operation_with_events(client, folder):
    (folder / "once.tlog").write_bytes(log_bytes(flight(seconds=5)))
    states = []
    with client.websocket_connect(f"ws://localhost{API}/telemetry") as socket:
        assert client.get(f"{API}/recordings/once.tlog/index").status_code == 200
        while states[-1:] != ["succeeded"]:
            event = socket.receive_json().get("event", {})
            if event.get("kind") == "operation":
                states.append(event["operation"]["state"])
                assert (event["operation"]["kind"], event["operation"]["subject"]) == (
                    "recording/index",
                    "once.tlog",
                )
    assert states == ["running", "succeeded"]
    assert client.get(f"{API}/recordings/once.tlog/index").status_code == 200
    indexing_operations = [o for o in operations(client) if o["subject"] == "once.tlog"]
    assert [(o["state"], o["vehicle"]) for o in indexing_operations] == [("succeeded", None)]
    assert client.get(f"{API}/operations/{indexing_operations[0]['id']}").json() == indexing_operations[0]
    assert client.delete(f"{API}/operations/{indexing_operations[0]['id']}").json() == indexing_operations[0]
    assert client.get(f"{API}/operations/77").json()["code"] == "unknown_operation"


def test_cancelled_indexing_is_reported_and_can_be_repeated(client, folder):
    (folder / "long.tlog").write_bytes(log_bytes(flight(seconds=60)))
    with ThreadPoolExecutor(1) as executor:
        index_request = executor.submit(client.get, f"{API}/recordings/long.tlog/index")
        while not (running_operations := [o for o in operations(client) if o["subject"] == "long.tlog"]):
            assert not index_request.done()
        assert client.delete(f"{API}/operations/{running_operations[0]['id']}").json()["state"] == "cancelled"
        response = index_request.result()
    assert (response.status_code, response.json()["code"]) == (409, "recording_unusable")
    assert "cancelled" in response.json()["detail"]
    assert client.get(f"{API}/recordings/long.tlog/index").json()["records"] > 500


def test_the_index_lists_modes_armed_times_and_messages(client):
    index = client.get(f"{API}/recordings/{NAME}/index").json()
    assert index["begin_unix_s"] == BEGIN_S
    assert index["end_unix_s"] == pytest.approx(BEGIN_S + 29.9, abs=0.1)
    assert index["bytes_skipped"] == 0
    first, second = index["vehicles"]
    assert (first["system_id"], second["system_id"]) == (1, 7)
    for vehicle in (first, second):
        modes = vehicle["modes"]
        assert {m["mode"] for m in modes} <= {"hold", "offboard", "rtl"}
        assert modes[-1]["end_unix_s"] == index["end_unix_s"]
        assert all(a["end_unix_s"] == b["begin_unix_s"] for a, b in itertools.pairwise(modes))
        assert any(m["text"].startswith(f"note {vehicle['system_id']} at") for m in vehicle["messages"])
        assert all(3 <= m["severity"] <= 6 for m in vehicle["messages"])


def test_a_replay_is_opened_controlled_and_closed(client):
    opened = client.post(f"{API}/replays", json={"recording": NAME, "playing": False}).json()
    name = opened["name"]
    assert (opened["recording"], opened["playing"], opened["speed"]) == (NAME, False, 1.0)
    replay = control_replay(client, name, position_unix_s=BEGIN_S + 12.05)
    assert replay["position_unix_s"] == pytest.approx(BEGIN_S + 12.05, abs=1e-3)
    assert replay["vehicles"] == ["1", "7"]
    vehicle = vehicles_by_id(client)["1"]
    assert vehicle["identity"]["replayed"]
    assert vehicle["topics"]["global_position"]["value"]["alt_home_m"] == pytest.approx(12.0)
    assert vehicle["topics"]["global_position"]["received_unix_s"] == pytest.approx(
        BEGIN_S + 12.001, abs=1e-3
    )
    assert not vehicle["status"]["link_lost"]
    messages = client.get(f"{API}/vehicles/1/messages").json()["messages"]
    assert messages
    assert all(BEGIN_S <= m["unix_s"] <= BEGIN_S + 12.1 for m in messages if m["kind"] != "link")

    control_replay(client, name, position_unix_s=BEGIN_S + 3.05)  # to an earlier time
    assert vehicles_by_id(client)["7"]["topics"]["global_position"]["value"]["alt_home_m"] == pytest.approx(
        3.0
    )
    history_samples = client.get(f"{API}/vehicles/1/history").json()["samples"]
    assert all(s["received_unix_s"] <= BEGIN_S + 3.06 for s in history_samples)
    refused = client.post(f"{API}/vehicles/1/hold")
    assert refused.status_code == 409
    assert "recording" in refused.json()["detail"]

    assert control_replay(client, name, position_unix_s=0)["position_unix_s"] == pytest.approx(BEGIN_S)
    second = client.post(f"{API}/replays", json={"recording": NAME}).json()
    assert second["position_unix_s"] == pytest.approx(BEGIN_S)
    assert client.get(f"{API}/replays/{name}/index").json()["records"] > 500
    assert client.delete(f"{API}/replays/{name}").status_code == 204
    assert client.get(f"{API}/replays").json() == {"replays": []}
    assert vehicles_by_id(client) == {}
    assert client.get(f"{API}/replays/{name}").status_code == 404


def test_a_replay_plays_to_its_end_and_can_be_started_again(client):
    name = client.post(f"{API}/replays", json={"recording": NAME, "speed": 50}).json()["name"]
    deadline = time.monotonic() + 60
    while (replay := client.get(f"{API}/replays/{name}").json())["state"] != "ended":
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert not replay["playing"]
    assert replay["position_unix_s"] == replay["end_unix_s"]
    vehicles_at_end = vehicles_by_id(client)
    assert vehicles_at_end["1"]["topics"]["global_position"]["value"]["alt_home_m"] == pytest.approx(29.9)
    assert not vehicles_at_end["1"]["status"]["link_lost"]
    replay_at_end = control_replay(client, name, position_unix_s=BEGIN_S + 30)
    assert vehicles_by_id(client)["1"]["topics"]["attitude"] == vehicles_at_end["1"]["topics"]["attitude"]
    assert replay_at_end["position_unix_s"] == replay["end_unix_s"]
    restarted_replay = control_replay(client, name, playing=True, speed=0.25)
    assert restarted_replay["playing"]
    assert restarted_replay["position_unix_s"] < BEGIN_S + 29


def test_the_telemetry_socket_reports_position_and_end_of_a_replay(client):
    name = client.post(f"{API}/replays", json={"recording": NAME, "playing": False}).json()["name"]
    with client.websocket_connect(f"ws://localhost{API}/telemetry") as socket:
        socket.send_json({"type": "subscribe", "rate_hz": 50})

        def next_replays():
            while (frame := socket.receive_json())["type"] != "replays":
                pass
            return frame["replays"]

        assert [r["name"] for r in next_replays()] == [name]
        control_replay(client, name, position_unix_s=BEGIN_S + 5)
        while next_replays()[0]["position_unix_s"] != pytest.approx(BEGIN_S + 5, abs=1e-3):
            pass
        client.delete(f"{API}/replays/{name}")
        while next_replays():
            pass


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"speed": 0}, "speed"),
        ({"speed": 51}, "speed"),
        ({"speed": "NaN"}, "speed"),
        ({"position_unix_s": -1}, "position_unix_s"),
        ({"playing": "maybe"}, "playing"),
        ({"pace": 1}, "pace"),
    ],
)
def test_an_error_about_an_invalid_replay_request_names_the_field(client, body, field):
    name = client.post(f"{API}/replays", json={"recording": NAME, "playing": False}).json()["name"]
    response = client.post(f"{API}/replays/{name}", json=body)
    assert (response.status_code, response.json()["field"]) == (422, field)
    assert client.get(f"{API}/replays/{name}").json()["speed"] == 1.0
