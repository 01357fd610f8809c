"""A flooded link takes a limited share of the event loop's time, and keeps its active peers."""

import asyncio
import socket
import time

import pytest

from gcs_server.links import udp
from gcs_server.links.channel import MAX_READ_S
from gcs_server.links.tcp import TcpServerLink
from gcs_server.links.udp import UdpLink

HANDLING_S = 0.002
"""Time that the handler of the test takes for one received piece of data."""


def run(scenario):
    asyncio.run(scenario())


@pytest.mark.parametrize("kind", ["udp", "tcp"])
def test_a_flooded_link_leaves_time_for_the_event_loop(kind):
    handler_s_by_iteration = [0.0]

    def handle_slowly(data, peer, received_s):
        time.sleep(HANDLING_S)
        handler_s_by_iteration[-1] += HANDLING_S

    async def scenario():
        loop = asyncio.get_running_loop()
        if kind == "udp":
            link = UdpLink("in", "udpin://x", "127.0.0.1", 0, outgoing=False)
        else:
            link = TcpServerLink("in", "tcpin://x", "127.0.0.1", 0)
        link.start(handle_slowly, lambda peer: None, lambda: None)
        async with asyncio.timeout(5):
            while link.local_port is None:  # noqa: ASYNC110 a test polls
                await asyncio.sleep(0.005)
        sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM)
        with sender:
            sender.connect(("127.0.0.1", link.local_port))
            for _ in range(60):  # more than the 40 pieces that are awaited
                sender.send(b"x" * 16_000)

            def begin_iteration():
                nonlocal handle
                handler_s_by_iteration.append(0.0)
                handle = loop.call_soon(begin_iteration)

            handle = loop.call_soon(begin_iteration)
            async with asyncio.timeout(10):
                while sum(handler_s_by_iteration) < 40 * HANDLING_S:  # noqa: ASYNC110
                    await asyncio.sleep(0)
            handle.cancel()
        await link.close()

    run(scenario)
    assert max(handler_s_by_iteration) <= MAX_READ_S + 2 * HANDLING_S


def test_a_flood_of_addresses_does_not_replace_active_peers(monkeypatch):
    monkeypatch.setattr(udp, "MAX_PEERS", 3)
    lost_peers, sender_names = [], []

    async def scenario():
        link = UdpLink("in", "udpin://x", "127.0.0.1", 0, outgoing=False)
        link.start(
            lambda data, peer, received_s: sender_names.append(peer.name),
            lambda p: lost_peers.append(p.name),
            lambda: None,
        )
        async with asyncio.timeout(5):
            while link.local_port is None:  # noqa: ASYNC110
                await asyncio.sleep(0.005)
        senders = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(20)]
        try:
            for sender in senders:
                sender.sendto(b"x", ("127.0.0.1", link.local_port))
            async with asyncio.timeout(5):
                while not link.info().detail:  # noqa: ASYNC110
                    await asyncio.sleep(0.005)
            assert lost_peers == []
            assert len(set(sender_names)) == len(link.info().peers) == 3
            assert "further addresses are ignored" in link.info().detail
            monkeypatch.setattr(udp, "EVICT_AFTER_S", 0.0)
            await asyncio.sleep(udp.EVICT_RETRY_S)
            senders[-1].sendto(b"x", ("127.0.0.1", link.local_port))
            async with asyncio.timeout(5):
                while not lost_peers:  # noqa: ASYNC110
                    await asyncio.sleep(0.005)
            assert len(link.info().peers) == 3, "no silent peer was replaced"
        finally:
            for sender in senders:
                sender.close()
            await link.close()

    run(scenario)
