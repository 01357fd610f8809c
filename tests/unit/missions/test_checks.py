"""Each fault of a plan causes its finding, and a plan without faults has no findings."""

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
    Delay,
    Gripper,
    Jump,
    Land,
    LegacyRoi,
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
from tests.support.plan_strategies import RESOLVED_ALTITUDES, plans

HOME = HomePosition(lat_deg=47.0, lon_deg=8.0, alt_amsl_m=480.0)
DEG_PER_M = 1.0 / 111_194.9
"""Degrees of latitude per metre."""


def at(north_m: float, east_m: float = 0.0) -> dict[str, float]:
    return {
        "lat_deg": 47.0 + north_m * DEG_PER_M,
        "lon_deg": 8.0 + east_m * DEG_PER_M / math.cos(math.radians(47.0)),
    }


def alt(value_m: float, reference: Reference = "home") -> Altitude:
    return Altitude(value_m=value_m, reference=reference)


def wp(north_m: float, east_m: float = 0.0, altitude: Altitude | None = None) -> Waypoint:
    """A waypoint at this distance from home; None: 20 m above home."""
    return Waypoint(**at(north_m, east_m), altitude=altitude or alt(20.0))


TAKEOFF = Takeoff(**at(0.0), altitude=alt(20.0))
LAND = Land(**at(0.0), altitude=alt(0.0))


def plan(*items: Any, **rest: Any) -> Plan:
    return Plan(items=items, **{"planned_home": HOME, **rest})


def square(half_m: float, *, inclusion: bool = True, north_m: float = 0.0) -> FencePolygon:
    corners = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    return FencePolygon(inclusion=inclusion, polygon=tuple(Point(**at(north_m + n, e)) for n, e in corners))


def circle(radius_m: float, *, inclusion: bool, north_m: float = 0.0) -> FenceCircle:
    return FenceCircle(inclusion=inclusion, center=Point(**at(north_m)), radius_m=radius_m)


def limits_requiring(takeoff_land_required: int) -> CheckLimits:
    return CheckLimits(vehicle=VehicleModel(takeoff_land_required=takeoff_land_required))


GOOD = plan(
    TAKEOFF, wp(100), wp(100, 100), LAND, fence=(square(300), circle(20, inclusion=False, north_m=-50))
)
SELF_INTERSECTING_ZONE = FencePolygon(
    inclusion=False, polygon=tuple(Point(**at(n, e)) for n, e in ((500, 0), (510, 10), (510, 0), (500, 10)))
)
TERRAIN = alt(30, "terrain")
PARAMS_WITHOUT_POSITION = (0.0, 0.0, 0.0, None, None, None, 20.0)
POWER = PowerModel(hover_power_w=200.0, battery_wh=3.0, mass_kg=1.5)
DEFAULTS, POWER_LIMITS = CheckLimits(), CheckLimits(power=POWER)
CASES: list[tuple[str, Plan, CheckLimits, int | None]] = [
    ("plan_empty", plan(), DEFAULTS, None),
    ("home_missing", plan(TAKEOFF, planned_home=None), DEFAULTS, None),
    ("takeoff_missing", plan(wp(50)), limits_requiring(1), None),
    ("takeoff_not_first", plan(wp(50), TAKEOFF), DEFAULTS, 1),
    ("takeoff_not_first", plan(Gripper(gripper=1.0, action=1.0), TAKEOFF), DEFAULTS, 1),
    ("takeoff_too_low", plan(Takeoff(**at(0), altitude=alt(480.0, "amsl"))), DEFAULTS, 0),
    ("takeoff_low", plan(Takeoff(**at(0), altitude=alt(481.5, "amsl"))), DEFAULTS, 0),
    ("starts_with_landing", plan(Land(**at(0), altitude=alt(0)), wp(50)), DEFAULTS, 0),
    ("value_refused", plan(TAKEOFF, LegacyRoi(**at(9), altitude=alt(0), mode=1.0)), DEFAULTS, 1),
    ("value_refused", plan(TAKEOFF, LegacyRoi(**at(9), altitude=alt(0), mode=2.0)), DEFAULTS, 1),
    ("value_refused", plan(TAKEOFF, LegacyRoi(**at(9), altitude=alt(0), mode=4.0)), DEFAULTS, 1),
    ("command_refused", plan(TAKEOFF, CommandItem(command=112, frame=2, params=(0,) * 7)), DEFAULTS, 1),
    ("command_refused", plan(TAKEOFF, CommandItem(command=178, frame=6, params=(1, 5, 0, 0, 47, 8, 0))),
     DEFAULTS, 1),
    ("landing_missing", plan(TAKEOFF, wp(50)), limits_requiring(3), None),
    ("takeoff_landing_mismatch", plan(TAKEOFF, wp(50)), limits_requiring(4), None),
    ("command_refused", plan(TAKEOFF, CommandItem(command=18, frame=3, params=(0,) * 7)), DEFAULTS, 1),
    ("command_refused", plan(TAKEOFF, SetServo(servo=1.0, pulse_us=1500.0)), DEFAULTS, 1),
    ("command_refused", plan(TAKEOFF, CameraZoom(zoom_type=2.0, value=50.0)), DEFAULTS, 1),
    ("place_missing", plan(CommandItem(command=22, frame=3, params=PARAMS_WITHOUT_POSITION)), DEFAULTS, 0),
    ("place_missing", plan(TAKEOFF, Land(lat_deg=0.0, lon_deg=0.0, altitude=alt(0))), DEFAULTS, 1),
    ("vtol_item", plan(CommandItem(command=84, frame=3, params=(0,) * 7)), DEFAULTS, 0),
    ("value_not_sendable", plan(TAKEOFF, Digicam(shoot=0.5)), DEFAULTS, 1),
    ("set_home_place", plan(TAKEOFF, SetHome(use_current=0.0)), DEFAULTS, 1),
    ("terrain_unresolved", plan(TAKEOFF, wp(50, altitude=TERRAIN)), DEFAULTS, 1),
    ("complex_without_items", plan(TAKEOFF, ComplexItem(complex_type="x", original="{}")), DEFAULTS, 1),
    ("jump_target_missing", plan(TAKEOFF, wp(50), Jump(target_index=7, repeat=1)), DEFAULTS, 2),
    ("jump_stalls", plan(TAKEOFF, Jump(target_index=1, repeat=60_000)), DEFAULTS, 1),
    ("jump_endless", plan(TAKEOFF, wp(50), Jump(target_index=1, repeat=-1)), DEFAULTS, 2),
    ("items_never_reached", plan(TAKEOFF, LoiterUnlimited(**at(9), altitude=alt(20)), wp(50)), DEFAULTS, 1),
    ("items_never_reached", plan(TAKEOFF, ReturnHome(), wp(50)), DEFAULTS, 1),
    ("speed_invalid", plan(TAKEOFF, ChangeSpeed(speed_m_s=0.0)), DEFAULTS, 1),
    ("speed_too_high", plan(TAKEOFF, ChangeSpeed(speed_m_s=12.5)), DEFAULTS, 1),
    ("speed_too_high", plan(TAKEOFF, hover_speed_m_s=12.5), DEFAULTS, None),
    ("altitude_too_high", plan(TAKEOFF, wp(50, altitude=alt(601, "amsl"))), DEFAULTS, 1),
    ("altitude_fence", plan(TAKEOFF, wp(50)), CheckLimits(vehicle=VehicleModel(fence_height_m=19.0)), 1),
    ("altitude_below_home", plan(TAKEOFF, wp(50, altitude=alt(-1))), DEFAULTS, 1),
    ("altitude_unknown", plan(TAKEOFF, wp(50, altitude=TERRAIN)), DEFAULTS, 1),
    ("first_waypoint_far", plan(wp(10_010), TAKEOFF), DEFAULTS, 0),
    ("leg_too_long", plan(TAKEOFF, wp(2001)), DEFAULTS, 1),
    ("radius_exceeded", plan(TAKEOFF, wp(101)), CheckLimits(vehicle=VehicleModel(fence_radius_m=100.0)), 1),
    ("fence_violation", plan(TAKEOFF, wp(301), fence=(square(300),)), DEFAULTS, 1),
    ("fence_violation", plan(TAKEOFF, wp(9), fence=(circle(3, inclusion=False, north_m=9),)), DEFAULTS, 1),
    ("fence_crossed", plan(TAKEOFF, wp(99), fence=(circle(9, inclusion=False, north_m=50),)), DEFAULTS, 1),
    ("fence_home_outside", plan(TAKEOFF, fence=(square(50, north_m=200),)), DEFAULTS, None),
    ("fence_invalid", plan(TAKEOFF, fence=(SELF_INTERSECTING_ZONE,)), DEFAULTS, None),
    ("rally_outside_fence", plan(TAKEOFF, fence=(square(9),), rally_points=(
        RallyPoint(**at(50), altitude=alt(20)),)), DEFAULTS, None),
    ("rally_terrain", plan(TAKEOFF, rally_points=(RallyPoint(**at(5), altitude=TERRAIN),)), DEFAULTS, None),
    ("too_many_items", plan(TAKEOFF, fence=(square(300),) * 17), DEFAULTS, None),
    ("endurance_exceeded", plan(TAKEOFF, wp(100), wp(0), wp(100)), POWER_LIMITS, None),
    ("parameters_unknown", GOOD, CheckLimits(unknown_parameters=("MPC_XY_VEL_MAX",)), None),
    ("endurance_endless", plan(TAKEOFF, wp(9), Jump(target_index=1, repeat=-1)), POWER_LIMITS, None),
]  # fmt: skip


def test_a_good_plan_has_no_findings() -> None:
    assert check(GOOD) == ()


@pytest.mark.parametrize(
    ("code", "document", "limits", "row"), CASES, ids=[f"{n}-{case[0]}" for n, case in enumerate(CASES)]
)
def test_each_finding_has_the_index_of_its_item_and_a_message_and_a_fix(
    code: str, document: Plan, limits: CheckLimits, row: int | None
) -> None:
    findings = {finding.code: finding for finding in check(document, limits)}
    assert findings[code].row == row
    assert findings[code].message.endswith(".")
    assert findings[code].fix is not None
    assert findings[code].fix.endswith(".")


def test_every_code_has_a_case() -> None:
    ground_codes = {"terrain_hit", "terrain_near", "terrain_outdated", "home_off_ground"}  # test_terrain.py
    obstacle_codes = {"obstacle_hit", "obstacle_near", "obstacle_invalid"}  # test_obstacles.py
    traffic_codes = {"separation", "separation_unknown"}  # tests/protocol/test_plan_traffic.py
    other_codes = {"check_failed"} | ground_codes | obstacle_codes | traffic_codes
    assert {code for code, *_ in CASES} | other_codes == set(CODES)


def test_a_missing_takeoff_is_an_error_only_if_the_vehicle_requires_a_takeoff() -> None:
    severities = [
        next(each.severity for each in check(plan(wp(50)), limits) if each.code == "takeoff_missing")
        for limits in (CheckLimits(), limits_requiring(1))
    ]
    assert severities == ["warning", "error"]


def test_a_check_that_raises_becomes_a_finding_and_the_other_checks_continue(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken_rule(context: object) -> Any:
        raise RuntimeError("a fault")

    monkeypatch.setattr(check_items, "RULES", (broken_rule, *check_items.RULES))
    findings = check(plan(TAKEOFF, wp(2001)))
    assert [finding.code for finding in findings] == ["check_failed", "leg_too_long"]
    assert "broken rule could not be carried out: RuntimeError('a fault')" in findings[0].message


def raw(command: int, frame: int, *params: float | None) -> CommandItem:
    position = (*at(50).values(), 20.0) if frame != 2 else (0.0, 0.0, 0.0)
    return CommandItem(command=command, frame=frame, params=(*params, *position))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "items",
    [
        (TAKEOFF, raw(16, 6, 0.0, 0.0, 0.0, None)),
        (TAKEOFF, raw(17, 3, 0.0, 0.0, 0.0, None)),
        (TAKEOFF, raw(19, 6, 5.0, 0.0, 0.0, 0.0)),
        (TAKEOFF, raw(178, 2, 1.0, 4.0, -1.0, 0.0)),
        (TAKEOFF, raw(206, 2, 5.0, 0.0, 0.0, 0.0)),
        (TAKEOFF, raw(2000, 2, 0.0, 1.0, 1.0, 0.0)),
        (TAKEOFF, raw(201, 2, 1.0, 0.0, 0.0, 0.0)),
        (Delay(delay_s=5.0), TAKEOFF),
    ],
    ids=lambda items: " ".join(str(getattr(each, "command", each.kind)) for each in items),
)
def test_items_that_px4_flies_are_no_error_in_raw_form_nor_a_delay_before_the_take_off(items: Any) -> None:
    assert [each for each in check(plan(*items)) if each.severity == "error"] == []


def test_a_raw_waypoint_is_checked_like_a_waypoint() -> None:
    codes = {each.code for each in check(plan(TAKEOFF, raw(16, 6, 0.0, 0.0, 0.0, None), fence=(square(40),)))}
    assert "fence_violation" in codes


@settings(deadline=None, max_examples=40)
@given(plan=plans(altitudes=RESOLVED_ALTITUDES))
def test_no_check_raises_for_any_plan(plan: Plan) -> None:
    limits = CheckLimits(power=POWER)
    assert "check_failed" not in {finding.code for finding in check(plan, limits)}


def test_the_table_in_the_documentation_matches_the_code() -> None:
    text = (Path(__file__).parents[3] / "docs" / "missions.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (error|warning) \| (.+) \|$", text, re.MULTILINE)
    assert {code: (severity, meaning) for code, severity, meaning in rows} == CODES


@pytest.mark.parametrize(
    ("code", "document", "limits"),
    [
        ("first_waypoint_far", plan(wp(10_010), TAKEOFF), DEFAULTS),
        ("leg_too_long", plan(TAKEOFF, wp(2001)), DEFAULTS),
        ("endurance_exceeded", plan(TAKEOFF, wp(100), wp(0), wp(100)), POWER_LIMITS),
        ("endurance_endless", plan(TAKEOFF, wp(9), Jump(target_index=1, repeat=-1)), POWER_LIMITS),
    ],
)
def test_a_leg_that_cannot_be_reached_is_an_error(code: str, document: Plan, limits: CheckLimits) -> None:
    (severity,) = [finding.severity for finding in check(document, limits) if finding.code == code]
    assert severity == "error"


@pytest.mark.parametrize(
    ("height_m", "landing_height_m", "severity"),
    [(-0.9, 1.0, "warning"), (-1.1, 1.0, "error"), (-20.0, 1.0, "error"), (-2.9, 3.0, "warning")],
)
def test_an_item_below_home_by_more_than_the_landing_height_is_an_error(
    height_m: float, landing_height_m: float, severity: str
) -> None:
    limits = CheckLimits(vehicle=VehicleModel(landing_height_m=landing_height_m))
    for altitude in (alt(height_m), alt(480.0 + height_m, "amsl")):
        findings = check(plan(TAKEOFF, wp(50, altitude=altitude)), limits)
        assert [f.severity for f in findings if f.code == "altitude_below_home"] == [severity]
    landing = plan(TAKEOFF, wp(50), Land(**at(50), altitude=alt(height_m)))
    assert "altitude_below_home" not in {f.code for f in check(landing, limits)}, (
        "a landing ends on the ground"
    )
