"""The server detects by the first bytes that a web page has connected to a TCP link, and disconnects the page
before a frame is read."""

import asyncio
import logging
import socket
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.clock import SystemClock
from gcs_server.links.tcp import (
    LOG_INTERVAL_S,
    SHOWN_FOR_S,
    ClosedConnections,
    FirstBytes,
    ForeignProtocol,
    foreign_protocol,
)
from gcs_server.links.url import make_link
from gcs_server.mavlink.codec import encode_frame
from gcs_server.mavlink.router import Router, RouterSettings
from gcs_server.supervise import Supervisor

HEARTBEAT = encode_frame(0, bytes(9), 0, 1, 1)
WEB_CLIENTS = {
    "post": [b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 40\r\n\r\n" + HEARTBEAT],
    "in pieces": [b"PO", b"ST / HTTP/1.1\r\n\r\n" + HEARTBEAT],
    "letter by letter": [*(bytes([letter]) for letter in b"OPTIONS * HTTP/1.1\r\n\r\n"), HEARTBEAT],
    "http 2": [b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + HEARTBEAT],
    "tls": [b"\x16", b"\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + HEARTBEAT],
}
"""For each web client: the pieces of data that it sends."""


async def until(condition, timeout_s=10.0):
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 a test polls
            await asyncio.sleep(0.005)


@pytest.mark.parametrize("pieces", WEB_CLIENTS.values(), ids=WEB_CLIENTS.keys())
def test_a_web_page_that_connects_by_tcp_is_disconnected_before_a_frame_is_read(pieces):
    async def scenario():
        clock = SystemClock()
        router = Router(clock, Supervisor(clock), RouterSettings())
        router.add(link := make_link("tcpin://127.0.0.1:0", "radio"))
        frames = []
        router.sink.on_frame = lambda frame, _connection, _peer: frames.append(frame)
        await until(lambda: link.info().state == "open")
        loop = asyncio.get_running_loop()
        address = ("127.0.0.1", link.local_port)
        with socket.socket() as page, socket.socket() as vehicle:
            for sock in (page, vehicle):
                sock.setblocking(False)
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                await loop.sock_connect(sock, address)
            try:
                for piece in pieces:
                    await loop.sock_sendall(page, piece)
                    await asyncio.sleep(0.01)
            except ConnectionError:
                pass  # closed before everything was sent
            await until(lambda: len(link.peers()) == 1)
            assert not frames
            info = router.links()[0]
            assert (info.state, info.frames_received, info.bytes_received) == ("open", 0, 0)
            assert "used" in info.detail
            assert "127.0.0.1" in info.detail
            assert ("link", "radio", info.detail) in router.warnings()
            await loop.sock_sendall(vehicle, HEARTBEAT[:1])
            await loop.sock_sendall(vehicle, HEARTBEAT[1:])
            await until(lambda: len(frames) == 1)
        await router.close()

    asyncio.run(scenario())


def test_a_tcp_link_to_a_web_server_reports_http_and_waits_before_the_next_attempt():
    async def scenario():
        received = []

        async def reply(_reader, writer):
            writer.write(b"HTTP/1.1 400 Bad Request\r\n\r\n" + HEARTBEAT)
            await writer.drain()

        server = await asyncio.start_server(reply, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        link = make_link(f"tcp://127.0.0.1:{port}")
        link.start(lambda data, _peer, _s: received.append(data), lambda _peer: None, lambda: None)
        await until(lambda: link.info().state == "waiting")
        assert "speaks HTTP, not MAVLink" in link.info().detail
        assert not received
        await link.close()
        server.close()

    asyncio.run(scenario())


@given(st.binary(min_size=1, max_size=60), st.lists(st.integers(1, 59), max_size=6))
def test_mavlink_bytes_pass_unchanged_in_any_pieces(data, cuts):
    data = bytes([0xFD]) + data
    edges = [0, *sorted({cut for cut in cuts if cut < len(data)}), len(data)]
    checker = FirstBytes()
    pieces = [data[a:b] for a, b in pairwise(edges)]
    assert b"".join(checker.accept(piece) for piece in pieces) == data


@given(st.from_regex(rb"[A-Z]{3,20} .{0,40}", fullmatch=True), st.lists(st.integers(1, 30), max_size=6))
def test_a_request_line_is_detected_in_any_pieces_and_not_passed_on(data, cuts):
    edges = [0, *sorted({cut for cut in cuts if cut < len(data)}), len(data)]
    checker, passed_on = FirstBytes(), b""
    with pytest.raises(ForeignProtocol, match="HTTP"):
        for a, b in pairwise(edges):
            passed_on += checker.accept(data[a:b])
    assert passed_on == b""


def test_bytes_from_the_middle_of_a_frame_are_not_taken_for_a_web_client():
    for first_bytes in (b"AB \xfd", b"A" * 24, b"\x16\x04", b"\xfe", b"\x00", b"HTTQ/1"):
        assert foreign_protocol(first_bytes) is None, first_bytes


def test_repeated_connections_of_a_page_are_logged_at_a_limited_rate_and_shown_for_a_limited_time(caplog):
    caplog.set_level(logging.WARNING)
    closed_connections = ClosedConnections("radio")
    for n in range(1000):
        closed_connections.add("127.0.0.1", "HTTP", n * LOG_INTERVAL_S / 500)
    assert len(caplog.records) == 2
    assert "1000 connections" in closed_connections.text(2 * LOG_INTERVAL_S)
    assert closed_connections.text(2 * LOG_INTERVAL_S + SHOWN_FOR_S) == ""
