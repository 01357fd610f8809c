"""Each finding occurs in a plan with that fault, and a plan without faults has no findings."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings

from missions import check_items
from missions.camera_items import CameraZoom, Digicam
from missions.checks import CODES, CheckLimits, check
from missions.items import (
    ChangeSpeed,
    CommandItem,
    Jump,
    Land,
    LoiterUnlimited,
    ReturnHome,
    SetHome,
    SetServo,
    Takeoff,
    Waypoint,
)
from missions.plan import ComplexItem, Plan
from missions.values import (
    Altitude,
    FenceCircle,
    FencePolygon,
    HomePosition,
    Point,
    RallyPoint,
    Reference,
)
from missions.vehicle import PowerModel, VehicleModel
from tests.support.plan_strategies import RESOLVED, plans

HOME = HomePosition(lat_deg=47.0, lon_deg=8.0, alt_amsl_m=480.0)
M = 1.0 / 111_194.9
"""Degrees of latitude per metre."""


def at(north_m: float, east_m: float = 0.0) -> dict[str, float]:
    return {"lat_deg": 47.0 + north_m * M, "lon_deg": 8.0 + east_m * M / math.cos(math.radians(47.0))}


def up(value_m: float, reference: Reference = "home") -> Altitude:
    return Altitude(value_m=value_m, reference=reference)


def to(north_m: float, east_m: float = 0.0, altitude: Altitude | None = None) -> Waypoint:
    return Waypoint(**at(north_m, east_m), altitude=altitude or up(20.0))


TAKEOFF = Takeoff(**at(0.0), altitude=up(20.0))
LAND = Land(**at(0.0), altitude=up(0.0))


def a_plan(*items: Any, **rest: Any) -> Plan:
    return Plan(items=items, **{"planned_home": HOME, **rest})


def square(half_m: float, *, inclusion: bool = True, north_m: float = 0.0) -> FencePolygon:
    corners = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    return FencePolygon(inclusion=inclusion, polygon=tuple(Point(**at(north_m + n, e)) for n, e in corners))


def circle(radius_m: float, *, inclusion: bool, north_m: float = 0.0) -> FenceCircle:
    return FenceCircle(inclusion=inclusion, center=Point(**at(north_m)), radius_m=radius_m)


def needs(required_ends: int) -> CheckLimits:
    return CheckLimits(vehicle=VehicleModel(required_ends=required_ends))


GOOD = a_plan(
    TAKEOFF, to(100), to(100, 100), LAND, fence=(square(300), circle(20, inclusion=False, north_m=-50))
)
CROSSED = FencePolygon(
    inclusion=False, polygon=tuple(Point(**at(n, e)) for n, e in ((500, 0), (510, 10), (510, 0), (500, 10)))
)
TERRAIN = up(30, "terrain")
NOWHERE = (0.0, 0.0, 0.0, None, None, None, 20.0)
POWER = PowerModel(hover_power_w=200.0, battery_wh=3.0, mass_kg=1.5)
DEFAULTS, ENDURANCE = CheckLimits(), CheckLimits(power=POWER)
CASES: list[tuple[str, Plan, CheckLimits, int | None]] = [
    ("plan_empty", a_plan(), DEFAULTS, None),
    ("home_missing", a_plan(TAKEOFF, planned_home=None), DEFAULTS, None),
    ("takeoff_missing", a_plan(to(50)), needs(1), None),
    ("takeoff_not_first", a_plan(to(50), TAKEOFF), DEFAULTS, 1),
    ("takeoff_too_low", a_plan(Takeoff(**at(0), altitude=up(481.5, "amsl"))), DEFAULTS, 0),
    ("landing_missing", a_plan(TAKEOFF, to(50)), needs(3), None),
    ("takeoff_landing_mismatch", a_plan(TAKEOFF, to(50)), needs(4), None),
    ("command_refused", a_plan(TAKEOFF, CommandItem(command=18, frame=3, params=(0,) * 7)), DEFAULTS, 1),
    ("command_refused", a_plan(TAKEOFF, SetServo(servo=1.0, pulse_us=1500.0)), DEFAULTS, 1),
    ("command_refused", a_plan(TAKEOFF, CameraZoom(zoom_type=2.0, value=50.0)), DEFAULTS, 1),
    ("place_missing", a_plan(CommandItem(command=22, frame=3, params=NOWHERE)), DEFAULTS, 0),
    ("vtol_item", a_plan(CommandItem(command=84, frame=3, params=(0,) * 7)), DEFAULTS, 0),
    ("value_not_sendable", a_plan(TAKEOFF, Digicam(shoot=0.5)), DEFAULTS, 1),
    ("set_home_place", a_plan(TAKEOFF, SetHome(use_current=0.0)), DEFAULTS, 1),
    ("terrain_unresolved", a_plan(TAKEOFF, to(50, altitude=TERRAIN)), DEFAULTS, 1),
    ("complex_without_items", a_plan(TAKEOFF, ComplexItem(complex_type="x", original="{}")), DEFAULTS, 1),
    ("jump_target_missing", a_plan(TAKEOFF, to(50), Jump(target_index=7, repeat=1)), DEFAULTS, 2),
    ("jump_stalls", a_plan(TAKEOFF, Jump(target_index=1, repeat=60_000)), DEFAULTS, 1),
    ("jump_endless", a_plan(TAKEOFF, to(50), Jump(target_index=1, repeat=-1)), DEFAULTS, 2),
    ("items_never_reached", a_plan(TAKEOFF, LoiterUnlimited(**at(9), altitude=up(20)), to(50)), DEFAULTS, 1),
    ("items_never_reached", a_plan(TAKEOFF, ReturnHome(), to(50)), DEFAULTS, 1),
    ("speed_invalid", a_plan(TAKEOFF, ChangeSpeed(speed_m_s=0.0)), DEFAULTS, 1),
    ("speed_too_high", a_plan(TAKEOFF, ChangeSpeed(speed_m_s=12.5)), DEFAULTS, 1),
    ("speed_too_high", a_plan(TAKEOFF, hover_speed_m_s=12.5), DEFAULTS, None),
    ("altitude_too_high", a_plan(TAKEOFF, to(50, altitude=up(601, "amsl"))), DEFAULTS, 1),
    ("altitude_fence", a_plan(TAKEOFF, to(50)), CheckLimits(vehicle=VehicleModel(fence_height_m=19.0)), 1),
    ("altitude_below_home", a_plan(TAKEOFF, to(50, altitude=up(-1))), DEFAULTS, 1),
    ("altitude_unknown", a_plan(TAKEOFF, to(50, altitude=TERRAIN)), DEFAULTS, 1),
    ("first_waypoint_far", a_plan(to(10_010), TAKEOFF), DEFAULTS, 0),
    ("leg_too_long", a_plan(TAKEOFF, to(2001)), DEFAULTS, 1),
    ("radius_exceeded", a_plan(TAKEOFF, to(101)), CheckLimits(vehicle=VehicleModel(fence_radius_m=100.0)), 1),
    ("fence_violation", a_plan(TAKEOFF, to(301), fence=(square(300),)), DEFAULTS, 1),
    ("fence_violation", a_plan(TAKEOFF, to(9), fence=(circle(3, inclusion=False, north_m=9),)), DEFAULTS, 1),
    ("fence_crossed", a_plan(TAKEOFF, to(99), fence=(circle(9, inclusion=False, north_m=50),)), DEFAULTS, 1),
    ("fence_home_outside", a_plan(TAKEOFF, fence=(square(50, north_m=200),)), DEFAULTS, None),
    ("fence_invalid", a_plan(TAKEOFF, fence=(CROSSED,)), DEFAULTS, None),
    ("rally_outside_fence", a_plan(TAKEOFF, fence=(square(9),), rally_points=(
        RallyPoint(**at(50), altitude=up(20)),)), DEFAULTS, None),
    ("rally_terrain", a_plan(TAKEOFF, rally_points=(RallyPoint(**at(5), altitude=TERRAIN),)), DEFAULTS, None),
    ("too_many_items", a_plan(TAKEOFF, fence=(square(300),) * 17), DEFAULTS, None),
    ("endurance_exceeded", a_plan(TAKEOFF, to(100), to(0), to(100)), ENDURANCE, None),
    ("parameters_unknown", GOOD, CheckLimits(unknown_parameters=("MPC_XY_VEL_MAX",)), None),
    ("endurance_endless", a_plan(TAKEOFF, to(9), Jump(target_index=1, repeat=-1)), ENDURANCE, None),
]  # fmt: skip


def test_a_good_plan_has_no_findings() -> None:
    assert check(GOOD) == ()


@pytest.mark.parametrize(
    ("code", "plan", "limits", "row"), CASES, ids=[f"{n}-{case[0]}" for n, case in enumerate(CASES)]
)
def test_each_finding_names_its_item(code: str, plan: Plan, limits: CheckLimits, row: int | None) -> None:
    found = {finding.code: finding for finding in check(plan, limits)}
    assert found[code].row == row
    assert found[code].message.endswith(".")
    assert found[code].fix is not None
    assert found[code].fix.endswith(".")


def test_every_code_has_a_case() -> None:
    of_ground = {"terrain_hit", "terrain_near", "terrain_outdated", "home_off_ground"}  # test_terrain.py
    of_obstacles = {"obstacle_hit", "obstacle_near", "obstacle_invalid"}  # test_obstacles.py
    of_traffic = {"separation", "separation_unknown"}  # test_plan_traffic.py
    elsewhere = {"check_failed"} | of_ground | of_obstacles | of_traffic
    assert {code for code, *_ in CASES} | elsewhere == set(CODES)


def test_a_missing_takeoff_is_an_error_only_if_the_vehicle_requires_one() -> None:
    severities = [
        next(each.severity for each in check(a_plan(to(50)), limits) if each.code == "takeoff_missing")
        for limits in (CheckLimits(), needs(1))
    ]
    assert severities == ["warning", "error"]


def test_a_check_that_raises_becomes_a_finding_and_the_other_checks_continue(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken_rule(context: object) -> Any:
        raise RuntimeError("out of order")

    monkeypatch.setattr(check_items, "RULES", (broken_rule, *check_items.RULES))
    found = check(a_plan(TAKEOFF, to(2001)))
    assert [finding.code for finding in found] == ["check_failed", "leg_too_long"]
    assert "broken rule could not be carried out: RuntimeError('out of order')" in found[0].message


@settings(deadline=None, max_examples=40)
@given(plan=plans(altitudes=RESOLVED))
def test_all_checks_of_any_plan_are_completed(plan: Plan) -> None:
    limits = CheckLimits(power=POWER)
    assert "check_failed" not in {finding.code for finding in check(plan, limits)}


def test_the_table_in_the_documentation_matches_the_code() -> None:
    text = (Path(__file__).parents[3] / "docs" / "missions.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (error|warning) \| (.+) \|$", text, re.MULTILINE)
    assert {code: (severity, meaning) for code, severity, meaning in rows} == CODES
