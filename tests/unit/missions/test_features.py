"""GeoJSON and KML: the server's own files are read completely, other files as far as the formats define
them."""

from __future__ import annotations

import io
import json
import zipfile
from xml.etree.ElementTree import fromstring

import pytest
from hypothesis import assume, given, settings

from missions.errors import PlanError
from missions.formats import any_format, geojson, kml
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
    assume(without_speeds != Plan())  # a file with nothing in it is refused
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
    altitudes = [item.altitude.value_m for item in imported.plan.items if isinstance(item, Waypoint)]
    assert altitudes == [900.0, 20.0, 20.0]
    (area,) = imported.areas
    assert area.outer == tuple(Point(lat_deg=lat, lon_deg=lon) for lon, lat in square[:3])
    assert len(area.holes) == 1
    assert imported.notes == (
        "The GeoJSON file: it has 1 altitude of 900 m; they are kept, as altitudes above home.",
        "The GeoJSON file has 1 area: choose a use for each.",
    )
    assert not imported.plan.fence


HEIGHTS = feature_collection(("LineString", [[8.5, 47.5, 5], [8.6, 47.5, 15], [8.6, 47.6, 60]]))


def test_heights_of_a_file_are_kept_and_only_their_reference_is_asked_for() -> None:
    with pytest.raises(PlanError, match="it has 3 altitudes from 5 to 60 m, but does not state") as refused:
        geojson.read(HEIGHTS)
    assert refused.value.field == "altitude_reference"
    for options in (ImportOptions(reference="home"), AT_20_M):
        items = geojson.read(HEIGHTS, options).plan.items
        altitudes = [item.altitude for item in items if isinstance(item, Waypoint)]
        assert [each.value_m for each in altitudes] == [5.0, 15.0, 60.0]
        assert {each.reference for each in altitudes} == {"home"}


def test_heights_that_are_all_0_are_no_heights() -> None:
    flat = feature_collection(("LineString", [[8.5, 47.5, 0], [8.6, 47.5, 0.0]]))
    with pytest.raises(PlanError, match="its altitude: the file does not state it") as refused:
        geojson.read(flat, ImportOptions(reference="amsl"))
    assert refused.value.field == "altitude_m"
    items = geojson.read(flat, AT_20_M).plan.items
    assert [item.altitude for item in items if isinstance(item, Waypoint)] == [AT_20_M.altitude] * 2


HOLE_KML = """<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>%s</name><Polygon>
<outerBoundaryIs><LinearRing><coordinates>
8,47 8.1,47 8.1,47.1 8,47.1 8,47</coordinates></LinearRing></outerBoundaryIs>
<innerBoundaryIs><LinearRing><coordinates>
8.04,47.04 8.06,47.04 8.06,47.06 8.04,47.04</coordinates></LinearRing></innerBoundaryIs>
</Polygon></Placemark></kml>"""


def test_an_area_is_asked_about_and_keeps_its_holes() -> None:
    imported = kml.read((HOLE_KML % "site").encode())
    assert imported.plan == Plan(), "an area alone is not part of the plan"
    (area,) = imported.areas
    inside, outside, survey = area.uses
    assert [zone.inclusion for zone in inside.fence] == [True, False]
    assert [len(zone.polygon) for zone in inside.fence if zone.shape == "polygon"] == [4, 3]
    assert [zone.inclusion for zone in outside.fence] == [False]
    assert (survey.use, survey.fence, len(area.holes)) == ("survey", (), 1)
    assert "1 hole" in inside.text
    assert area.likely_use is None


@pytest.mark.parametrize("name", ["No-fly zone 3", "NFZ", "exclusion", "Keep out", "PROHIBITED"])
def test_the_name_of_a_no_fly_area_suggests_to_stay_out_of_it(name: str) -> None:
    (area,) = kml.read((HOLE_KML % name).encode()).areas
    assert area.likely_use == "stay_outside"


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
    imported = kml.read((KML % "clampToGround").encode(), AT_20_M)
    assert [item.altitude for item in imported.plan.items if isinstance(item, Waypoint)] == [
        AT_20_M.altitude,
        AT_20_M.altitude,
    ]
    assert "clamps its altitudes to the ground" in imported.notes[0]


GX = 'xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"'


def test_a_gx_track_is_a_path_without_its_times() -> None:
    track = (
        "<gx:Track><altitudeMode>absolute</altitudeMode><when>2020-01-01T00:00:00Z</when>"
        "<when>2020-01-01T00:00:01Z</when><gx:coord>8.5 47.3 500</gx:coord><gx:coord>8.6 47.4 510</gx:coord>"
        "</gx:Track>"
    )
    for text in (track, f"<gx:MultiTrack>{track}</gx:MultiTrack>"):
        imported = kml.read(f"<kml {GX}><Placemark><name>t</name>{text}</Placemark></kml>".encode())
        assert positions(imported) == [(47.3, 8.5), (47.4, 8.6)]
        heights = [i.altitude for i in imported.plan.items if isinstance(i, Waypoint)]
        assert [(each.value_m, each.reference) for each in heights] == [(500.0, "amsl"), (510.0, "amsl")]
        assert "the times of 1 gx:Track" in imported.notes[-1]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("<kml><Placemark><LinearRing><coordinates>8,47 9,47</coordinates></LinearRing></Placemark></kml>",
         "found: 1 LinearRing, 1 Placemark without point"),
        ("<kml><Placemark><Model><Location/></Model></Placemark></kml>", "found: 1 Model"),
        ("<kml><Document><GroundOverlay/><NetworkLink/></Document></kml>", "1 GroundOverlay, 1 NetworkLink"),
        ("<kml/>", "found: no point, line or area"),
        ("<gpx><trk><trkseg><trkpt lat='47' lon='8'/></trkseg></trk></gpx>", "but a GPX file"),
        ("<svg xmlns='http://www.w3.org/2000/svg'><path d='M0 0'/></svg>", "but an SVG picture"),
        ("<!DOCTYPE html><html><body>Sign in<br></body></html>", "but a web page"),
        ("<!DOCTYPE svg PUBLIC 'x' 'y'><svg/>", "but an SVG picture"),
        ("<TrainingCenterDatabase/>", "XML of the kind <TrainingCenterDatabase>"),
    ],
)  # fmt: skip
def test_a_file_without_anything_to_import_is_refused_with_what_was_found(text: str, found: str) -> None:
    with pytest.raises(PlanError, match=found):
        kml.read(text.encode(), AT_20_M)


def test_an_empty_geojson_is_refused() -> None:
    with pytest.raises(PlanError, match="nothing in it can be imported"):
        geojson.read(feature_collection((None, None)), AT_20_M)


def test_what_is_not_understood_beside_a_path_is_named() -> None:
    text = (KML % "absolute").replace("</Folder>", "<Placemark><Model/></Placemark></Folder>")
    assert "Left out: 1 Model." in kml.read(text.encode()).notes


DJI = """<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:wpml="http://www.dji.com/wpmz/1.0.2"><Document><Folder>
<wpml:executeHeightMode>%s</wpml:executeHeightMode>
<Placemark><Point><coordinates>8.545,47.397</coordinates></Point><wpml:executeHeight>5</wpml:executeHeight></Placemark>
<Placemark><Point><coordinates>8.546,47.397</coordinates></Point><wpml:executeHeight>60</wpml:executeHeight></Placemark>
</Folder></Document></kml>"""


def test_dji_waylines_keep_their_heights() -> None:
    def heights(imported: Imported) -> list[tuple[float, str]]:
        items = [each for each in imported.plan.items if isinstance(each, Waypoint)]
        return [(each.altitude.value_m, each.altitude.reference) for each in items]

    relative = (DJI % "relativeToStartPoint").encode()
    assert heights(kml.read(relative)) == [(5.0, "home"), (60.0, "home")]
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("wpmz/template.kml", DJI % "WGS84")
        file.writestr("wpmz/waylines.wpml", relative)
    assert heights(kml.read(archive.getvalue())) == [(5.0, "home"), (60.0, "home")]
    with pytest.raises(PlanError, match="from 5 to 60 m above the WGS84 ellipsoid") as refused:
        kml.read((DJI % "WGS84").encode())
    assert refused.value.field == "altitude_reference"
    asked = kml.read((DJI % "WGS84").encode(), ImportOptions(reference="amsl"))
    assert heights(asked) == [(5.0, "amsl"), (60.0, "amsl")]


TEMPLATE = """<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:wpml="http://www.dji.com/wpmz/1.0.2"><Document><Folder>
<wpml:waylineCoordinateSysParam><wpml:heightMode>EGM96</wpml:heightMode></wpml:waylineCoordinateSysParam>
<wpml:globalHeight>80</wpml:globalHeight>
<Placemark><Point><coordinates>8.545,47.397</coordinates></Point><wpml:useGlobalHeight>1</wpml:useGlobalHeight>
<wpml:ellipsoidHeight>99</wpml:ellipsoidHeight><wpml:height>51</wpml:height></Placemark>
<Placemark><Point><coordinates>8.546,47.397</coordinates></Point><wpml:useGlobalHeight>0</wpml:useGlobalHeight>
<wpml:ellipsoidHeight>99</wpml:ellipsoidHeight><wpml:height>52</wpml:height></Placemark>
</Folder></Document></kml>"""


def test_a_dji_template_has_a_global_height_or_one_for_each_point() -> None:
    items = kml.read(TEMPLATE.encode()).plan.items
    altitudes = [each.altitude for each in items if isinstance(each, Waypoint)]
    assert [(each.value_m, each.reference) for each in altitudes] == [(80.0, "amsl"), (52.0, "amsl")]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_a_file_may_be_in_utf_16_and_have_a_byte_order_mark(encoding: str) -> None:
    mark = "" if encoding in ("utf-8-sig", "utf-16") else "\ufeff"
    for text in (KML % "absolute", HEIGHTS.decode()):
        data = (mark + text).replace("UTF-8", "UTF-16").encode(encoding)
        read = any_format.read(any_format.recognise(data), data, ImportOptions(reference="amsl"))
        assert isinstance(read.plan, Plan)
        assert len(read.plan.items) in (2, 3)


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
