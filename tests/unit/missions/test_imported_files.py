"""Files as other programs write them become plans with the right positions, heights, home and geofence, or
are refused with a sentence. `shared/cases` has one file of each kind; fifty relatives are generated here."""

from __future__ import annotations

import io
import json
import math
import random
import zipfile
from pathlib import Path

import pytest

from missions.checks import check
from missions.errors import PlanError
from missions.formats import any_format, qgc_plan, waypoints
from missions.formats.results import Imported, ImportOptions
from missions.items import CommandItem, Land, PlacedItem, RoiNone, Takeoff, Waypoint
from missions.plan import Plan
from missions.values import Altitude, FencePolygon, HomePosition

RELATIVES = range(50)
AMSL = ImportOptions(reference="amsl")
Position = tuple[float, float]


def imported(data: bytes, name: str = "", options: ImportOptions | None = None) -> tuple[Plan, Imported]:
    """The file as the server imports it."""
    result = any_format.read(any_format.recognise(data, name), data, options)
    assert isinstance(result.plan, Plan)
    return result.plan, result


def positions(plan: Plan) -> list[Position]:
    return [(i.lat_deg, i.lon_deg) for _, i in plan.simple_items() if isinstance(i, PlacedItem)]


def heights(plan: Plan) -> list[tuple[float, str]]:
    items = [item for _, item in plan.simple_items() if isinstance(item, PlacedItem)]
    return [(item.altitude.value_m, item.altitude.reference) for item in items]


def encoded(rng: random.Random, text: str) -> bytes:
    """The text in an encoding and with the line ends of some system."""
    text = text.replace("\n", rng.choice(["\n", "\r\n"]))
    return text.encode(rng.choice(["utf-8", "utf-8-sig", "utf-16"]))


def place(rng: random.Random) -> Position:
    return (round(47.397 + rng.random() / 200, 7), round(8.545 + rng.random() / 200, 7))


# --- the files of shared/cases ------------------------------------------------------------------------


def case(shared_folder: Path, name: str, options: ImportOptions | None = None) -> tuple[Plan, Imported]:
    path = shared_folder / "cases" / name
    if not path.exists():
        pytest.skip(f"shared/cases/{name} is missing")
    return imported(path.read_bytes(), name, options)


def test_the_case_of_a_takeoff_at_0_0_takes_off_at_home_and_lands_where_the_path_ends(
    reference_data: Path,
) -> None:
    plan, result = case(reference_data, "ap-takeoff-zero.waypoints")
    assert positions(plan) == [(47.397742, 8.545594), (47.3982, 8.5456), (47.3982, 8.5462), (47.3982, 8.5462)]
    assert "At home: item 1" in result.notes[0]


def test_the_case_of_a_relative_home_row_has_home_and_two_items(reference_data: Path) -> None:
    plan, _ = case(reference_data, "home-frame3.waypoints")
    assert plan.planned_home == HomePosition(lat_deg=47.397742, lon_deg=8.545594, alt_amsl_m=343.0)
    assert heights(plan) == [(20.0, "home"), (20.0, "home")]


def test_the_case_of_fence_rows_is_a_geofence(reference_data: Path) -> None:
    plan, _ = case(reference_data, "wpl-fence.waypoints")
    (zone,) = plan.fence
    assert isinstance(zone, FencePolygon)
    assert (zone.inclusion, len(zone.polygon), plan.items) == (True, 3, ())


def test_the_case_of_a_comment_has_one_item(reference_data: Path) -> None:
    plan, _ = case(reference_data, "wpl-comment.waypoints")
    assert (heights(plan), plan.planned_home is not None) == ([(30.0, "home")], True)


@pytest.mark.parametrize(
    ("name", "altitudes_m"),
    [("geojson-z.geojson", [5, 15, 60]), ("dji-waylines.kml", [560, 520]), ("gx-track.kml", [500])],
)
def test_the_cases_with_heights_keep_them(reference_data: Path, name: str, altitudes_m: list[float]) -> None:
    with pytest.raises(PlanError) as refused:
        case(reference_data, name)
    assert refused.value.field == "altitude_reference"
    plan, _ = case(reference_data, name, AMSL)
    assert heights(plan) == [(altitude_m, "amsl") for altitude_m in altitudes_m]


def test_the_case_of_an_area_with_a_hole_asks_for_its_use(reference_data: Path) -> None:
    plan, result = case(reference_data, "area-with-hole.kml")
    (area,) = result.areas
    assert (plan, len(area.outer), [len(hole) for hole in area.holes]) == (Plan(), 4, [3])


def test_the_case_of_an_old_fence_leaves_it_out_and_says_so(reference_data: Path) -> None:
    plan, result = case(reference_data, "fence-version-1.plan")
    assert plan.planned_home is not None
    assert "geofence of the file has an old version" in result.notes[0]
    assert json.loads(qgc_plan.write(plan).data).get("geoFence", {"version": 2})["version"] == 2


# --- .waypoints ---------------------------------------------------------------------------------------


def wpl(rng: random.Random, rows: list[tuple[object, ...]], version: str = "110") -> bytes:
    """A file of rows (frame, command, p1, p2, p3, p4, x, y, z), with comments and blank lines."""
    lines = [f"QGC WPL {version}"]
    for index, row in enumerate(rows):
        if rng.random() < 0.2:
            lines.append(rng.choice(["# a comment", "", "#\t1\t2", "   "]))
        separator = rng.choice(["\t", "\t", " ", "  "])
        current = rng.choice([0, 1]) if index == 0 else 0
        lines.append(separator.join(map(str, (index, current, *row, 1))))
    if rng.random() < 0.2:
        lines.insert(0, "# written by hand")
    return encoded(rng, "\n".join(lines) + rng.choice(["", "\n"]))


def home_row(rng: random.Random, home: Position, alt_amsl_m: float) -> tuple[object, ...]:
    """A first row that is home, as different programs write it."""
    return (
        rng.choice([0, 0, 3, 5, 6, 10]),
        rng.choice([16, 16, 16, 0]),
        rng.choice([0, 2, 5, "nan"]),
        rng.choice([0, 3, 5, "NaN"]),
        rng.choice([0, 10, "nan"]),
        rng.choice([0, 90, "nan"]),
        *home,
        alt_amsl_m,
    )


@pytest.mark.parametrize("seed", RELATIVES)
def test_the_first_row_is_home_whatever_its_frame_and_parameters_are(seed: int) -> None:
    rng = random.Random(seed)
    home, target, alt_amsl_m = place(rng), place(rng), rng.choice([0, 343, 488.5, -3])
    frame, reference = rng.choice([(3, "home"), (0, "amsl"), (10, "terrain")])
    rows = [
        home_row(rng, home, alt_amsl_m),
        (3, 22, 0, 0, 0, 0, *home, 20),
        (frame, 16, 0, rng.choice([0, 5]), 0, rng.choice([0, "nan"]), *target, 25),
    ]
    plan, _ = imported(wpl(rng, rows), rng.choice(["a.waypoints", "mission.txt", ""]))
    assert plan.planned_home == HomePosition(lat_deg=home[0], lon_deg=home[1], alt_amsl_m=alt_amsl_m)
    assert positions(plan) == [home, target]
    assert heights(plan) == [(20.0, "home"), (25.0, reference)]
    assert [getattr(item, "yaw_ned_deg", None) for item in plan.items] == [None, None]


@pytest.mark.parametrize("seed", RELATIVES)
def test_a_first_row_that_is_no_waypoint_is_the_first_item(seed: int) -> None:
    rng = random.Random(seed)
    start, target = place(rng), place(rng)
    first = rng.choice([(3, 22, 0, 0, 0, "nan", *start, 20), (2, 178, 1, 5, -1, 0, 0, 0, 0)])
    plan, result = imported(wpl(rng, [first, (3, 16, 0, 0, 0, 0, *target, 25)]), "a.waypoints")
    assert plan.planned_home is None
    assert len(plan.items) == 2
    assert positions(plan)[-1] == target
    assert "no home position" in result.notes[0]


def test_a_file_whose_rows_begin_at_1_has_no_home_row_and_its_jumps_name_the_indexes() -> None:
    waypoint = "{} 0 3 16 0 0 0 0 {} 8.5 30 1\n"
    rows = waypoint.format(1, 47.4) + waypoint.format(2, 47.41) + "3 0 3 177 2 4 0 0 0 0 0 1\n"
    text = f"QGC WPL 110\n{rows}"
    plan, _ = imported(text.encode(), "a.waypoints")
    assert (plan.planned_home, positions(plan)) == (None, [(47.4, 8.5), (47.41, 8.5)])
    jump = plan.items[2]
    assert jump.kind == "jump"
    assert jump.target_index == 1


def test_version_120_has_no_home_and_other_versions_are_refused() -> None:
    rng = random.Random(1)
    rows: list[tuple[object, ...]] = [(3, 16, 0, 5, 0, 0, 47.4, 8.5, 30), (3, 16, 0, 5, 0, 0, 47.41, 8.5, 30)]
    plan, _ = imported(wpl(rng, rows, "120"), "a.waypoints")
    assert (len(plan.items), plan.planned_home) == (2, None)
    for version in ("100", "130", ""):
        with pytest.raises(PlanError, match='it is not "QGC WPL 110"'):
            waypoints.read(wpl(rng, rows, version))


@pytest.mark.parametrize("home", [(0, 0, 0), ("nan", "nan", "nan"), (47.4, 8.5, "nan")])
def test_a_home_that_is_not_set_is_none(home: tuple[object, ...]) -> None:
    rows: list[tuple[object, ...]] = [(0, 16, 0, 0, 0, 0, *home), (3, 16, 0, 0, 0, 0, 47.41, 8.5, 30)]
    plan, result = imported(wpl(random.Random(1), rows), "a.waypoints")
    assert (plan.planned_home, positions(plan)) == (None, [(47.41, 8.5)])
    assert "is not set" in result.notes[0]


@pytest.mark.parametrize("seed", RELATIVES)
def test_0_0_is_where_the_path_stands_and_never_a_target(seed: int) -> None:
    rng = random.Random(seed)
    home, first, second = place(rng), place(rng), place(rng)
    zero: Position = rng.choice([(0, 0), (0.0, 0.0), (1e-9, -0.0)])
    here_command, here_alt_m, kept_alt_m = rng.choice(
        [(16, 30, 30), (16, 0, 25), (17, 0, 25), (19, 12, 12), (31, 40, 40)]
    )
    rows = [
        home_row(rng, home, 488),
        (3, 22, 0, 0, 0, 0, *zero, 20),
        (3, 16, 0, 0, 0, 0, *first, 25),
        (3, here_command, 1, 0, 0, 0, *zero, here_alt_m),
        (3, 201, 0, 0, 0, 0, *zero, 0),
        (3, 16, 0, 0, 0, 0, *second, 25),
        (3, 21, 0, 0, 0, 0, *zero, 0),
    ]
    plan, result = imported(wpl(rng, rows), "a.waypoints")
    assert positions(plan) == [home, first, first, second, second]
    assert [each for each, _ in heights(plan)] == [20, 25, kept_alt_m, 25, 0]
    assert isinstance(plan.items[3], RoiNone)
    notes = " ".join(result.notes)
    assert "At home: item 1" in notes
    assert "Where the path stands before it: item 3, 6" in notes
    assert "at nothing from here: item 4" in notes
    assert not {"first_waypoint_far", "leg_too_long", "place_missing"} & {each.code for each in check(plan)}


def test_after_a_return_the_path_stands_at_home() -> None:
    rows: list[tuple[object, ...]] = [
        (0, 16, 0, 0, 0, 0, 47.4, 8.5, 488),
        (3, 16, 0, 0, 0, 0, 47.41, 8.51, 30),
        (3, 20, 0, 0, 0, 0, 0, 0, 0),
        (3, 21, 0, 0, 0, 0, 0, 0, 0),
    ]
    plan, _ = imported(wpl(random.Random(1), rows), "a.waypoints")
    assert positions(plan)[-1] == (47.4, 8.5)


def test_0_0_without_home_and_path_has_no_position_and_is_an_error() -> None:
    rows: list[tuple[object, ...]] = [(3, 22, 0, 0, 0, 0, 0, 0, 20), (3, 16, 0, 0, 0, 0, 47.4, 8.5, 25)]
    plan, result = imported(wpl(random.Random(1), rows), "a.waypoints")
    takeoff = plan.items[0]
    assert isinstance(takeoff, CommandItem)
    assert (takeoff.command, takeoff.params[4:]) == (22, (None, None, 20.0))
    assert "Without a position" in result.notes[1]
    assert "place_missing" in {each.code for each in check(plan) if each.severity == "error"}


def qgc_items(rng: random.Random, zero: object, first: Position) -> list[dict[str, object]]:
    rows = [
        (22, [0, 0, 0, 0, zero, zero, 20]),
        (16, [0, 0, 0, None, *first, 25]),
        (21, [0, 0, 0, 0, zero, zero, 0]),
    ]
    return [
        {"type": "SimpleItem", "autoContinue": True, "command": command, "doJumpId": n, "frame": 3,
         "params": params}
        for n, (command, params) in enumerate(rows, start=1)
    ]  # fmt: skip


@pytest.mark.parametrize("seed", RELATIVES)
def test_a_plan_file_has_0_0_resolved_and_old_parts_left_out(seed: int) -> None:
    rng = random.Random(seed)
    home, first = place(rng), place(rng)
    old_fence: dict[str, object] = rng.choice(
        [{"version": 1}, {}, {"version": 1, "polygon": [[47.3, 8.5]], "parameters": []}]
    )
    document = {
        "fileType": "Plan",
        "geoFence": old_fence,
        "groundStation": rng.choice(["QGroundControl", "MissionPlanner"]),
        "mission": {
            "items": qgc_items(rng, rng.choice([0, 0.0, None]), first),
            "plannedHomePosition": [*home, rng.choice([488, 343.5, None])],
            "version": 2,
        },
        "rallyPoints": rng.choice([{"points": [], "version": 1}, {"points": [], "version": 2}, {}]),
        "version": 1,
    }
    data = encoded(rng, json.dumps(document, indent=rng.choice([None, 4])))
    plan, result = imported(data, rng.choice(["a.plan", "b.json"]))
    assert positions(plan) == [home, first, first]
    assert plan.fence == plan.rally_points == ()
    notes = " ".join(result.notes)
    assert "geofence of the file has an old version" in notes
    assert "list of rally points" not in notes, "there was none"
    assert "At home: item 1" in notes
    again = qgc_plan.read(qgc_plan.write(plan).data).plan
    assert isinstance(again, Plan)
    assert positions(again) == positions(plan)


def test_a_planned_home_at_0_0_is_not_set() -> None:
    document = {
        "fileType": "Plan",
        "mission": {"items": [], "plannedHomePosition": [0, 0, 0], "version": 2},
        "version": 1,
    }
    plan, result = imported(json.dumps(document).encode())
    assert plan.planned_home is None
    assert "counts as not set" in result.notes[0]


@pytest.mark.parametrize("seed", RELATIVES)
def test_fence_and_rally_rows_are_fence_and_rally_points(seed: int) -> None:
    rng = random.Random(seed)
    rows: list[tuple[object, ...]] = []
    has_home = rng.random() < 0.5
    if has_home:
        rows.append(home_row(rng, place(rng), 488))
    zones = [(rng.choice([5001, 5002]), [place(rng) for _ in range(rng.randint(3, 8))]) for _ in range(2)]
    circle, rally = place(rng), place(rng)
    frame = rng.choice([0, 3])
    for command, corners in zones:
        rows += [(frame, command, len(corners), 0, 0, 0, *corner, rng.choice([0, 100])) for corner in corners]
    rows.append((frame, 5004, 50, 0, 0, 0, *circle, 0))
    if rng.random() < 0.5:
        rows.append((3, 5000, 0, 0, 0, 0, *place(rng), 0))
    rows.append((3, 5100, 0, 0, 0, 0, *rally, 40))
    plan, _ = imported(wpl(rng, rows), "fence.waypoints")
    assert plan.items == ()
    assert (plan.planned_home is not None) == has_home
    first, second, third = plan.fence
    for zone, (command, corners) in zip((first, second), zones, strict=True):
        assert isinstance(zone, FencePolygon)
        assert zone.inclusion == (command == 5001)
        assert [(point.lat_deg, point.lon_deg) for point in zone.polygon] == corners
    assert third.shape == "circle"
    assert (third.inclusion, third.radius_m) == (False, 50.0)
    (point,) = plan.rally_points
    assert (point.lat_deg, point.lon_deg, point.altitude.value_m) == (*rally, 40.0)


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ((3, 5001, 4, 0, 0, 0, 47.4, 8.5, 0), "does not have 4 corners"),
        ((3, 5003, 0, 0, 0, 0, 47.4, 8.5, 0), "greater than 0"),
        ((3, 5001, 3, 0, 0, 0, 0, 0, 0), "line 2, columns x and y: it has no position"),
        ((3, 5100, 0, 0, 0, 0, 470, 8.5, 0), "it has no position"),
        ((3, 5100, 0, 0, 0, 0, 47.4, 8.5, "nan"), "the rally point has no altitude"),
    ],
)
def test_a_fence_row_that_makes_no_zone_is_refused(row: tuple[object, ...], reason: str) -> None:
    text = "QGC WPL 110\n0 0 " + " ".join(map(str, row)) + " 1\n"
    with pytest.raises(PlanError, match=reason):
        waypoints.read(text)


def test_a_jump_over_home_comments_and_fence_rows_keeps_its_target() -> None:
    rows: list[tuple[object, ...]] = [
        (0, 16, 0, 0, 0, 0, 47.4, 8.5, 488),
        (0, 5003, 50, 0, 0, 0, 47.4, 8.5, 0),
        (3, 16, 0, 0, 0, 0, 47.41, 8.5, 30),
        (3, 177, 2, 3, 0, 0, 0, 0, 0),
    ]
    plan, _ = imported(wpl(random.Random(2), rows), "a.waypoints")
    jump = plan.items[1]
    assert jump.kind == "jump"
    assert jump.target_index == 0


def test_a_written_file_has_no_nan_as_yaw_and_is_read_with_the_same_yaw() -> None:
    at = {"lat_deg": 47.4, "lon_deg": 8.5, "altitude": Altitude(value_m=20.0, reference="home")}
    items = (
        Takeoff(**at),
        Waypoint(**at, yaw_ned_deg=0.0),
        Waypoint(**at, yaw_ned_deg=-90.0),
        Land(**at),
    )
    plan = Plan(items=items, planned_home=HomePosition(lat_deg=47.4, lon_deg=8.5, alt_amsl_m=488.0))
    text = waypoints.write(plan).data.decode()
    assert "nan" not in text.lower()
    assert [float(line.split("\t")[7]) for line in text.splitlines()[2:]] == [0.0, 360.0, -90.0, 0.0]
    assert waypoints.read(text).plan == plan


# --- GeoJSON, KML, DJI --------------------------------------------------------------------------------


def path(rng: random.Random) -> tuple[list[Position], list[float]]:
    points = [place(rng) for _ in range(rng.randint(2, 6))]
    return points, [round(rng.uniform(1, 120), 1) for _ in points]


@pytest.mark.parametrize("seed", RELATIVES)
def test_geojson_keeps_its_heights_in_any_shape(seed: int) -> None:
    rng = random.Random(seed)
    points, altitudes_m = path(rng)
    coordinates = [[lon, lat, z] for (lat, lon), z in zip(points, altitudes_m, strict=True)]
    shape = rng.choice(
        [
            [{"type": "LineString", "coordinates": coordinates}],
            [{"type": "MultiLineString", "coordinates": [coordinates]}],
            [{"type": "MultiPoint", "coordinates": coordinates}],
            [{"type": "Point", "coordinates": each} for each in coordinates],
            [
                {
                    "type": "GeometryCollection",
                    "geometries": [{"type": "LineString", "coordinates": coordinates}],
                }
            ],
        ]
    )
    collection = {
        "type": "FeatureCollection",
        "features": [{"type": "Feature", "properties": rng.choice([None, {}, {"name": "a", "role": "x"}]),
                      "geometry": each} for each in shape],
    }  # fmt: skip
    data = encoded(rng, json.dumps(collection))
    with pytest.raises(PlanError) as refused:
        imported(data)
    assert refused.value.field == "altitude_reference"
    reference = rng.choice(["home", "amsl", "terrain"])
    plan, _ = imported(data, options=ImportOptions(reference=reference))
    assert positions(plan) == points
    assert heights(plan) == [(altitude_m, reference) for altitude_m in altitudes_m]


def kml_file(rng: random.Random, body: str) -> bytes:
    prefix = rng.choice(["", '<?xml version="1.0" encoding="UTF-8"?>\n', "<!-- a <Placemark> -->\n"])
    inside = rng.choice(
        ["%s", "<Document>%s</Document>", "<Document><Folder><name>x</name>%s</Folder></Document>"]
    )
    namespaces = (
        'xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2" '
        'xmlns:wpml="http://www.dji.com/wpmz/1.0.6"'
    )
    text = f"{prefix}<kml {namespaces}>{inside % body}</kml>"
    if rng.random() < 0.3:
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("doc.kml", text)
        return out.getvalue()
    return encoded(rng, text)


@pytest.mark.parametrize("seed", RELATIVES)
def test_kml_paths_and_tracks_keep_their_heights(seed: int) -> None:
    rng = random.Random(seed)
    points, altitudes_m = path(rng)
    mode, reference = rng.choice(
        [("absolute", "amsl"), ("relativeToGround", "terrain"), (None, None), ("relativeToSeaFloor", None)]
    )
    mode_text = "" if mode is None else f"<altitudeMode>{mode}</altitudeMode>"
    triples = [f"{lon},{lat},{z}" for (lat, lon), z in zip(points, altitudes_m, strict=True)]
    track = "".join(
        f"<when>2026-01-01</when><gx:coord>{each.replace(',', ' ')}</gx:coord>" for each in triples
    )
    blank = rng.choice([" ", "\n"])
    geometry = rng.choice(
        [
            f"<LineString>{mode_text}<coordinates>{blank.join(triples)}</coordinates></LineString>",
            f"<gx:Track>{mode_text}{track}</gx:Track>",
            f"<gx:MultiTrack><gx:Track>{mode_text}{track}</gx:Track></gx:MultiTrack>",
            "<MultiGeometry>"
            + "".join(f"<Point>{mode_text}<coordinates>{each}</coordinates></Point>" for each in triples)
            + "</MultiGeometry>",
        ]
    )
    data = kml_file(rng, f"<Placemark><name>p</name>{geometry}</Placemark>")
    if reference is None:
        with pytest.raises(PlanError) as refused:
            imported(data)
        assert refused.value.field == "altitude_reference"
    plan, _ = imported(data, options=ImportOptions(reference="home"))
    assert positions(plan) == points
    assert heights(plan) == [(altitude_m, reference or "home") for altitude_m in altitudes_m]


@pytest.mark.parametrize("seed", RELATIVES)
def test_dji_waylines_keep_their_heights(seed: int) -> None:
    rng = random.Random(seed)
    points, altitudes_m = path(rng)
    mode, reference = rng.choice(
        [("WGS84", None), ("relativeToStartPoint", "home"), ("realTimeFollowSurface", None)]
    )
    marks = "".join(
        f"<Placemark><Point><coordinates>{lon},{lat}</coordinates></Point><wpml:index>{n}</wpml:index>"
        f"<wpml:executeHeight>{z}</wpml:executeHeight><wpml:waypointSpeed>3</wpml:waypointSpeed></Placemark>"
        for n, ((lat, lon), z) in enumerate(zip(points, altitudes_m, strict=True))
    )
    data = kml_file(rng, f"<Folder><wpml:executeHeightMode>{mode}</wpml:executeHeightMode>{marks}</Folder>")
    if reference is None:
        with pytest.raises(PlanError) as refused:
            imported(data)
        assert refused.value.field == "altitude_reference"
        assert ("ellipsoid" in refused.value.reason) == (mode == "WGS84")
    plan, _ = imported(data, options=AMSL)
    assert positions(plan) == points
    assert heights(plan) == [(altitude_m, reference or "amsl") for altitude_m in altitudes_m]


def ring(rng: random.Random, center: Position, radius_deg: float) -> list[Position]:
    corners = rng.randint(3, 9)
    return [
        (
            round(center[0] + radius_deg * math.cos(2 * math.pi * n / corners), 7),
            round(center[1] + radius_deg * math.sin(2 * math.pi * n / corners), 7),
        )
        for n in range(corners)
    ]


@pytest.mark.parametrize("seed", RELATIVES)
def test_areas_keep_their_holes_in_each_use(seed: int) -> None:
    rng = random.Random(seed)
    center = place(rng)
    rings = [ring(rng, center, 0.01), *(ring(rng, center, 0.001) for _ in range(rng.randint(0, 2)))]
    name = rng.choice(["site", "", "No fly zone"])
    closed = [[*each, each[0]] for each in rings]
    if rng.random() < 0.5:
        coordinates = [[[lon, lat] for lat, lon in each] for each in closed]
        feature = {"type": "Feature", "properties": {"name": name},
                   "geometry": {"type": "Polygon", "coordinates": coordinates}}  # fmt: skip
        data = encoded(rng, json.dumps(feature))
    else:
        texts = [" ".join(f"{lon},{lat},0" for lat, lon in each) for each in closed]
        boundaries = [f"<LinearRing><coordinates>{text}</coordinates></LinearRing>" for text in texts]
        inner = "".join(f"<innerBoundaryIs>{each}</innerBoundaryIs>" for each in boundaries[1:])
        polygon = f"<Polygon><outerBoundaryIs>{boundaries[0]}</outerBoundaryIs>{inner}</Polygon>"
        data = kml_file(rng, f"<Placemark><name>{name}</name>{polygon}</Placemark>")
    plan, result = imported(data)
    assert plan == Plan(), "nothing is chosen for the user"
    (area,) = result.areas
    found = [[(p.lat_deg, p.lon_deg) for p in each] for each in (area.outer, *area.holes)]
    assert found == rings
    inside, outside, _ = area.uses
    corners = [
        [(point.lat_deg, point.lon_deg) for point in zone.polygon]
        for zone in inside.fence
        if isinstance(zone, FencePolygon)
    ]
    assert corners == rings
    assert [zone.inclusion for zone in inside.fence] == [True] + [False] * (len(rings) - 1)
    assert [zone.inclusion for zone in outside.fence] == [False]
    assert (area.likely_use == "stay_outside") == (name == "No fly zone")
