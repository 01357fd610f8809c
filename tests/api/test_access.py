"""Access over HTTP: a link or the form signs a browser in; programs get an error, browsers get the sign-in
page."""

import logging
import re
import stat

import pytest
from fastapi.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from gcs_server.addresses import page_urls
from gcs_server.app import create_app
from gcs_server.client.aio import address_and_token
from gcs_server.errors import GcsError, InvalidRequest
from gcs_server.settings import Settings, load, token_of
from gcs_server.storage.folder import StorageError
from gcs_server.storage.token import is_well_formed

URL = "http://gcs.field:8080"
HTML = {"Accept": "text/html,*/*;q=0.8"}


@pytest.fixture
def server(tmp_path):
    """A server that accepts requests from other machines, in process and without a socket."""
    (tmp_path / "index.html").write_text("<!doctype html><title>page</title>")
    settings = Settings(host="0.0.0.0", links=(), sim=0, data=tmp_path, scene=False, record=False)
    with TestClient(create_app(settings, static=tmp_path), base_url=URL, follow_redirects=False) as client:
        client.token = (tmp_path / "token").read_text().strip()
        yield client


def test_the_link_and_the_form_sign_a_browser_in(server):
    refused = server.get("/docs?a=1", headers=HTML)
    assert refused.status_code == 401
    assert "Offboard GCS: sign in" in refused.text
    assert 'name="next" value="/docs?a=1"' in refused.text
    redirect = server.get(f"/docs?a=1&token={server.token}", headers=HTML)
    assert (redirect.status_code, redirect.headers["location"]) == (303, "/docs?a=1")
    assert "HttpOnly" in redirect.headers["set-cookie"]
    assert server.get("/docs?a=1", headers=HTML).status_code == 200
    server.cookies.clear()
    same_origin = {"Origin": URL}
    wrong = server.post("/sign-in", data={"token": "guess", "next": "/docs"}, headers=same_origin)
    assert wrong.status_code == 401
    assert "set-cookie" not in wrong.headers
    assert 'role="alert"' in wrong.text
    assert 'name="next" value="/docs"' in wrong.text
    right = server.post(
        "/sign-in", data={"token": f" {server.token}\n", "next": "/docs"}, headers=same_origin
    )
    assert (right.status_code, right.headers["location"]) == (303, "/docs")
    assert server.get("/").text.endswith("page</title>")
    assert server.post("/api/v1/vehicles/7/arm", headers=same_origin).status_code == 404
    assert server.post("/api/v1/vehicles/7/arm").json()["code"] == "origin_missing"
    with server.websocket_connect("ws://gcs.field:8080/api/v1/telemetry", headers=same_origin) as socket:
        assert socket.receive_json()["type"] == "hello"


def test_a_program_without_a_token_gets_an_error_that_explains_it(server):
    response = server.get("/api/v1/vehicles")
    assert (response.status_code, response.json()["code"]) == (401, "token_missing")
    assert response.headers["www-authenticate"] == "Bearer"
    assert "Bearer" in response.json()["remedy"]
    assert "content-security-policy" in response.headers
    wrong = server.get("/api/v1/vehicles", headers={"Authorization": "Bearer guess"})
    assert wrong.headers["www-authenticate"] == 'Bearer error="invalid_token"'
    right = {"Authorization": f"Bearer {server.token}"}
    assert server.get("/api/v1/vehicles", headers=right).status_code == 200
    with server.websocket_connect("ws://gcs.field:8080/api/v1/telemetry", headers=right) as socket:
        assert socket.receive_json()["type"] == "hello"
    with (
        pytest.raises(WebSocketDisconnect) as closed,
        server.websocket_connect("ws://gcs.field:8080/api/v1/telemetry"),
    ):
        pass
    assert closed.value.code == 1008


def test_a_page_that_is_opened_from_another_site_reloads_to_get_the_cookie(server):
    cross_site = HTML | {
        "Sec-Fetch-Site": "cross-site",
        "Sec-Fetch-Mode": "navigate",
        "Sec-Fetch-Dest": "document",
    }
    assert server.get("/", headers=cross_site).headers["refresh"] == "0"
    assert "refresh" not in server.get("/", headers=cross_site | {"Sec-Fetch-Site": "same-origin"}).headers


def test_the_sign_in_page_has_no_scripts_and_loads_nothing(server):
    response = server.get("/", headers=HTML)
    policy = response.headers["content-security-policy"]
    assert re.fullmatch(
        r"default-src 'none'; style-src 'sha256-[\w+/=]+'; form-action 'self'; "
        r"frame-ancestors 'self'; base-uri 'none'",
        policy,
    )
    assert not re.search(r"<script|<link|src=|style=|https?://", response.text)


def test_the_sign_in_page_is_german_for_a_german_browser_also_where_the_token_was_wrong(server):
    german = HTML | {"Accept-Language": "de-CH, de;q=0.9, en;q=0.8"}
    for response in (
        server.get("/", headers=german),
        server.get("/?token=wrong", headers=german),
        server.get("/", headers=german | {"Cookie": "gcs-token=wrong"}),
        server.post("/sign-in", data={"token": "wrong"}, headers=german | {"Origin": URL}),
    ):
        assert response.status_code == 401
        assert '<html lang="de">' in response.text
        assert "Anmelden" in response.text
        assert "not valid" not in response.text
        assert "Accept-Language" in response.headers["vary"]
    assert "not valid" in server.get("/?token=wrong", headers=german | {"Cookie": "gcs-language=en"}).text


def test_a_too_long_sign_in_form_is_refused(server):
    body = f"token={server.token}&more={'x' * 5000}"
    response = server.post("/sign-in", content=body, headers={"Origin": URL})
    assert response.status_code == 401


def test_wrong_tokens_are_logged_at_a_limited_rate_without_the_token(server, caplog):
    with caplog.at_level(logging.WARNING, "gcs_server.api.guard"):
        for _ in range(20):
            server.get("/", headers={"Authorization": "Bearer my-mistyped-secret"})
    assert len(caplog.records) == 1
    assert "mistyped" not in caplog.text
    assert (
        server.get("/api/v1/health", headers={"Authorization": f"Bearer {server.token}"}).status_code == 200
    )


# --- where the token comes from ------------------------------------------------------------------


def test_the_token_is_created_once_in_a_private_file(tmp_path):
    settings = Settings(host="0.0.0.0", data=tmp_path)
    token = token_of(settings)
    assert is_well_formed(token)
    assert token_of(settings) == token, "a restart would sign the pilot out"
    assert stat.S_IMODE((tmp_path / "token").stat().st_mode) == 0o600
    assert [path.name for path in tmp_path.iterdir()] == ["token"]
    (tmp_path / "token").unlink()
    assert token_of(settings) != token


def test_on_loopback_there_is_no_token_unless_one_is_set(tmp_path):
    assert token_of(Settings(data=tmp_path)) is None
    assert list(tmp_path.iterdir()) == []
    assert token_of(load({}, {"GCS_TOKEN": "sixteen-letters-x"})) == "sixteen-letters-x"
    file = tmp_path / "secret"
    file.write_text("from-docker-secrets\n")
    assert token_of(load({"token_file": file}, {})) == "from-docker-secrets"
    with pytest.raises(InvalidRequest, match="token_file"):
        token_of(load({"token_file": file}, {"GCS_TOKEN": "sixteen-letters-x"}))


@pytest.mark.parametrize("token", ["short", "has a blank in between", "schlüssel-schlüssel", "x" * 300])
def test_an_invalid_token_is_refused_and_does_not_appear_in_the_error(tmp_path, token):
    with pytest.raises(InvalidRequest) as caught:
        load({}, {"GCS_TOKEN": token})
    assert "GCS_TOKEN" in caught.value.message
    assert token not in caught.value.message
    (tmp_path / "token").write_text(token)
    with pytest.raises(StorageError) as refused:
        token_of(Settings(host="0.0.0.0", data=tmp_path))
    assert str(tmp_path / "token") in refused.value.message
    assert token not in refused.value.message


def test_an_error_about_a_missing_token_folder_names_the_folder(tmp_path):
    with pytest.raises(GcsError, match="missing"):
        token_of(Settings(token_file=tmp_path / "missing" / "token"))


def test_settings_never_show_the_token():
    settings = load({}, {"GCS_TOKEN": "sixteen-letters-x"})
    assert "sixteen" not in f"{settings!r} {settings} {settings.model_dump_json()}"


# --- how a user gets the token -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("host", "token", "in_container", "expected"),
    [
        ("127.0.0.1", None, False, ["http://localhost:80"]),
        ("localhost", "t", False, ["http://localhost:80/?token=t"]),
        ("::1", None, False, ["http://[::1]:80"]),
        ("192.168.1.5", "t", False, ["http://192.168.1.5:80/?token=t"]),
        ("0.0.0.0", "t", False, ["http://localhost:80/?token=t", "http://10.0.0.7:80/?token=t"]),
        ("::", "t", False, ["http://localhost:80/?token=t", "http://10.0.0.7:80/?token=t"]),
        ("0.0.0.0", "t", True, ["http://localhost:80/?token=t"]),
    ],
)
def test_the_printed_links_contain_the_token_and_an_address_that_a_browser_can_open(
    host, token, in_container, expected
):
    assert page_urls(host, 80, token, ["10.0.0.7"], in_container=in_container) == expected


@pytest.mark.parametrize(
    ("url", "token", "environment", "expected"),
    [
        ("http://h:1/", None, {}, ("http://h:1", None)),
        ("http://h:1/?token=t", None, {"GCS_TOKEN": "e"}, ("http://h:1", "t")),
        ("http://h:1/?token=t", "given", {"GCS_TOKEN": "e"}, ("http://h:1", "given")),
        ("https://h/gcs/", None, {"GCS_TOKEN": "e"}, ("https://h/gcs", "e")),
        ("http://h", "", {"GCS_TOKEN": "e"}, ("http://h", None)),
    ],
)
def test_the_client_accepts_the_printed_link(url, token, environment, expected):
    assert address_and_token(url, token, environment) == expected


def test_the_api_description_explains_the_token(server):
    api_description = server.get(
        "/api/v1/openapi.json", headers={"Authorization": f"Bearer {server.token}"}
    ).json()
    assert api_description["components"]["securitySchemes"]["token"]["scheme"] == "bearer"
    assert api_description["security"] == [{"token": []}, {}]
    assert "Bearer" in api_description["info"]["description"]
