"""The table of commands has the permission that each route and WebSocket message needs; the server
enforces it."""

import re
from pathlib import Path

import msgspec
import pytest
from fastapi.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from gcs_server.api.permission import bind_commands, calls_of
from gcs_server.api.schema import description
from gcs_server.app import create_app
from gcs_server.control.commands import ALL, BY_CALL, BY_NAME, table
from gcs_server.control.principal import Principal
from gcs_server.scene.gizmo import MovedMessage, ReleasedMessage
from gcs_server.scene.proxy import CameraMessage
from gcs_server.telemetry.wire import Subscribe
from tests.support.api_client import settings_for

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "authority.md"
STREAM = "/api/v1/vehicles/{v}/offboard/stream"


def tag(message):
    return msgspec.inspect.type_info(message).tag


MESSAGES = {
    f"WS /api/v1/telemetry {tag(Subscribe)}",
    f"WS {STREAM} setpoint",
    "WS /api/v1/vehicles/{v}/manual_control/stream sticks",
    *(f"WS /scene/ {tag(message)}" for message in (CameraMessage, MovedMessage, ReleasedMessage)),
}
NOBODY = Principal("nobody", "0" * 12, permissions=frozenset())


@pytest.fixture(params=["no page built", "page built"])
def app(tmp_path, request):
    if request.param == "page built":
        (tmp_path / "index.html").write_text("<!doctype html><title>page</title>")
    return create_app(settings_for(tmp_path, scene=True), static=tmp_path)


def method_and_path(call):
    method, path = call.split(" ")[:2]
    return method, re.sub(r"\{\w+\}", "1", path)


def test_each_route_and_message_has_exactly_one_row_and_no_row_is_unused(app):
    existing = {call for call, _ in calls_of(app)}
    assert len(existing) > 75
    assert existing | MESSAGES == set(BY_CALL)
    assert len(BY_CALL) == sum(len(row.calls) for row in ALL), "a call is in two rows"
    assert len(BY_NAME) == len(ALL)


def test_a_route_without_a_row_stops_the_server_from_starting(app):
    @app.post("/api/v1/vehicles/{v}/explode")
    async def explode(v: str) -> None: ...

    with pytest.raises(RuntimeError, match="explode has no row"):
        bind_commands(app)


def test_a_role_without_the_permission_is_refused_at_every_route_and_journaled(app, monkeypatch):
    monkeypatch.setattr(Principal, "from_identity", lambda *_: NOBODY)
    client = TestClient(app, base_url="http://localhost")
    refused = set()
    for call, _ in calls_of(app):
        row, (method, path) = BY_CALL[call], method_and_path(call)
        if row.permission is None:
            continue
        is_first_refusal = row.name not in refused  # equal refusals share one journal line
        refused.add(row.name)
        if method == "WS":
            with (
                pytest.raises(WebSocketDisconnect) as closed,
                client.websocket_connect(f"ws://localhost{path}"),
            ):
                pass
            assert (closed.value.code, closed.value.reason) == (1008, "not_permitted")
            continue
        response = client.request(method, path)
        assert (response.status_code, response.json()["code"]) == (403, "not_permitted"), call
        assert response.json()["permission"] == row.permission
        newest = app.state.station.journal.tail(1)
        if row.journaled and is_first_refusal:
            assert (newest[0].command, newest[0].result) == (row.name, "not_permitted")
    assert refused == {row.name for row in ALL if row.permission is not None}


def test_the_permission_for_a_socket_equals_the_permission_of_each_of_its_messages():
    """So the server checks the permission only once, when the socket opens."""
    for call in MESSAGES:
        socket_call = call.rsplit(" ", 1)[0]
        assert BY_CALL[call].permission == BY_CALL[socket_call].permission


def test_the_api_description_has_the_authority_of_each_operation():
    paths = description()["paths"]
    authority = paths["/api/v1/links/{name}"]["delete"]["x-authority"]
    assert (authority["permission"], authority["control"], authority["journaled"]) == (
        "station",
        "not_anothers",
        True,
    )
    assert paths["/api/v1/vehicles/{v}/kill"]["post"]["x-authority"]["confirmed"]
    assert all("x-authority" in operation for methods in paths.values() for operation in methods.values())


def test_authority_md_contains_the_table():
    assert table() in DOCUMENT.read_text(encoding="utf-8"), "run `python -m tools.build_command_table`"
