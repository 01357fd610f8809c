"""A WMTS service by the address of its capabilities: its layers are listed, and one is a source as any
other; a service that answers with something else is refused in words."""

import threading

import pytest

from gcs_server.maps import downloads
from tests.support.api_client import api_client
from tests.support.tile_server import PNG, TileServer
from tests.support.wmts import description, layer, matrix_set


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with api_client(tmp_path_factory.mktemp("data")) as client:
        yield client


@pytest.fixture
def server():
    server = TileServer()
    server.base = server.url.partition("/{z}")[0]
    yield server
    server.close()


def layers_of(client, url):
    return client.post("/api/v1/map_sources/wmts_layers", json={"url": url})


def test_a_chosen_layer_is_a_source_as_any_other(client, server):
    template = f"{server.base}/rest/{{Style}}/{{TileMatrixSet}}/{{TileMatrix}}/{{TileRow}}/{{TileCol}}.png"
    server.answer = description(
        matrix_set(zooms=range(6, 15)), layer(template=template), layer("roads", title="Roads"),
        layer("utm", sets=("utm",)), kvp=f"{server.base}/kvp?",
    )  # fmt: skip
    read = layers_of(client, f"{server.base}/1.0.0/WMTSCapabilities.xml")
    assert read.status_code == 200, read.text
    service = read.json()
    assert (service["attribution"], service["others"]) == ("Office of Maps", 1)
    assert [each["name"] for each in service["layers"]] == ["Aerial images", "Roads"]
    assert [path for path, _ in server.asked] == ["/1.0.0/WMTSCapabilities.xml"]
    server.answer = None
    for each, path in zip(service["layers"], ("/rest/default/google/7/3/5.png", "/kvp?"), strict=True):
        added = client.post("/api/v1/map_sources", json={**each, "attribution": service["attribution"]})
        assert added.status_code == 201, added.text
        source = added.json()["id"]
        client.put("/api/v1/map_sources/chosen", json={"source": source})
        shown = client.get("/api/v1/maps").json()["maps"][0]
        assert (shown["min_zoom"], shown["max_zoom"], shown["attribution"]) == (6, 14, "Office of Maps")
        tile = client.get(f"/api/v1/map_sources/{source}/7/5/3")
        assert tile.content.startswith(PNG)
        assert server.asked[-1][0].startswith(path)
        assert client.get(f"/api/v1/map_sources/{source}/5/0/0").status_code == 204
        server.answer, server.status = b"<ExceptionReport><Exception exceptionCode='TileOutOfRange'/>", 400
        assert client.get(f"/api/v1/map_sources/{source}/8/0/0").status_code == 204  # outside the layer
        server.answer, server.status = None, 200


@pytest.mark.parametrize(
    ("status", "answer", "expected", "text"),
    [
        (200, b"<html>please sign in</html>", (422, "invalid_request"), "a web page"),
        (200, description(matrix_set(crs="EPSG:2056"), layer()), (422, "invalid_request"), "Web Mercator"),
        (200, b" " * 10_000_000, (502, "map_source_failed"), "more than 8 MB"),
        (503, b"", (502, "map_source_failed"), "status 503"),
    ],
)
def test_other_answers_are_named(client, server, status, answer, expected, text):
    server.status, server.answer = status, answer
    refused = layers_of(client, f"{server.base}/wmts")
    assert (refused.status_code, refused.json()["code"]) == expected
    assert text in refused.json()["detail"]


def test_no_answer_at_all_ends_in_words(client, server, monkeypatch):
    monkeypatch.setattr(downloads, "TIMEOUT_S", 0.05)  # only the total: the client has its own already
    waiting = threading.Event()
    server.answer = lambda _: str(waiting.wait(20)).encode()
    refused = layers_of(client, f"{server.base}/wmts")
    waiting.set()
    assert (refused.status_code, refused.json()["code"]) == (502, "map_source_failed")
    assert "127.0.0.1 does not describe its tiles: no answer in 0.1 s" in refused.json()["detail"]
    server.close()
    assert "does not describe" in layers_of(client, f"{server.base}/wmts").json()["detail"]


@pytest.mark.parametrize("url", ["file:///etc/passwd", "https://[::1/x", "http://", "https://a.example/a b"])
def test_only_addresses_of_the_web_are_asked(client, url):
    refused = layers_of(client, url)
    assert (refused.status_code, refused.json()["field"]) == (422, "url")


def test_the_smallest_zoom_of_a_source_is_not_above_its_largest(client):
    body = {"name": "Wrong", "url": "http://a.example/{z}/{x}/{y}", "min_zoom": 9, "max_zoom": 8}
    assert client.post("/api/v1/map_sources", json=body).json()["field"] == "min_zoom"
