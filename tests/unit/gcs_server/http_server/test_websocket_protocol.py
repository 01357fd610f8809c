"""Limits of WebSockets, without sockets: of received frames, of message size, and of unread data."""

import asyncio
import base64
import time

import pytest

from gcs_server.api.refusals import UNREAD_DEADLINE_S
from gcs_server.http_server.websocket_protocol import CLOSE_DEADLINE_S, MAX_FRAMES, MAX_FRAMES_PER_S
from tests.e2e.attacks import websocket_frame
from tests.unit.gcs_server.http_server.memory_server import respond_with_size, run_with_server

CONTINUATION, TEXT, BINARY, PING, PONG = 0, 1, 2, 9, 10
"""Opcodes of WebSocket frames."""
UPGRADE = (
    b"GET /x HTTP/1.1\r\nHost: a\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: " + base64.b64encode(b"0123456789abcdef") + b"\r\n\r\n"
)


async def open_websocket(server):
    transport = server.connect()
    await server.send(transport, UPGRADE)
    head, _, transport.written = transport.written.partition(b"\r\n\r\n")
    assert b" 101 " in head
    return transport


def close_frame(transport):
    """(code, reason) of the close frame at the end of the written bytes."""
    start = transport.written.rindex(b"\x88")
    size = transport.written[start + 1]
    payload = transport.written[start + 2 :]
    assert len(payload) == size
    return int.from_bytes(payload[:2], "big"), payload[2:].decode()


@pytest.mark.parametrize("opcode", [TEXT, BINARY, PING, PONG])
def test_a_flood_of_empty_frames_is_parsed_in_pieces_and_closes_the_connection(opcode):
    async def scenario(server):
        transport = await open_websocket(server)
        longest_iteration_s, finished = 0.0, False

        async def measure_iterations():
            nonlocal longest_iteration_s
            while not finished:
                began_s = time.thread_time()
                await asyncio.sleep(0)
                longest_iteration_s = max(longest_iteration_s, time.thread_time() - began_s)

        measurement = asyncio.ensure_future(measure_iterations())
        await server.send(transport, websocket_frame(b"", opcode) * 42_000)
        finished = True
        await measurement
        assert close_frame(transport) == (1008, f"more than {MAX_FRAMES_PER_S} frames in a second")
        assert longest_iteration_s < 0.3, "all frames were parsed in one piece"
        await asyncio.sleep(0.1)
        assert len(server.connections) == 0

    run_with_server(scenario)


def test_the_application_gets_every_message_in_order():
    received_texts = []

    async def receiving_app(scope, receive, send):
        await receive()
        await send({"type": "websocket.accept"})
        while (message := await receive())["type"] == "websocket.receive":
            received_texts.append(message["text"])
            await asyncio.sleep(0)

    async def scenario(server):
        transport = await open_websocket(server)
        texts = [f"{n} " + "x" * (n * 37 % 9000) for n in range(300)]
        await server.send(transport, b"".join(websocket_frame(text.encode()) for text in texts), 10_000)
        await asyncio.sleep(1)
        assert received_texts == texts

    run_with_server(scenario, receiving_app)


def test_while_the_application_is_busy_nothing_more_is_read_or_parsed():
    async def blocked_app(scope, receive, send):
        await receive()
        await send({"type": "websocket.accept"})
        await asyncio.Event().wait()

    async def scenario(server):
        transport = await open_websocket(server)
        received_bytes = await server.send(transport, websocket_frame(b"x" * 1000) * 3000)
        assert received_bytes <= 262_144
        assert transport.reading_paused
        assert transport.protocol.queue.qsize() <= 3

    run_with_server(scenario, blocked_app)


def test_reading_pauses_only_while_a_message_waits_behind_an_unread_one():
    async def scenario(server):
        transport, pauses = await open_websocket(server), []
        transport.pause_reading = lambda: pauses.append(1)
        for _ in range(5):
            await server.send(transport, websocket_frame(b"x"))
        assert not pauses
        for _ in range(2):
            transport.protocol.data_received(websocket_frame(b"x"))
        assert pauses

    run_with_server(scenario)


def test_a_message_of_too_many_frames_closes_the_connection():
    async def scenario(server):
        transport = await open_websocket(server)
        message_frames = (
            websocket_frame(b"x", TEXT, final=False) + websocket_frame(b"", CONTINUATION, final=False) * 2000
        )
        await server.send(transport, message_frames)
        assert close_frame(transport) == (1009, f"a message of more than {MAX_FRAMES} frames")

    run_with_server(scenario)


def test_a_too_large_message_closes_the_connection_before_it_is_complete():
    async def scenario(server):
        transport = await open_websocket(server)
        received_bytes = await server.send(transport, websocket_frame(b"x" * 3_000_000))
        assert received_bytes < 300_000
        assert close_frame(transport)[0] == 1009

    run_with_server(scenario)


def test_unread_pongs_are_limited():
    async def scenario(server):
        transport = await open_websocket(server)
        transport.client_reads = False
        for _ in range(20):
            await server.send(transport, websocket_frame(b"x" * 125, PING) * 900)
            await server.wait(1)
        assert len(transport.unread) < 70_000

    run_with_server(scenario)


def test_a_client_that_reads_nothing_gets_a_close_frame_and_is_then_disconnected():
    async def sending_app(scope, receive, send):
        await receive()
        await send({"type": "websocket.accept"})
        while True:
            await send({"type": "websocket.send", "text": "text " * 1000})
            await asyncio.sleep(0.01)

    async def scenario(server):
        transport = await open_websocket(server)
        transport.client_reads = False
        await asyncio.sleep(0.1)
        unread_bytes = len(transport.unread)
        await server.wait(UNREAD_DEADLINE_S + 1)
        assert len(transport.unread) < unread_bytes + 100
        transport.written = transport.unread
        assert close_frame(transport) == (1013, f"nothing was read for {UNREAD_DEADLINE_S:g} s")
        assert not transport.aborted
        await server.wait(CLOSE_DEADLINE_S + 1)
        await asyncio.sleep(0.1)
        assert transport.aborted
        assert len(server.connections) == 0

    run_with_server(scenario, sending_app)


def test_an_open_websocket_without_messages_stays_open():
    async def scenario(server):
        transport = await open_websocket(server)
        for _ in range(10):
            await server.wait(15)
            # A ping of the server has four bytes of payload.
            pings = transport.written.count(b"\x89\x04")
            payload = transport.written[transport.written.rindex(b"\x89\x04") + 2 :][:4] if pings else b""
            await server.send(transport, websocket_frame(payload, PONG))
        assert not transport.closed

    run_with_server(scenario, respond_with_size)


@pytest.mark.parametrize(
    "early_data",
    [
        websocket_frame(b"early"),
        b"\xff" * 5000,
        websocket_frame(b"x", CONTINUATION),
        websocket_frame(b"x" * 3_000_000),
    ],
)
@pytest.mark.parametrize("disconnects", [False, True])
def test_data_received_before_the_accept_is_kept_and_causes_no_log_line(early_data, disconnects, caplog):
    received_messages = []

    async def slow_app(scope, receive, send):
        await receive()
        await asyncio.sleep(1)
        await send({"type": "websocket.accept"})
        received_messages.append(await receive())

    async def scenario(server):
        transport = server.connect()
        await server.send(transport, UPGRADE)
        await server.send(transport, early_data)
        if disconnects:
            transport.abort()
        await asyncio.sleep(2)
        assert disconnects or b" 101 " in transport.written
        assert len(server.connections) == 0

    run_with_server(scenario, slow_app)
    assert caplog.records == []
    if not disconnects:
        message = received_messages[0]
        assert message.get("text") == "early" or message["type"] == "websocket.disconnect"
