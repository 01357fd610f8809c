"""Access control: which requests are allowed, sign-in, and invalid requests."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.datastructures import Headers

from gcs_server.api.access import (
    SIGN_IN_PATH,
    Access,
    FormSent,
    Refusal,
    RequestHead,
    SignedIn,
    form_fields,
    local_path,
)
from gcs_server.api.sign_in_page import FOLDER, sign_in_page
from gcs_server.language import LANGUAGES

TOKEN = "correct-horse-battery"
LOOPBACK_ONLY = Access(loopback_only=True, token=None)
ALL_INTERFACES = Access(loopback_only=False, token=TOKEN)
LOOPBACK_WITH_TOKEN = Access(loopback_only=True, token=TOKEN)
COOKIE = f"theme=dark; {ALL_INTERFACES.cookie_name}={ALL_INTERFACES.cookie_value}"
BEARER = f"Bearer {TOKEN}"
REMOTE_HOST = "gcs.field:8080"


def request_head(method="GET", path="/", query="", *, host="localhost:8080", secure=False, **headers):
    pairs = [("host", host)] if host is not None else []
    pairs += [(name.replace("_", "-"), value) for name, value in headers.items()]
    raw = [(name.encode(), value.encode("latin-1")) for name, value in pairs]
    scope = {"type": "http", "method": method, "path": path, "query_string": query.encode(), "headers": raw}
    if method == "WEBSOCKET":
        scope = {**scope, "type": "websocket"}
    return RequestHead.from_scope({**scope, "scheme": "https" if secure else "http"})


def refusal_code(access, request):
    """The code of the refusal; if the request is not refused, the decision."""
    verdict = access.decide(request)
    return verdict.code if isinstance(verdict, Refusal) else verdict


METHODS = ("GET", "HEAD", "OPTIONS", "POST", "PUT", "DELETE", "WEBSOCKET")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("headers", "expected"),
    [
        ({}, None),  # curl
        ({"origin": "http://localhost:8080"}, None),
        ({"host": "127.0.0.1:8080", "origin": "http://127.0.0.1:8080"}, None),
        ({"host": "[::1]:9", "origin": "http://[::1]:9"}, None),
        ({"host": "127.0.0.2"}, None),
        ({"host": "LOCALHOST"}, None),
        ({"sec_fetch_site": "same-origin"}, None),
        ({"sec_fetch_site": "none"}, None),
        ({"origin": "http://evil.example"}, "foreign_origin"),
        ({"origin": "http://localhost:3000"}, "foreign_origin"),
        ({"origin": "http://127.0.0.1:8080"}, "foreign_origin"),
        ({"origin": "null"}, "foreign_origin"),
        ({"origin": ""}, "foreign_origin"),
        ({"origin": "localhost:8080"}, "foreign_origin"),
        ({"origin": "file://localhost:8080"}, "foreign_origin"),
        ({"origin": "http://localhost:8080.evil.example"}, "foreign_origin"),
        ({"sec_fetch_site": "cross-site"}, "foreign_origin"),
        ({"sec_fetch_site": "same-site"}, "foreign_origin"),
        ({"sec_fetch_site": "cross-site", "sec_fetch_mode": "no-cors"}, "foreign_origin"),
        ({"host": "rebound.example:8080"}, "foreign_host"),
        ({"host": "rebound.example", "origin": "http://rebound.example"}, "foreign_host"),
        ({"host": "localhost.evil.example"}, "foreign_host"),
        ({"host": "192.168.1.5:8080"}, "foreign_host"),
        ({"host": "127.0.0.1.nip.io"}, "foreign_host"),
        ({"host": None}, "bad_host"),
        ({"host": ""}, "bad_host"),
        ({"host": "localhost:8080@evil.example"}, "bad_host"),
        ({"host": "localhost, evil.example"}, "bad_host"),
        ({"host": "[::1"}, "bad_host"),
    ],
)
def test_on_loopback_no_token_is_needed_and_only_pages_of_the_server_are_allowed(method, headers, expected):
    assert refusal_code(LOOPBACK_ONLY, request_head(method, **headers)) == expected


@pytest.mark.parametrize(
    ("method", "dest", "expected"),
    [("GET", "document", None), ("GET", "iframe", "foreign_origin"), ("POST", "document", "foreign_origin")],
)
def test_from_another_site_only_a_link_to_the_page_is_allowed(method, dest, expected):
    headers = {"sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate", "sec_fetch_dest": dest}
    assert refusal_code(LOOPBACK_ONLY, request_head(method, **headers)) == expected


@pytest.mark.parametrize("access", [ALL_INTERFACES, LOOPBACK_WITH_TOKEN], ids=["all interfaces", "loopback"])
@pytest.mark.parametrize("method", ["GET", "POST", "WEBSOCKET"])
@pytest.mark.parametrize("path", ["/", "/docs", "/api/v1/health", "/scene/", "/assets/a.js", "/nothing"])
def test_with_a_token_every_request_must_send_the_token(access, method, path):
    same_origin = {"origin": "http://localhost:8080"}
    assert refusal_code(access, request_head(method, path)) == "token_missing"
    assert refusal_code(access, request_head(method, path, authorization="Bearer wrong")) == "token_wrong"
    assert refusal_code(access, request_head(method, path, authorization=BEARER)) is None
    assert refusal_code(access, request_head(method, path, cookie=COOKIE, **same_origin)) is None
    assert (
        refusal_code(access, request_head(method, path, cookie=f"{ALL_INTERFACES.cookie_name}={TOKEN}"))
        == "token_missing"
    )
    assert (
        refusal_code(access, request_head(method, path, cookie=COOKIE, origin="http://evil.example"))
        == "foreign_origin"
    )
    foreign_bearer = request_head(method, path, authorization=BEARER, origin="http://evil.example")
    assert refusal_code(access, foreign_bearer) == "foreign_origin"


@pytest.mark.parametrize(
    ("method", "headers", "expected"),
    [
        ("GET", {"cookie": COOKIE}, None),
        ("POST", {"cookie": COOKIE}, "origin_missing"),
        ("WEBSOCKET", {"cookie": COOKIE}, "origin_missing"),
        ("POST", {"cookie": COOKIE, "authorization": "Basic eDp5"}, "origin_missing"),
        (
            "GET",
            {"cookie": COOKIE, "authorization": "Basic eDp5"},
            None,
        ),  # a password for the proxy, not for this server
        ("GET", {"cookie": COOKIE, "authorization": "Bearer wrong"}, "token_wrong"),
        ("GET", {"authorization": f"bearer  {TOKEN} "}, None),
        ("GET", {"authorization": "Bearer"}, "token_wrong"),
        ("GET", {"authorization": "Bearer \xe9"}, "token_wrong"),
        ("GET", {"authorization": TOKEN}, "token_missing"),
        ("GET", {"authorization": f"Bearer {TOKEN}x"}, "token_wrong"),
        ("POST", {"cookie": COOKIE, "origin": f"http://{REMOTE_HOST}"}, None),
        (
            "POST",
            {"cookie": COOKIE, "origin": f"https://{REMOTE_HOST}"},
            None,
        ),  # the proxy in front of the server uses https
        ("POST", {"cookie": COOKIE, "origin": f"http://{REMOTE_HOST}", "secure": True}, "foreign_origin"),
        ("POST", {"host": "rebound.example", "origin": "http://rebound.example"}, "token_missing"),
        ("GET", {"host": "whatever.name", "authorization": BEARER}, None),
    ],
)
def test_from_other_machines_a_cookie_needs_the_pages_origin_and_a_bearer_token_does_not(
    method, headers, expected
):
    assert refusal_code(ALL_INTERFACES, request_head(method, **{"host": REMOTE_HOST, **headers})) == expected


def test_on_loopback_foreign_host_names_are_refused_even_with_the_token():
    assert (
        refusal_code(LOOPBACK_WITH_TOKEN, request_head(host="rebound.example", authorization=BEARER))
        == "foreign_host"
    )


@pytest.mark.parametrize(
    ("path", "query", "location"),
    [
        ("/", "token={}", "/"),
        ("/docs", "a=1&token={}&b=%26", "/docs?a=1&b=%26"),
        ("//evil.example/", "token={}", "/evil.example/"),
        ("/\\evil.example", "token={}", "/evil.example"),
        ("/a b\r\nSet-Cookie: x", "token={}", "/a%20b%0D%0ASet-Cookie:%20x"),
    ],
)
def test_the_sign_in_link_leaves_no_token_in_the_address(path, query, location):
    assert ALL_INTERFACES.decide(request_head(path=path, query=query.format(TOKEN))) == SignedIn(location)
    refusal = ALL_INTERFACES.decide(request_head(path=path, query=query.format("wrong")))
    assert isinstance(refusal, Refusal)
    assert (refusal.status, refusal.wrong_token) == (401, True)
    assert ALL_INTERFACES.decide(
        request_head(path=path, query=query.format("old"), cookie=COOKIE)
    ) == SignedIn(location)


def test_a_sign_in_link_works_only_as_a_get_request_that_is_not_from_another_site():
    for method in ("POST", "PUT", "DELETE", "WEBSOCKET"):
        assert refusal_code(ALL_INTERFACES, request_head(method, query=f"token={TOKEN}")) == "token_missing"
    assert (
        refusal_code(ALL_INTERFACES, request_head(query=f"token={TOKEN}", origin="http://evil.example"))
        == "foreign_origin"
    )


def test_the_sign_in_form_is_accepted_if_a_token_is_set_and_only_from_the_servers_page():
    assert (
        ALL_INTERFACES.decide(request_head("POST", SIGN_IN_PATH, origin="http://localhost:8080"))
        == FormSent()
    )
    assert (
        refusal_code(ALL_INTERFACES, request_head("POST", SIGN_IN_PATH, origin="http://evil.example"))
        == "foreign_origin"
    )
    assert LOOPBACK_ONLY.decide(request_head("POST", SIGN_IN_PATH)) is None
    assert form_fields(f"token=+{TOKEN}%0A&next=%2Fdocs%3Fa%3D1".encode()) == (TOKEN, "/docs?a=1")
    assert form_fields(b"next=//evil.example") == ("", "/evil.example")


def test_the_cookie_is_valid_for_this_site_only_and_does_not_contain_the_token():
    cookie = ALL_INTERFACES.cookie(secure=False)
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert "Secure" not in cookie
    assert TOKEN not in cookie
    assert ALL_INTERFACES.cookie(secure=True).endswith("; Secure")
    other_server = Access(loopback_only=False, token=TOKEN + "x")
    assert other_server.cookie_name != ALL_INTERFACES.cookie_name, (
        "two servers on one machine would use the same cookie"
    )
    assert other_server.cookie_value != ALL_INTERFACES.cookie_value


any_text = st.text(st.characters(max_codepoint=255), max_size=60)


@given(
    st.sampled_from(METHODS),
    any_text,
    any_text,
    st.lists(
        st.tuples(
            st.sampled_from(
                ["host", "origin", "cookie", "authorization", "sec-fetch-site", "sec-fetch-mode", "accept"]
            ),
            any_text,
        ),
        max_size=6,
    ),
)
def test_invalid_requests_are_never_allowed_and_never_raise(method, path, query, headers):
    for access in (LOOPBACK_ONLY, ALL_INTERFACES, LOOPBACK_WITH_TOKEN):
        raw = [(name.encode(), value.encode("latin-1")) for name, value in headers]
        scope = {"type": "websocket" if method == "WEBSOCKET" else "http", "method": method, "path": path}
        verdict = access.decide(
            RequestHead.from_scope({**scope, "query_string": query.encode("latin-1"), "headers": raw})
        )
        if access is not LOOPBACK_ONLY:
            assert isinstance(verdict, Refusal)
    form_fields(query.encode("latin-1"))


@given(any_text)
def test_sign_in_redirects_only_to_this_server(address):
    assert re.match(r"/(?![/\\])[\x21-\x7e]*\Z", local_path(address))


def test_the_sign_in_page_uses_the_pages_colours():
    tokens_css = (Path(__file__).parents[3] / "web/src/ui/tokens.css").read_text()
    dark_css, light_css = re.split(r"\[data-theme=.light.\]", tokens_css)
    style = (FOLDER / "style.css").read_text()
    colours = re.findall(r"--(\S+): light-dark\((#\w+), (#\w+)\);", style)
    assert len(colours) >= 9
    for name, light_colour, dark_colour in colours:
        if name != "shade":  # only the sign-in page has this colour
            assert f"--{name}: {light_colour};" in light_css
            assert f"--{name}: {dark_colour};" in dark_css


def test_the_sign_in_page_escapes_its_texts():
    refusal = Refusal(401, "token_wrong", "", "<script>", wrong_token=True)
    for language in LANGUAGES:
        headers = Headers({"Accept-Language": language})
        text = bytes(sign_in_page(refusal, '/"><script>alert(1)</script>', headers).body).decode()
        assert f'<html lang="{language}">' in text
        assert "<script" not in text
        assert "&lt;script&gt;" in text
