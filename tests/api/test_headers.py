"""The security headers of every response: only this server's own files may run or load."""

import re

import pytest
from fastapi.testclient import TestClient
from starlette.routing import Route

from gcs_server.app import create_app
from tests.station import wait_until
from tests.support.api_client import settings_for


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    (data / "index.html").write_text("<!doctype html><title>page</title>")
    app = create_app(settings_for(data, scene=True), static=data)

    async def raise_error(_):
        raise RuntimeError("boom")

    app.router.routes.insert(0, Route("/broken", raise_error))
    with TestClient(app, base_url="http://localhost", raise_server_exceptions=False) as client:
        yield client


def directives(response):
    parts = (part.split() for part in response.headers["content-security-policy"].split(";"))
    return {part[0]: part[1:] for part in parts}


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/", 200),
        ("/docs", 200),
        ("/docs/reference.js", 200),
        ("/api/v1/health", 200),
        ("/api/v1/openapi.json", 200),
        ("/api/v1/vehicles/77", 404),
        ("/nothing", 404),
        ("/broken", 500),
    ],
)
def test_every_response_has_the_security_headers(client, path, status):
    response = client.get(path)
    assert response.status_code == status
    policy = directives(response)
    assert policy["default-src"] == ["'none'"]
    assert policy["script-src"] == policy["style-src"] == policy["frame-src"] == ["'self'"]
    assert policy["frame-ancestors"] == ["'self'"]
    assert policy["connect-src"] == ["'self'", "ws://localhost"]
    assert "unsafe" not in response.headers["content-security-policy"]
    assert response.headers["x-content-type-options"] == "nosniff"
    assert response.headers["x-frame-options"] == "SAMEORIGIN"
    assert response.headers["referrer-policy"] == "same-origin"


def test_the_headers_of_a_refusal_do_not_contain_the_invalid_host_name(client):
    response = client.get("/api/v1/health", headers={"Host": "x; script-src *"})
    assert response.status_code == 400
    assert directives(response)["connect-src"] == ["'self'"]
    assert directives(response)["script-src"] == ["'self'"]


def test_the_3d_view_has_its_own_policy(client):
    wait_until(lambda: client.get("/scene/").status_code != 503, "the 3D view", timeout_s=30)
    response = client.get("/scene/")
    assert response.status_code == 200
    assert "'unsafe-inline'" in directives(response)["script-src"]
    assert response.headers["referrer-policy"] == "no-referrer"
    assert len(response.headers.get_list("content-security-policy")) == 1
    assert response.headers["x-frame-options"] == "SAMEORIGIN"


def test_the_api_reference_loads_nothing_from_other_sites(client):
    assert client.get("/api/v1/docs", follow_redirects=False).headers["location"] == "/docs"
    texts = [client.get(path).text for path in ("/docs", "/docs/reference.js", "/docs/reference.css")]
    assert not [text for text in texts if re.search(r"https?://|\burl\(|\bimport\b", text)]
    assert 'href="/"' in texts[0]
