"""A mission for several vehicles: the document, errors in it, and findings about separation."""

from __future__ import annotations

import re

import pytest

from missions import documents
from missions.errors import PlanError
from missions.geodesy import LocalOrigin
from missions.offboard import document
from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.positions import Start
from missions.offboard.reader import read
from missions.offboard.roles import CompiledRoles, compile_roles, planned_starts
from missions.offboard.segments import WaitSegment
from missions.offboard.state import MissionVehicle
from missions.offboard.writer import write_yaml
from tests.support.offboard_missions import HOME

TAKE_OFF, LAND = "{step: take_off, height_m: 10}", "{step: land}"


def crossing(meet_step: str = "") -> OffboardMission:
    """A mission of two vehicles 40 m apart whose diagonal paths cross."""
    return read(
        "name: Crossing\nroles:\n"
        f"  lead:\n    steps:\n    - {TAKE_OFF}\n    - {fly(40, 40)}\n{meet_step}    - {LAND}\n"
        f"  left:\n    steps:\n    - {TAKE_OFF}\n{meet_step}    - {fly(40, -40)}\n    - {LAND}\n"
    )


def fly(north: float, east: float) -> str:
    return f"{{step: fly, points: [{{offset_ned_m: [{north}, {east}, -10]}}]}}"


def compile_with_distance(mission: OffboardMission, east_m: float = 40.0) -> CompiledRoles:
    """Compiles the roles for vehicles at this distance; each vehicle is at its own local origin."""
    origin = LocalOrigin(47.0, 8.0, 480.0)
    lat, lon, alt = origin.to_geodetic((0.0, east_m, 0.0))
    starts = {"lead": Start(origin=origin), "left": Start(origin=LocalOrigin(lat, lon, alt))}
    return compile_roles(mission, dict.fromkeys(starts, MissionVehicle()), starts)


def codes(compiled: CompiledRoles) -> list[str]:
    return [each.code for each in compiled.findings]


def test_a_mission_with_roles_is_unchanged_after_writing_and_its_steps_are_counted() -> None:
    mission = crossing("    - {step: meet, meeting: crossed}\n")
    assert list(mission.roles) == ["lead", "left"]
    assert mission.steps == ()
    assert documents.count_steps(mission) == 8
    assert read(document.write(mission)) == mission
    assert read(write_yaml(mission)) == mission
    assert documents.read(documents.write(mission)) == mission


def test_a_mission_without_roles_is_written_without_roles() -> None:
    text = document.write(read(f"name: One\nsteps:\n  - {LAND}\n")).decode()
    assert "roles" not in text
    assert "separation" not in text


@pytest.mark.parametrize(
    ("text", "place", "reason"),
    [
        (f"steps: [{LAND}]\nroles:\n  a: {{steps: [{LAND}]}}\n  b: {{steps: [{LAND}]}}", "line 1", "roles"),
        (f"roles:\n  a: {{steps: [{LAND}]}}", "line 1", "single role"),
        (f"steps: [{LAND}]\nminimum_separation_m: 4", "line 1", "belongs to `roles`"),
        (
            f"roles:\n  a: {{steps: [{LAND}]}}\n  b:\n    steps:\n    - {LAND}\n    - {{step: hold}}",
            "line 7, role 'b', step 2, field duration_s",
            "required",
        ),
        ("roles:\n  a: {steps: []}", "line 3, role 'a', field steps", "at least 1"),
        (
            f"roles:\n  a: {{steps: [{LAND}]}}\n  b: {{steps: [{{step: call, mission: x}}]}}",
            "role 'b', call of 'x'",
            "no list with this name",
        ),
        ("steps: [{step: meet, meeting: x}]", "the steps", "no roles"),
        (
            f"roles:\n  a: {{steps: [{{step: meet, meeting: x}}]}}\n  b: {{steps: [{LAND}]}}",
            "role 'b', meeting 1",
            "it is missing, but 'x' in role 'a'",
        ),
        (
            "roles:\n  a: {steps: [{step: repeat, times: 2, steps: [{step: meet, meeting: x}]}]}\n"
            "  b: {steps: [{step: meet, meeting: x}, {step: meet, meeting: y}]}",
            "role 'b', meeting 2",
            "it is 'y', but 'x' in role 'a'",
        ),
        (
            "roles:\n  a: {steps: [{step: branch, condition: {value: satellites, above: 9}, then: "
            f"[{{step: meet, meeting: x}}]}}]}}\n  b: {{steps: [{LAND}]}}",
            "role 'a'",
            "inside a branch",
        ),
        (
            "roles:\n  a: {steps: [{step: repeat, times: 1000, steps: [{step: repeat, times: 1000, steps: "
            "[{step: meet, meeting: x}]}]}]}\n  b: {steps: [{step: land}]}",
            "role 'a'",
            "more than 1000 meetings",
        ),
    ],
)  # fmt: skip
def test_an_error_names_role_and_step(text: str, place: str, reason: str) -> None:
    with pytest.raises(PlanError) as caught:
        read(f"name: Test\n{text}\n")
    assert caught.value.place == place
    assert reason in caught.value.reason


def test_a_mission_for_several_vehicles_is_never_compiled_for_one_vehicle() -> None:
    with pytest.raises(PlanError, match="it is for 2 vehicles"):
        compile_mission(crossing())
    with pytest.raises(PlanError, match="there is no role 'right'"):
        compile_mission(crossing(), role="right")


def test_each_role_begins_with_a_common_start_and_its_steps_have_the_name_of_the_role() -> None:
    compiled = compile_mission(crossing(), role="left")
    start = compiled.segments[0]
    assert isinstance(start, WaitSegment)
    assert (start.kind, start.message, start.place) == ("meet", "start", "left, start")
    assert compiled.segments[1].place == "left, step 1"


def test_vehicles_that_cross_at_the_same_time_cause_a_finding_with_position_and_time() -> None:
    compiled = compile_with_distance(crossing())
    assert codes(compiled) == ["separation"]
    text = compiled.findings[0].message
    assert "lead, step 2; left, step 2" in text
    assert re.search(r"lead at 1[45] m north, 1[45] m east, -10 m down", text)
    assert compiled.findings[0].step == "lead, step 2"


def test_vehicles_that_cross_one_after_the_other_because_of_a_meeting_cause_no_finding() -> None:
    mission = read(
        "name: Crossing\nroles:\n"
        f"  lead:\n    steps: [{TAKE_OFF}, {fly(40, 60)}, {{step: meet, meeting: passed}}, {LAND}]\n"
        f"  left:\n    steps: [{TAKE_OFF}, {{step: meet, meeting: passed}}, {fly(40, -40)}, {LAND}]\n"
    )
    compiled = compile_with_distance(mission)
    assert codes(compiled) == []
    lead, left = compiled.timelines.values()
    assert compiled.duration_s > max(lead.duration_s, left.duration_s)


def test_vehicles_too_near_at_the_start_cause_a_finding() -> None:
    compiled = compile_with_distance(crossing(), east_m=4.0)
    assert compiled.findings[0].code == "separation"
    assert "lead, s" in compiled.findings[0].message


def test_the_documents_minimum_separation_is_used() -> None:
    side_by_side = read(
        f"name: Two\nminimum_separation_m: 2\nroles:\n  lead: {{steps: [{TAKE_OFF}, {fly(40, 0)}, {LAND}]}}\n"
        f"  left: {{steps: [{TAKE_OFF}, {fly(40, 0)}, {LAND}]}}\n"
    )
    assert codes(compile_with_distance(side_by_side, east_m=5.0)) == []
    with_default_separation = side_by_side.model_copy(update={"minimum_separation_m": None})
    assert codes(compile_with_distance(with_default_separation, east_m=5.0)) == ["separation"]


def test_without_the_vehicles_positions_there_is_no_finding_about_separation() -> None:
    mission = crossing().model_copy(update={"home": HOME})
    vehicles = dict.fromkeys(mission.roles, MissionVehicle())
    assert "separation_unknown" in codes(compile_roles(mission, vehicles, planned_starts(mission)))
    roles = {
        name: role.model_copy(update={"start_ned_m": (0.0, east, 0.0)})
        for (name, role), east in zip(mission.roles.items(), (0.0, 40.0), strict=True)
    }
    with_starts = mission.model_copy(update={"roles": roles})
    assert "separation" in codes(compile_roles(with_starts, vehicles, planned_starts(with_starts)))


def test_a_role_without_a_vehicle_is_refused() -> None:
    with pytest.raises(PlanError, match="role 'left' has no vehicle"):
        compile_roles(crossing(), {"lead": MissionVehicle()}, {"lead": Start()})
