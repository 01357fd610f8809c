"""After an exception in the server's code, the link stays open; only one piece of received data is lost."""

import asyncio
import errno
import logging
import socket

import pytest

from gcs_server.clock import SystemClock
from gcs_server.faults import LOG_PERIOD_S, MAX_TRACEBACKS, FaultLog
from gcs_server.links.tcp import TcpServerLink
from gcs_server.links.udp import UdpLink
from gcs_server.links.url import make_link
from gcs_server.mavlink.codec import encode_frame
from gcs_server.mavlink.router import Router, RouterSettings
from gcs_server.supervise import Supervisor

ATTITUDE = 30


async def until(condition, timeout_s=10.0):
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 a test polls
            await asyncio.sleep(0.005)


class Sink:
    """A sink that raises an exception for each frame of system 66 and for each lost peer."""

    def __init__(self):
        self.systems, self.lost_peers = [], 0

    def on_frame(self, frame, _connection, _peer):
        if frame.system_id == 66:
            raise ArithmeticError("no number")
        self.systems.append(frame.system_id)

    def on_peer_gone(self, _connection, _peer):
        self.lost_peers += 1
        raise KeyError("unknown peer")


def run_with_router(scenario):
    async def run():
        clock = SystemClock()
        router = Router(clock, Supervisor(clock), RouterSettings())
        router.sink = Sink()
        try:
            await scenario(router)
        finally:
            await router.close()

    asyncio.run(run())


def frame_of(system_id, seq=0):
    return encode_frame(ATTITUDE, b"\x01" * 28, seq, system_id, 1)


def test_a_frame_that_cannot_be_handled_is_skipped_and_the_link_continues():
    async def scenario(router):
        router.add_link("udpin://127.0.0.1:0", "l")
        await until(lambda: router.links()[0].state == "open")
        port = router.connection("l").link.local_port
        vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        vehicle.connect(("127.0.0.1", port))
        vehicle.send(frame_of(66) + frame_of(1))  # the valid frame in the same datagram is handled
        await until(lambda: router.sink.systems == [1])
        for seq in range(5):
            await asyncio.sleep(0.02)
            vehicle.send(frame_of(66, seq))
        vehicle.send(frame_of(2))
        await until(lambda: router.sink.systems == [1, 2])
        info = router.links()[0]
        assert (info.state, info.handler_errors) == ("open", 6)
        ((kind, name, text),) = router.warnings()
        assert (kind, name) == ("link", "l")
        assert "6 messages" in text
        assert "ArithmeticError: no number" in text
        vehicle.close()

    run_with_router(scenario)


def test_a_failing_listener_does_not_prevent_reopening_a_link():
    async def scenario(router):
        def failing_listener(_info):
            raise RuntimeError("a listener's fault")

        router.on_change(failing_listener)
        states = []
        router.on_change(lambda info: states.append(info.state))
        server = TcpServerLink("s", "tcpin", "127.0.0.1", 0)
        server.start(lambda *_: None, lambda _: None, lambda: None)
        router.add_link(f"tcp://127.0.0.1:{server.local_port}", "c")
        await until(lambda: router.links()[0].state == "open")
        await server.close()  # the peer disconnects, and the sink raises an error
        await until(lambda: router.links()[0].state == "waiting")
        assert router.sink.lost_peers == 1
        restarted_server = TcpServerLink(
            "s", "tcpin", "127.0.0.1", int(router.links()[0].url.rpartition(":")[2])
        )
        restarted_server.start(lambda *_: None, lambda _: None, lambda: None)
        await until(lambda: router.links()[0].state == "open")
        assert "waiting" in states
        await restarted_server.close()

    run_with_router(scenario)


@pytest.mark.parametrize("kind", ["udpin", "tcp", "tcpin"])
def test_a_link_without_a_free_file_descriptor_waits_and_opens_later(kind, monkeypatch):
    async def scenario(router):
        real_socket, failures = socket.socket, []

        def fail_once(*arguments, **options):
            if arguments == (socket.AF_INET, link_socket_type) and len(failures) < 1:
                failures.append(1)
                raise OSError(errno.EMFILE, "Too many open files")
            return real_socket(*arguments, **options)

        link_socket_type = socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM
        server = real_socket(socket.AF_INET, socket.SOCK_STREAM)
        server.bind(("127.0.0.1", 0))
        server.listen()
        port = server.getsockname()[1] if kind == "tcp" else 0
        monkeypatch.setattr(socket, "socket", fail_once)
        router.add_link(f"{kind}://localhost:{port}", "l")
        await until(lambda: router.links()[0].state == "waiting")
        assert "too many files" in router.links()[0].detail
        await until(lambda: router.links()[0].state == "open")
        server.close()

    run_with_router(scenario)


def test_a_tcp_server_link_without_file_descriptors_pauses_and_accepts_clients_later(monkeypatch):
    monkeypatch.setattr("gcs_server.links.tcp.ACCEPT_AGAIN_AFTER_S", 0.1)

    async def scenario():
        link = TcpServerLink("s", "tcpin", "127.0.0.1", 0)
        received_data, accept_calls = [], []
        link.start(lambda data, *_: received_data.append(data), lambda _: None, lambda: None)
        real_socket = link._socket

        class SocketWithoutDescriptors:
            def accept(self):
                accept_calls.append(1)
                if len(accept_calls) < 3:
                    raise OSError(errno.EMFILE, "Too many open files")
                return real_socket.accept()

            def __getattr__(self, name):
                return getattr(real_socket, name)

        link._socket = SocketWithoutDescriptors()
        client = socket.create_connection(("127.0.0.1", real_socket.getsockname()[1]))
        client.send(frame_of(1))
        await until(lambda: received_data)
        assert len(accept_calls) == 3, "accept was called repeatedly during the pause"
        client.close()
        await link.close()

    asyncio.run(scenario())


def test_a_udp_link_continues_to_receive_after_an_exception():
    async def scenario():
        link, received_data = make_link("udpin://127.0.0.1:0"), []
        link.start(lambda data, *_: received_data.append(data), lambda _: None, lambda: None)
        real_new_peer, faults = UdpLink._new_peer, []

        def new_peer(self, address):
            if not faults:
                faults.append(1)
                raise LookupError("once")
            return real_new_peer(self, address)

        link._new_peer = new_peer.__get__(link)
        vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        vehicle.connect(("127.0.0.1", link.local_port))
        vehicle.send(b"lost by the fault")
        await until(lambda: link.info().handler_errors == 1)
        vehicle.send(b"after the fault")
        await until(lambda: received_data == [b"after the fault"])
        vehicle.close()
        await link.close()

    asyncio.run(scenario())


def test_the_log_of_repeated_faults_is_limited(caplog, monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr("gcs_server.faults.time.monotonic", lambda: now_s[0])
    faults = FaultLog("link x")
    with caplog.at_level(logging.WARNING):
        for number in range(1000):
            try:
                raise ValueError(f"{number} " * 200)
            except ValueError as error:
                faults.add(error, "handling HEARTBEAT")
        assert len(caplog.records) == 2, "the log is not one traceback and one line"
        now_s[0] += LOG_PERIOD_S
        for number in range(100):
            try:
                raise ValueError(number)
            except ValueError as error:
                faults.add(error, f"handling message {number}")
    assert len(caplog.records) <= 2 + MAX_TRACEBACKS + 1
    assert faults.count == 1100
    assert max(len(r.getMessage()) for r in caplog.records) < 400
