"""The language of a browser: what the page's `chooseLanguage` has stored in its cookie."""

from __future__ import annotations

from http.cookies import CookieError, SimpleCookie

from starlette.datastructures import Headers

LANGUAGE_COOKIE = "gcs-language"
LANGUAGES = ("en", "de")
"""The first is the language of the sources."""


def language_of(headers: Headers) -> str:
    """The chosen language; English without a choice, and for a choice that is none of the languages."""
    try:
        chosen = SimpleCookie(headers.get("cookie", "")).get(LANGUAGE_COOKIE)
    except CookieError:
        return LANGUAGES[0]
    return chosen.value if chosen is not None and chosen.value in LANGUAGES else LANGUAGES[0]
