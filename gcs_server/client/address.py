"""The server's URL and token, from the link that the server printed or from separate values."""

from __future__ import annotations

import os
from collections.abc import Mapping
from urllib.parse import parse_qs, urlsplit, urlunsplit


def address_and_token(
    url: str, token: str | None, environment: Mapping[str, str] | None = None
) -> tuple[str, str | None]:
    """The server's address without the token, and the token: the given one, or the one in the URL, or
    `GCS_TOKEN`.
    """
    parts = urlsplit(url)
    if token is None:
        known = os.environ if environment is None else environment
        linked = parse_qs(parts.query).get("token")
        token = linked[0] if linked else known.get("GCS_TOKEN")
    return urlunsplit((parts.scheme, parts.netloc, parts.path.rstrip("/"), "", "")), token or None
