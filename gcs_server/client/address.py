"""Where the server is and what lets us in: the link that the server printed says both."""

from __future__ import annotations

import os
from collections.abc import Mapping
from urllib.parse import parse_qs, urlsplit, urlunsplit


def address_and_token(
    url: str, token: str | None, environment: Mapping[str, str] | None = None
) -> tuple[str, str | None]:
    """The server's bare address, and the token: as given, else of the link, else of `GCS_TOKEN`."""
    parts = urlsplit(url)
    if token is None:
        known = os.environ if environment is None else environment
        linked = parse_qs(parts.query).get("token")
        token = linked[0] if linked else known.get("GCS_TOKEN")
    return urlunsplit((parts.scheme, parts.netloc, parts.path.rstrip("/"), "", "")), token or None
