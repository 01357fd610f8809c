"""Settings of the HTTP server that clients depend on."""

import asyncio

import httpx

from gcs_server.api.connections import Connections
from gcs_server.clock import LoopClock
from gcs_server.http_server.server import HttpServer


def test_a_client_never_reuses_a_connection_at_the_moment_when_the_server_closes_it():
    loop = asyncio.new_event_loop()
    clock = LoopClock(loop)
    loop.close()
    reused_for_s = httpx.Limits().keepalive_expiry
    assert reused_for_s is not None
    closed_after_s = HttpServer(None, Connections(clock), clock, []).config.timeout_keep_alive
    assert closed_after_s >= 2 * reused_for_s
