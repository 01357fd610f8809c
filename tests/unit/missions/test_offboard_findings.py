"""Findings about offboard missions, each with its step."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from missions.check_context import CheckLimits
from missions.fence import CircleFence, PolygonFence
from missions.geodesy import LocalOrigin
from missions.offboard.compiler import compile_mission
from missions.offboard.findings import CODES
from missions.offboard.positions import Start
from missions.offboard.reader import read
from missions.offboard.roles import compile_roles, planned_starts
from missions.offboard.state import MissionVehicle, OperatorArea
from missions.trajectory.limits import MotionLimits
from missions.vehicle import PowerModel, VehicleModel
from tests.support.mission_steps import STEPS, mission_for_two
from tests.support.offboard_missions import HOME, LAND, TAKE_OFF, finding_codes, flight_steps, mission

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize(
    ("steps", "code"),
    [
        ("- {step: hold, duration_s: 1}\n" + LAND, "takeoff_missing"),
        (TAKE_OFF + TAKE_OFF + LAND, "takeoff_in_air"),
        (TAKE_OFF, "landing_missing"),
        (flight_steps("step: table, file: x"), "step_invalid"),
        (flight_steps("step: fly, points: [{offset_ned_m: [9, 0, -9]}], speed_m_s: 50"), "speed_too_high"),
        (flight_steps("step: velocity, velocity_ned_m_s: [50, 0, 0], duration_s: 60"), "speed_exceeded"),
        (flight_steps("step: velocity, velocity_ned_m_s: [5, 0, 0], duration_s: 1"), "duration_too_short"),
        (flight_steps("step: attitude, roll_rad: 1.2, thrust: 0.5, duration_s: 1"), "tilt_exceeded"),
        (flight_steps("step: fly, points: [{offset_ned_m: [9, 0, -200]}]"), "altitude_too_high"),
        (flight_steps("step: fly, points: [{offset_ned_m: [9, 0, 5]}]"), "altitude_below_home"),
        (flight_steps("step: gimbal, track: fixed, pitch_rad: 2"), "gimbal_steep"),
        (flight_steps("step: hold, duration_s: 86400"), "endurance_exceeded"),
        (flight_steps("step: wait, until: {value: battery_share, above: 1}, timeout_s: 9"),
         "condition_never"),
        (flight_steps("step: branch, condition: {value: satellites, below: 0}, then: []"), "condition_never"),
        (flight_steps("step: wait, until: {value: wind_speed_m_s, below: 5}, timeout_s: 9"),
         "condition_unreported"),
        (flight_steps("step: fly, points: [{offset_ned_m: [90, 0, -9]}]"), "radius_exceeded"),
        (flight_steps("step: fly, points: [{offset_ned_m: [9, 0, -90]}]"), "altitude_fence"),
    ],
)  # fmt: skip
def test_each_fault_causes_its_finding(steps: str, code: str) -> None:
    limits = CheckLimits(
        power=PowerModel(200.0, 100.0, 2.0),
        vehicle=VehicleModel(fence_radius_m=80.0, fence_height_m=80.0),
    )
    reported = frozenset({"battery_share", "satellites"})
    compiled = compile_mission(mission(steps), MissionVehicle(MotionLimits(), limits, reported))
    assert code in finding_codes(compiled)
    assert all(finding.message.endswith(".") for finding in compiled.findings)


FENCE = "fence:\n- {shape: circle, inclusion: true, center: {lat_deg: 47, lon_deg: 8}, radius_m: 50}\n"


def test_a_path_outside_the_geofence_causes_a_finding_with_its_position() -> None:
    fly = "- {step: fly, points: [{offset_ned_m: [60, 0, -10]}]}\n"
    text = f"name: Test\n{FENCE}steps:\n{TAKE_OFF}{fly}{LAND}"
    assert finding_codes(compile_mission(read(text))) == {"fence_unknown"}
    compiled = compile_mission(read(text).model_copy(update={"home": HOME}))
    assert finding_codes(compiled) == {"fence_crossed"}
    assert compiled.findings[0].step == "step 2"
    assert "north" in compiled.findings[0].message
    text_inside = text.replace("60, 0", "40, 0")
    assert compile_mission(read(text_inside).model_copy(update={"home": HOME})).findings == ()


CORNERS_DEG = ((-4e-4, -4e-4), (4e-4, -4e-4), (4e-4, 4e-4), (-4e-4, 4e-4))
"""North and east of home; the rectangle extends 44 m to north and south, and 30 m to east and west."""
HOME_DEG = (HOME.lat_deg, HOME.lon_deg)
RECTANGLE = PolygonFence(tuple((HOME_DEG[0] + north, HOME_DEG[1] + east) for north, east in CORNERS_DEG))


@pytest.mark.parametrize(
    ("area", "text"),
    [
        (OperatorArea(height_max_m=9.0), "climbs to 10 m above home, your limit is 9 m"),
        (OperatorArea(distance_max_m=59.0), "up to 60 m from the start, your limit is 59 m from home"),
        (OperatorArea(fence=CircleFence(*HOME_DEG, 50.0)), "leaves your geofence near north 5"),
        (OperatorArea(fence=RECTANGLE), "leaves your geofence near north 4"),
    ],
)
def test_a_step_beyond_the_operators_limits_is_an_error(area: OperatorArea, text: str) -> None:
    plan = mission(flight_steps("step: fly, points: [{offset_ned_m: [60, 0, -10]}]"))
    start = Start(origin=LocalOrigin(*HOME_DEG, HOME.alt_amsl_m), home_alt_amsl_m=HOME.alt_amsl_m)
    assert OperatorArea.from_json(json.loads(json.dumps(area.to_json()))) == area
    compiled = compile_mission(plan, MissionVehicle(operator=area), start)
    (finding, *_) = [each for each in compiled.findings if each.code == "limit_exceeded"]
    assert finding.severity == "error"
    assert text in finding.message
    larger_area = OperatorArea(11.0, 61.0, CircleFence(*HOME_DEG, 70.0))
    assert "limit_exceeded" not in finding_codes(
        compile_mission(plan, MissionVehicle(operator=larger_area), start)
    )


def test_unknown_parameters_cause_one_finding_that_names_them_also_for_several_vehicles() -> None:
    vehicle = MissionVehicle(limits=CheckLimits(unknown_parameters=("MPC_XY_VEL_MAX", "MPC_ACC_HOR")))
    (finding,) = compile_mission(mission(flight_steps("step: hold, duration_s: 1")), vehicle).findings
    assert (finding.code, finding.severity, finding.step) == ("parameters_unknown", "warning", None)
    assert finding.message.endswith("PX4's defaults are used: MPC_ACC_HOR, MPC_XY_VEL_MAX.")
    five_unknown = MissionVehicle(limits=CheckLimits(unknown_parameters=("D", "C", "B", "A", "E")))
    (finding,) = compile_mission(mission(flight_steps("step: hold, duration_s: 1")), five_unknown).findings
    assert finding.message.endswith("PX4's defaults are used: A, B, C and 2 more.")
    two_roles = mission_for_two(*STEPS["take_off"], *STEPS["meet"], *STEPS["land"])
    compiled = compile_roles(
        two_roles, dict.fromkeys(two_roles.roles, vehicle), planned_starts(two_roles)
    ).findings
    assert [each.code for each in compiled].count("parameters_unknown") == 1


def test_a_condition_that_can_become_true_causes_no_finding_with_or_without_known_reports() -> None:
    wait = flight_steps("step: wait, until: {value: wind_speed_m_s, below: 5}, timeout_s: 9")
    assert finding_codes(compile_mission(mission(wait))) == set()
    vehicle = MissionVehicle(reported=frozenset({"wind_speed_m_s"}))
    assert finding_codes(compile_mission(mission(wait), vehicle)) == set()


def test_each_finding_code_is_explained_in_the_documentation() -> None:
    text = (ROOT / "docs" / "missions.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (error|warning) \| `(\w+)` \| (.+) \|$", text, re.MULTILINE)
    assert {code: (severity, meaning) for severity, code, meaning in rows} == CODES
