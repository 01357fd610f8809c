"""An offboard mission flies on from a logged moment: unchanged it stays with the log, a changed step is
flown."""

import json

import numpy as np
import pytest

from gcs_server.logbook import tasks
from missions.geodesy import LocalOrigin
from missions.offboard.document import write
from missions.offboard.positions import Start
from missions.offboard.segments import CurveSegment
from missions.what_if.flight import LoggedStream, MissionBegin, NotFlyable
from missions.what_if.mission_moment import FlownMission
from tests.support.flown_mission import flown_offboard
from tests.support.offboard_missions import mission, timeline

pytestmark = pytest.mark.flight

STEPS = """
- {step: take_off, height_m: 6}
- {step: fly, speed_m_s: 4, points: [{offset_ned_m: [20, 0, -6]}, {offset_ned_m: [20, 20, -8]}]}
- {step: hold, duration_s: 4}
- {step: orbit, center: {offset_ned_m: [10, 20, -8]}, radius_m: 8, turns: 2, speed_m_s: 4}
- {step: wait, until: person, timeout_s: 60}
- {step: velocity, velocity_ned_m_s: [2, 0, 0], duration_s: 5}
- {step: land}
"""
ROUNDS = """
- {step: take_off, height_m: 6}
- step: repeat
  times: 3
  steps:
  - {step: fly, points: [{offset_ned_m: [12, 0, -6]}]}
  - {step: fly, points: [{offset_ned_m: [0, 0, -6]}]}
- step: branch
  condition: {value: battery_share, above: 0.1}
  then:
  - {step: fly, points: [{offset_ned_m: [0, 15, -6]}, {offset_ned_m: [10, 15, -6]}]}
  otherwise: [{step: land}]
- {step: land}
"""
IN_FLY, IN_HOLD, IN_ORBIT, IN_WAIT, IN_VELOCITY = 13.0, 23.0, 45.0, 63.0, 67.5
AFTER_CORNER = 20.0
QUESTION_S = 5.0
HOLD_AFTER_1 = {"number": 1, "moved_ned_m": None, "speed_m_s": None, "then": "hold"}


def answered_late(pilot, t_s):
    """The person answers after `QUESTION_S`."""
    asked = pilot.__dict__.setdefault("asked_s", t_s) if pilot.runner.question is not None else t_s
    pilot._answers = lambda _: t_s - asked >= QUESTION_S


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return flown_offboard(
        tmp_path_factory.mktemp("mission"),
        mission(STEPS),
        for_s=85.0,
        before_each_step=answered_late,
        parameters={"GF_MAX_VER_DIST": 100.0},
    )


@pytest.fixture(scope="module")
def rounds(tmp_path_factory):
    """Paused for 4 s in the second round; the first leg of the third one is skipped."""

    def steer(pilot, t_s):
        runner, now = pilot.runner, round(t_s, 2)
        if now == 24.0:
            pilot.execute(t_s, runner.pause(t_s, pilot.reading(), "Pilot"))
        elif now == 28.0:
            pilot.execute(t_s, runner.resume(t_s, pilot.reading(), "Pilot"))
        elif now == 38.0:
            pilot.execute(t_s, runner.skip(t_s, pilot.reading(), "Pilot"))

    return flown_offboard(
        tmp_path_factory.mktemp("rounds"), mission(ROUNDS), for_s=75.0, before_each_step=steer
    )


def rerun(flight, at_s, *, duration_s=15.0, steps=STEPS, **change):
    folder, start_s = flight
    request = {
        "flown_by": "autopilot", "parameters": {}, "wind_ned_m_s": None, "motor_health": None,
        "moved_ned_m": None, "battery_percent": None, "lost": [], "item": None, "step": None,
    }  # fmt: skip
    plan = None
    if steps is not None:
        plan = {"kind": "offboard_mission", "text": write(mission(steps)).decode()}
    from_s = start_s + at_s
    return json.loads(tasks.rerun(str(folder), from_s, from_s + duration_s, request | change, plan))


def step(place, **change):
    return {
        "place": place,
        "point": None,
        "moved_ned_m": None,
        "speed_m_s": None,
        "duration_s": None,
    } | change


def position(track):
    return np.array(track["position_ned_m"])


def places(track):
    return [each["text"] for each in track["steps"]]


def begins_s(result, track, place):
    return next(each["t_s"] for each in result[track]["steps"] if each["text"].startswith(place))


def nearest_m(track, north_m, east_m):
    return np.hypot(*(position(track)[:, :2] - (north_m, east_m)).T).min()


@pytest.mark.parametrize(
    ("at_s", "near_m"),
    [(IN_FLY, 0.3), (IN_HOLD, 0.6), (IN_ORBIT, 0.3), (IN_WAIT, 0.3), (IN_VELOCITY, 0.6)],
)
def test_an_unchanged_mission_stays_with_the_log(flight, at_s, near_m):
    result = rerun(flight, at_s)
    assert result["max_error_m"] < near_m
    assert result["changed"]["position_ned_m"] == result["unchanged"]["position_ned_m"]
    assert result["notes"] == [], "it lands by itself"


def test_it_says_which_step_began_when_and_answers_questions_as_late_as_in_the_log(flight):
    result = rerun(flight, IN_ORBIT, duration_s=40.0)
    assert [each.split(":")[0] for each in places(result["unchanged"])] == [
        "Step 4", "Step 5", "Step 6", "Step 7",
    ]  # fmt: skip
    waited_s = begins_s(result, "unchanged", "Step 6") - begins_s(result, "unchanged", "Step 5")
    assert waited_s == pytest.approx(QUESTION_S, abs=0.7)
    assert [each["text"] for each in result["unchanged"]["modes"]] == ["Offboard", "Land"]


@pytest.mark.parametrize("at_s", [18.0, 26.0, 31.0, 45.0, 52.0])
def test_rounds_a_pause_a_skipped_step_and_a_branch_are_found_in_the_log(rounds, at_s):
    result = rerun(rounds, at_s, duration_s=2.0, steps=ROUNDS)
    assert result["max_error_m"] < 0.5
    assert result["notes"] == []


def test_the_round_is_found_in_a_flight_of_most_of_an_hour():
    """By the setpoints alone; fewer of them are compared."""
    circles = "- {step: orbit, center: {offset_ned_m: [0, 0, -6]}, radius_m: 20, turns: 1, speed_m_s: 2}\n"
    steps = f"- {{step: take_off, height_m: 6}}\n- step: repeat\n  times: 50\n  steps:\n  {circles}"
    origin = LocalOrigin(47.0, 8.0, 480.0)
    segments = timeline(steps, Start(origin=origin, home_alt_amsl_m=480.0)).segments
    flown = [each.curve for each in segments if isinstance(each, CurveSegment)][:40]
    followed = np.concatenate(
        [curve.sample(np.arange(0.0, curve.duration_s, 0.2)).position_ned_m for curve in flown]
    )
    t_s = 10.0 + 0.2 * np.arange(len(followed))
    assert t_s[-1] > 2000.0
    begin = MissionBegin(10.0, (0.0, 0.0, 0.0), 0.0, in_air=False)
    stream = LoggedStream(t_s, followed, (2.0, 0.0, 0.0), (begin,), origin)
    moment = FlownMission(mission(steps), stream, {}, 480.0).moment
    present = moment.segments()[moment.index]
    assert isinstance(present, CurveSegment)
    assert present.curve.duration_s == flown[-1].duration_s
    assert moment.index == [n for n, each in enumerate(segments) if isinstance(each, CurveSegment)][39]
    assert moment.t_s == pytest.approx(present.duration_s, abs=0.3)


def test_a_moved_point_of_the_present_step_is_flown_without_a_stop(flight):
    result = rerun(flight, IN_FLY, step=step("step 2", point=2, moved_ned_m=[5.0, 6.0, -4.0]))
    assert nearest_m(result["changed"], 25.0, 26.0) < 0.5
    assert nearest_m(result["unchanged"], 25.0, 26.0) > 6.0
    assert position(result["changed"])[:, 2].min() == pytest.approx(-12.0, abs=0.5)
    speed = np.linalg.norm(np.array(result["changed"]["velocity_ned_m_s"])[:10], axis=1)
    assert speed.min() > 2.0


def test_a_moved_circle_is_approached_and_flown_for_the_rest_of_its_turns(flight):
    result = rerun(flight, IN_ORBIT, duration_s=30.0, step=step("step 4", moved_ned_m=[0.0, 12.0, 0.0]))
    middle_m = np.hypot(*(position(result["changed"])[150:250, :2] - (10.0, 32.0)).T)
    assert middle_m == pytest.approx(8.0, abs=0.5)


def test_a_slower_step_goes_on_in_the_same_turn(flight):
    result = rerun(flight, IN_ORBIT, duration_s=60.0, step=step("step 4", speed_m_s=2.0))
    rest_s = begins_s(result, "unchanged", "Step 5") - result["t_s"][0]
    slower_s = begins_s(result, "changed", "Step 5") - result["t_s"][0]
    assert slower_s == pytest.approx(2.0 * rest_s, rel=0.15)


def test_a_longer_hold_and_a_shorter_wait_are_flown(flight):
    longer = rerun(flight, IN_HOLD, duration_s=12.0, step=step("step 3", duration_s=9.0))
    assert begins_s(longer, "changed", "Step 4") - begins_s(longer, "unchanged", "Step 4") == pytest.approx(
        5.0, abs=0.15
    )
    shorter = rerun(flight, IN_ORBIT, duration_s=30.0, step=step("step 5", duration_s=1.0))
    waited_s = begins_s(shorter, "changed", "Step 6") - begins_s(shorter, "changed", "Step 5")
    assert waited_s == pytest.approx(1.0, abs=0.15)


def test_a_repeated_step_changes_in_the_rounds_that_follow(rounds):
    result = rerun(
        rounds, 18.0, duration_s=20.0, steps=ROUNDS, step=step("step 2.1", moved_ned_m=[6.0, 0.0, 0.0])
    )
    assert position(result["changed"])[:, 0].max() == pytest.approx(18.0, abs=0.5)


def test_a_lost_link_ends_the_setpoints_as_it_would_in_flight(flight):
    result = rerun(flight, IN_FLY, lost=["data_link"])
    assert [each["text"] for each in result["changed"]["modes"]] == ["Offboard", "Return"]
    assert places(result["changed"]) == ["Step 2: Fly"]
    assert [each["text"] for each in result["unchanged"]["modes"]] == ["Offboard"]


def test_a_low_battery_does_what_the_mission_says(flight):
    result = rerun(flight, IN_FLY, battery_percent=14.0, parameters={"COM_LOW_BAT_ACT": 0})
    assert "Battery at 14%: returning home." in [each["text"] for each in result["changed"]["warnings"]]
    assert [each["text"] for each in result["changed"]["modes"]] == ["Offboard", "Return"]


def test_what_the_checks_find_of_the_changed_step_is_said(flight):
    result = rerun(flight, IN_FLY, duration_s=2.0, step=step("step 6", duration_s=9.0))
    assert result["notes"] == []
    result = rerun(flight, IN_FLY, duration_s=2.0, step=step("step 4", moved_ned_m=[0.0, 0.0, -150.0]))
    assert result["notes"] == [
        f"With the change, step {place}: {title} climbs to 158 m above home; the geofence limit is 100 m."
        for place, title in ((4, "Approach"), (4, "Orbit"), (5, "Wait"), (6, "Velocity"), (7, "Land"))
    ]


@pytest.mark.parametrize(
    ("at_s", "change", "field", "words"),
    [
        (IN_ORBIT, {"step": step("step 2", speed_m_s=2.0)}, "step", "Step 2 was flown before; .* step 4"),
        (IN_ORBIT, {"step": step("step 9", speed_m_s=2.0)}, "step", "has no step 9"),
        (
            IN_FLY,
            {"step": step("step 3", moved_ned_m=[1.0, 0.0, 0.0])},
            "step",
            r"3 \(hold\) has no position",
        ),
        (IN_FLY, {"step": step("step 3", speed_m_s=1.0)}, "step", r"Step 3 \(hold\) has no speed"),
        (IN_FLY, {"step": step("step 2", duration_s=1.0)}, "step", "no duration of its own"),
        (IN_FLY, {"step": step("step 2", point=3, duration_s=1.0)}, "step", "no point 3; it has 2"),
        (IN_FLY, {"step": step("step 4", point=1, duration_s=1.0)}, "step", "through no points"),
        (IN_VELOCITY, {"step": step("step 6", duration_s=1.0)}, "step", "not reached in 1 s"),
        (IN_FLY, {"item": HOLD_AFTER_1}, "item", "flew in Offboard then, in which no plan item"),
        (IN_FLY, {"steps": None}, "plan", "does not know its offboard mission"),
        (AFTER_CORNER, {"steps": STEPS.replace("[20, 0,", "[26, 0,")}, "plan", "it was changed since"),
        (9.5, {"step": step("step 3", duration_s=1.0)}, "step", "flew in Hold then"),
    ],
)
def test_what_cannot_be_flown_on_is_refused_with_the_reason(flight, at_s, change, field, words):
    with pytest.raises(NotFlyable, match=words) as refused:
        rerun(flight, at_s, **change)
    assert refused.value.field == field


def test_a_mission_of_several_vehicles_is_refused(flight):
    folder, start_s = flight
    roles = {"format": "offboard-gcs-mission", "version": 1, "name": "Two", "roles": {
        name: {"steps": [{"step": "take_off", "height_m": 5}, {"step": "land"}]} for name in ("a", "b")
    }}  # fmt: skip
    request = {
        "flown_by": "autopilot", "parameters": {}, "wind_ned_m_s": None, "motor_health": None,
        "moved_ned_m": None, "battery_percent": None, "lost": [], "item": None, "step": None,
    }  # fmt: skip
    plan = {"kind": "offboard_mission", "text": json.dumps(roles)}
    with pytest.raises(NotFlyable, match="for several vehicles"):
        tasks.rerun(str(folder), start_s + IN_FLY, start_s + IN_FLY + 5.0, request, plan)
