"""The proxy to viser accepts only pages of this server, and from them only camera and handle messages."""

from __future__ import annotations

import asyncio
import stat
from pathlib import Path
from urllib.request import Request, urlopen

import httpx
import msgspec
import pytest
import websockets
from starlette.datastructures import Headers
from viser import _messages
from websockets.asyncio.client import unix_connect

from gcs_server.origin import is_same_origin
from gcs_server.scene.messages import MAX_VIEWS, SECRET_HEADER
from gcs_server.scene.page import content_policy, page
from gcs_server.scene.proxy import parse_message
from tests.integration.gcs_server.scene.scene_server import (
    PROTOCOL,
    message_types,
    open_stream,
    wait_until,
)
from tests.support.viser_camera import CAMERA_MESSAGE


def listening_tcp_ports() -> set[int]:
    inodes = set()
    for link in Path("/proc/self/fd").iterdir():
        target = str(link.readlink()) if link.is_symlink() else ""
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    ports = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for row in Path(table).read_text().splitlines()[1:]:
            fields = row.split()  # the state 0A is LISTEN
            if fields[3] == "0A" and fields[9] in inodes:
                ports.add(int(fields[1].rsplit(":", 1)[1], 16))
    return ports


# --- access to viser -----------------------------------------------------------------------------


def test_viser_listens_on_no_tcp_port(scene_server):
    assert listening_tcp_ports() == {scene_server.port}


def test_the_socket_is_in_a_private_folder(scene_server):
    folder = scene_server.host.socket_path.parent
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_http_without_the_secret_is_refused(scene_server):
    with httpx.Client(transport=httpx.HTTPTransport(uds=str(scene_server.host.socket_path))) as client:
        assert client.get("http://scene/").status_code == 403
        assert client.get("http://scene/", headers={SECRET_HEADER: "guess"}).status_code == 403
        assert (
            client.get("http://scene/", headers={SECRET_HEADER: scene_server.host.secret}).status_code == 200
        )


@pytest.mark.parametrize("headers", [{}, {SECRET_HEADER: "guess"}, {SECRET_HEADER: "\u00e9"}])
def test_a_stream_without_the_secret_is_refused(scene_server, headers):
    async def open_without_secret():
        await unix_connect(
            str(scene_server.host.socket_path),
            "ws://scene/",
            subprotocols=[PROTOCOL],
            additional_headers=headers,
        )

    with pytest.raises(websockets.exceptions.InvalidStatus) as refused:
        asyncio.run(open_without_secret())
    assert refused.value.response.status_code == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "file://"])
def test_a_page_of_another_origin_gets_no_stream(scene_server, origin):
    async def open_from_other_origin():
        await open_stream(scene_server, origin=origin)

    with pytest.raises(websockets.exceptions.InvalidStatus) as refused:
        asyncio.run(open_from_other_origin())
    assert refused.value.response.status_code == 403


def test_a_page_of_another_origin_may_not_change_a_view(scene_server):
    response = httpx.post(scene_server.url + "view/a", json={}, headers={"Origin": "http://evil.example"})
    assert response.status_code == 409


@pytest.mark.parametrize(
    ("origin", "host", "is_same"),
    [
        (None, "gcs:8080", True),
        ("http://gcs:8080", "gcs:8080", True),
        ("http://GCS:8080", "gcs:8080", True),
        ("http://gcs", "gcs:80", True),
        ("https://gcs", "gcs", True),
        ("https://gcs:443", "gcs", True),
        ("http://gcs:9090", "gcs:8080", False),
        ("http://gcs.evil.example", "gcs", False),
        ("null", "null", False),
        ("", "", False),
    ],
)
def test_a_request_has_the_same_origin_if_its_origin_header_names_the_host(origin, host, is_same):
    headers = {"host": host} | ({"origin": origin} if origin is not None else {})
    assert is_same_origin(Headers(headers)) is is_same


# --- messages from a browser ---------------------------------------------------------------------


pack = msgspec.msgpack.encode


def test_a_camera_message_passes_without_extra_fields():
    assert msgspec.msgpack.decode(parse_message(pack(CAMERA_MESSAGE)), type=dict) == {
        k: list(v) if isinstance(v, tuple) else v for k, v in CAMERA_MESSAGE.items()
    }
    # A map with two "type" keys: parsers differ in which key they use, so the proxy encodes the map again.
    two_types = b"\x8a" + pack("type") + pack("ShareUrlRequest") + pack(CAMERA_MESSAGE)[1:]
    passed_message = parse_message(two_types)
    assert passed_message is None or b"Share" not in passed_message


@pytest.mark.parametrize(
    "data",
    [
        *(pack({"type": t}) for t in ("ShareUrlRequest", "ShareUrlDisconnect", "GuiUpdateMessage")),
        pack({**CAMERA_MESSAGE, "type": "ShareUrlRequest"}),
        pack({**CAMERA_MESSAGE, "type": ["ViewerCameraMessage"]}),
        pack({**CAMERA_MESSAGE, "more": 1}),
        pack({**CAMERA_MESSAGE, "position": (float("nan"), 0.0, 0.0)}),
        pack({**CAMERA_MESSAGE, "look_at": CAMERA_MESSAGE["position"]}),
        pack({**CAMERA_MESSAGE, "up_direction": (0.0, 0.0, 0.0)}),
        pack({k: v for k, v in CAMERA_MESSAGE.items() if k != "fov"}),
        pack("x" * 5000),
        b"",
        b"\xc1",
        b"\x93\x01\x02\x03",
    ],
)
def test_messages_that_are_no_valid_camera_message_are_dropped(data):
    assert parse_message(data) is None


def test_a_request_for_a_public_tunnel_is_dropped(scene_server, monkeypatch):
    """The proxy does not pass the request on, and viser has no handler for this request."""
    import viser._tunnel

    tunnels: list[object] = []
    monkeypatch.setattr(viser._tunnel.ViserTunnel, "__init__", lambda *a, **k: tunnels.append(a))
    server = scene_server.host._server
    received_types: list[str] = []
    real_handler = server._websock_server._handle_incoming_message

    async def record_type(client_id, message):
        received_types.append(type(message).__name__)
        await real_handler(client_id, message)

    monkeypatch.setattr(server._websock_server, "_handle_incoming_message", record_type)

    async def request_tunnel():
        async with open_stream(scene_server) as stream:
            await stream.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
            await stream.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
            await wait_until(lambda: "ViewerCameraMessage" in received_types)

    asyncio.run(request_tunnel())
    assert "ShareUrlRequest" not in received_types
    assert _messages.ShareUrlRequest not in server._websock_server._incoming_handlers
    assert server.request_share_url() is None
    assert tunnels == []


def test_a_text_message_ends_only_the_stream_that_sent_it(scene_server):
    async def send_to_both_streams():
        async with open_stream(scene_server) as good_stream, open_stream(scene_server) as bad_stream:
            await bad_stream.send("hello")
            async with asyncio.timeout(30):
                await bad_stream.wait_closed()
            await good_stream.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
            assert message_types(await good_stream.recv())

    asyncio.run(send_to_both_streams())


# --- data for a browser --------------------------------------------------------------------------


def test_visers_page_is_served_completely(scene_server):
    response = httpx.get(scene_server.url)
    assert response.status_code == 200
    assert response.headers["content-type"].startswith("text/html")
    assert response.headers["content-encoding"] == "gzip"
    assert response.text.encode() == page().plain
    second_response = httpx.get(scene_server.url, headers={"If-None-Match": response.headers["etag"]})
    assert second_response.status_code == 304
    with urlopen(Request(scene_server.url)) as uncompressed_response:  # requests no compression
        assert uncompressed_response.read() == page().plain


def test_visers_page_may_connect_only_to_this_server():
    policy = content_policy("gcs:8080", secure=False)
    assert "default-src 'none'" in policy
    assert "connect-src 'self' ws://gcs:8080 data: blob:;" in policy
    assert "http" not in policy
    assert "wss://gcs" in content_policy("gcs", secure=True)


def test_a_hostile_host_header_adds_nothing_to_the_policy(scene_server):
    response = httpx.get(scene_server.url, headers={"Host": "a; script-src *"})
    assert "script-src *" not in response.headers.get("content-security-policy", "")


def test_a_browser_gets_a_scene_that_is_removed_when_its_stream_ends(scene_server):
    async def run():
        async with open_stream(
            scene_server, "?theme=light", origin=scene_server.url.removesuffix("/scene/")
        ) as stream:
            assert stream.subprotocol == PROTOCOL
            await stream.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
            kinds: set[str] = set()
            async with asyncio.timeout(30):
                while (
                    not {"MeshMessage", "GridMessage", "LineSegmentsMessage", "SetCameraPositionMessage"}
                    <= kinds
                ):
                    kinds |= set(message_types(await stream.recv()))
            await wait_until(lambda: scene_server.scene.viewers == 1)

    asyncio.run(run())
    asyncio.run(wait_until(lambda: scene_server.scene.viewers == 0))


def test_an_unchanged_scene_is_not_sent_again(scene_server):
    async def run():
        async with open_stream(scene_server) as stream:
            await stream.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
            received_types: list[str] = []
            try:
                async with asyncio.timeout(1.5):
                    while True:
                        received_types += message_types(await stream.recv())
            except TimeoutError:
                pass
            return received_types

    for vehicle in scene_server.fleet.vehicles:
        vehicle.values.pop("motors")
    received_types = asyncio.run(run())
    assert received_types.count("MeshMessage") < 20
    assert received_types.count("SetPositionMessage") < 30  # at 30 Hz, two vehicles would send 90 in 1.5 s


def test_a_page_changes_its_view(scene_server):
    response = httpx.post(scene_server.url + "view/page1", json={"mode": "top", "vehicle": "2"})
    assert response.json() == {"mode": "top", "vehicle": "2", "theme": "dark"}
    httpx.post(scene_server.url + "view/page1", json={"theme": "light"})
    view = scene_server.scene._views["page1"]
    assert (view.mode, view.vehicle, view.theme) == ("top", "2", "light")


def test_a_new_theme_rebuilds_the_scene(scene_server):
    async def run():
        async with open_stream(scene_server, "?view=page2&theme=dark") as stream:
            await stream.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
            await wait_until(lambda: scene_server.scene.viewers == 1)
            async with httpx.AsyncClient() as client:
                await client.post(scene_server.url + "view/page2", json={"theme": "light"})
            browser_scenes = scene_server.scene._browser_scenes
            camera = next(iter(scene_server.host.clients().values())).camera
            position_before = tuple(camera.position)
            await wait_until(
                lambda: all(s.theme == "light" for _, s in browser_scenes.values()) and browser_scenes
            )
            assert tuple(camera.position) == position_before

    asyncio.run(run())


@pytest.mark.parametrize(
    ("body", "field"), [({"mode": "side"}, "mode"), ({"colour": 1}, "colour"), ({"theme": 3}, "theme")]
)
def test_an_invalid_view_request_names_its_field(scene_server, body, field):
    response = httpx.post(scene_server.url + "view/page1", json=body)
    assert response.status_code == 422
    assert field in response.text


def test_an_invalid_view_token_is_refused(scene_server):
    assert httpx.post(scene_server.url + "view/a.b", json={}).status_code == 409


def test_the_number_of_stored_views_is_limited(scene_server):
    with httpx.Client() as client:
        for i in range(MAX_VIEWS + 20):
            client.post(f"{scene_server.url}view/many{i}", json={})
    assert len(scene_server.scene._views) <= MAX_VIEWS
