"""The API without a vehicle: errors name the invalid input, refusals are problem+json, requests
from other origins are refused."""

import asyncio
import json

import pytest
from starlette.websockets import WebSocketDisconnect

from gcs_server.api import responses
from gcs_server.api.schema import description
from gcs_server.flights.group import GroupStatus
from tests.support.api_client import api_client


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with api_client(tmp_path_factory.mktemp("data"), raise_server_exceptions=False) as client:
        yield client


def setpoint_body(kind, field, values):
    return f'{{"setpoint": {{"type": "{kind}", "{field}": {values}}}}}'


POSITION = {"type": "position", "position_ned_m": [0, 0, -5]}


@pytest.mark.parametrize(
    ("path", "body", "field"),
    [
        ("takeoff", '{"alt_home_m": NaN}', "alt_home_m"),
        ("takeoff", '{"alt_home_m": Infinity}', "alt_home_m"),
        ("takeoff", '{"alt_home_m": 0.5}', "alt_home_m"),
        ("takeoff", "{}", "alt_home_m"),
        ("takeoff", '{"alt_home_m": 5, "speed": 3}', "speed"),
        ("takeoff", "{", "body"),
        ("goto", '{"lat_deg": 91, "lon_deg": 0, "alt_home_m": 5}', "lat_deg"),
        ("goto", '{"lat_deg": 1, "lon_deg": 0}', "body"),
        (
            "offboard/setpoint",
            setpoint_body("position", "position_ned_m", "[0, NaN, 0]"),
            "setpoint.position_ned_m.1",
        ),
        (
            "offboard/setpoint",
            setpoint_body("velocity", "velocity_ned_m_s", "[0, 21, 0]"),
            "setpoint.velocity_ned_m_s.1",
        ),
        (
            "offboard/setpoint",
            setpoint_body("velocity", "velocity_ned_m_s", "[0, 1]"),
            "setpoint.velocity_ned_m_s.2",
        ),
        ("offboard/setpoint", json.dumps({"setpoint": POSITION, "valid_for_s": 0.01}), "valid_for_s"),
        (
            "offboard/setpoint",
            json.dumps({"setpoint": POSITION, "on_expiry": {"action": "wait"}}),
            "on_expiry",
        ),
        ("offboard/setpoint", json.dumps({**POSITION, "valid_for_s": 1}), "body"),
        ("offboard/start", json.dumps(POSITION), "body"),
        ("offboard/start", json.dumps({"setpoint": POSITION, "rate_hz": 1}), "rate_hz"),
        ("offboard/start", json.dumps({"rate_hz": 10}), "setpoint"),
        ("gimbal/angles", '{"pitch_deg": NaN, "yaw_deg": 0}', "pitch_deg"),
    ],
)
def test_invalid_values_get_status_422_and_the_error_names_the_field(client, path, body, field):
    response = client.post(
        f"/api/v1/vehicles/1/{path}", content=body, headers={"Content-Type": "application/json"}
    )
    assert response.status_code == 422
    assert response.headers["content-type"] == "application/problem+json"
    problem = response.json()
    assert problem["code"] == "invalid_request"
    assert problem["field"] == field
    assert field in problem["detail"]


@pytest.mark.parametrize("path", ["arm", "hold", "offboard/stop", "gimbal/take"])
def test_a_command_to_an_unknown_vehicle_gets_status_404_and_is_journaled(client, path):
    response = client.post(f"/api/v1/vehicles/77/{path}", headers={"X-Client": "tester"})
    assert response.status_code == 404
    assert response.json()["vehicle"] == "77"
    entry = client.get("/api/v1/journal?limit=1").json()["entries"][0]
    assert (entry["command"], entry["client"], entry["vehicle"], entry["result"]) == (
        path,
        "tester",
        "77",
        "unknown_vehicle",
    )


MEMBERS = [{"vehicle": v, "setpoint": POSITION} for v in ("1", "2")]
DECREASING_TIMES = {"type": "path", "points": [{"t_s": t, "position_ned_m": [0, 0, -5]} for t in (0, 2, 1)]}


@pytest.mark.parametrize(
    ("path", "body", "field", "text"),
    [
        ("", {}, "members", "required"),
        ("", {"members": MEMBERS[:1]}, "members", "at least 2"),
        ("", {"members": MEMBERS * 6}, "members", "at most 10"),
        ("", {"members": [*MEMBERS, MEMBERS[0]]}, "body", "members: vehicle 1 is named twice"),
        ("", {"members": [MEMBERS[0], {"vehicle": "2"}]}, "members.1.setpoint", "required"),
        (
            "",
            {"members": [MEMBERS[0], {"vehicle": "2", "setpoint": DECREASING_TIMES}]},
            "members.1.setpoint",
            "points.2.t_s must be later",
        ),
        ("", {"members": MEMBERS, "minimum_separation_m": 0.5}, "minimum_separation_m", "1"),
        ("", {"members": MEMBERS, "valid_for_s": 3600}, "valid_for_s", "600"),
        ("", {"members": MEMBERS, "start_at_unix_s": "soon"}, "start_at_unix_s", "number"),
        ("", {"members": MEMBERS, "others": 1}, "others", "not permitted"),
        ("/1/setpoints", {}, "setpoints", "required"),
        ("/1/setpoints", {"setpoints": [MEMBERS[0]] * 2}, "body", "setpoints: vehicle 1 is named twice"),
    ],
)
def test_an_invalid_group_gets_status_422_and_the_error_names_the_field(client, path, body, field, text):
    response = client.post(f"/api/v1/groups{path}", json=body)
    assert response.status_code == 422
    problem = response.json()
    assert (problem["code"], problem["field"]) == ("invalid_request", field)
    assert text in problem["detail"]


def test_a_group_of_unknown_vehicles_gets_status_404_and_each_vehicle_is_journaled(client):
    response = client.post("/api/v1/groups", json={"members": MEMBERS}, headers={"X-Client": "tester"})
    assert (response.status_code, response.json()["code"]) == (404, "unknown_vehicle")
    entries = client.get("/api/v1/journal?limit=2").json()["entries"]
    assert sorted((e["command"], e["vehicle"], e["result"]) for e in entries) == [
        ("group/start", "1", "unknown_vehicle"),
        ("group/start", "2", "unknown_vehicle"),
    ]
    assert client.get("/api/v1/groups").json() == {"groups": []}
    for route in ("/hold", "/setpoints"):
        unknown = client.post(f"/api/v1/groups/7{route}", json={"setpoints": []})
        assert (unknown.status_code, unknown.json()["code"]) == (404, "unknown_group")


def test_changes_of_a_group_are_sent_as_events(client, monkeypatch):
    groups = client.app.state.station.flights.groups
    status = GroupStatus(
        id="4", state="flying", mission=None, client="anna", client_key="key", minimum_separation_m=5.0,
        margin_m=1.6, others_go_on=False, created_unix_s=1.0, start_unix_s=2.0, valid_left_s=3.0, members=(),
        nearest=None, findings=(), ended=None,
    )  # fmt: skip
    monkeypatch.setattr(groups, "_status", lambda _group: status)
    with client.websocket_connect("ws://localhost/api/v1/telemetry") as socket:
        assert socket.receive_json()["type"] == "hello"
        client.portal.call(lambda: groups._announce(None, "Group 4 has begun.", warning=True))
        event = socket.receive_json()["event"]
    assert (event["kind"], event["vehicle"], event["severity"]) == ("group", None, 4)
    assert (event["text"], event["group"]["id"]) == ("Group 4 has begun.", "4")


def test_links_are_added_and_removed_and_an_invalid_url_is_refused(client):
    assert client.post("/api/v1/links", json={"url": "carrier-pigeon://x"}).status_code == 422
    added = client.post("/api/v1/links", json={"url": "udpin://127.0.0.1:0", "name": "any"})
    assert added.status_code == 201
    assert [link["name"] for link in client.get("/api/v1/links").json()["links"]] == ["any"]
    assert client.delete("/api/v1/links/any").status_code == 204
    assert client.delete("/api/v1/links/any").status_code == 404


def test_other_origins_and_host_names_are_refused(client):
    foreign_origin = {"Origin": "http://evil.example"}
    assert client.post("/api/v1/vehicles/1/arm", headers=foreign_origin).json()["code"] == "foreign_origin"
    same_origin = client.post("/api/v1/vehicles/1/arm", headers={"Origin": "http://localhost"})
    assert same_origin.status_code == 404
    assert client.get("/api/v1/health", headers={"Host": "rebound.example"}).status_code == 403
    with (
        pytest.raises(WebSocketDisconnect) as closed,
        client.websocket_connect("ws://localhost/api/v1/telemetry", headers=foreign_origin),
    ):
        pass
    assert closed.value.code == 1008


def test_without_a_built_page_the_server_says_how_to_build_it(client):
    response = client.get("/")
    assert response.status_code == 503
    assert "make" in response.text


def test_telemetry_sends_hello_and_explains_an_invalid_subscription(client):
    with client.websocket_connect("ws://localhost/api/v1/telemetry") as socket:
        hello = socket.receive_json()
        assert (hello["type"], hello["schema_version"]) == ("hello", 1)
        socket.send_text('{"type": "subscribe", "topics": ["altitude"]}')
        error = socket.receive_json()
        assert error["type"] == "error"
        assert "altitude" in error["detail"]


def test_every_model_and_field_of_the_schema_is_described():
    schemas = description()["components"]["schemas"]
    fastapi_schemas = ("HTTPValidationError", "ValidationError")
    own_schemas = {name: schema for name, schema in schemas.items() if name not in fastapi_schemas}
    undescribed = [name for name, schema in own_schemas.items() if not schema.get("description")]
    undescribed += [
        f"{name}.{key}"
        for name, schema in own_schemas.items()
        for key, field in schema.get("properties", {}).items()
        if not field.get("description") and "const" not in field and "$ref" not in field
        if "discriminator" not in field
    ]
    assert undescribed == []
    assert responses.VehicleModel.__name__ in own_schemas


def test_dependencies_of_routes_run_in_the_event_loop(client, monkeypatch):
    principals = []

    def renew(principal):
        asyncio.get_running_loop()  # raises if called in another thread
        principals.append(principal)

    monkeypatch.setattr(client.app.state.station.authority, "renew", renew)
    assert client.get("/api/v1/me", headers={"X-Client": "anna"}).json()["name"] == "anna"
    assert {principal.name for principal in principals} == {"anna"}
