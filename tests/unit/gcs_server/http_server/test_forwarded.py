"""X-Forwarded headers are used only from trusted proxies; otherwise the client's address is the address of
the connection's peer."""

import asyncio

import pytest

from gcs_server.api.connections import Connections
from gcs_server.clock import SystemClock
from gcs_server.http_server.server import HttpServer


def address_in_application(trusted_proxies, peer_address):
    """(address, scheme) that the application gets."""
    received_scope = {}

    async def app(scope, receive, send):
        received_scope.update(scope)

    clock = SystemClock()
    connections = Connections(clock, in_control=lambda key: False)
    config = HttpServer(app, connections, clock, (), trusted_proxies).config
    config.load()
    headers = [(b"x-forwarded-for", b"10.9.9.9"), (b"x-forwarded-proto", b"https")]
    scope = {"type": "http", "client": (peer_address, 50000), "scheme": "http", "headers": headers}
    asyncio.run(config.loaded_app(scope, None, None))
    return received_scope["client"][0], received_scope["scheme"]


@pytest.mark.parametrize(
    ("trusted_proxies", "peer_address", "address", "scheme"),
    [
        ((), "127.0.0.1", "127.0.0.1", "http"),
        (("192.168.1.5",), "127.0.0.1", "127.0.0.1", "http"),
        (("127.0.0.1",), "127.0.0.1", "10.9.9.9", "https"),
    ],
)
def test_a_forwarded_address_is_used_only_from_a_trusted_proxy(
    trusted_proxies, peer_address, address, scheme
):
    assert address_in_application(trusted_proxies, peer_address) == (address, scheme)
