"""The language of a browser: the one that the page's `chooseLanguage` has stored in its cookie, or else the
browser's own.
"""

from __future__ import annotations

import re
from http.cookies import CookieError, SimpleCookie

from starlette.datastructures import Headers

LANGUAGE_COOKIE = "gcs-language"
LANGUAGES = ("en", "de")
"""The first is the language of the sources."""

_ACCEPTED = re.compile(r"\s*([A-Za-z]{2})(?:-[\w-]*)?\s*(?:;\s*q=(\d(?:\.\d{0,3})?)\s*)?")
"""A language of Accept-Language with its weight (RFC 9110, 12.5.4)."""


def language_of(headers: Headers) -> str:
    """The chosen language; without a choice, that of `LANGUAGES` which the browser prefers, or English."""
    try:
        chosen = SimpleCookie(headers.get("cookie", "")).get(LANGUAGE_COOKIE)
    except CookieError:
        chosen = None
    if chosen is not None and chosen.value in LANGUAGES:
        return chosen.value
    return _preferred(headers.get("accept-language", ""))


def _preferred(accepted: str) -> str:
    weights: dict[str, float] = {}
    for part in accepted.split(","):
        found = _ACCEPTED.fullmatch(part)
        if found is not None and found[1].lower() in LANGUAGES:
            weights.setdefault(found[1].lower(), 1.0 if found[2] is None else float(found[2]))
    best = max(weights, key=weights.__getitem__, default=LANGUAGES[0])  # the first of several
    return best if weights.get(best, 0.0) > 0.0 else LANGUAGES[0]
