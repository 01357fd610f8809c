"""WMTS: layers in Web Mercator become addresses of tiles, however a service names its zooms; anything else
is refused in words."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.maps import wmts
from gcs_server.maps.sources import MapSource
from missions.errors import PlanError
from tests.support.wmts import description, layer, matrix_set

TEMPLATE = "https://a.example/{Style}/{TileMatrixSet}/{TileMatrix}/{TileRow}/{TileCol}.png"


def tile_of(found, zoom=5, x=17, y=11):
    """The address of a tile of a layer, as the server asks for it."""
    return MapSource("x", "x", found.url, "", found.max_zoom, may_save=False).tile_url(zoom, x, y)


def only_layer(*contents, **options):
    (found,) = wmts.read(description(*contents, **options)).layers
    return found


def test_a_template_of_the_service_becomes_the_address_of_its_tiles():
    service = wmts.read(description(matrix_set(), layer(template=TEMPLATE)))
    (found,) = service.layers
    assert (service.attribution, service.others, found.name) == ("Office of Maps", 0, "Aerial images")
    assert (found.min_zoom, found.max_zoom) == (0, 19)
    assert tile_of(found) == "https://a.example/default/google/5/11/17.png"


def test_a_service_without_templates_is_asked_by_parameters():
    found = only_layer(matrix_set(), layer("a b", image="image/jpeg"), kvp="https://a.example/ows?map=1&amp;")
    assert tile_of(found) == (
        "https://a.example/ows?map=1&SERVICE=WMTS&REQUEST=GetTile&VERSION=1.0.0&LAYER=a%20b&FORMAT=image/jpeg"
        "&STYLE=default&TILEMATRIXSET=google&TILEMATRIX=5&TILEROW=11&TILECOL=17"
    )
    assert "?SERVICE=" in only_layer(matrix_set(), layer(), kvp="https://a.example/ows").url


@pytest.mark.parametrize(
    ("named", "zooms", "tile", "first", "last"),
    [
        (str, range(20), "/5/", 0, 19),
        (lambda zoom: f"{zoom:02d}", range(15), "/05/", 0, 14),
        (lambda zoom: f"EPSG:900913:{zoom}", range(25), "/EPSG:900913:5/", 0, 24),
        (str, range(6, 19), "/5/", 6, 18),
        (lambda zoom: str(zoom) if zoom < 8 else f"fine{zoom}", range(12), "/5/", 0, 7),
        (str, (0, 1, 2, 3, 5, 6), "/5/", 0, 3),
    ],
)
def test_zooms_are_found_by_their_scale_whatever_they_are_called(named, zooms, tile, first, last):
    found = only_layer(matrix_set(named=named, zooms=zooms), layer(template=TEMPLATE))
    assert (found.min_zoom, found.max_zoom) == (first, last)
    assert tile in tile_of(found)


def test_tiles_of_512_pixels_have_the_zoom_of_their_area():
    found = only_layer(matrix_set(tile_px=512, zooms=range(10)), layer(template=TEMPLATE))
    assert (found.min_zoom, found.max_zoom) == (0, 9)


def test_a_layer_may_use_only_some_zooms_of_its_set():
    found = only_layer(matrix_set(), layer(template=TEMPLATE, limits=("7", "8", "9")))
    assert (found.min_zoom, found.max_zoom) == (7, 9)


def test_other_dimensions_have_their_default():
    time = "<Dimension><ows:Identifier>Time</ows:Identifier><Default>2024-06</Default></Dimension>"
    template = TEMPLATE.replace("{Style}", "{time}")
    assert "/2024-06/" in only_layer(matrix_set(), layer(template=template, more=time)).url
    with pytest.raises(PlanError, match="none of its 1 layers"):  # a value that nobody knows
        wmts.read(description(matrix_set(), layer(template=template)))


def test_layers_that_the_map_cannot_show_are_counted():
    service = wmts.read(
        description(
            matrix_set(),
            matrix_set("utm", crs="urn:ogc:def:crs:EPSG::25832"),
            matrix_set("clipped", corner="1000000 6000000"),
            layer("a", template=TEMPLATE, sets=("utm", "google")),
            layer("b", template=TEMPLATE, sets=("utm",)),
            layer("c", template=TEMPLATE, sets=("clipped",)),
            layer("d", template=TEMPLATE, image="application/vnd.mapbox-vector-tile"),
            layer("e", template="ftp://a.example/{TileMatrix}/{TileRow}/{TileCol}"),
            layer("f"),  # neither a template nor parameters
        )
    )
    assert ([each.url for each in service.layers], service.others) == (
        ["https://a.example/default/google/{z}/{y}/{x}.png"],
        5,
    )


ENTITIES = b'<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><Capabilities>&b;</Capabilities>'


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"<!DOCTYPE html><html><body>Sign in</body></html>", "a web page"),
        (b"<WMS_Capabilities/>", "a WMS service, which has no tiles"),
        (b"<ows:ExceptionReport xmlns:ows='x'><e> No\n key </e></ows:ExceptionReport>", "it refuses: No key"),
        (ENTITIES, "entities or a document type"),
        (b"", "no valid XML"),
        (b"\x89PNG\r\n", "no valid XML"),
        (b"<?xml version='1.0' encoding='nothing'?><a/>", "no valid XML"),
        (b"<kml/>", "XML of the kind <kml>"),
        (description(), "it has no layer"),
        (description(matrix_set(crs="EPSG:4326"), layer(template=TEMPLATE)), "Web Mercator (EPSG:3857)"),
    ],
)
def test_what_is_no_description_is_refused_in_words(content, text):
    with pytest.raises(PlanError) as refused:
        wmts.read(content)
    assert text in str(refused.value)
    assert refused.value.field == "url"


WHOLE = description(matrix_set(zooms=range(3)), layer(template=TEMPLATE), kvp="https://a.example/")


@given(st.integers(0, len(WHOLE)), st.integers(0, 40), st.binary(max_size=12))
def test_a_damaged_description_is_read_or_refused(at, removed, put):
    try:
        service = wmts.read(WHOLE[:at] + put + WHOLE[at + removed :])
    except PlanError:
        return
    for each in service.layers:
        assert dataclasses.astuple(each)[2:] <= (24, 24)
