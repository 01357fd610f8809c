"""Limits of HTTP connections, without sockets: a request beyond a limit gets one refusal and a closed
connection."""

import asyncio
import gc
import json
import logging
import os
import random
import tracemalloc

import pytest

from gcs_server.api import refusals
from gcs_server.http_server.http_protocol import LINGER_BYTES, LINGER_S, MAX_CHUNKS
from tests.unit.gcs_server.http_server.memory_server import respond_with_size, run_with_server

GET = b"GET /x HTTP/1.1\r\nHost: a\r\n"
POST = b"POST /x HTTP/1.1\r\nHost: a\r\n"


def refusal(transport):
    """(status, code) of the only response, which closes the connection."""
    head, _, body = transport.written.partition(b"\r\n\r\n")
    assert transport.written.count(b"HTTP/1.1 ") == 1
    assert b"content-type: application/problem+json" in head
    assert b"connection: close" in head
    assert transport.eof_written
    problem = json.loads(body)
    assert problem["detail"]
    assert problem["remedy"]
    return int(head.split()[1]), problem["code"]


TOO_LARGE_REQUESTS = {
    "a header without end": (GET + b"x: ", b"a", 431),
    "headers without end": (GET, b"x: y\r\n", 431),
    "the name of a header without end": (GET, b"a", 431),
    "a URL without end": (b"GET /", b"a", 414),
    "a body with its length": (POST + b"Content-Length: 10000000\r\n\r\n", b"a", 413),
    "a body in chunks": (
        POST + b"Transfer-Encoding: chunked\r\n\r\n",
        b"10000\r\n" + b"a" * 65536 + b"\r\n",
        413,
    ),
    "a body in tiny chunks": (POST + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\na\r\n", 413),
    "an extension of a chunk": (POST + b"Transfer-Encoding: chunked\r\n\r\n1;", b"a", 413),
    "trailers": (POST + b"Transfer-Encoding: chunked\r\n\r\n0\r\n", b"x: y\r\n", 431),
    "a trailer without end": (POST + b"Transfer-Encoding: chunked\r\n\r\n0\r\nx: ", b"a", 413),
    "bytes of another protocol (TLS)": (b"\x16\x03\x01\x02\x00\x01", b"\xfc\x03", 400),
}
"""For each request: its start, the bytes that are then repeated, and the status of the refusal."""


@pytest.mark.parametrize("name", TOO_LARGE_REQUESTS)
@pytest.mark.parametrize("piece_bytes", [1460, 262_144])
def test_too_large_requests_are_refused_with_a_reason_and_not_stored(name, piece_bytes):
    start, repeated, status = TOO_LARGE_REQUESTS[name]

    async def scenario(server):
        transport = server.connect()
        request = start + repeated * (8_000_000 // len(repeated))
        received_bytes = await server.send(transport, request, piece_bytes)
        assert refusal(transport)[0] == status
        assert received_bytes <= refusals.MAX_BODY_BYTES + LINGER_BYTES + 1_000_000
        assert transport.aborted
        await asyncio.sleep(0.1)
        assert len(server.connections) == 0

    run_with_server(scenario)


def test_requests_within_the_limits_are_served_for_any_size_of_the_received_pieces():
    body = b"a" * refusals.MAX_BODY_BYTES
    request = POST + b"x: " + b"y" * 30_000 + b"\r\nContent-Length: %d\r\n\r\n" % len(body) + body
    chunked_request = (
        POST
        + b"Transfer-Encoding: chunked\r\n\r\n"
        + b"".join(b"400\r\n" + b"a" * 1024 + b"\r\n" for _ in range(1000))
    )
    chunked_request += b"0\r\n\r\n"

    async def scenario(server):
        rng = random.Random(3)
        for piece_bytes in (100_000, 262_144, 1460, rng.randrange(5000, 9000)):
            transport = server.connect()
            await server.send(transport, (request + chunked_request) * 2 + GET + b"\r\n", piece_bytes)
            assert transport.written.count(b"1048576 bytes") == 2
            assert transport.written.count(b"1024000 bytes") == 2
            assert transport.written.endswith(b"0 bytes")
            assert not transport.closed

    run_with_server(scenario)


def test_incomplete_headers_get_status_408_and_connections_that_send_nothing_are_closed():
    async def scenario(server):
        silent, incomplete, one_byte_per_s, empty_lines = (server.connect() for _ in range(4))
        await server.send(incomplete, GET)
        for _ in range(int(refusals.HEAD_DEADLINE_S) + 1):
            await server.send(one_byte_per_s, b"x")
            await server.send(empty_lines, b"\r\n")
            await server.wait(1.0)
        assert silent.closed
        assert silent.written == b""
        assert refusal(incomplete) == (408, "too_slow")
        assert one_byte_per_s.closed or one_byte_per_s.eof_written
        assert empty_lines.closed
        await server.wait(LINGER_S + 1)
        assert len(server.connections) == 0

    run_with_server(scenario)


def test_an_incomplete_body_gets_status_408_and_the_application_gets_a_disconnect():
    received_types = []

    async def receiving_app(scope, receive, send):
        while True:
            message = await receive()
            received_types.append(message["type"])
            if message["type"] == "http.disconnect":
                return

    async def scenario(server):
        transport = server.connect()
        await server.send(transport, POST + b"Content-Length: 100\r\n\r\nabc")
        await server.wait(refusals.BODY_DEADLINE_S - 1)
        assert transport.written == b""
        await server.wait(2)
        assert refusal(transport) == (408, "too_slow")
        assert received_types == ["http.request", "http.disconnect"]

    run_with_server(scenario, receiving_app)


def test_a_slow_response_is_not_interrupted():
    async def slow_app(scope, receive, send):
        await asyncio.sleep(60)
        await respond_with_size(scope, receive, send)

    async def scenario(server):
        transport = server.connect()
        await server.send(transport, GET + b"\r\n")
        await server.wait(61)
        assert transport.written.endswith(b"0 bytes")

    run_with_server(scenario, slow_app)


def test_too_many_pipelined_requests_close_the_connection():
    async def blocked_app(scope, receive, send):
        await asyncio.Event().wait()

    async def scenario(server):
        transport = server.connect()
        await server.send(transport, (GET + b"\r\n") * 10_000)
        assert transport.written == b"", (
            "the client would take a refusal for the response to its first request"
        )
        assert transport.eof_written
        await server.wait(LINGER_S + 1)
        assert len(server.connections) == 0

    run_with_server(scenario, blocked_app)


def test_a_connection_with_an_unread_response_is_closed_at_the_deadline():
    async def scenario(server):
        not_reading, slow = server.connect(), server.connect()
        for transport in (not_reading, slow):
            transport.client_reads = False
            await server.send(transport, GET + b"\r\n")
        for _ in range(int(refusals.UNREAD_DEADLINE_S) + 2):
            slow.unread = slow.unread[1:]  # the client reads one byte per second
            await server.wait(1)
        assert not_reading.aborted
        assert not slow.closed, "a client that reads slowly was disconnected"

    run_with_server(scenario)


def test_the_total_size_of_bodies_is_limited():
    async def scenario(server):
        transports = [server.connect() for _ in range(60)]
        for transport in transports:
            await server.send(transport, POST + b"Content-Length: 1000000\r\n\r\n" + b"a" * 900_000)
        refused_transports = [t for t in transports if t.written]
        assert {refusal(t) for t in refused_transports} == {(503, "server_full")}
        assert 60 - len(refused_transports) == server.connections.limits.body_bytes // 900_000

    run_with_server(scenario)


@pytest.mark.parametrize("ends", ["refused by the application", "closed by the client"])
def test_a_body_that_nobody_read_is_not_kept_after_its_request(ends):
    async def refuse_unread(_, receive, send):
        if ends == "closed by the client":
            await asyncio.sleep(60)
        await send({"type": "http.response.start", "status": 429, "headers": [(b"content-length", b"0")]})
        await send({"type": "http.response.body", "body": b""})

    async def scenario(server):
        gc.disable()  # protocol and request refer to each other: only the collector would free them
        tracemalloc.start()
        try:
            for _ in range(20):
                transport = server.connect()
                await server.send(transport, POST + b"Content-Length: 900000\r\n\r\n" + b"a" * 250_000)
                transport.abort()
                await asyncio.sleep(100)
            assert tracemalloc.get_traced_memory()[0] < 2_000_000
        finally:
            tracemalloc.stop()
            gc.enable()

    run_with_server(scenario, refuse_unread)


def test_malformed_requests_are_not_logged(caplog):
    rng = random.Random(7)

    async def scenario(server):
        for _ in range(300):
            transport = server.connect()
            line = rng.choice(
                [b"GET / HTTP/1.1\r\n", b"GET http://[ HTTP/1.1\r\n", b"GET ? HTTP/1.1\r\n", b""]
            )
            await server.send(transport, line + os.urandom(rng.randrange(1, 200)) + b"\r\n\r\n")
            await server.wait(0.5)
        await server.wait(60)
        assert len(server.connections) == 0

    with caplog.at_level(logging.WARNING):
        run_with_server(scenario)
    assert caplog.records == []


def test_a_requested_protocol_upgrade_is_ignored_and_the_request_answered():
    async def scenario(server):
        transport = server.connect()
        await server.send(transport, GET + b"Connection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\n\r\n")
        assert transport.written.endswith(b"0 bytes")

    run_with_server(scenario)


def test_the_limit_of_chunks_allows_every_valid_body():
    average_chunk_bytes = refusals.MAX_BODY_BYTES / MAX_CHUNKS
    assert average_chunk_bytes <= 256
