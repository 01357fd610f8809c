"""The server's URL and token, from the link that the server printed or from separate values."""

from __future__ import annotations

import os
from collections.abc import Mapping
from urllib.parse import parse_qs, urlsplit, urlunsplit


def address_and_token(
    url: str, token: str | None, environment: Mapping[str, str] | None = None
) -> tuple[str, str | None]:
    """The server's address without the token, and the token: `token`, or else the token in `url`, or else
    `GCS_TOKEN`.
    """
    parts = urlsplit(url)
    if token is None:
        environment = os.environ if environment is None else environment
        url_tokens = parse_qs(parts.query).get("token")
        token = url_tokens[0] if url_tokens else environment.get("GCS_TOKEN")
    return urlunsplit((parts.scheme, parts.netloc, parts.path.rstrip("/"), "", "")), token or None
