"""The document of an offboard mission: its fields, and the errors for invalid fields."""

from __future__ import annotations

import contextlib
import json
import time

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from missions.errors import PlanError
from missions.offboard import document
from missions.offboard.document import OffboardMission
from missions.offboard.reader import MAX_VALUES, read, read_json
from missions.offboard.steps import FlyPoint, Hold, MissionStep, Orbit
from missions.offboard.writer import write_yaml

HEAD = "name: Test\nsteps:\n"
LAND_ONLY = "  - {step: land}\n"
ORBIT_BEGINNING = "  - {step: orbit, radius_m: 3, center: "


def test_yaml_and_json_give_the_same_mission() -> None:
    text = (
        HEAD
        + "  - {step: take_off, height_m: 5}\n  - {step: hold, duration_s: 1.5, name: 'yes'}\n"
        + LAND_ONLY
    )
    mission = read(text)
    assert [step.step for step in mission.steps] == ["take_off", "hold", "land"]
    assert mission.steps[1] == Hold(duration_s=1.5, name="yes")
    assert read(document.write(mission)) == mission
    assert read(text.encode()) == mission


def test_numbers_and_truth_values_in_yaml_are_read_as_such() -> None:
    mission = read(HEAD + ORBIT_BEGINNING + "{position_ned_m: [1, -2e1, .5]}, clockwise: false}")
    orbit = mission.steps[0]
    assert isinstance(orbit, Orbit)
    assert orbit.center.position_ned_m == (1.0, -20.0, 0.5)
    assert orbit.clockwise is False


def test_the_schema_contains_every_kind_of_step() -> None:
    schema_text = json.dumps(document.schema())
    for kind in MissionStep.__origin__.__args__:  # type: ignore[attr-defined]
        assert f'"{kind.model_fields["step"].default}"' in schema_text


@pytest.mark.parametrize(
    ("text", "place", "reason"),
    [
        ("", "the file", "empty"),
        ("steps: [", "line 1", "not valid YAML"),
        ("- 1", "line 1", "object"),
        ("name: a\nname: b", "line 2", "appears twice"),
        ("name: &x a", "line 1", "anchors"),
        ("name: !!python/object:os.system a", "line 1", "tag"),
        ("name: a\n---\nname: b", "the file", "more than one document"),
        ("? [1]\n: 2", "line 1", "plain word"),
        ("name: " + "9" * 50, "line 1", "digits"),
        ("name: a", "line 1", "give `steps`"),
        (HEAD + "  - step: jump", "line 3, step 1", "take_off"),
        (HEAD + "  - {hold: 1}", "line 3, step 1", "no `step` field"),
        (HEAD + "  - step: hold\n    duration_s: -1", "line 4, step 1, field duration_s", "greater"),
        (HEAD + "  - step: hold\n    duration_s: 1\n    speed: 2", "line 5, step 1, field speed", "not"),
        (HEAD + "  - step: hold\n    duration_s: .nan", "line 4, step 1, field duration_s", "number"),
        (HEAD + "  - step: hold\n    duration_s: '5'", "line 4, step 1, field duration_s", "number"),
        (
            HEAD + "  - step: repeat\n    times: 2\n    steps:\n      - step: fly\n"
            "        points:\n          - offset_ned_m: [1, 2]",
            "line 8, step 1.1, field points[0].offset_ned_m[2]",
            "required",
        ),
        (
            HEAD + LAND_ONLY + "missions:\n  a:\n    - step: take_off\n      height_m: 0",
            "line 7, list 'a', step 1, field height_m",
            "greater",
        ),
        (HEAD + "  - {step: call, mission: b}", "the steps, call of 'b'", "no list with this name"),
        (
            HEAD + LAND_ONLY + "missions:\n  a: [{step: call, mission: b}]\n  b: [{step: call, mission: a}]",
            "list 'a'",
            "loop",
        ),
        (
            HEAD + ORBIT_BEGINNING + "{lat_deg: 1, lon_deg: 2}}",
            "line 3, step 1, field center",
            "exactly one of alt_amsl_m and alt_home_m",
        ),
        (
            HEAD + ORBIT_BEGINNING + "{offset_ned_m: [0, 0, 0]}, yaw_ned_rad: 1, heading: along_path}",
            "line 3, step 1",
            "one of heading",
        ),
    ],
)  # fmt: skip
def test_an_error_names_line_step_and_reason(text: str, place: str, reason: str) -> None:
    with pytest.raises(PlanError) as caught:
        read(text)
    assert caught.value.place == place
    assert reason in caught.value.reason
    assert caught.value.fix.endswith(".")


@pytest.mark.parametrize(
    "text",
    [
        "a: " * 30_000,
        "[" * 100_000,
        "{" * 100_000,
        "steps:\n" + "  - {step: land}\n" * (MAX_VALUES // 2),
        "name: " + "x" * 3_000_000,
        "a: &a [1,1,1,1]\nb: &b [*a,*a,*a,*a]\nc: [*b,*b,*b,*b]",
        "\x00",
        "\t- a",
    ],
)
def test_hostile_text_is_refused_quickly(text: str) -> None:
    began_s = time.process_time()
    with pytest.raises(PlanError):
        read(text)
    assert time.process_time() - began_s < 5.0


def test_deeply_nested_calls_are_refused_and_many_calls_are_accepted() -> None:
    nested_lists = "".join(f"  m{k}: [{{step: call, mission: m{k + 1}}}]\n" for k in range(9))
    with pytest.raises(PlanError, match="nested deeper than 8"):
        read(HEAD + "  - {step: call, mission: m0}\nmissions:\n" + nested_lists + "  m9: [{step: land}]\n")
    doubled_calls = "".join(
        f"  m{k}: [{{step: call, mission: m{k + 1}}}, {{step: call, mission: m{k + 1}}}]\n" for k in range(7)
    )
    assert read(
        HEAD + "  - {step: call, mission: m0}\nmissions:\n" + doubled_calls + "  m7: [{step: land}]\n"
    )


@settings(deadline=None, max_examples=200)
@given(st.text(max_size=200) | st.binary(max_size=200))
def test_any_text_gives_a_mission_or_a_plan_error(text: str | bytes) -> None:
    with contextlib.suppress(PlanError):
        assert isinstance(read(text), OffboardMission)


def test_a_position_is_given_in_exactly_one_way() -> None:
    with pytest.raises(ValueError, match="give one of"):
        FlyPoint()
    with pytest.raises(ValueError, match="give one of"):
        FlyPoint(offset_ned_m=(0, 0, 0), position_ned_m=(0, 0, 0))
    with pytest.raises(ValueError, match="both"):
        FlyPoint(lat_deg=1.0, alt_home_m=2.0)


def test_a_mission_built_in_python_equals_the_mission_read_from_yaml() -> None:
    mission = OffboardMission(name="Test", steps=(Hold(duration_s=2.0),), missions={})
    assert read(HEAD + "  - {step: hold, duration_s: 2}") == mission


@settings(deadline=None, max_examples=200)
@given(st.text(min_size=1, max_size=100), st.floats(-1e4, 1e4), st.floats(0.0, 86_400.0))
@example("1e5", 0.1, 0.0)
@example("Null", -0.0, 1.0)
@example("a: b\n # c \n", 1e-7, 2.0)
def test_written_yaml_is_read_as_the_same_mission(text: str, metres: float, seconds: float) -> None:
    try:
        mission = read_json(
            json.dumps(
                {
                    "name": text,
                    "steps": [
                        {"step": "hold", "name": text, "duration_s": seconds},
                        {"step": "fly", "points": [{"offset_ned_m": [metres, 0, -metres]}]},
                        {"step": "call", "mission": text},
                    ],
                    "missions": {text: [{"step": "land"}]},
                    "tables": {text: text},
                }
            )
        )
    except PlanError:
        return  # text that a document cannot contain
    assert read(write_yaml(mission)) == mission


def test_written_yaml_has_the_actions_on_failures_and_omits_other_defaults() -> None:
    written = write_yaml(read(HEAD + "  - {step: photo}\n")).decode()
    assert "link_loss: hold" in written
    assert "count" not in written


def test_an_error_in_json_names_step_and_field() -> None:
    steps = [{"step": "repeat", "times": 2, "steps": [{"step": "hold", "duration_s": -1}]}]
    with pytest.raises(PlanError) as caught:
        read_json(json.dumps({"name": "a", "steps": steps}))
    assert caught.value.place == "step 1.1, field duration_s"
    with pytest.raises(PlanError, match="no list with this name"):
        read_json(json.dumps({"name": "a", "steps": [{"step": "call", "mission": "b"}]}))
    nested_step: dict[str, object] = {"step": "land"}
    for _ in range(12):
        nested_step = {"step": "repeat", "times": 1, "steps": [nested_step]}
    with pytest.raises(PlanError, match="nested deeper"):
        read_json(json.dumps({"name": "a", "steps": [nested_step]}))
