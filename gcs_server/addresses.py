"""URLs of the page for browsers, computed from the address that the server is bound to."""

from __future__ import annotations

import ipaddress
import socket
from pathlib import Path
from urllib.parse import quote

WILDCARD_HOSTS = frozenset({"0.0.0.0", "::", "::0"})
_ROUTE_TARGETS = (
    (socket.AF_INET, "192.0.2.1"),
    (socket.AF_INET6, "2001:db8::1"),
)
"""Addresses reserved for documentation (RFC 5737 and 3849), used only to look up the route to them; nothing
is sent."""


def page_urls(
    host: str,
    port: int,
    token: str | None,
    computer_addresses: list[str] | None = None,
    *,
    in_container: bool | None = None,
) -> list[str]:
    """URLs of the page; a URL with `localhost` is the first.

    Args:
        host: address that the server is bound to.
        token: added to the URLs; None if no token is required.
        computer_addresses: this computer's addresses; default: detected.
        in_container: whether this process runs in a container, whose addresses cannot be reached from
            outside; default: detected.
    """
    hosts = [host]
    if host in WILDCARD_HOSTS:
        hosts = ["localhost"]
        if not (_runs_in_container() if in_container is None else in_container):
            hosts += detect_addresses() if computer_addresses is None else computer_addresses
    elif _is_loopback(host):
        hosts = ["localhost" if host == "127.0.0.1" else host]
    query = f"/?token={quote(token, safe='')}" if token is not None else ""
    return [f"http://{f'[{host}]' if ':' in host else host}:{port}{query}" for host in hosts]


def _runs_in_container() -> bool:
    return Path("/.dockerenv").exists() or Path("/run/.containerenv").exists()


def detect_addresses() -> list[str]:
    """This computer's address on each default route."""
    addresses: list[str] = []
    for address_family, target in _ROUTE_TARGETS:
        try:
            # Connecting a datagram socket sends nothing: it only looks up the route.
            with socket.socket(address_family, socket.SOCK_DGRAM) as probe:
                probe.connect((target, 9))
                addresses.append(str(probe.getsockname()[0]))
        except OSError:
            continue
    return [address for address in dict.fromkeys(addresses) if not _is_loopback(address)]


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
