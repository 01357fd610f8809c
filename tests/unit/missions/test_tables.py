"""The line-based formats: .waypoints files and CSV tables."""

from __future__ import annotations

import pytest
from hypothesis import given, settings

from missions.errors import PlanError
from missions.formats import csv_table, waypoints
from missions.formats.results import ImportOptions
from missions.items import Jump, Takeoff, Waypoint
from missions.plan import Plan
from missions.values import Altitude, HomePosition
from tests.support.plan_strategies import ALTITUDES, HOMES, RESOLVED_ALTITUDES, plans

WAYPOINTS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.3977419\t8.5455938\t489.4\t1
1\t0\t3\t22\t0\t0\t0\tnan\t47.3977419\t8.5455938\t20\t1
2\t0\t0\t16\t2.5\t0\t0\t0\t47.398\t8.546\t510.5\t1
3\t0\t3\t177\t2\t3\t0\t0\t0\t0\t0\t1
"""


def items_and_home(plan: Plan) -> Plan:
    return Plan(items=plan.items, planned_home=plan.planned_home)


def test_a_waypoints_file_is_read_with_home_and_frames_and_jumps() -> None:
    plan = waypoints.read(WAYPOINTS).plan
    assert plan.planned_home == HomePosition(lat_deg=47.3977419, lon_deg=8.5455938, alt_amsl_m=489.4)
    takeoff, waypoint, jump = plan.items
    assert isinstance(takeoff, Takeoff)
    assert takeoff.yaw_ned_deg is None
    assert isinstance(waypoint, Waypoint)
    assert waypoint.altitude == Altitude(value_m=510.5, reference="amsl")
    assert isinstance(jump, Jump)
    assert (jump.target_index, jump.repeat) == (1, 3)


@settings(deadline=None, max_examples=30)
@given(plan=plans(homes=HOMES))
def test_items_and_home_are_unchanged_after_writing_and_reading_a_waypoints_file(plan: Plan) -> None:
    written = waypoints.write(plan)
    assert waypoints.read(written.data).plan == items_and_home(plan)
    assert bool(written.notes) == bool(
        plan.fence or plan.rally_points or plan.obstacles or plan.hover_speed_m_s or plan.cruise_speed_m_s
    )


@settings(deadline=None, max_examples=30)
@given(plan=plans(altitudes=RESOLVED_ALTITUDES))
def test_items_are_unchanged_after_writing_and_reading_a_table(plan: Plan) -> None:
    assert csv_table.read(csv_table.write(plan).data).plan == Plan(items=plan.items)


def test_a_plan_without_home_cannot_be_written_as_a_waypoints_file() -> None:
    with pytest.raises(PlanError, match="field planned_home: the first line"):
        waypoints.write(Plan())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("QGC WPL 110", "QGC WPL 100", "line 1: it is not"),
        ("47.398\t", "95.0\t", "line 4, field lat_deg: .*less than or equal to 90"),
        ("47.398\t", "north\t", "line 4, column x: 'north' is not a number"),
        ("2.5", "1e308", "line 4, column param1: '1e308' is not a possible value"),
        ("510.5", "inf", "line 4, column z: 'inf' is not a possible value"),
        ("\t510.5", "", "line 4: it has 11 columns, not 12"),
        ("177\t2", "177\t0", "line 5, column param1: it jumps to the home position"),
        ("22", "22.5", "line 3, column command: '22.5' is not a whole number"),
    ],
)
def test_the_error_for_an_invalid_line_names_its_column(old: str, new: str, message: str) -> None:
    assert old in WAYPOINTS
    with pytest.raises(PlanError, match=message):
        waypoints.read(WAYPOINTS.replace(old, new, 1))


TABLE = "lat_deg;lon_deg;altitude_m;altitude_reference;hold_s\n47.1;8.2;20;home;\n47.2;8.3;520.5;amsl;3\n"


def test_a_table_of_points_is_read_as_a_plan() -> None:
    first, second = csv_table.read("\ufeff".encode() + TABLE.encode()).plan.items
    assert first == Waypoint(lat_deg=47.1, lon_deg=8.2, altitude=Altitude(value_m=20.0, reference="home"))
    assert isinstance(second, Waypoint)
    assert (second.hold_s, second.altitude.reference) == (3.0, "amsl")


def test_points_without_altitude_need_an_altitude_from_the_user() -> None:
    table = "lat_deg,lon_deg\n47,8\n"
    with pytest.raises(PlanError, match="line 2, column altitude_m: the point has no altitude"):
        csv_table.read(table)
    altitude = Altitude(value_m=30.0, reference="home")
    (item,) = csv_table.read(table, ImportOptions(altitude=altitude)).plan.items
    assert isinstance(item, Waypoint)
    assert item.altitude == altitude


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("hold_s", "wait", "line 1, column 'wait': no item has such a field"),
        ("hold_s", "lat_deg", "line 1, column 'lat_deg': it appears twice"),
        ("47.2", "95", "line 3, column lat_deg: "),
        ("47.2", "nan", "line 3, column lat_deg: 'nan' is not a finite number"),
        ("47.2", "1e308", "line 3, column lat_deg: '1e308' is not a finite number"),
        ("520.5", "", "line 3, column altitude_m: Field required"),
        (";amsl", ";sea", "line 3, column altitude_reference: "),
        (";3", ";3;4;5", "line 3: 7 cells, but 5 columns"),
        ("hold_s", "repeat", "line 3, column repeat: "),
        (TABLE, "", "the file: it has no rows"),
    ],
)
def test_the_error_for_an_invalid_cell_names_its_column(old: str, new: str, message: str) -> None:
    assert old in TABLE
    with pytest.raises(PlanError, match=message):
        csv_table.read(TABLE.replace(old, new, 1))


@given(altitude=ALTITUDES)
def test_a_table_has_the_reference_of_each_altitude(altitude: Altitude) -> None:
    plan = Plan(items=(Waypoint(lat_deg=1.0, lon_deg=2.0, altitude=altitude),))
    header, row = csv_table.write(plan).data.decode().splitlines()
    assert header == "kind,lat_deg,lon_deg,altitude_m,altitude_reference"
    assert row == f"waypoint,1.0,2.0,{altitude.value_m},{altitude.reference}"
