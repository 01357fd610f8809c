"""Attacks on running servers: the servers refuse them, no vehicle moves, and no data leaves the machine.

The tests attack two servers, each with a vehicle that is ready to arm: one with the default settings on
loopback, and one that listens on all addresses and requires a token.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import os
import signal
import socket
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest
import viser
from websockets.asyncio.client import connect, unix_connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Subprotocol
from zstandard import ZstdDecompressor

from gcs_server.client import NotAllowed, SyncGcs
from tests.bench.process import process_tree
from tests.e2e.fast_station import FAST_OPTIONS
from tests.station import (
    end_process,
    free_port,
    running_process,
    running_vehicles,
    server_command,
    wait_for_start,
    wait_until,
)
from tests.support.viser_camera import CAMERA_MESSAGE

pytestmark = pytest.mark.story

VEHICLE = "101"
TCP_LISTEN = "0A"  # state of a socket in /proc/net/tcp
VISER_PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")
POSITION = {"type": "position", "position_ned_m": [0, 0, -5]}
COMMANDS: list[tuple[str, str, dict[str, Any] | None]] = [
    ("POST", f"/api/v1/vehicles/{VEHICLE}/arm", None),
    ("POST", f"/api/v1/vehicles/{VEHICLE}/takeoff", {"alt_home_m": 5}),
    ("POST", f"/api/v1/vehicles/{VEHICLE}/offboard/start", {"setpoint": POSITION}),
    ("POST", f"/api/v1/vehicles/{VEHICLE}/kill", {"confirm": f"motors stop, vehicle {VEHICLE} falls"}),
    ("POST", f"/api/v1/vehicles/{VEHICLE}/gimbal/take", None),
    ("PUT", f"/api/v1/vehicles/{VEHICLE}/params/COM_OBL_RC_ACT", {"value": 5}),
    ("POST", "/api/v1/links", {"url": "udpin://127.0.0.1:0"}),
    ("POST", "/scene/view/attack", {"mode": "top"}),
]
READ_PATHS = ["/", "/docs", "/docs/reference.js", "/api/v1/openapi.json", "/api/v1/health"]
READ_PATHS += ["/api/v1/vehicles", "/api/v1/journal", "/scene/", "/nothing"]
WEBSOCKET_PATHS = ["/api/v1/telemetry", "/scene/"]
FOREIGN_ORIGINS = ["http://evil.example", "null", "http://localhost:1", "http://localhost.evil.example"]


@dataclass
class AttackedServer:
    """A server, its vehicle, and its credentials."""

    port: int
    token: str | None
    process: subprocess.Popen[bytes]
    folder: Path

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def page_headers(self) -> dict[str, str]:
        """Headers that a browser sends from the page: its Origin, and the cookie if there is one."""
        return {"Origin": self.url} | self.cookie

    @functools.cached_property
    def cookie(self) -> dict[str, str]:
        if self.token is None:
            return {}
        response = httpx.get(f"{self.url}/?token={self.token}", verify=False)
        assert response.status_code == 303
        return {"Cookie": response.headers["set-cookie"].partition(";")[0]}

    @property
    def bearer(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.token}"} if self.token else {}

    def statuses(self, headers: dict[str, str], *, reads: bool = True, query: str = "") -> set[int]:
        """The statuses of the responses to all requests with these headers."""
        found: set[int] = set()
        with httpx.Client(verify=False, base_url=self.url, headers=headers, timeout=30) as client:
            for method, path, body in COMMANDS:
                found.add(client.request(method, path + query, json=body).status_code)
            for path in READ_PATHS if reads else []:
                found.add(client.get(path).status_code)
        return found | {asyncio.run(self.handshake(path + query, headers)) for path in WEBSOCKET_PATHS}

    async def handshake(self, path: str, headers: dict[str, str]) -> int:
        """Requests a WebSocket; returns 101 if the server opens it, otherwise the status of the refusal."""
        other_headers = {name: value for name, value in headers.items() if name != "Host"}
        # The host in the address becomes the Host header; the connection goes to this server.
        address = f"ws://{headers.get('Host', f'127.0.0.1:{self.port}')}{path}"
        protocols = [VISER_PROTOCOL] if path.startswith("/scene/") else None
        try:
            async with connect(
                address,
                host="127.0.0.1",
                port=self.port,
                proxy=None,
                additional_headers=other_headers,
                subprotocols=protocols,
            ):
                return 101
        except InvalidStatus as refused:
            return refused.response.status_code

    def assert_nothing_changed(self) -> None:
        """Checks that no vehicle moved, no command was accepted, no link was opened, and no connection leaves
        the machine."""
        with httpx.Client(verify=False, base_url=f"{self.url}/api/v1", headers=self.bearer) as client:
            state = client.get(f"/vehicles/{VEHICLE}").raise_for_status().json()
            assert state["status"]["armed"] is False
            assert state["status"]["landed_state"] == "on_ground"
            assert client.get("/journal").json()["entries"] == []
            assert len(client.get("/links").json()["links"]) == 1
        assert remote_addresses(self.process.pid) == set()


def pids_of_tree(root: int) -> set[int]:
    """Process ids of the process and all its descendants."""
    parents: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    found = {root}
    while children := {child for child, parent in parents.items() if parent in found} - found:
        found |= children
    return found


def tcp_sockets(root: int) -> list[tuple[str, str, str]]:
    """Local address, remote address and state of all TCP sockets of the process and its descendants, from
    /proc."""
    inodes: set[str] = set()
    for process in pids_of_tree(root):
        for link in Path(f"/proc/{process}/fd").iterdir():
            with contextlib.suppress(OSError):
                inodes.add(str(link.readlink()).removeprefix("socket:[").removesuffix("]"))
    rows = [
        row.split() for name in ("tcp", "tcp6") for row in Path(f"/proc/net/{name}").read_text().splitlines()
    ]
    return [(row[1], row[2], row[3]) for row in rows if row[9] in inodes]


def remote_addresses(root: int) -> set[str]:
    """Addresses of other machines to which the process or its descendants are connected."""
    local = ("0100007F:", "00000000:", "0000000000000000FFFF00000100007F:", "0" * 32 + ":")
    return {remote for _, remote, _ in tcp_sockets(root) if not remote.startswith(local)}


@contextlib.contextmanager
def running_server(folder: Path, *, exposed: bool) -> Iterator[AttackedServer]:
    port, mavlink_port = free_port(socket.SOCK_STREAM), free_port()
    command = server_command(port, [f"udpin://127.0.0.1:{mavlink_port}"], folder)
    command += ["--host", "0.0.0.0"] if exposed else []
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GCS_")}
    output_file = folder / "output.txt"
    with (
        output_file.open("wb") as out,
        running_process(
            command, stdout=out, stderr=subprocess.STDOUT, env=environment | {"TMPDIR": str(folder)}
        ) as process,
        running_vehicles(mavlink_port, arguments=FAST_OPTIONS),
    ):
        wait_for_start(process, lambda: "Ready: " in output_file.read_text(), output_file)
        token = (folder / "token").read_text().strip() if exposed else None
        target = AttackedServer(port, token, process, folder)
        with SyncGcs(target.url, token=token or "") as gcs:
            gcs.wait_for_vehicle(VEHICLE, ready=True, timeout_s=120)
        wait_until(
            lambda: httpx.get(f"{target.url}/scene/", headers=target.bearer, verify=False).status_code == 200,
            "the 3D view",
        )
        yield target


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, AttackedServer]]:
    with (
        running_server(tmp_path_factory.mktemp("a"), exposed=False) as loopback,
        running_server(tmp_path_factory.mktemp("b"), exposed=True) as exposed,
    ):
        yield {"loopback": loopback, "exposed": exposed}


@pytest.fixture(params=["loopback", "exposed"])
def target(targets: dict[str, AttackedServer], request: pytest.FixtureRequest) -> Iterator[AttackedServer]:
    """Each of the two servers; checks after the test that nothing has changed."""
    server = targets[request.param]
    yield server
    server.assert_nothing_changed()


@pytest.fixture
def loopback(targets: dict[str, AttackedServer]) -> Iterator[AttackedServer]:
    yield targets["loopback"]
    targets["loopback"].assert_nothing_changed()


@pytest.fixture
def exposed(targets: dict[str, AttackedServer]) -> Iterator[AttackedServer]:
    yield targets["exposed"]
    targets["exposed"].assert_nothing_changed()


@pytest.mark.parametrize("origin", FOREIGN_ORIGINS)
def test_requests_of_pages_of_other_sites_are_refused(target: AttackedServer, origin: str) -> None:
    """The server refuses the requests even with valid credentials: a browser adds the cookie by itself, and a
    token may be stolen."""
    for credentials in ({}, target.cookie | target.bearer):
        assert target.statuses({**credentials, "Origin": origin}) == {403}


def test_requests_of_a_foreign_page_without_an_origin_are_refused(target: AttackedServer) -> None:
    """For a request such as `<img src>` the browser sends `Sec-Fetch-Site` instead of an Origin."""
    assert target.statuses(
        {**target.cookie, "Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}
    ) == {403}


@pytest.mark.parametrize("name", ["rebound.example:{}", "localhost.evil.example:{}", "192.168.1.5:{}"])
def test_a_rebound_host_name_is_refused(targets: dict[str, AttackedServer], name: str) -> None:
    """DNS rebinding: another name resolves to this server. The request's Origin equals its Host, and it has
    no cookie."""
    # A WebSocket that is refused before it is accepted always gets status 403.
    for target, statuses in ((targets["loopback"], {403}), (targets["exposed"], {401, 403})):
        host = name.format(target.port)
        rebound = {"Host": host, "Origin": f"http://{host}"}
        assert target.statuses(rebound) == statuses
        assert target.statuses({"Host": host}) == statuses
        target.assert_nothing_changed()


def test_requests_without_a_valid_token_are_refused(exposed: AttackedServer) -> None:
    assert exposed.token
    name, _, value = exposed.cookie["Cookie"].partition("=")
    invalid_headers = [
        {},
        {"Origin": exposed.url},
        {"Authorization": "Bearer wrong"},
        {"Authorization": f"Bearer {exposed.token[:-1]}"},
        {"Authorization": f"Basic {exposed.token}"},
        {"Origin": exposed.url, "Cookie": f"{name}={exposed.token}"},
        {"Origin": exposed.url, "Cookie": f"{name}={value[:-1]}; gcs={value}"},
        {"X-Forwarded-For": "127.0.0.1", "Forwarded": "for=127.0.0.1;host=localhost"},
    ]
    for headers in invalid_headers:
        assert exposed.statuses(headers) == {401, 403}, headers
    # An address with the token only signs the browser in; the request itself has no effect.
    assert exposed.statuses({}, reads=False, query=f"?token={exposed.token}") == {401, 403}
    with SyncGcs(exposed.url, token="wrong") as gcs, pytest.raises(NotAllowed, match="Bearer"):
        gcs.vehicles()


def test_a_cookie_without_the_pages_origin_commands_nothing(exposed: AttackedServer) -> None:
    assert exposed.statuses(exposed.cookie, reads=False) == {403}


def test_direct_access_to_viser_is_refused(target: AttackedServer) -> None:
    listening = {
        int(local.rpartition(":")[2], 16)
        for pid in process_tree(target.process.pid)
        for local, _, state in tcp_sockets(pid)
        if state == TCP_LISTEN
    }
    assert listening == {target.port}, "a process of the server listens on another port"
    (path,) = target.folder.glob("gcs-scene-*/s")
    assert path.parent.stat().st_mode & 0o077 == 0
    invalid_headers = [{}, {"X-Scene-Secret": "guess"}, target.bearer or {"X-Scene-Secret": ""}]

    async def handshake(headers: dict[str, str]) -> int:
        try:
            async with unix_connect(
                str(path), "ws://scene/", subprotocols=[VISER_PROTOCOL], additional_headers=headers
            ):
                return 101
        except InvalidStatus as refused:
            return refused.response.status_code

    with httpx.Client(transport=httpx.HTTPTransport(uds=str(path))) as client:
        for headers in invalid_headers:
            assert client.get("http://scene/", headers=headers).status_code == 403
            assert asyncio.run(handshake(headers)) == 403


def message_types(data: bytes) -> set[str]:
    """Types of viser's messages in one frame, which has two lengths, compressed messages and buffers."""
    size, compressed = int.from_bytes(data[:8], "little"), int.from_bytes(data[8:16], "little")
    inner = ZstdDecompressor().decompress(data[16 : 16 + compressed], max_output_size=size)
    return {message["type"] for message in msgspec.msgpack.decode(inner)["messages"]}


def test_a_share_request_opens_no_tunnel(target: AttackedServer) -> None:
    before = pids_of_tree(target.process.pid)

    async def request_share() -> set[str]:
        received_types: set[str] = set()
        async with connect(
            f"ws://127.0.0.1:{target.port}/scene/",
            additional_headers=target.page_headers,
            subprotocols=[VISER_PROTOCOL],
            max_size=None,
        ) as stream:
            for kind in ("ShareUrlRequest", "ShareUrlDisconnect", "ShareUrlRequest"):
                await stream.send(msgspec.msgpack.encode({"type": kind}))
            await stream.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
            # The scene replies to the camera message, which was sent after the share requests.
            async with asyncio.timeout(15):
                while "SetCameraPositionMessage" not in received_types:
                    received_types |= message_types(await stream.recv())
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(1):
                    while True:
                        received_types |= message_types(await stream.recv())
        return received_types

    received_types = asyncio.run(request_share())
    assert not [kind for kind in received_types if "Share" in kind]
    assert pids_of_tree(target.process.pid) == before, "a process was started, such as viser's tunnel"
    assert remote_addresses(target.process.pid) == set()


def send_until_acknowledged(client: httpx.Client, command: str) -> None:
    """Repeats a command until the vehicle acknowledges it: on a busy machine the link may be lost for a
    moment."""
    statuses: list[int] = []

    def is_acknowledged() -> bool:
        statuses.append(client.post(f"/{VEHICLE}/{command}", timeout=30).status_code)
        return statuses[-1] != httpx.codes.SERVICE_UNAVAILABLE

    wait_until(is_acknowledged, f"an acknowledgement of {command}")
    assert statuses[-1] == httpx.codes.OK


def test_after_all_attacks_authorized_commands_work(targets: dict[str, AttackedServer]) -> None:
    """This test runs last; it shows that the vehicles could have moved during the attacks."""
    for target in targets.values():
        for headers in (target.bearer, target.page_headers):
            with httpx.Client(
                verify=False, base_url=f"{target.url}/api/v1/vehicles", headers=headers
            ) as client:
                send_until_acknowledged(client, "arm")
                assert client.get(f"/{VEHICLE}").json()["status"]["armed"] is True
                send_until_acknowledged(client, "disarm")
        assert {asyncio.run(target.handshake(path, target.page_headers)) for path in WEBSOCKET_PATHS} == {101}


def test_after_a_restart_cookies_stay_valid(tmp_path: Path) -> None:
    """The server accepts the earlier cookie, so no user is signed out in flight."""
    port = free_port(socket.SOCK_STREAM)
    command = [*server_command(port, [], tmp_path), "--no-scene", "--host", "0.0.0.0"]
    cookies: list[dict[str, str]] = []
    output_file = tmp_path / "output.txt"
    for _ in range(2):
        with (
            output_file.open("wb") as out,
            running_process(command, stdout=out, stderr=subprocess.STDOUT) as process,
        ):
            wait_for_start(process, lambda: "Ready: " in output_file.read_text(), output_file)
            target = AttackedServer(port, (tmp_path / "token").read_text().strip(), process, tmp_path)
            assert f"http://localhost:{port}/?token={target.token}" in output_file.read_text()
            cookies.append(target.cookie)
            assert httpx.get(f"{target.url}/api/v1/health", headers=cookies[0]).status_code == 200
            assert target.token not in Path(f"/proc/{process.pid}/cmdline").read_text()
            end_process(process, signal.SIGTERM)
    assert cookies[0] == cookies[1]
