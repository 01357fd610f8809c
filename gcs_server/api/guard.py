"""Middleware that applies the decisions of `access.py` before the application handles a request.

It applies to the page, the API, its documentation and the 3D view. A refused WebSocket is closed before it is
accepted. A refused program gets problem+json, and a browser without the token gets the sign-in page.
"""

from __future__ import annotations

import asyncio
import logging

from starlette.requests import ClientDisconnect, Request
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from gcs_server.api.access import (
    Access,
    FormSent,
    Refusal,
    RequestHead,
    SignedIn,
    form_fields,
    location_without_token,
    token_refusal,
)
from gcs_server.api.problems import problem
from gcs_server.api.sign_in_page import sign_in_page
from gcs_server.clock import Clock

log = logging.getLogger(__name__)

POLICY_VIOLATION = 1008
MAX_FORM_LENGTH = 4096
FORM_DEADLINE_S = 10.0
LOG_PERIOD_S = 10.0
"""Time between two log lines about wrong tokens, so that guessed tokens do not fill the log."""


class Guard:
    """ASGI middleware."""

    def __init__(self, app: ASGIApp, access: Access, clock: Clock) -> None:
        self._app = app
        self._access = access
        self._clock = clock
        self._wrong_token_count = 0
        self._last_log_s = float("-inf")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        head = RequestHead.from_scope(scope)
        decision = self._access.decide(head)
        if decision is None:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()
            reason = ""
            if isinstance(decision, Refusal):
                self._log_wrong_token(scope, decision)
                reason = decision.code
            await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": reason})
        else:
            await (await self._respond(head, decision, scope, receive))(scope, receive, send)

    async def _respond(
        self, head: RequestHead, decision: Refusal | SignedIn | FormSent, scope: Scope, receive: Receive
    ) -> Response:
        if isinstance(decision, Refusal):
            self._log_wrong_token(scope, decision)
            return _refusal_response(head, decision)
        if isinstance(decision, SignedIn):
            location = decision.location
        else:
            token, location = await _read_form(scope, receive)
            if not self._access.is_token(token):
                refusal = token_refusal("This token is not valid.", wrong_token=True)
                self._log_wrong_token(scope, refusal)
                return sign_in_page(refusal, location, head.headers)
        response = RedirectResponse(location, status_code=303, headers={"Cache-Control": "no-store"})
        response.headers["Set-Cookie"] = self._access.cookie(secure=head.secure)
        return response

    def _log_wrong_token(self, scope: Scope, refusal: Refusal) -> None:
        """Logs wrong tokens. They never block a client, because that client could be the pilot."""
        if not refusal.wrong_token:
            return
        self._wrong_token_count += 1
        now_s = self._clock.monotonic_s()
        if now_s - self._last_log_s < LOG_PERIOD_S:
            return
        caller = scope["client"][0] if scope.get("client") else "an unknown client"
        log.warning("a wrong token from %s (%d since the last such line)", caller, self._wrong_token_count)
        self._wrong_token_count, self._last_log_s = 0, now_s


def _refusal_response(head: RequestHead, refusal: Refusal) -> Response:
    headers = {"Cache-Control": "no-store"}
    if refusal.status == 401:
        if head.only_reads and "text/html" in head.headers.get("accept", ""):
            page = sign_in_page(refusal, location_without_token(head.path, head.query), head.headers)
            if head.is_navigation and head.is_cross_site:
                # A browser does not send the cookie when another site links to this page, but does when the
                # page reloads.
                page.headers["Refresh"] = "0"
            return page
        error = ' error="invalid_token"' if refusal.wrong_token else ""
        headers["WWW-Authenticate"] = "Bearer" + error
    response = problem(refusal.status, refusal.title, refusal.code, refusal.detail, remedy=refusal.remedy)
    response.headers.update(headers)
    return response


async def _read_form(scope: Scope, receive: Receive) -> tuple[str, str]:
    """Token and location from the sign-in form; empty if the form is too long or arrives too slowly."""
    body = b""
    try:
        async with asyncio.timeout(FORM_DEADLINE_S):
            async for chunk in Request(scope, receive).stream():
                body += chunk
                if len(body) > MAX_FORM_LENGTH:
                    return "", "/"
    except (TimeoutError, ClientDisconnect):
        return "", "/"
    return form_fields(body)
