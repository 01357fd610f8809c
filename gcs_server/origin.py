"""Whose page asks, and under which name we were asked: `Origin` and `Host`, read so that garbage is foreign.

Pure text; `api/access.py` decides by it for everything, `scene/proxy.py` once more for the 3D view.
"""

from __future__ import annotations

import ipaddress
import re

from starlette.datastructures import Headers

_HOST = re.compile(r"(?P<name>[a-z0-9_.-]{1,253}|\[[0-9a-f:.]{2,45}\])(?::[0-9]{1,5})?")
_DEFAULT_PORTS = {"http": ":80", "https": ":443"}


def host_name(host: str) -> str | None:
    """A Host header without its port, in lower case; None for what is no host."""
    found = _HOST.fullmatch(host.lower())
    return found["name"] if found else None


def is_loopback(name: str) -> bool:
    """Whether a host's name can only mean this machine: `localhost`, or an address that no DNS can turn."""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name.strip("[]")).is_loopback
    except ValueError:
        return False


def same_origin(origin: str, host: str, *, secure: bool = False) -> bool:
    """Whether a page of `origin` was served under `host`, behind any port mapping and name.

    Args:
        origin: the Origin header; "null" is that of sandboxed frames and files, and never ours.
        host: the Host header of the same request.
        secure: the request came by https: then the page must have, too.
    """
    scheme, mark, asking = origin.lower().partition("://")
    if not mark or scheme not in _DEFAULT_PORTS or (secure and scheme != "https"):
        return False
    default = _DEFAULT_PORTS[scheme]
    return bool(asking) and asking.removesuffix(default) == host.lower().removesuffix(default)


def is_same_origin(headers: Headers) -> bool:
    """True where the page that asks is one of ours (or it is no page: no browser leaves Origin out)."""
    origin = headers.get("origin")
    return origin is None or same_origin(origin, headers.get("host", ""))
