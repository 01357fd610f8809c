"""Settings of the HTTP server that clients depend on."""

import asyncio

import httpx

from gcs_server.api.connections import Connections
from gcs_server.clock import LoopClock
from gcs_server.http_server.server import HttpServer


def test_the_server_keeps_idle_connections_longer_than_clients_reuse_them():
    loop = asyncio.new_event_loop()
    clock = LoopClock(loop)
    loop.close()
    clients_reuse_for_s = httpx.Limits().keepalive_expiry
    assert clients_reuse_for_s is not None
    server_closes_after_s = HttpServer(None, Connections(clock), clock, []).config.timeout_keep_alive
    assert server_closes_after_s >= 2 * clients_reuse_for_s
