"""The sign-in page for browsers without the token: it explains how to get the token and has a field to enter
it. The page is a single document without scripts. Its style is inline, so that no other file is served
without the token; the content security policy allows the style by its hash.
"""

from __future__ import annotations

import base64
import functools
import hashlib
from html import escape
from pathlib import Path
from string import Template

from starlette.responses import HTMLResponse

from gcs_server.api.access import Refusal

FOLDER = Path(__file__).resolve().parent / "sign_in"


@functools.cache
def _parts() -> tuple[Template, str, str]:
    """The document, its style, and the content security policy that allows the style."""
    style = (FOLDER / "style.css").read_text("utf-8")
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    policy = (
        f"default-src 'none'; style-src 'sha256-{digest}'; "
        "form-action 'self'; frame-ancestors 'self'; base-uri 'none'"
    )
    return Template((FOLDER / "index.html").read_text("utf-8")), style, policy


def sign_in_page(refusal: Refusal, location: str) -> HTMLResponse:
    """The sign-in page as a response.

    Args:
        refusal: why access was refused; its text is shown at the field if the token was wrong.
        location: path on this server to open after signing in.
    """
    document, style, policy = _parts()
    error = (
        f'<p class="error" id="error" role="alert">{escape(refusal.detail)}</p>'
        if refusal.wrong_token
        else ""
    )
    text = document.substitute(
        style=style,
        next=escape(location, quote=True),
        error=error,
        invalid='aria-invalid="true" aria-describedby="error" ' if error else "",
    )
    headers = {
        "Content-Security-Policy": policy,
        "Cache-Control": "no-store",
        "WWW-Authenticate": "Bearer",
    }
    return HTMLResponse(text, status_code=refusal.status, headers=headers)
