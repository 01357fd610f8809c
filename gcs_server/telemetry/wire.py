"""Samples and events as JSON text: encoded once, whoever gets them; NaN and infinity become null."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec

from gcs_server.vehicle.events import Event

SCHEMA_VERSION = 1
LONGEST_REQUEST = 65_536
MOST_NAMES = 256
LONGEST_ERROR = 500

# msgspec writes NaN and infinities as null, and dataclasses and tuples without help.
_encoder = msgspec.json.Encoder(enc_hook=lambda value: str(value))


@dataclass(frozen=True, slots=True)
class WireSample:
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
    """Any dataclass, mapping or sequence as JSON."""
    return _encoder.encode(value)


def plain(value: object) -> Any:
    """As `encode`, for values that another encoder will write: dicts and lists, NaN as None."""
    return msgspec.json.decode(_encoder.encode(value))


def hello(unix_s: float) -> str:
    """The first frame."""
    return encode({"type": "hello", "schema_version": SCHEMA_VERSION, "server_time_unix_s": unix_s}).decode()


def samples_frame(encoded: list[bytes]) -> str:
    """A frame of samples that are encoded already."""
    return (b'{"type":"samples","samples":[' + b",".join(encoded) + b"]}").decode()


def event_frame(event: Event) -> str:
    """One event; its data stand beside the fields that every event has."""
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
    """All replays as they are now."""
    return encode({"type": "replays", "replays": replays}).decode()


def error_frame(text: str) -> str:
    """An error message to a client; the socket stays open."""
    short = text if len(text) <= LONGEST_ERROR else f"{text[:LONGEST_ERROR]}…"
    return encode({"type": "error", "detail": short}).decode()


def parse_subscribe(text: str | bytes, known_topics: frozenset[str]) -> Subscribe:
    """Checks a client's request.

    Raises:
        ValueError: in words, naming the field.
    """
    if len(text) > LONGEST_REQUEST:
        raise ValueError(f"Not a subscription: longer than {LONGEST_REQUEST} characters.")
    try:
        request = _subscribe.decode(text)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(f"Not a subscription: {error}.") from error
    for name in ("vehicles", "topics"):
        if len(getattr(request, name)) > MOST_NAMES:
            raise ValueError(f"{name}: at most {MOST_NAMES}.")
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
