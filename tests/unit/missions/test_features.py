"""GeoJSON and KML: the server's own files are read completely, other files as far as the formats define
them."""

from __future__ import annotations

import io
import json
import zipfile
from xml.etree.ElementTree import fromstring

import pytest
from hypothesis import given, settings

from missions.errors import PlanError
from missions.formats import geojson, kml
from missions.formats.results import Imported, ImportOptions
from missions.items import Waypoint
from missions.plan import Plan
from missions.values import Altitude, HomePosition, Point
from tests.support.plan_strategies import RESOLVED_ALTITUDES, plans

AT_20_M = ImportOptions(altitude=Altitude(value_m=20.0, reference="home"))


@settings(deadline=None, max_examples=40)
@given(plan=plans(altitudes=RESOLVED_ALTITUDES))
def test_any_plan_is_unchanged_after_writing_and_reading_geojson_and_kml(plan: Plan) -> None:
    without_speeds = plan.model_copy(update={"hover_speed_m_s": None, "cruise_speed_m_s": None})
    for written, read in ((geojson.write(plan), geojson.read), (kml.write(plan), kml.read)):
        assert read(written.data).plan == without_speeds
        assert bool(written.notes) == (plan != without_speeds)
    assert kml.read(kml.write_kmz(plan).data).plan == without_speeds


def feature_collection(*features: tuple[str | None, object]) -> bytes:
    feature_objects = [
        {
            "type": "Feature",
            "geometry": kind and {"type": kind, "coordinates": coordinates},
            "properties": None,
        }
        for kind, coordinates in features
    ]
    return json.dumps({"type": "FeatureCollection", "features": feature_objects}).encode()


def positions(imported: Imported) -> list[tuple[float, float]]:
    assert all(isinstance(item, Waypoint) for item in imported.plan.items)
    return [(item.lat_deg, item.lon_deg) for item in imported.plan.items if isinstance(item, Waypoint)]


def test_points_and_lines_of_other_programs_become_waypoints_and_areas_stay_areas() -> None:
    square = [[8.0, 47.0], [8.1, 47.0], [8.1, 47.1], [8.0, 47.0]]
    imported = geojson.read(
        feature_collection(
            ("Point", [8.5, 47.5, 900.0]),
            ("LineString", [[8.6, 47.6], [8.7, 47.7]]),
            ("MultiPolygon", [[square, square]]),
            (None, None),
        ),
        AT_20_M,
    )
    assert positions(imported) == [(47.5, 8.5), (47.6, 8.6), (47.7, 8.7)]
    assert {item.altitude for item in imported.plan.items if isinstance(item, Waypoint)} == {AT_20_M.altitude}
    (area,) = imported.areas
    assert area.outer == tuple(Point(lat_deg=lat, lon_deg=lon) for lon, lat in square[:3])
    assert len(area.holes) == 1
    assert imported.notes == ("The GeoJSON file has 1 area: choose a use for each.",)
    assert not imported.plan.fence


def test_an_altitude_without_a_reference_is_never_used() -> None:
    with pytest.raises(PlanError, match="feature 1, its altitude: the file does not state"):
        geojson.read(feature_collection(("Point", [8.5, 47.5, 900.0])))


KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Folder>
<Placemark><name>path</name><LineString><altitudeMode>%s</altitudeMode>
<coordinates> 8.5,47.5,30
8.6,47.6,31 </coordinates></LineString></Placemark>
<Placemark><name>field</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
8,47 8.1,47 8.1,47.1 8,47</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
</Folder></Document></kml>"""


@pytest.mark.parametrize(("mode", "reference"), [("absolute", "amsl"), ("relativeToGround", "terrain")])
def test_the_altitude_mode_of_kml_is_the_reference_of_its_altitudes(mode: str, reference: str) -> None:
    imported = kml.read((KML % mode).encode())
    assert positions(imported) == [(47.5, 8.5), (47.6, 8.6)]
    first = imported.plan.items[0]
    assert isinstance(first, Waypoint)
    assert (first.altitude.value_m, first.altitude.reference) == (30.0, reference)
    assert imported.areas[0].name == "field"


def test_kml_without_altitudes_needs_an_altitude_from_the_import() -> None:
    with pytest.raises(PlanError, match=r"feature 1 \(path\), its altitude"):
        kml.read((KML % "clampToGround").encode())
    assert len(kml.read((KML % "clampToGround").encode(), AT_20_M).plan.items) == 2


def test_written_kml_has_altitudes_above_mean_sea_level() -> None:
    plan = Plan(
        planned_home=HomePosition(lat_deg=47.0, lon_deg=8.0, alt_amsl_m=480.0),
        items=(Waypoint(lat_deg=47.1, lon_deg=8.1, altitude=Altitude(value_m=20.0, reference="home")),),
    )
    text = "".join(fromstring(kml.write(plan).data).itertext())
    assert "8.1,47.1,500.0" in text
    assert "absolute" in text


BILLION_LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE kml [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">'
    "]><kml><Placemark><name>&b;</name></Placemark></kml>"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BILLION_LAUGHS, "it has entities or a document type"),
        ('<!DOCTYPE kml SYSTEM "file:///etc/passwd"><kml/>', "it has entities or a document type"),
        ("<kml><Placemark>", "line 1, column 17: not valid XML"),
        ("", "not valid XML"),
        ("<a>" * 500, "too many elements"),
        (KML.replace("47.5,", "north,") % "absolute", "placemark 'path': '8.5,north,30' is not longitude"),
        (KML.replace("47.5,", "nan,") % "absolute", "placemark 'path': '8.5,nan,30' is not longitude"),
        (KML.replace("47.5,", "95,") % "absolute", r"feature 1 \(path\), field lat_deg"),
        (KML.replace(",30", ",1e7") % "absolute", r"feature 1 \(path\), field value_m"),
    ],
)
def test_hostile_kml_is_refused_with_a_reason(text: str, message: str) -> None:
    with pytest.raises(PlanError, match=message):
        kml.read(text.encode())


def kmz_file(name: str, content: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    return out.getvalue()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (kmz_file("doc.kml", b" " * 40_000_000), "its KML document is larger than 8 MiB"),
        (kmz_file("doc.txt", b""), "it has no KML document"),
        (kmz_file("doc.kml", b"<kml/>")[:40], "it cannot be unpacked"),
        (b"PK\x03\x04" + b"\x00" * 100, "it cannot be unpacked"),
    ],
    ids=["larger than 8 MiB", "no document", "incomplete", "zeros"],
)
def test_a_hostile_kmz_is_not_unpacked(data: bytes, message: str) -> None:
    with pytest.raises(PlanError, match=message):
        kml.read(data)
