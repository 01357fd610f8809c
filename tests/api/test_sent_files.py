"""The page's files are sent compressed and cached; the 3D view is downloaded once."""

import gzip
import re
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from gcs_server.app import create_app
from gcs_server.encodings import accepted_encodings
from gcs_server.scene.page import page
from tests.station import wait_until
from tests.support.api_client import settings_for

BUILT_PAGE = Path(__file__).resolve().parents[2] / "gcs_server" / "static"
FIRST_LOAD_BYTES = 140_000
SCRIPT = b"console.log('page');" * 200


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    (data / "index.html").write_text("<!doctype html><title>page</title>")
    (data / "index.de.html").write_text('<!doctype html><html lang="de"><title>Seite</title>')
    (data / "assets").mkdir()
    (data / "assets/index-1a.js").write_bytes(SCRIPT)
    (data / "assets/index-1a.js.gz").write_bytes(gzip.compress(SCRIPT))
    (data / "assets/index-1a.js.br").write_bytes(b"brotli form")
    (data / "assets/small-1a.js").write_bytes(b"1;")
    app = create_app(settings_for(data, scene=True), static=data)
    with TestClient(app, base_url="http://localhost") as client:
        yield client


def sent_bytes(client, path, accepted):
    with client.stream("GET", path, headers={"Accept-Encoding": accepted}) as response:
        return response, b"".join(response.iter_raw())


def test_a_file_is_sent_in_the_smallest_form_that_the_build_wrote_and_the_browser_accepts(client):
    forms = {"br, gzip": ("br", b"brotli form"), "gzip, deflate": ("gzip", gzip.compress(SCRIPT))}
    tags = set()
    for accepted, (encoding, content) in forms.items():
        response, sent = sent_bytes(client, "/assets/index-1a.js", accepted)
        assert (response.headers["content-encoding"], len(sent)) == (encoding, len(content))
        assert response.headers["content-type"].startswith("text/javascript")
        assert response.headers["vary"] == "Accept-Encoding"
        assert response.headers["cache-control"] == "public, max-age=31536000, immutable"
        tags.add(response.headers["etag"])
    response, sent = sent_bytes(client, "/assets/index-1a.js", "identity")
    assert sent == SCRIPT
    assert "content-encoding" not in response.headers
    assert response.headers["vary"] == "Accept-Encoding"
    assert len(tags | {response.headers["etag"]}) == 3


def test_a_file_without_a_compressed_form_is_sent_as_it_is(client):
    for path in ("/assets/small-1a.js", "/"):
        response, _ = sent_bytes(client, path, "br, gzip")
        assert response.status_code == 200
        assert "content-encoding" not in response.headers
    assert response.headers["cache-control"] == "no-cache"


def test_a_cached_file_is_not_sent_again(client):
    tag = sent_bytes(client, "/assets/index-1a.js", "br")[0].headers["etag"]
    headers = {"Accept-Encoding": "br", "If-None-Match": tag}
    response = client.get("/assets/index-1a.js", headers=headers)
    assert (response.status_code, response.content, response.headers["vary"]) == (304, b"", "Accept-Encoding")


@pytest.mark.parametrize(
    ("cookie", "accepted", "title"),
    [
        ("gcs-language=de", "en", "Seite"),
        ("other=1; gcs-language=de", "", "Seite"),
        ("gcs-language=en", "de", "page"),
        ("gcs-language=fr", "", "page"),
        ("gcs-language=../../de", "", "page"),
        ("gcs-language", "", "page"),
        ("=;;gcs-language=\x01", "", "page"),
        ("", "", "page"),
        ("", "de", "Seite"),
        ("", "de-AT,de;q=0.9,en;q=0.8", "Seite"),
        ("", "en-US,en;q=0.9,de;q=0.8", "page"),
        ("", "fr;q=0.9, DE ; q=0.2", "Seite"),
        ("", "fr, de;q=0", "page"),
        ("gcs-language=fr", "de", "Seite"),
        ("", "de;q=" + "9" * 500 + ",\x01;;=", "page"),
    ],
)
def test_the_page_is_sent_in_the_language_that_a_person_chose_or_else_the_browser_prefers(
    client, cookie, accepted, title
):
    for path in ("/", "/index.html"):
        response = client.get(path, headers={"Cookie": cookie, "Accept-Language": accepted})
        assert f"<title>{title}</title>" in response.text
        assert response.headers["cache-control"] == "no-cache"
        assert response.headers["vary"] == "Accept-Encoding, Cookie, Accept-Language"


@pytest.mark.parametrize(
    ("header", "accepted"),
    [
        ("gzip, deflate, br, zstd", ["br", "gzip"]),
        ("GZIP;q=0.5", ["gzip"]),
        ("br;q=0, gzip;q=0.000", []),
        ("br; q=0.1", ["br"]),
        ("", []),
        ("*", []),
    ],
)
def test_only_encodings_that_the_browser_names_are_used(header, accepted):
    assert accepted_encodings(header) == accepted


def test_whether_the_3d_view_runs_is_told_without_sending_it_and_the_page_is_sent_compressed_once(client):
    wait_until(lambda: client.head("/scene/").status_code != 503, "the 3D view", timeout_s=30)
    response = client.head("/scene/")
    assert (response.status_code, response.content) == (200, b"")
    assert response.headers["content-type"].startswith("text/html")
    response, sent = sent_bytes(client, "/scene/", "gzip")
    assert len(sent) < 0.85 * len(page().plain)  # viser has compressed most of it already
    cached = client.get("/scene/", headers={"If-None-Match": response.headers["etag"]})
    assert (cached.status_code, cached.content) == (304, b"")


def first_load(built: Path) -> set[Path]:
    """The files that a browser needs to show the page: document, scripts with what they import at once,
    styles, and the font of Latin letters."""
    index = built / "index.html"
    files = {index, built / "icon.svg", *built.glob("assets/inter-latin-wght-*.woff2")}
    waiting = re.findall(r'(?:src|href)="/(assets/[^"]+)"', index.read_text())
    while waiting:
        file = built / waiting.pop()
        if file in files:
            continue
        files.add(file)
        if file.suffix == ".js":
            static_import = r"""(?:import|from)\s*["']\./([^"']+)["']"""
            waiting += [f"assets/{name}" for name in re.findall(static_import, file.read_text())]
    return files


@pytest.mark.skipif(not (BUILT_PAGE / "index.html").exists(), reason="the page is not built")
def test_the_first_load_of_the_built_page_is_small():
    files = first_load(BUILT_PAGE)
    assert {file.suffix for file in files} == {".html", ".svg", ".js", ".css", ".woff2"}
    compressed = [Path(f"{file}.br") for file in files]
    sizes = [
        (sent if sent.exists() else file).stat().st_size for file, sent in zip(files, compressed, strict=True)
    ]
    assert sum(sizes) < FIRST_LOAD_BYTES, {file.name: size for file, size in zip(files, sizes, strict=True)}
