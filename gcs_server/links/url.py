"""The grammar of link URLs.

    udpin://127.0.0.1:14550            listens; the host defaults to 127.0.0.1
    udpout://127.0.0.1:14580           sends first
    tcp://127.0.0.1:5760               client
    tcpin://127.0.0.1:5790             listens
    serial:///dev/ttyACM0?baud=57600   or serial:/dev/ttyACM0:57600
    tlog:///path/to/flight.tlog?speed=1    speed=0: as fast as possible
    ros2://0/px4_1                     a DDS domain (docs/links.md)

With `guard=ask` (or `free`, `read`), on any link except a recording, programs are connected over the link, to
which this server is their vehicle; its options are `vehicle`, `client`, `valid_for_s`, `same_for_s` and
`on_expiry` (docs/how-to-guard-a-program.md).

With `forward=1`, on any link except a recording, the link leads to another ground station: messages are
forwarded between that station and the vehicles. With `key=NAME`, on any link except a recording, sent frames
are signed and received frames are checked with that key (docs/links.md). `signing=required` (the default)
refuses unsigned frames, `signing=allowed` accepts them. With `simulated=1` the operator says that only
simulated vehicles are connected over the link, which agents may then fly
(docs/how-to-give-an-agent-a-simulator.md).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from urllib.parse import SplitResult, parse_qs, unquote, urlsplit

from gcs_server.errors import InvalidRequest
from gcs_server.links.base import GuardOptions, Link, SigningOptions
from gcs_server.links.names import checked_host, checked_key_name, checked_name, checked_path, derived_name
from gcs_server.links.serial import DEFAULT_BAUD, SerialLink
from gcs_server.links.tcp import TcpLink, TcpServerLink
from gcs_server.links.udp import UdpLink

LOOPBACK = "127.0.0.1"
GUARD_OPTIONS = frozenset({"guard", "vehicle", "client", "valid_for_s", "on_expiry", "same_for_s"})
LIVE_OPTIONS = frozenset({"forward", "key", "signing", "simulated"}) | GUARD_OPTIONS
"""Options of all links except recordings."""
GUARD_CONTROL = ("ask", "free", "read")
GUARD_ACTIONS = ("hold", "land", "stop_stream")
MAX_NAME_LENGTH = 32
MIN_VALID_S, MAX_VALID_S = 0.1, 10.0
"""Limits of `valid_for_s` of a guarded link [s]."""
KINDS = ("udpin", "udpout", "tcp", "tcpin", "serial")
LinkMaker = Callable[[str, str | None, SplitResult, dict[str, str]], Link]
"""(URL, name of the link, parts of the URL, options of the URL) → link. Raises the errors of `make_link`."""
NO_OTHER_KINDS: Mapping[str, LinkMaker] = {}
REMEDY = "Examples: udpin://127.0.0.1:14550, tcp://127.0.0.1:5760, serial:///dev/ttyACM0?baud=57600."


def make_link(
    url: str, name: str | None = None, other_kinds: Mapping[str, LinkMaker] = NO_OTHER_KINDS
) -> Link:
    """Creates the link of a URL, without starting it.

    Args:
        url: a link URL.
        name: name of the link; None: derived from the URL.
        other_kinds: functions that create further kinds of links (recordings, ROS 2), by URL scheme.

    Raises:
        InvalidRequest: the URL or the name is not valid.
        LinkError: a file that the link reads does not exist, or software that it needs is missing.
    """
    for key_name in re.findall(r"[?&]key=([^&#]*)", url, re.IGNORECASE):
        # Checked first: the other errors contain the whole URL, and a secret key that was given instead of
        # its name must not be shown.
        checked_key_name(unquote(key_name))
    link = _link(url, name, other_kinds)
    link.signing = _signing(url)
    link.guard = _guard(url, link)
    link.simulated = _parse_flag(url, "simulated", _options(urlsplit(url).query).get("simulated", "0"))
    return link


def _link(url: str, name: str | None, other_kinds: Mapping[str, LinkMaker]) -> Link:
    if name is not None:
        checked_name(name)
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise InvalidRequest("url", f"{url!r} is not a link: {error}.", remedy=REMEDY) from None
    kind = parts.scheme
    options = _options(parts.query)
    if kind in other_kinds:
        return other_kinds[kind](url, name, parts, options)
    if kind not in KINDS:
        kinds = ", ".join((*KINDS, *other_kinds))
        raise InvalidRequest(
            "url", f"{url!r} is not a link: it must begin with one of {kinds}.", remedy=REMEDY
        )
    allowed = {"baud", *LIVE_OPTIONS} if kind == "serial" else LIVE_OPTIONS
    for key in options.keys() - allowed:
        raise InvalidRequest("url", f"{url!r}: {kind} links have no option {key!r}.", remedy=REMEDY)
    forward = _parse_flag(url, "forward", options.get("forward", "0"))
    if kind == "serial":
        if not parts.path.startswith("/"):
            raise InvalidRequest("url", f"{url!r} has no device.", remedy=REMEDY)
        device, baud_text = checked_path(url, unquote(parts.path)), str(DEFAULT_BAUD)
        after_colon = re.fullmatch(r"(.+):(\d{4,})", device)
        if after_colon is not None:
            device, baud_text = after_colon.groups()
        baud = parsed_number(url, "baud", options.get("baud", baud_text))
        if not 1200 <= baud <= 12_000_000 or baud != int(baud):
            raise InvalidRequest("url", f"{url!r}: baud must be a whole number from 1200 to 12000000.")
        name = name or derived_name(f"serial-{Path(device).name}")
        return SerialLink(name, url, device, int(baud), forward=forward)
    listens = kind in ("udpin", "tcpin")
    host = parts.hostname or (LOOPBACK if listens else "")
    if not host:
        raise InvalidRequest("url", f"{url!r} has no host to connect to.", remedy=REMEDY)
    checked_host(url, host)
    if port is None or (port == 0 and not listens):
        raise InvalidRequest("url", f"{url!r} has no port (1 to 65535).", remedy=REMEDY)
    if parts.path not in ("", "/") or "@" in parts.netloc:
        raise InvalidRequest("url", f"{url!r}: only host, port and options may follow '//'.", remedy=REMEDY)
    name = name or derived_name(f"{kind}-{host}-{port}")
    if kind == "tcp":
        return TcpLink(name, url, host, port, forward=forward)
    if kind == "tcpin":
        return TcpServerLink(name, url, host, port, forward=forward)
    return UdpLink(name, url, host, port, outgoing=kind == "udpout", forward=forward)


def _options(query: str) -> dict[str, str]:
    return {key: values[-1] for key, values in parse_qs(query, keep_blank_values=True).items()}


def _signing(url: str) -> SigningOptions | None:
    options = _options(urlsplit(url).query)
    mode = options.get("signing", "required")
    if mode not in ("required", "allowed"):
        raise InvalidRequest("url", f"{url!r}: signing must be required or allowed, not {mode!r}.")
    if "key" not in options:
        if "signing" in options:
            raise InvalidRequest(
                "url", f"{url!r}: signing needs a key.", remedy="Name one: key=NAME (see gcs key --help)."
            )
        return None
    return SigningOptions(checked_key_name(options["key"]), mode == "required")


def _guard(url: str, link: Link) -> GuardOptions | None:
    options = _options(urlsplit(url).query)
    given = sorted(GUARD_OPTIONS & options.keys())
    if "guard" not in options:
        if given:
            raise InvalidRequest(
                "url", f"{url!r}: {given[0]} is an option of guarded links.", remedy="Add guard=ask."
            )
        return None
    if link.forward or link.replay:
        raise InvalidRequest(
            "url",
            f"{url!r}: a guarded link leads to programs; it neither forwards nor replays.",
            remedy="Example: udpin://127.0.0.1:14540?guard=ask.",
        )
    control, action = options["guard"], options.get("on_expiry", "hold")
    for name, value, allowed in (("guard", control, GUARD_CONTROL), ("on_expiry", action, GUARD_ACTIONS)):
        if value not in allowed:
            raise InvalidRequest(
                "url", f"{url!r}: {name} must be one of {', '.join(allowed)}, not {value!r}."
            )
    valid_for_s = parsed_number(url, "valid_for_s", options.get("valid_for_s", "0.5"))
    if not MIN_VALID_S <= valid_for_s <= MAX_VALID_S:
        raise InvalidRequest(
            "url", f"{url!r}: valid_for_s must be from {MIN_VALID_S:g} to {MAX_VALID_S:g} seconds."
        )
    same_for_s = parsed_number(url, "same_for_s", options.get("same_for_s", "10"))
    if same_for_s != 0.0 and not 1.0 <= same_for_s <= 3600.0:
        raise InvalidRequest("url", f"{url!r}: same_for_s must be 0, or from 1 to 3600 seconds.")
    vehicle, client = options.get("vehicle"), options.get("client")
    for name, text in (("vehicle", vehicle), ("client", client)):
        if text is not None and not (0 < len(text) <= MAX_NAME_LENGTH and text.isprintable()):
            raise InvalidRequest("url", f"{url!r}: {name} must have 1 to {MAX_NAME_LENGTH} characters.")
    return GuardOptions(control, vehicle, client, valid_for_s, action, same_for_s)


def guarded(url: str) -> str:
    """The URL of a guarded link; `guard=ask` unless the URL says otherwise."""
    if "guard" in _options(urlsplit(url).query):
        return url
    return f"{url}{'&' if '?' in url else '?'}guard={GUARD_CONTROL[0]}"


def _parse_flag(url: str, name: str, text: str) -> bool:
    if text not in ("0", "1"):
        raise InvalidRequest("url", f"{url!r}: {name} must be 0 or 1.")
    return text == "1"


def parsed_number(url: str, key: str, text: str) -> float:
    """Value of an option. Raises InvalidRequest if it is not a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InvalidRequest("url", f"{url!r}: {key} must be a number, not {text!r}.")
    return value
