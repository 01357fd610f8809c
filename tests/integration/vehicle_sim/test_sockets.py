"""The simulator's ports: TCP serves one client at a time, UDP messages go to the first sender."""

from __future__ import annotations

import contextlib
import socket
import struct
from collections.abc import Iterator

import pytest

from tests.station import free_port
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.mavlink.transports import is_web_client
from vehicle_sim.server import Ports, SimServer

MAX_SPEED = float("inf")


@pytest.fixture
def tcp_port() -> int:
    return free_port(socket.SOCK_STREAM)


@pytest.fixture
def server(tcp_port: int) -> Iterator[SimServer]:
    ports = Ports(gcs_local=0, gcs_remote=free_port(), api_remote=0, tcp=tcp_port)
    server = SimServer(
        SimulatedFleet(1, links=()), first_instance=0, ports=ports, bind="127.0.0.1", gcs_host="127.0.0.1"
    )
    yield server
    server.close()


def connect_client(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=2.0)


def received_names(connection: socket.socket) -> set[str]:
    parser, names = FrameParser(), set[str]()
    connection.setblocking(False)
    try:
        while data := connection.recv(65536):
            names |= {message.name for message in parser.feed(data)}
    except BlockingIOError:
        pass
    return names


def test_the_next_tcp_client_is_served_after_the_previous_client_disconnects(
    server: SimServer, tcp_port: int
) -> None:
    first_client = connect_client(tcp_port)
    server.run(MAX_SPEED, 1.2)
    assert {"HEARTBEAT", "ATTITUDE"} <= received_names(first_client)
    second_client = connect_client(tcp_port)
    server.run(MAX_SPEED, 1.2)
    assert received_names(second_client) == set()
    first_client.close()
    server.run(MAX_SPEED, 1.2)
    assert {"HEARTBEAT", "ATTITUDE"} <= received_names(second_client)
    second_client.close()


def test_after_a_connection_reset_the_next_tcp_client_is_served(server: SimServer, tcp_port: int) -> None:
    first_client = connect_client(tcp_port)
    server.run(MAX_SPEED, 0.2)
    # A reset, not an orderly close: the server detects it while it sends or while it receives.
    first_client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    first_client.close()
    server.run(MAX_SPEED, 0.2)
    second_client = connect_client(tcp_port)
    server.run(MAX_SPEED, 1.2)
    assert "HEARTBEAT" in received_names(second_client)
    second_client.close()


def test_udp_messages_go_to_the_first_sender(server: SimServer) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        heartbeat = frame_v2(*pack("HEARTBEAT", type=6, autopilot=8, mavlink_version=3), 0, 255, 190)
        station.sendto(heartbeat, ("127.0.0.1", server.vehicles[0].transports["gcs"].port))
        server.run(MAX_SPEED, 1.2)
        assert {"HEARTBEAT", "ATTITUDE"} <= received_names(station)


@pytest.mark.parametrize(("speed", "stays_connected"), [(1.0, False), (3.0, True)])
def test_the_timeout_of_a_ground_station_is_longer_in_a_fast_simulation(
    server: SimServer, speed: float, stays_connected: bool
) -> None:
    """At three times real time, a ground station's heartbeats arrive every three seconds of simulated
    time."""
    server.run(speed, 0.02)
    context = server.fleet.nodes[0].context
    link = context.links[0]
    link.gcs_heartbeat_at_s = context.view.time_s
    assert context.gcs_connected(link)
    server.run(speed, 3.2)
    assert context.gcs_connected(link) is stays_connected


WEB_CLIENTS = {
    "post": [b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 40\r\n\r\n"],
    "get": [b"GET / HTTP/1.1\r\n\r\n"],
    "in pieces": [b"PO", b"ST / HTTP/1.1\r\n\r\n"],
    "letter by letter": [bytes([letter]) for letter in b"OPTIONS / HTTP/1.1\r\n\r\n"],
    "http 2": [b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"],
    "tls": [b"\x16", b"\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"],
}


@pytest.mark.parametrize("pieces", WEB_CLIENTS.values(), ids=WEB_CLIENTS.keys())
def test_a_web_page_cannot_command_the_vehicle_over_its_tcp_port(
    server: SimServer, tcp_port: int, pieces: list[bytes], caplog: pytest.LogCaptureFixture
) -> None:
    server.run(MAX_SPEED, 2.0)
    heartbeat = frame_v2(*pack("HEARTBEAT", type=6, autopilot=8, mavlink_version=3), 0, 255, 190)
    for _ in range(2):
        page = connect_client(tcp_port)
        page.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for piece in [*pieces, heartbeat]:
            with contextlib.suppress(ConnectionError):  # closed before everything was sent
                page.sendall(piece)
            server.run(MAX_SPEED, 0.02)
        assert not server.vehicles[0].transports["tcp"].connected  # type: ignore[union-attr]
        page.close()
    assert len([r for r in caplog.records if "web browser" in r.message]) == 1
    assert all(not link.parser.counts.frames for link in server.fleet.nodes[0].context.links)
    # Afterwards the port accepts a ground station, even if its first frame comes in pieces.
    station = connect_client(tcp_port)
    server.run(MAX_SPEED, 0.2)
    for piece in (heartbeat[:1], heartbeat[1:]):
        station.sendall(piece)
        server.run(MAX_SPEED, 0.2)
    assert sum(link.parser.counts.frames for link in server.fleet.nodes[0].context.links) == 1
    station.close()


def test_a_peer_that_begins_in_the_middle_of_a_frame_is_not_taken_for_a_web_client() -> None:
    assert is_web_client(b"AB \xfd") is False
    assert is_web_client(b"A" * 21) is False
    assert is_web_client(b"\x16\x04") is False
    assert is_web_client(b"GE") is None
