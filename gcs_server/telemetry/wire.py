"""Encodes samples and events as JSON text, once for all clients; NaN and infinity become null."""

from __future__ import annotations

import msgspec

from gcs_server.plain import encoder
from gcs_server.vehicle.events import Event

SCHEMA_VERSION = 1
MAX_REQUEST_LENGTH = 65_536
MAX_NAMES = 256
"""Maximum number of vehicles, and of topics, in one subscription."""
MAX_ERROR_LENGTH = 500


class WireSample(msgspec.Struct, frozen=True):
    """One element of a `samples` frame."""

    vehicle: str
    topic: str
    vehicle_time_boot_s: float | None
    received_unix_s: float
    value: object


class Subscribe(msgspec.Struct, tag="subscribe", forbid_unknown_fields=True):
    """The subscription that a client sends."""

    vehicles: list[str] | str = "*"
    topics: list[str] | str = "*"
    rate_hz: float = 20.0


_subscribe = msgspec.json.Decoder(Subscribe)


def encode(value: object) -> bytes:
    """Encodes a dataclass, mapping or sequence as JSON."""
    return encoder.encode(value)


def hello(unix_s: float) -> str:
    """The first frame of a connection."""
    return encode({"type": "hello", "schema_version": SCHEMA_VERSION, "server_time_unix_s": unix_s}).decode()


def samples_frame(encoded: list[bytes]) -> str:
    """A frame of already encoded samples."""
    return (b'{"type":"samples","samples":[' + b",".join(encoded) + b"]}").decode()


def event_frame(event: Event) -> str:
    """A frame with one event: the event's data and the common fields in one object."""
    body = {
        **event.data,
        "kind": event.kind,
        "vehicle": event.vehicle,
        "unix_s": event.unix_s,
        "severity": event.severity,
        "text": event.text,
        "index": event.index,
    }
    return encode({"type": "event", "event": body}).decode()


def replays_frame(replays: object) -> str:
    """A frame with all open replays."""
    return encode({"type": "replays", "replays": replays}).decode()


def error_frame(text: str) -> str:
    """An error message to a client; the socket stays open."""
    short = text if len(text) <= MAX_ERROR_LENGTH else f"{text[:MAX_ERROR_LENGTH]}…"
    return encode({"type": "error", "detail": short}).decode()


def parse_subscribe(text: str | bytes, known_topics: frozenset[str]) -> Subscribe:
    """Checks a client's request.

    Raises:
        ValueError: a field is invalid; the error names the field.
    """
    if len(text) > MAX_REQUEST_LENGTH:
        raise ValueError(f"Not a subscription: longer than {MAX_REQUEST_LENGTH} characters.")
    try:
        request = _subscribe.decode(text)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(f"Not a subscription: {error}.") from error
    for name in ("vehicles", "topics"):
        if len(getattr(request, name)) > MAX_NAMES:
            raise ValueError(f"{name}: at most {MAX_NAMES} names.")
    if isinstance(request.vehicles, str) and request.vehicles != "*":
        raise ValueError('vehicles: a list of ids, or "*".')
    if isinstance(request.topics, str):
        if request.topics != "*":
            raise ValueError('topics: a list of names, or "*".')
    else:
        unknown = sorted(set(request.topics) - known_topics)
        if unknown:
            raise ValueError(
                f"topics: unknown {', '.join(unknown)}; known are {', '.join(sorted(known_topics))}."
            )
    if not 0.1 <= request.rate_hz <= 100:
        raise ValueError("rate_hz: from 0.1 to 100.")
    return request
