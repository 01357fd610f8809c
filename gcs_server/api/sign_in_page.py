"""The sign-in page for browsers without the token: it explains how to get the token and has a field to enter
it, in the browser's language. The page is a single document without scripts. Its style is inline, so that no
other file is served without the token; the content security policy allows the style by its hash.
"""

from __future__ import annotations

import base64
import functools
import hashlib
from html import escape
from pathlib import Path
from string import Template

from starlette.datastructures import Headers
from starlette.responses import HTMLResponse

from gcs_server.api.access import Refusal
from gcs_server.language import LANGUAGES, language_of

FOLDER = Path(__file__).resolve().parent / "sign_in"
_DOCUMENTS = {"en": "index.html", "de": "index.de.html"}
_GERMAN = {
    "The token is not valid.": "Das Token ist nicht gültig.",
    "This token is not valid.": "Dieses Token ist nicht gültig.",
    "The token in the link is not valid, or is no longer valid.": (
        "Das Token im Link ist nicht oder nicht mehr gültig."
    ),
}
"""The refusals of a wrong token."""


@functools.cache
def _parts(language: str) -> tuple[Template, str, str]:
    """The document in a language, its style, and the content security policy that allows the style."""
    style = (FOLDER / "style.css").read_text("utf-8")
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    policy = (
        f"default-src 'none'; style-src 'sha256-{digest}'; "
        "form-action 'self'; frame-ancestors 'self'; base-uri 'none'"
    )
    return Template((FOLDER / _DOCUMENTS[language]).read_text("utf-8")), style, policy


def sign_in_page(refusal: Refusal, location: str, headers: Headers) -> HTMLResponse:
    """The sign-in page as a response.

    Args:
        refusal: why access was refused; its text is shown at the field if the token was wrong.
        location: path on this server to open after signing in.
        headers: the request's, for the browser's language.
    """
    language = language_of(headers)
    document, style, policy = _parts(language)
    detail = refusal.detail if language == LANGUAGES[0] else _GERMAN.get(refusal.detail, refusal.detail)
    error = f'<p class="error" id="error" role="alert">{escape(detail)}</p>' if refusal.wrong_token else ""
    text = document.substitute(
        style=style,
        next=escape(location, quote=True),
        error=error,
        invalid='aria-invalid="true" aria-describedby="error" ' if error else "",
    )
    sent_headers = {
        "Content-Security-Policy": policy,
        "Cache-Control": "no-store",
        "Vary": "Cookie, Accept-Language",
        "WWW-Authenticate": "Bearer",
    }
    return HTMLResponse(text, status_code=refusal.status, headers=sent_headers)
