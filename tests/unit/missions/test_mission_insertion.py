"""A stored mission inserted into another mission becomes a list of steps and a call, with the same
meaning."""

from __future__ import annotations

import itertools
import json
import math
from typing import Any

import pytest

from missions.errors import PlanError
from missions.geodesy import LocalOrigin
from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.insertion import InsertionResult, insert
from missions.offboard.positions import Start
from missions.offboard.reader import read_json
from missions.offboard.roles import planned_starts
from missions.offboard.steps import Call, Fly, Repeat, Table
from tests.support.offboard_missions import finding_codes

FORMAT = "offboard-gcs-mission"
HOME = {"lat_deg": 47.0, "lon_deg": 8.0, "alt_amsl_m": 480.0}
OTHER_HOME = {"lat_deg": 47.001, "lon_deg": 8.002, "alt_amsl_m": 492.0}
TAKE_OFF, LAND = {"step": "take_off", "height_m": 10}, {"step": "land"}
CSV = "t_s,north_m,east_m,down_m\n0,0,0,-10\n20,20,0,-10\n"


def fly(*offset_ned_m: float, **rest: Any) -> dict[str, Any]:
    return {"step": "fly", "points": [{"offset_ned_m": offset_ned_m}], **rest}


def call(name: str) -> dict[str, Any]:
    return {"step": "call", "mission": name}


def mission(*steps: dict[str, Any], name: str = "Field", **rest: Any) -> OffboardMission:
    return read_json(json.dumps({"format": FORMAT, "name": name, "steps": list(steps), **rest}))


def tower(*steps: dict[str, Any], **rest: Any) -> OffboardMission:
    return mission(*(steps or (TAKE_OFF, fly(30, 0, -12), LAND)), name="Tower", **rest)


FIELD = mission(TAKE_OFF, fly(5, 0, -10), LAND)


def insertion_error(
    host: OffboardMission, added: OffboardMission, *at: str | int, **options: Any
) -> PlanError:
    with pytest.raises(PlanError) as raised:
        insert(host, added, at or ("steps", 1), **options)
    return raised.value


def segment_ends(document: OffboardMission) -> list[tuple[float, ...]]:
    """The ends of the planned segments, as positions relative to HOME (NED)."""
    assert document.home is not None
    timeline = compile_mission(document)
    assert not {"step_invalid", "estimate_missing"} & finding_codes(timeline)
    origin = LocalOrigin(**document.home.model_dump())
    ends = [segment.end_ned_m for segment in timeline.segments if segment.title in ("Fly", "Table", "Orbit")]
    return [LocalOrigin(**HOME).to_ned(*origin.to_geodetic(end)) for end in ends]


def test_the_steps_become_a_list_that_a_new_step_calls() -> None:
    result = insert(FIELD, tower(), ("steps", 2))
    assert [step.step for step in result.mission.steps] == ["take_off", "fly", "call", "land"]
    assert result.mission.steps[2] == Call(mission="Tower")
    assert result.mission.missions == {"Tower": tower().steps}
    assert (result.called, result.notes, result.mission.name) == ("Tower", (), "Field")
    assert FIELD.missions == {}


def test_take_off_and_landing_are_omitted_from_a_mission_that_is_flown_in_the_air() -> None:
    gimbal = {"step": "gimbal", "track": "fixed"}
    added = tower(gimbal, TAKE_OFF, fly(30, 0, -12), LAND)
    result = insert(FIELD, added, ("steps", 2), in_air=True)
    assert [step.step for step in result.mission.missions["Tower"]] == ["gimbal", "fly"]
    assert result.notes == (
        "Take-off and landing of 'Tower' are left out. The vehicle flies straight to its first position.",
    )
    assert "takeoff_in_air" in finding_codes(compile_mission(insert(FIELD, added, ("steps", 2)).mission))
    assert not finding_codes(compile_mission(result.mission))
    two_takeoffs = tower(TAKE_OFF, LAND, TAKE_OFF, fly(30, 0, -12))
    remaining_steps = insert(FIELD, two_takeoffs, ("steps", 2), in_air=True).mission.missions["Tower"]
    assert [step.step for step in remaining_steps] == ["land", "take_off", "fly"]
    error = insertion_error(FIELD, tower(TAKE_OFF, LAND), in_air=True)
    assert (error.field, error.reason) == ("in_air", "without its take-off and landing it has no steps")


@pytest.mark.parametrize(
    ("at", "place"),
    [
        (("steps", 0), "step 1"),
        (("steps", 3, "then", 1), "step 4 then 2"),
        (("steps", 2, "steps", 0), "step 3.1"),
        (("missions", "round", 1), "step 2, round 2"),
    ],
)
def test_the_call_is_inserted_at_any_place(at: tuple[str | int, ...], place: str) -> None:
    hold = {"step": "hold", "duration_s": 1}
    repeat = {"step": "repeat", "times": 2, "steps": [hold]}
    branch = {"step": "branch", "condition": {"value": "battery_share", "above": 0.5}, "then": [hold]}
    host = mission(TAKE_OFF, call("round"), repeat, branch, missions={"round": [hold]})
    result = insert(host, tower(fly(30, 0, -12)), at)
    timeline = compile_mission(result.mission)
    places = [each.place for part in (timeline, timeline.then) if part for each in part.segments]
    assert f"{place}, Tower 1" in places


@pytest.mark.parametrize(
    "at",
    [
        ("steps",), (), ("steps", 4), ("steps", -1), ("steps", "1"), ("home", 0), ("steps", 1, "points", 0),
        ("missions", "none", 0), ("steps", 1, "steps", 0), ("roles", "lead", "steps", 0), ("steps", 1, 0),
    ],
)  # fmt: skip
def test_an_invalid_path_to_a_step_is_refused(at: tuple[str | int, ...]) -> None:
    with pytest.raises(PlanError, match=r"not a valid position for a step.*\[\"steps\", 2\]") as raised:
        insert(FIELD, tower(), at)
    assert raised.value.field == "at"


def test_the_lists_that_the_inserted_mission_calls_are_copied_under_free_names() -> None:
    lists = {"round": [fly(1, 0, -9), call("photos")], "photos": [{"step": "photo"}], "unused": [LAND]}
    repeat = {"step": "repeat", "times": 2, "steps": [call("round")]}
    added = tower(TAKE_OFF, repeat, LAND, missions=lists)
    host = mission(
        TAKE_OFF, call("round"), missions={"round": [fly(2, 0, -9)], "photos": [{"step": "photo"}]}
    )
    combined = insert(host, added, ("steps", 2)).mission
    assert list(combined.missions) == ["round", "photos", "Tower", "round 2"]
    repeat_step = combined.missions["Tower"][1]
    assert isinstance(repeat_step, Repeat)
    assert repeat_step.steps == (Call(mission="round 2"),)
    assert combined.missions["round 2"][1] == Call(mission="photos")
    assert combined.missions["round"] == host.missions["round"]


def test_a_mission_that_was_inserted_before_is_called_again() -> None:
    added = tower(fly(30, 0, -12), call("round"), missions={"round": [fly(1, 0, -9)]})
    with_tower = insert(FIELD, added, ("steps", 1)).mission
    with_two_calls = insert(with_tower, added, ("steps", 3))
    assert (with_two_calls.called, list(with_two_calls.mission.missions)) == ("Tower", ["Tower", "round"])
    changed = tower(fly(30, 0, -12), call("round"), missions={"round": [fly(2, 0, -9)]})
    with_changed_tower = insert(with_tower, changed, ("steps", 3))
    assert (with_changed_tower.called, list(with_changed_tower.mission.missions)) == (
        "Tower 2",
        ["Tower", "round", "Tower 2", "round 2"],
    )


def test_a_mission_inserted_into_a_list_with_the_name_of_its_own_list_creates_no_loop() -> None:
    added = tower(call("round"), missions={"round": [fly(1, 0, -9)]})
    host = mission(TAKE_OFF, call("round"), missions={"round": [fly(1, 0, -9)]})
    combined = insert(host, added, ("missions", "round", 0)).mission
    assert combined.missions["round"][0] == Call(mission="Tower")
    assert combined.missions["Tower"] == (Call(mission="round 2"),)
    field_in_itself = insert(FIELD, FIELD, ("steps", 1), in_air=True).mission
    assert field_in_itself.missions == {"Field": (FIELD.steps[1],)}


@pytest.mark.parametrize(
    ("name", "called"), [("a\x07\tb", "a  b"), ("\n", "mission"), ("é" * 100, "é" * 98 + " 2")]
)
def test_the_list_gets_a_valid_free_name(name: str, called: str) -> None:
    host = mission(TAKE_OFF, call("é" * 100), missions={"é" * 100: [LAND]})
    assert insert(host, tower().model_copy(update={"name": name}), ("steps", 1)).called == called


def chained_calls(depth: int) -> dict[str, Any]:
    return {
        f"level {i}": [call(f"level {i + 1}") if i < depth else fly(1, 0, -9)] for i in range(1, depth + 1)
    }


def test_calls_may_be_nested_eight_deep() -> None:
    assert insert(FIELD, tower(call("level 1"), missions=chained_calls(7)), ("steps", 1)).called == "Tower"
    error = insertion_error(FIELD, tower(call("level 1"), missions=chained_calls(8)))
    assert "nested deeper than 8" in error.reason
    assert "Replace some calls" in error.fix


def test_a_mission_with_many_lists_that_call_each_other_can_be_inserted() -> None:
    layers = [[f"{layer} {i}" for i in range(12)] for layer in range(7)]
    lists = {
        name: [call(each) for each in below] for names, below in itertools.pairwise(layers) for name in names
    }
    lists |= {name: [LAND] for name in layers[-1]}
    added = tower(
        call("0 0"), missions={name: lists[name] for name in lists if name == "0 0" or name[0] != "0"}
    )
    with_tower = insert(FIELD, added, ("steps", 1)).mission
    assert insert(with_tower, added, ("steps", 1)).called == "Tower"


def test_too_many_lists_or_tables_are_refused() -> None:
    host = mission(TAKE_OFF, missions={f"list {i}": [LAND] for i in range(100)})
    assert insertion_error(host, tower()).place == "field missions"
    tables = {f"{i}.csv": CSV for i in range(20)}
    added = tower({"step": "table", "file": "a.csv"}, tables={"a.csv": CSV + "30,0,0,-10\n"})
    assert insertion_error(mission(TAKE_OFF, tables=tables), added).place == "field tables"


def test_a_mission_for_several_vehicles_is_refused() -> None:
    added = read_json(
        json.dumps(
            {
                "format": FORMAT,
                "name": "Show",
                "roles": {"a": {"steps": [TAKE_OFF]}, "b": {"steps": [TAKE_OFF]}},
            }
        )
    )
    error = insertion_error(FIELD, added)
    assert "for 2 vehicles (roles: a, b)" in error.reason


# --- positions ----------------------------------------------------------------------------------


STEPS_WITH_POSITIONS = (
    TAKE_OFF,
    fly(30, 0, -12),
    {"step": "fly", "points": [{"position_ned_m": [40, 10, -15]}]},
    {"step": "fly", "points": [{"lat_deg": 47.0015, "lon_deg": 8.0021, "alt_home_m": 20}]},
    {"step": "fly", "points": [{"lat_deg": 47.0014, "lon_deg": 8.0021, "alt_amsl_m": 520}]},
    {
        "step": "orbit",
        "center": {"offset_ned_m": [0, 20, -9]},
        "radius_m": 5,
        "look_at": {"offset_ned_m": [0, 0, 0]},
    },
    {"step": "table", "file": "a.csv"},
    {"step": "table", "file": "a.csv", "relative": False},
    LAND,
)
HOST = mission(TAKE_OFF, LAND, home=HOME)
ADDED = tower(*STEPS_WITH_POSITIONS, home=OTHER_HOME, tables={"a.csv": CSV})


def test_positions_are_unchanged_if_the_starts_are_the_same() -> None:
    added = tower(*STEPS_WITH_POSITIONS, home=HOME, tables={"a.csv": CSV})
    for home in (None, {**HOME, "alt_amsl_m": 480.3}):
        host = mission(TAKE_OFF, LAND, home=home) if home else mission(TAKE_OFF, LAND)
        combined = insert(host, added, ("steps", 1)).mission
        assert combined.missions["Tower"] == added.steps
        assert combined.tables == {"a.csv": CSV}
    assert "no planned home" in insert(mission(TAKE_OFF, LAND), added, ("steps", 1)).notes[0]


def test_different_starts_need_a_decision_if_positions_are_relative() -> None:
    error = insertion_error(HOST, ADDED)
    assert error.field == "positions"
    assert "188 m apart" in error.reason
    assert "from_start" in error.fix
    amsl_only = tower(STEPS_WITH_POSITIONS[4], home=OTHER_HOME)
    assert insert(HOST, amsl_only, ("steps", 1)).mission.missions["Tower"] == amsl_only.steps


def test_inserted_positions_can_stay_at_their_latitude_and_longitude() -> None:
    result = insert(HOST, ADDED, ("steps", 1), in_air=True, positions="same_places")
    planned_ends = segment_ends(ADDED)
    assert len(planned_ends) > 6
    for end, planned in zip(segment_ends(result.mission), planned_ends, strict=True):
        assert end == pytest.approx(planned, abs=0.02)
    assert "188 m apart" in result.notes[1]
    assert set(result.mission.tables) == {"a.csv"}  # both frames have the same origin here


def test_inserted_positions_can_be_relative_to_the_start_of_the_host_mission() -> None:
    result = insert(HOST, ADDED, ("steps", 1), positions="from_start")
    assert result.mission.missions["Tower"] == ADDED.steps
    assert "now refer to the start and home of this mission" in result.notes[0]


def test_positions_are_inserted_relative_to_the_start_of_the_role() -> None:
    roles = {
        "a": {"start_ned_m": [0, 0, 0], "steps": [TAKE_OFF]},
        "b": {"start_ned_m": [0, 20, -1], "steps": [TAKE_OFF]},
    }
    lists = {"round": [fly(1, 0, -9)]}
    host = read_json(
        json.dumps({"format": FORMAT, "name": "Show", "home": HOME, "roles": roles, "missions": lists})
    )
    added = tower(*STEPS_WITH_POSITIONS[1:-1], home=HOME, tables={"a.csv": CSV})
    assert insert(host, added, ("roles", "a", "steps", 1)).mission.missions["Tower"] == added.steps
    at = ("roles", "b", "steps", 1)
    assert "20 m apart" in insertion_error(host, added, *at).reason
    combined = insert(host, added, at, positions="same_places").mission
    start = planned_starts(combined)["b"]
    ends = [each.end_ned_m for each in compile_mission(combined, start=start, role="b").segments]
    planned_segments = compile_mission(added, start=Start(in_air=True)).segments
    for segment in planned_segments:
        if segment.title == "Fly":
            assert min(math.dist(segment.end_ned_m, end) for end in ends) < 0.01
    assert set(combined.tables) == {"a.csv", "a 2.csv"}
    error = insertion_error(host, added, "missions", "round", 0, positions="same_places")
    assert "roles that may fly this list have different planned starts" in error.reason
    assert insert(host, added, ("missions", "round", 0), positions="from_start").called == "Tower"
    assert 'roles", "lead"' in insertion_error(host, added, "steps", 0).fix


def test_positions_that_are_too_far_away_are_refused() -> None:
    host, added = mission(TAKE_OFF, home=HOME), tower(home={**OTHER_HOME, "lat_deg": 80.0})
    error = insertion_error(host, added, positions="same_places")
    assert "km from the start" in error.reason


# --- fields of the whole mission ------------------------------------------------------------------


def test_the_speed_limit_becomes_a_speed_of_each_step() -> None:
    added = tower(
        fly(1, 0, -9), fly(2, 0, -9, speed_m_s=2), fly(3, 0, -9, speed_m_s=9), limits={"speed_m_s": 3}
    )

    def speeds(host: OffboardMission) -> list[float | None]:
        steps = insert(host, added, ("steps", 1)).mission.missions["Tower"]
        return [step.speed_m_s for step in steps if isinstance(step, Fly)]

    assert speeds(FIELD) == [3, 2, 3]
    assert speeds(mission(TAKE_OFF, limits={"speed_m_s": 5})) == [3, 2, 3]
    assert speeds(mission(TAKE_OFF, limits={"speed_m_s": 2.5})) == [None, 2, 9]


def test_for_other_limits_the_lower_value_applies() -> None:
    host = mission(TAKE_OFF, limits={"climb_m_s": 2, "tilt_rad": 0.3})
    added = tower(limits={"climb_m_s": 1, "tilt_rad": 0.5, "jerk_m_s3": 4})
    result = insert(host, added, ("steps", 1))
    limits = result.mission.limits
    assert (limits.climb_m_s, limits.tilt_rad, limits.jerk_m_s3) == (1, 0.3, 4)
    assert result.notes == (
        "Lower limits of 'Tower' now apply to the whole mission: climb_m_s 1, jerk_m_s3 4.",
    )


def test_avoidance_becomes_a_field_of_each_step() -> None:
    added = tower(fly(1, 0, -9), fly(2, 0, -9, avoidance=False), avoidance="around")

    def avoidance_of_steps(host: OffboardMission) -> list[Any]:
        steps = insert(host, added, ("steps", 1)).mission.missions["Tower"]
        return [step.avoidance for step in steps if isinstance(step, Fly)]

    assert avoidance_of_steps(FIELD) == ["around", False]
    assert avoidance_of_steps(mission(TAKE_OFF, avoidance="around")) == [None, False]
    table = {"step": "table", "file": "a.csv", "name": "Line"}
    error = insertion_error(FIELD, tower(table, avoidance=True, tables={"a.csv": CSV}))
    assert error.place == "mission 'Tower', step 'Line'"
    assert "`avoidance` is over, that of this mission is off" in error.reason


def test_geofence_obstacles_and_actions_are_merged_and_named_in_notes() -> None:
    center = {"lat_deg": 47.0, "lon_deg": 8.0}
    inclusion = {"shape": "circle", "inclusion": True, "center": center, "radius_m": 300}
    exclusion = {"shape": "circle", "inclusion": False, "center": center, "radius_m": 5}
    corners = [center, {**center, "lat_deg": 47.0001}, {**center, "lon_deg": 8.0001}]
    barn = {"polygon": corners, "top": {"value_m": 8.0, "reference": "home"}}
    actions = {"link_loss": "continue"}
    added = tower(
        fly(1, 0, -9), fence=[inclusion, exclusion], obstacles=[barn], home=OTHER_HOME, actions=actions
    )
    host = mission(TAKE_OFF, LAND, home=HOME, fence=[exclusion])
    result = insert(host, added, ("steps", 1), positions="from_start")
    assert result.mission.fence == (*host.fence, added.fence[0])
    assert result.mission.obstacles[0].top.value_m == 20.0
    assert result.mission.actions == host.actions
    assert result.notes[1:] == (
        "The geofence of 'Tower' now applies to the whole mission.",
        "1 obstacle of 'Tower' is added.",
        "The actions of this mission apply: link_loss hold, not continue.",
    )
    larger_inclusion = {**inclusion, "radius_m": 400}
    error = insertion_error(mission(TAKE_OFF, fence=[larger_inclusion]), tower(fence=[inclusion]))
    assert (error.place, "stay inside" in error.reason) == ("mission 'Tower', field fence", True)
    assert isinstance(
        insert(mission(TAKE_OFF, fence=[inclusion]), tower(fence=[inclusion]), ("steps", 1)), InsertionResult
    )


def test_tables_are_inserted_with_the_mission_and_a_missing_table_is_refused() -> None:
    table = {"step": "table", "file": "a.csv"}
    added = tower(TAKE_OFF, table, LAND, tables={"a.csv": CSV, "unused.csv": CSV})
    host = mission(TAKE_OFF, table, LAND, tables={"a.csv": CSV.replace("20,20", "20,30")})
    combined = insert(host, added, ("steps", 2)).mission
    assert combined.tables == {**host.tables, "a 2.csv": CSV}
    table_step = combined.missions["Tower"][1]
    assert isinstance(table_step, Table)
    assert table_step.file == "a 2.csv"
    error = insertion_error(host, tower(TAKE_OFF, table))
    assert (error.place, error.reason) == (
        "mission 'Tower', step 'table'",
        "the mission has no table 'a.csv'",
    )
