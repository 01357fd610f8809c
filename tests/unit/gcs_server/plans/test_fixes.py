"""When the page applies a fix, the finding disappears, and no new error appears.

This module makes the plans and their findings (`cases.json`); `web/src/features/plan/editor/fixes.test.ts`
applies the fixes (`fixed.json`). The tests compare their output with these files in `tests/data/plan_fixes`.
After a change run `python -m tests.unit.gcs_server.plans.test_fixes`, then
`npx vitest run -u src/features/plan/editor/fixes.test.ts`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from gcs_server.plans import tasks
from missions import documents
from missions.offboard.document import OffboardMission
from missions.offboard.reader import read
from missions.offboard.state import OperatorArea
from missions.plan import Plan

FOLDER = Path(__file__).resolve().parents[3] / "data" / "plan_fixes"
HOME = {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 480.0}
HOME_DEG = {"lat_deg": 47.4, "lon_deg": 8.5}


def altitude(value_m: float, reference: str = "home") -> dict[str, Any]:
    return {"altitude": {"value_m": value_m, "reference": reference}}


def waypoint(value_m: float, lat_deg: float = 47.401) -> dict[str, Any]:
    return {"kind": "waypoint", "lat_deg": lat_deg, "lon_deg": 8.5, **altitude(value_m)}


TAKEOFF = {"kind": "takeoff", **HOME_DEG, **altitude(20)}
LAND = {"kind": "land", **HOME_DEG, **altitude(0)}
ENDLESS_JUMP = {"kind": "jump", "target_index": 1, "repeat": -1}
SELF_CROSSING_FENCE = {
    "shape": "polygon",
    "inclusion": False,
    "polygon": [
        {"lat_deg": 47.5 + n, "lon_deg": 8.5 + e} for n, e in ((0, 0), (1e-3, 1e-3), (1e-3, 0), (0, 1e-3))
    ],
}
PLANS: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]] = {
    "home_missing": ([TAKEOFF, waypoint(20)], {"planned_home": None}),
    "takeoff_missing": ([waypoint(20), LAND], {}),
    "takeoff_not_first": ([waypoint(20), TAKEOFF], {}),
    "takeoff_too_low": ([{**TAKEOFF, **altitude(479.0, "amsl")}, waypoint(20)], {}),
    "takeoff_low": ([{**TAKEOFF, **altitude(481.0, "amsl")}, waypoint(20)], {}),
    "landing_missing": ([TAKEOFF, waypoint(20)], {"MIS_TKO_LAND_REQ": 3.0}),
    "takeoff_landing_mismatch": ([TAKEOFF, waypoint(20)], {"MIS_TKO_LAND_REQ": 4.0}),
    "command_refused": ([TAKEOFF, {"kind": "set_servo", "servo": 1, "pulse_us": 1500}, waypoint(20)], {}),
    "complex_without_items": ([TAKEOFF, {"kind": "complex", "complex_type": "x", "original": "{}"}], {}),
    "jump_target_missing": ([TAKEOFF, waypoint(20), {**ENDLESS_JUMP, "target_index": 7, "repeat": 1}], {}),
    "jump_stalls": ([TAKEOFF, {**ENDLESS_JUMP, "repeat": 60_000}], {}),
    "jump_endless": ([TAKEOFF, waypoint(20), ENDLESS_JUMP], {}),
    "endurance_endless": ([TAKEOFF, waypoint(20), ENDLESS_JUMP], {}),
    "items_never_reached": ([TAKEOFF, {"kind": "return_home"}, waypoint(20), waypoint(30)], {}),
    "speed_invalid": ([TAKEOFF, {"kind": "change_speed", "speed_m_s": 0}, waypoint(20)], {}),
    "speed_too_high": (
        [TAKEOFF, {"kind": "change_speed", "speed_m_s": 9}, waypoint(20)],
        {"MPC_XY_VEL_MAX": 8.0},
    ),
    "speed_too_high of the plan": ([TAKEOFF, waypoint(20)], {"hover_speed_m_s": 14.0}),
    "altitude_too_high": ([TAKEOFF, waypoint(150)], {}),
    "altitude_fence": ([TAKEOFF, waypoint(70)], {"GF_MAX_VER_DIST": 60.0}),
    "fence_invalid": ([TAKEOFF, waypoint(20)], {"fence": [SELF_CROSSING_FENCE]}),
}
"""For each finding code: items, and other fields of the plan or PX4's parameters."""
OPEN_FLY = "{step: fly, points: [{offset_ned_m: [20, 0, -10]}]"
"""A step without its closing brace, so that fields can be appended."""
FLY_HIGH = "{step: fly, points: [{offset_ned_m: [20, 0, -150]}, {offset_ned_m: [40, 0, -50]}]}"
FLY_GLOBAL = "{step: fly, points: [{lat_deg: 47.4002, lon_deg: 8.5, alt_amsl_m: 500}]}"
MISSIONS: dict[str, tuple[list[str], dict[str, Any]]] = {
    "takeoff_missing": ([OPEN_FLY + "}", "{step: land}"], {}),
    "takeoff_in_air": (["TAKE_OFF", "{step: take_off, height_m: 8}", "{step: land}"], {}),
    "landing_missing": (["TAKE_OFF", OPEN_FLY + "}"], {}),
    "estimate_missing": (["TAKE_OFF", FLY_GLOBAL, "{step: land}"], {}),
    "speed_too_high": (["TAKE_OFF", OPEN_FLY + ", speed_m_s: 9}", "{step: land}"], {"MPC_XY_VEL_MAX": 8.0}),
    "speed_too_high of the mission": (
        ["TAKE_OFF", OPEN_FLY + "}", "{step: land}"],
        {"limits": {"speed_m_s": 14.0}},
    ),
    "tilt_exceeded": (
        ["TAKE_OFF", "{step: attitude, roll_rad: 1.2, pitch_rad: 1.2, thrust: 0.5, duration_s: 1}"],
        {},
    ),
    "duration_too_short": (["TAKE_OFF", "{step: velocity, velocity_ned_m_s: [5, 0, 0], duration_s: 1}"], {}),
    "altitude_too_high": (["TAKE_OFF", FLY_HIGH], {}),
    "altitude_too_high of the take-off": (["{step: take_off, height_m: 130}", "{step: land}"], {}),
    "altitude_fence": (["TAKE_OFF", FLY_HIGH], {"GF_MAX_VER_DIST": 80.0}),
    "limit_exceeded": (["TAKE_OFF", FLY_HIGH], {"height_max_m": 40.0}),
    "altitude_below_home": (["TAKE_OFF", "{step: fly, points: [{offset_ned_m: [20, 0, 3]}]}"], {}),
    "gimbal_steep": (["TAKE_OFF", "{step: gimbal, track: fixed, pitch_rad: 2}", OPEN_FLY + "}"], {}),
    "gimbal_steep of a sweep": (
        ["TAKE_OFF", "{step: gimbal, track: sweep, pitch_rad: -1.2, sweep_pitch_rad: 0.6}"],
        {},
    ),
}
"""For each finding code: steps, of which TAKE_OFF is a take-off, and other fields or PX4's parameters."""
DOCUMENT_FIELDS = {"planned_home", "hover_speed_m_s", "fence", "limits"}


def make_plan(items: list[dict[str, Any]], extras: dict[str, Any]) -> Plan:
    fields = {name: value for name, value in extras.items() if name in DOCUMENT_FIELDS}
    text = json.dumps({"planned_home": HOME, "items": items, **fields})
    return Plan.model_validate_json(text)


def make_mission(steps: list[str], extras: dict[str, Any]) -> OffboardMission:
    lines = "".join(f"- {step.replace('TAKE_OFF', '{step: take_off, height_m: 10}')}\n" for step in steps)
    limits_line = f"limits: {json.dumps(extras['limits'])}\n" if "limits" in extras else ""
    return read(f"name: Test\n{limits_line}steps:\n{lines}")


def check(
    document: dict[str, Any], extras: dict[str, Any], home: dict[str, float] | None
) -> list[dict[str, Any]]:
    """Findings as the API returns them."""
    arguments = {
        "plan": json.dumps(document),
        "parameters": {name: value for name, value in extras.items() if name.isupper()},
        "unknown_parameters": [],
        "home": home,
        "origin": None,
        "reported": None,
        "operator": OperatorArea(height_max_m=extras.get("height_max_m")).to_json(),
        "power": {"hover_power_w": 200.0, "battery_wh": 5000.0, "mass_kg": 2.0},
        "elevation": [],
        "traffic": None,
        "vehicle": None,
        "not_known": [],
    }
    return json.loads(tasks.run("check", arguments).body)["findings"]


def cases() -> dict[str, dict[str, Any]]:
    """The plans and the finding that is to be fixed, by name."""
    cases_by_name: dict[str, dict[str, Any]] = {}
    for kind, table, make_document in (("plan", PLANS, make_plan), ("mission", MISSIONS, make_mission)):
        for name, (elements, extras) in table.items():
            document = json.loads(documents.write(make_document(elements, extras)))  # type: ignore[operator]
            findings = check(document, extras, None)
            finding = next(each for each in findings if each["code"] == name.split()[0])
            cases_by_name[f"{kind}: {name}"] = {"more": extras, "document": document, "finding": finding}
    return cases_by_name


def read_stored(name: str) -> dict[str, Any]:
    return json.loads((FOLDER / name).read_text(encoding="utf-8"))


CASE_NAMES = [f"{kind}: {name}" for kind, table in (("plan", PLANS), ("mission", MISSIONS)) for name in table]


def test_the_stored_cases_equal_the_generated_cases() -> None:
    assert cases() == read_stored("cases.json")
    assert list(read_stored("fixed.json")) == CASE_NAMES


@pytest.mark.parametrize("name", CASE_NAMES)
def test_the_fix_removes_the_finding_and_adds_no_error(name: str) -> None:
    case, fixed_document = read_stored("cases.json")[name], read_stored("fixed.json")[name]
    before = check(case["document"], case["more"], None)
    after = check(fixed_document, case["more"], None)
    fixed_finding = (case["finding"]["code"], json.dumps(case["finding"]["place"]))
    assert fixed_finding not in {(each["code"], json.dumps(each["place"])) for each in after}
    errors = {each["code"] for each in before if each["severity"] == "error"}
    assert {each["code"] for each in after if each["severity"] == "error"} <= errors


if __name__ == "__main__":
    lines = [f"{json.dumps(name)}: {json.dumps(case)}" for name, case in cases().items()]
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / "cases.json").write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
