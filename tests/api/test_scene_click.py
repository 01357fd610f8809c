"""A click in a 3D view is sent to the telemetry sockets as an event."""

from __future__ import annotations

from fastapi.testclient import TestClient

from gcs_server.app import create_app
from gcs_server.scene.clicks import SceneClick
from gcs_server.settings import Settings


def test_a_click_in_3d_is_sent_with_the_id_of_its_view_and_is_not_stored(tmp_path):
    settings = Settings(links=(), sim=0, data=tmp_path, scene=False, record=False)
    app = create_app(settings, static=tmp_path)
    with (
        TestClient(app, base_url="http://localhost") as client,
        client.websocket_connect("ws://localhost/api/v1/telemetry") as socket,
    ):
        assert socket.receive_json()["type"] == "hello"
        click = SceneClick("page-1", "1", 47.4, 8.5, 488.0, 0.5, 0.9)
        client.portal.call(app.state.server._events.scene_click, click)
        event = socket.receive_json()["event"]
        assert app.state.server.fleet.events.since() == []
    sent_click = {key: event[key] for key in ("kind", "view", "vehicle", "lat_deg", "lon_deg", "alt_amsl_m")}
    assert sent_click == {
        "kind": "scene_click",
        "view": "page-1",
        "vehicle": "1",
        "lat_deg": 47.4,
        "lon_deg": 8.5,
        "alt_amsl_m": 488.0,
    }
    assert (event["view_x"], event["view_y"], event["text"]) == (0.5, 0.9, "")
