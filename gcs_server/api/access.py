"""Access control: accepts or refuses every request and WebSocket before any other code handles it.

Three checks, in this order:
1. The Host must be one of this server's names. On loopback, this prevents DNS rebinding.
2. The Origin must be this server's own page. This prevents commands from other web sites.
3. If the server requires a token, the caller must send it. A server that other computers can reach always
   requires one.

No I/O and no state: `guard.py` applies the decisions.
"""

from __future__ import annotations

import hmac
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode

from starlette.datastructures import Headers

from gcs_server.origin import bearer_token, host_name, is_loopback, same_origin

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
SIGN_IN_PATH = "/sign-in"
AGENTS_PATH = "/mcp"
"""Where agents call; their tokens are accepted only there."""
TOKEN_FIELD = "token"
_MAX_QUERY_FIELDS = 64
_LEADING_SEPARATORS = "/\\ \t\r\n"
_SAFE_IN_PATHS = "/:@!$&'()*+,;=~"
_TOKEN_REMEDY = (
    "Open the link that the server printed when it started, or send its token as `Authorization: Bearer …` "
    "(the Python client: token=… or GCS_TOKEN)."
)


@dataclass(frozen=True, slots=True)
class Refusal:
    """Access refused, with the reason."""

    status: int
    code: str
    title: str
    detail: str
    remedy: str | None = None
    wrong_token: bool = False
    """Whether a wrong token was sent."""


@dataclass(frozen=True, slots=True)
class SignedIn:
    """The caller opened the URL with the token; the browser gets a cookie and is redirected to `location`."""

    location: str


@dataclass(frozen=True, slots=True)
class FormSent:
    """The sign-in page sends a token in the request's body."""


AccessDecision = Refusal | SignedIn | FormSent | None
"""None: the request is allowed."""


@dataclass(frozen=True, slots=True)
class RequestHead:
    """The parts of a request or WebSocket that the access checks use."""

    method: str
    """HTTP method; `WEBSOCKET` for a WebSocket."""
    path: str
    query: str
    secure: bool
    headers: Headers

    @classmethod
    def from_scope(cls, scope: Mapping[str, Any]) -> RequestHead:
        """The head of the request in an ASGI scope of type http or websocket."""
        return cls(
            method=scope["method"] if scope["type"] == "http" else "WEBSOCKET",
            path=scope["path"],
            query=scope.get("query_string", b"").decode("latin-1"),
            secure=scope.get("scheme") in ("https", "wss"),
            headers=Headers(raw=list(scope["headers"])),
        )

    @property
    def only_reads(self) -> bool:
        """Whether the request cannot change anything (GET, HEAD, OPTIONS)."""
        return self.method in SAFE_METHODS

    @property
    def is_navigation(self) -> bool:
        """Whether a browser is opening a document (from a link, a bookmark or a typed address)."""
        mode, dest = self.headers.get("sec-fetch-mode"), self.headers.get("sec-fetch-dest")
        return self.only_reads and mode == "navigate" and dest == "document"

    @property
    def is_cross_site(self) -> bool:
        """Whether the browser reports that another site's page caused the request."""
        return self.headers.get("sec-fetch-site") in ("cross-site", "same-site")


class Access:
    """The access rules of one server.

    Args:
        loopback_only: whether the server is bound to loopback; it then accepts only this machine's own names.
        token: the token that a caller needs; None if no token is required.
        agent_tokens: tokens of agents, which are no tokens of this server.
    """

    def __init__(self, *, loopback_only: bool, token: str | None, agent_tokens: Iterable[str] = ()) -> None:
        self.loopback_only = loopback_only
        self.token = token
        self._agent_tokens = [_to_bytes(each) for each in agent_tokens]
        key = (token or "").encode()
        # The cookie is derived from the token, so that a leaked cookie does not reveal the token. Its name is
        # derived too, because browsers do not separate cookies of two servers on one machine by port.
        self.cookie_name = "gcs-" + hmac.digest(key, b"cookie name", "sha256").hex()[:8]
        self.cookie_value = hmac.digest(key, b"cookie", "sha256").hex()

    def decide(self, head: RequestHead) -> AccessDecision:
        """Whether a request is allowed, or the response to it."""
        refusal = self._refuse_wrong_host(head) or self._refuse_foreign_page(head)
        if refusal is not None:
            return refusal
        sent = bearer_token(head.headers.get("authorization", ""))
        if sent is not None and self._is_agents(sent):
            return None if head.path == AGENTS_PATH else _agent_refusal()
        if self.token is None:
            # A mistyped token would otherwise be that of an unnamed agent, which only reads.
            is_wrong = head.path == AGENTS_PATH and sent is not None
            return token_refusal("This is not the token of an agent.", wrong_token=True) if is_wrong else None
        if head.path == SIGN_IN_PATH and head.method == "POST":
            return FormSent()
        if head.method in ("GET", "HEAD") and (link_token := token_in_query(head.query)) is not None:
            if self.is_token(link_token) or self._has_cookie(head):
                return SignedIn(location_without_token(head.path, head.query))
            return token_refusal(
                "The token in the link is not valid, or is no longer valid.", wrong_token=True
            )
        return self._refuse_without_token(head)

    def is_token(self, token: str) -> bool:
        """Whether a string is the token; compared in constant time."""
        return self.token is not None and hmac.compare_digest(_to_bytes(token), _to_bytes(self.token))

    def cookie(self, *, secure: bool) -> str:
        """The Set-Cookie header: for requests of this site only, and not readable by scripts."""
        return (
            f"{self.cookie_name}={self.cookie_value}; Path=/; Max-Age={30 * 86400}; HttpOnly; SameSite=Strict"
            + ("; Secure" if secure else "")
        )

    def _refuse_wrong_host(self, head: RequestHead) -> Refusal | None:
        hosts = head.headers.getlist("host")
        name = host_name(hosts[0]) if len(hosts) == 1 else None
        if name is None:
            return Refusal(400, "bad_host", "Not understood", "The request names no host, or more than one.")
        if self.loopback_only and not is_loopback(name):
            return Refusal(
                403,
                "foreign_host",
                "Forbidden",
                f"This server answers only requests to this machine's own names, not to {name!r}.",
                "Use http://localhost, or start the server with --host to let other machines in.",
            )
        return None

    def _refuse_foreign_page(self, head: RequestHead) -> Refusal | None:
        origins = head.headers.getlist("origin")
        if not origins:
            if head.is_cross_site and not head.is_navigation:
                return _foreign_page_refusal("A page of another site")
            return None
        host = head.headers["host"]
        if len(origins) > 1 or not same_origin(origins[0], host, secure=head.secure):
            return _foreign_page_refusal(f"A page of {origins[0][:200]!r}")
        return None

    def _is_agents(self, token: str) -> bool:
        return any([hmac.compare_digest(_to_bytes(token), known) for known in self._agent_tokens])

    def _refuse_without_token(self, head: RequestHead) -> Refusal | None:
        token = bearer_token(head.headers.get("authorization", ""))
        if token is not None:
            if self.is_token(token):
                return None
            return token_refusal("The token is not valid.", wrong_token=True)
        if not self._has_cookie(head):
            return token_refusal("This server requires a token.")
        if not head.only_reads and "origin" not in head.headers:
            # Every browser sends the Origin of the page; a request without one must carry the token itself.
            return Refusal(
                403,
                "origin_missing",
                "Forbidden",
                "A command with a cookie needs the Origin header of the page that sends it.",
                "Programs send the token as `Authorization: Bearer …` instead.",
            )
        return None

    def _has_cookie(self, head: RequestHead) -> bool:
        expected = self.cookie_value.encode()
        values = cookies_named(head.headers.getlist("cookie"), self.cookie_name)
        return any([hmac.compare_digest(_to_bytes(value), expected) for value in values])


def token_refusal(detail: str, *, wrong_token: bool = False) -> Refusal:
    """The refusal for a missing or wrong token."""
    return Refusal(
        401,
        "token_wrong" if wrong_token else "token_missing",
        "Not signed in",
        detail,
        _TOKEN_REMEDY,
        wrong_token,
    )


def _agent_refusal() -> Refusal:
    return Refusal(
        403,
        "agent_token",
        "Forbidden",
        f"The token of an agent is accepted only at {AGENTS_PATH}.",
        "Agents use their tools; programs send the server's own token.",
    )


def _foreign_page_refusal(caller: str) -> Refusal:
    return Refusal(
        403,
        "foreign_origin",
        "Forbidden",
        f"{caller} must not use this server; only the server's own page may command vehicles and read data.",
    )


def cookies_named(headers: Iterable[str], name: str) -> list[str]:
    """The values of all cookies of this name."""
    pairs = (part.strip().partition("=") for header in headers for part in header.split(";"))
    return [value for key, _, value in pairs if key == name]


def token_in_query(query: str) -> str | None:
    """The token in a URL's query; None if there is none."""
    return next((value for key, value in _query_pairs(query) if key == TOKEN_FIELD), None)


def form_fields(body: bytes) -> tuple[str, str]:
    """Token from the sign-in form, empty if missing, and the location to open afterwards; default: `/`."""
    fields = dict(_query_pairs(body.decode("latin-1")))
    return fields.get(TOKEN_FIELD, "").strip(), local_path(fields.get("next", "/"))


def location_without_token(path: str, query: str) -> str:
    """The location on this server without the token in its query; `path` is decoded, as in ASGI."""
    rest = [(key, value) for key, value in _query_pairs(query) if key != TOKEN_FIELD]
    local = "/" + quote(path.lstrip(_LEADING_SEPARATORS), safe=_SAFE_IN_PATHS)
    return f"{local}?{urlencode(rest)}" if rest else local


def local_path(address: str) -> str:
    """Path and query of an address on this server; `//elsewhere/`, another server's address, becomes
    `/elsewhere/`."""
    path, _, query = address.partition("?")
    local = "/" + quote(path.lstrip(_LEADING_SEPARATORS), safe=_SAFE_IN_PATHS + "%")
    return f"{local}?{quote(query, safe='=&%+/:@')}" if query else local


def _query_pairs(text: str) -> list[tuple[str, str]]:
    try:
        return parse_qsl(text, keep_blank_values=True, max_num_fields=_MAX_QUERY_FIELDS)
    except ValueError:  # more fields than any page of this server has
        return []


def _to_bytes(text: str) -> bytes:
    return text.encode("utf-8", errors="replace")
