"""Parses `Origin` and `Host` headers; an invalid origin matches no host.

Pure functions on text; used by `api/access.py` for all requests, and by `scene/proxy.py` for the 3D view.
"""

from __future__ import annotations

import ipaddress
import re

from starlette.datastructures import Headers

_HOST = re.compile(r"(?P<name>[a-z0-9_.-]{1,253}|\[[0-9a-f:.]{2,45}\])(?::[0-9]{1,5})?")
_DEFAULT_PORTS = {"http": ":80", "https": ":443"}


def host_name(host: str) -> str | None:
    """A Host header without its port, in lower case; None if it is not a host."""
    match = _HOST.fullmatch(host.lower())
    return match["name"] if match else None


def is_loopback(name: str) -> bool:
    """Whether a host name always means this computer: `localhost`, or a loopback address."""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name.strip("[]")).is_loopback
    except ValueError:
        return False


def same_origin(origin: str, host: str, *, secure: bool = False) -> bool:
    """Whether a page with this origin was served by this host. Port mappings do not matter, because a browser
    sends both headers with the address that it uses.

    Args:
        origin: the Origin header; "null" (sandboxed frames and files) is never the same.
        host: the Host header of the same request.
        secure: whether the request used https; the page must then have used https, too.
    """
    scheme, separator, origin_host = origin.lower().partition("://")
    if not separator or scheme not in _DEFAULT_PORTS or (secure and scheme != "https"):
        return False
    default_port = _DEFAULT_PORTS[scheme]
    host_without_default = host.lower().removesuffix(default_port)
    return bool(origin_host) and origin_host.removesuffix(default_port) == host_without_default


def is_same_origin(headers: Headers) -> bool:
    """Whether the requesting page belongs to this server. True without an Origin header, because only
    browsers send it."""
    origin = headers.get("origin")
    return origin is None or same_origin(origin, headers.get("host", ""))


def bearer_token(authorization: str) -> str | None:
    """The token in a header `Authorization`; None: it has none."""
    scheme, _, token = authorization.partition(" ")
    return token.strip() if scheme.lower() == "bearer" else None
