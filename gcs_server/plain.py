"""Values as plain JSON data."""

from __future__ import annotations

from typing import Any

import msgspec

# msgspec writes NaN and infinity as null, and supports dataclasses and tuples.
encoder = msgspec.json.Encoder(enc_hook=lambda value: str(value))
"""Encodes dataclasses, mappings and sequences; other values as text."""


def plain(value: object) -> Any:
    """The value as dicts and lists for another encoder, with None instead of NaN."""
    return msgspec.json.decode(encoder.encode(value))
