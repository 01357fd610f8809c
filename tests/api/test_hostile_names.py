"""Hostile names and ids from clients: refused or not found, never a 5xx, and nothing is stored."""

import json
from itertools import product
from urllib.parse import quote

import pytest

from gcs_server.mavlink import router
from tests.support.api_client import api_client

HOSTILE_TEXTS = {
    "nul": "a\0b",
    "slash": "a/b",
    "parent folder": "../../etc/passwd",
    "two dots": "..",
    "long": "n" * 300,
    "longer": "n" * 5000,
    "long tlog": "n" * 300 + ".tlog",
    "long in bytes": "é" * 150 + ".tlog",
    "long pmtiles": "n" * 300 + ".pmtiles",
    "long mbtiles": "é" * 150 + ".mbtiles",
    "newline": "a\r\nX-Evil: 1",
    "blank": " ",
    "right to left": "\u202eevil",
    "emoji": "🚁" * 60,
    "digits": "9" * 400,
    "superscript": "²",
    "percent": "%00%2f%s%n",
    "markup": "<script>alert(1)</script>",
    "nul tlog": "a\0b.tlog",
    "tilde": "1~" + "9" * 5000,
}
INVALID_ENCODINGS = ["%ff%fe", "%ED%A0%80", "%2e%2e%2f", "%", "%00.tlog", "%ff.pmtiles"]
"""Invalid UTF-8 and invalid percent encodings."""


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    for folder in ("maps", "recordings"):
        (data / folder).mkdir()
    with api_client(data, record=True, raise_server_exceptions=False) as client:
        yield client


def calls(client):
    """Method and path for each route and path parameter, with each hostile text as that parameter."""
    for path, methods in client.get("/api/v1/openapi.json").json()["paths"].items():
        parts = path.split("/")
        parameter_indices = [index for index, part in enumerate(parts) if part.startswith("{")]
        for parameter_index, method in product(parameter_indices, methods):
            for value in [*(quote(text, safe="") for text in HOSTILE_TEXTS.values()), *INVALID_ENCODINGS]:
                filled_parts = [
                    "1" if index in parameter_indices else part for index, part in enumerate(parts)
                ]
                filled_parts[parameter_index] = value
                yield method.upper(), "/".join(filled_parts)


@pytest.mark.story
def test_hostile_names_in_paths_never_cause_a_5xx(client):
    statuses = {
        (method, path): client.request(method, path, content=b"{}").status_code
        for method, path in calls(client)
    }
    assert len(statuses) > 500
    assert {call: status for call, status in statuses.items() if status >= 500} == {}


@pytest.mark.parametrize("text", HOSTILE_TEXTS.values(), ids=HOSTILE_TEXTS.keys())
def test_a_link_with_a_hostile_name_is_refused_and_the_error_names_the_field(client, text):
    response = client.post("/api/v1/links", json={"url": "udpin://127.0.0.1:0", "name": text})
    assert (response.status_code, response.json()["field"]) == (422, "name")
    assert client.get("/api/v1/links").json()["links"] == []


@pytest.mark.parametrize("url", ["udpin://{}:14999", "tcp://{}:14999", "serial:///dev/{}", "tlog:///tmp/{}"])
@pytest.mark.parametrize("text", HOSTILE_TEXTS.values(), ids=HOSTILE_TEXTS.keys())
def test_a_link_with_a_hostile_address_is_refused_or_can_be_deleted(client, url, text):
    for address in (text, quote(text, safe="")):
        response = client.post("/api/v1/links", json={"url": url.format(address)})
        if response.status_code != 201:
            assert response.status_code in (409, 422), response.text
            assert response.json()["detail"]
        else:
            name = response.json()["name"]
            assert 1 <= len(name) <= 64
            assert name == quote(name, safe="")
            assert client.delete(f"/api/v1/links/{name}").status_code == 204
    assert client.get("/api/v1/links").json()["links"] == []


def test_a_link_that_fails_to_start_is_removed(client, monkeypatch):
    monkeypatch.setattr("gcs_server.links.base.Link.start", lambda *_: 1 / 0)
    for _ in range(2):
        response = client.post("/api/v1/links", json={"url": "udpin://127.0.0.1:0", "name": "one"})
        assert response.status_code == 500
    assert client.get("/api/v1/links").json()["links"] == []
    monkeypatch.undo()
    assert client.post("/api/v1/links", json={"url": "udpin://127.0.0.1:0", "name": "one"}).status_code == 201
    assert client.delete("/api/v1/links/one").status_code == 204


@pytest.mark.parametrize("text", HOSTILE_TEXTS.values(), ids=HOSTILE_TEXTS.keys())
def test_hostile_names_in_bodies_never_cause_a_5xx(client, text):
    position = {"type": "position", "position_ned_m": [0, 0, -5]}
    for path, body in (
        ("replays", {"recording": text}),
        ("groups", {"members": [{"vehicle": v, "setpoint": position} for v in (text, "2")]}),
        ("groups/1/setpoints", {"setpoints": [{"vehicle": text, "setpoint": position}]}),
        ("vehicles/1/control/grant", {"client": text}),
        ("vehicles/1/control/request", {"reason": text}),
        ("vehicles/1/mode", {"mode": text}),
        ("vehicles/1/kill", {"confirm": text}),
        ("vehicles/1/land_now", {"confirm": text}),
        ("links", {"url": text}),
    ):
        response = client.post(f"/api/v1/{path}", content=json.dumps(body))
        assert response.status_code < 500, (path, response.text)


HIDDEN_CHARACTERS = "\0\n\x1b\x7f\x85\u2028\u202e\u2066\u200f"
HOME = {"value_m": 20, "reference": "home"}
MAST = {"polygon": [{"lat_deg": 47, "lon_deg": 8 + n} for n in range(3)], "top": HOME}


@pytest.mark.parametrize("character", HIDDEN_CHARACTERS, ids=lambda each: f"U+{ord(each):04X}")
def test_a_name_with_an_invisible_character_is_refused_wherever_it_is_given(client, character):
    name, plan = f"a{character}b", {"items": []}
    mission = {"format": "offboard-gcs-mission", "name": "Mast", "steps": [{"step": "land"}]}
    bodies = [
        ("plans", {"name": name, "plan": plan}),
        ("plans/check", {"plan": {**plan, "obstacles": [{**MAST, "name": name}]}}),
        ("plans/check", {"plan": {**mission, "name": name}}),
        ("plans/check", {"plan": {**mission, "steps": [{"step": "land", "name": name}]}}),
        ("plans/check", {"plan": {**mission, "missions": {name: [{"step": "land"}]}}}),
        ("links", {"url": "udpin://127.0.0.1:0", "name": name}),
    ]
    for path, body in bodies:
        response = client.post(f"/api/v1/{path}", content=json.dumps(body))
        assert response.status_code == 422, (path, body)
    assert f"U+{ord(character):04X}" in client.post("/api/v1/plans", json=bodies[0][1]).json()["detail"]


def test_names_in_other_scripts_and_with_emoji_are_allowed(client):
    for name in ("Übung 3", "פרויקט", "مشروع", "测绘", "🚁 north", "می\u200cخواهم"):
        response = client.post("/api/v1/plans", json={"name": name, "plan": {"items": []}})
        assert response.status_code == 201, response.text


def test_an_imported_file_with_hidden_characters_gives_names_without_them(client):
    ring = [[8, 47], [8.001, 47], [8.001, 47.001], [8, 47]]
    area = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {"name": "a\u202eb"}, "geometry": area}
    file = json.dumps({"type": "FeatureCollection", "features": [feature]})
    response = client.post("/api/v1/plans/import?filename=a.geojson", content=file)
    assert [each["name"] for each in response.json()["areas"]] == ["a b"], response.text


def test_the_number_of_links_is_limited_and_a_removed_link_makes_room(client, monkeypatch):
    monkeypatch.setattr(router, "MAX_LINKS", 3)
    names = [f"link{n}" for n in range(3)]
    for name in names:
        body = {"url": "udpin://127.0.0.1:0", "name": name}
        assert client.post("/api/v1/links", json=body).status_code == 201
    refused = client.post("/api/v1/links", json={"url": "udpin://127.0.0.1:0", "name": "more"})
    assert (refused.status_code, refused.json()["code"]) == (409, "refused")
    assert "3 links and replays are open" in refused.json()["detail"]
    for name in names:
        assert client.delete(f"/api/v1/links/{name}").status_code == 204


@pytest.mark.parametrize("text", ["\ud800", "a\ud800b.tlog"])
def test_a_lone_surrogate_in_a_name_is_refused(client, text):
    for path, body in (("links", {"url": text}), ("replays", {"recording": text})):
        assert client.post(f"/api/v1/{path}", content=json.dumps(body)).status_code in (404, 422)


@pytest.mark.parametrize("name", [b"\xff\xfe", b"a" * 5000, b"\xc2\x85x", b"%00", b"\x01\x02"])
def test_any_client_name_is_allowed(client, name):
    headers = [(b"x-client", name), (b"x-client-id", name)]
    assert client.get("/api/v1/me", headers=headers).status_code == 200
    assert client.post("/api/v1/vehicles/1/arm", headers=headers).status_code == 404
    assert client.get("/api/v1/journal").status_code == 200


def test_a_key_in_a_links_url_never_appears_in_responses_journal_log_or_warnings(client, caplog):
    secret = bytes(range(32)).hex()
    response = client.post("/api/v1/links", json={"url": f"udpin://127.0.0.1:0?key={secret}"})
    assert (response.status_code, response.json()["field"]) == (422, "key")
    entries = client.get("/api/v1/journal?limit=1").json()["entries"]
    assert entries[0]["arguments"]["url"] == "udpin://127.0.0.1:0?key=(not shown)"
    published_texts = response.text + json.dumps(entries) + caplog.text + client.get("/api/v1/warnings").text
    assert secret not in published_texts
