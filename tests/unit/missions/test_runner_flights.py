"""The mission runner: whole flights, waits, and the sent setpoints."""

import itertools
import math

import pytest

from missions.runner.course import Course
from missions.runner.requests import ChangeScript, Photo, PointGimbal, StreamScript, TakeOff
from missions.setpoints import Position, Trajectory
from tests.support.mission_steps import (
    CENTER,
    FLOWN_BY_SETPOINTS,
    FLY,
    STEPS,
    all_step_kinds,
    flight_in_step,
    mission_with_lists,
    step_kinds,
)
from tests.support.mission_vehicle import STEP_S, FakeFlight
from tests.support.offboard_missions import flight_steps, mission, timeline


def test_each_step_kind_of_the_mission_format_has_a_test_flight():
    assert set[str]().union(*map(step_kinds, STEPS.values())) == all_step_kinds()
    assert len(all_step_kinds()) >= 18


# --- whole flights --------------------------------------------------------------------------------


def test_a_whole_flight_takes_off_flies_its_path_and_lands():
    steps = [step for kind in FLOWN_BY_SETPOINTS if kind != "meet" for step in STEPS[kind]]
    fake = FakeFlight(mission_with_lists(flight_steps(*steps, FLY))).start()
    fake.set_reading(satellites=14)
    fake.until_state("waiting")
    assert fake.status.question == "Sharp?"
    fake.continue_after_question()
    fake.until_state("done")
    assert fake.requested_modes() == ["land"]
    assert fake.count_requests(TakeOff) == 1
    assert fake.count_requests(StreamScript) == 1  # one stream from take-off to landing
    assert fake.count_requests(Photo) == 20
    assert fake.reading.armed is False
    assert math.dist(fake.flown_path[-1][:2], (30.0, 0.0)) < 1.0


def test_pictures_are_taken_and_the_gimbal_is_pointed_on_time():
    look_at = "step: gimbal, track: look_at, place: {offset_ned_m: [20, 0, 0]}"
    fake = FakeFlight(
        mission(
            flight_steps(
                look_at, f"step: orbit, {CENTER}, photo_every_m: 5", "step: gimbal, track: release", FLY
            )
        )
    )
    fake.start().until_state("done")
    assert fake.count_requests(Photo) == math.ceil(math.tau * 8 / 5)
    gimbal_requests = [request for request in fake.requests if isinstance(request, PointGimbal)]
    assert all(-math.pi / 2 <= p.pitch_rad < 0 for p in gimbal_requests)
    orbit_s = fake.runner.flight.course.segments[3].duration_s
    assert len(gimbal_requests) > 5 * orbit_s  # more than 5 requests per second
    assert fake.runner.flight.last_gimbal_request is None


def test_each_photo_step_takes_its_pictures_with_its_camera():
    photos = "step: photo, count: 2, component: 101", "step: photo, count: 1"
    fake = FakeFlight(mission(flight_steps(*photos))).start().until_state("done")
    taken = [request.component for request in fake.requests if isinstance(request, Photo)]
    assert taken == [101, 101, None]


def test_a_wait_on_the_ground_streams_nothing_before_the_take_off():
    steps = "- {step: wait, until: {value: satellites, above: 10, for_s: 2}, timeout_s: 60}\n"
    fake = FakeFlight(mission(steps + flight_steps(FLY))).start()
    fake.set_reading(satellites=6)
    fake.fly(5)
    assert (fake.status.state, fake.sent_setpoints, fake.count_requests(TakeOff)) == ("waiting", [], 0)
    fake.set_reading(satellites=12)
    fake.fly(1.5)
    assert fake.count_requests(TakeOff) == 0
    fake.until_state("taking_off").until_state("done")


def test_a_mission_can_take_off_again_after_a_landing():
    wait_on_ground = "- {step: wait, until: person, timeout_s: 600}\n"
    fake = FakeFlight(
        mission(flight_steps(FLY) + wait_on_ground + flight_steps("step: hold, duration_s: 1"))
    ).start()
    fake.until_state("waiting")
    assert fake.reading.armed is False
    sent_count = len(fake.sent_setpoints)
    fake.fly(3)
    assert len(fake.sent_setpoints) == sent_count
    fake.continue_after_question()
    fake.until_state("done")
    assert (fake.count_requests(TakeOff), fake.requested_modes()) == (2, ["land", "land"])


def test_a_mission_that_ends_in_flight_switches_to_hold():
    fake = FakeFlight(mission("- {step: take_off, height_m: 10}\n- {" + FLY + "}\n")).start()
    fake.until_state("done")
    assert fake.requested_modes() == ["hold"]


@pytest.mark.parametrize(("battery_share", "east"), [(0.8, 20.0), (0.3, -20.0), (None, -20.0)])
def test_a_branch_is_decided_when_it_is_reached(battery_share, east):
    branch = (
        "step: branch, condition: {value: battery_share, above: 0.5}, "
        "then: [{step: fly, points: [{offset_ned_m: [0, 20, -10]}]}], "
        "otherwise: [{step: fly, points: [{offset_ned_m: [0, -20, -10]}]}]"
    )
    fake = FakeFlight(mission(flight_steps(FLY, branch, "step: hold, duration_s: 1"))).start()
    fake.set_reading(battery_share=battery_share)
    fake.until_state("done")
    assert fake.flown_path[-1][1] == pytest.approx(east, abs=0.5)
    assert fake.count_requests(StreamScript) == 1


def test_the_next_take_off_or_landing_is_found_from_any_segment_and_again_after_a_branch():
    branch = "step: branch, condition: {value: battery_share, above: 0.5}, then: [{step: land}]"
    course = Course(timeline(flight_steps(FLY, branch)))
    count = len(course.segments)
    assert [course.next_px4_segment(index) for index in (1, count, 1, 0)] == [count, count, count, 0]
    course.choose(fulfilled=True)
    assert [course.next_px4_segment(index) for index in (count, 1, 0)] == [count, count, 0]
    assert course.flown_by_px4(count)
    course_with_hold = Course(timeline(flight_steps(FLY, branch.replace("land", "hold, duration_s: 1"))))
    course_with_hold.next_px4_segment(1)
    course_with_hold.choose(fulfilled=True)
    assert course_with_hold.next_px4_segment(1) == len(course_with_hold.segments) - 1 > count


def test_a_long_mission_is_sent_to_the_stream_in_parts_without_stops_between_them():
    laps = f"step: repeat, times: 30, steps: [{{step: orbit, {CENTER}}}, {{{FLY}}}]"
    fake = FakeFlight(mission(flight_steps(laps))).start()
    fake.until_state("flying")
    stream_request = next(r for r in fake.requests if isinstance(r, StreamScript))
    assert sum(s.duration_s for s in stream_request.script.segments) < 200.0
    longest_stop_s = stop_s = 0.0
    fake.fly(2.0)
    while fake.status.state == "flying" and fake.runner.flight.segment is not None:
        position_before = fake.flown_path[-1]
        fake.step()
        stop_s = stop_s + STEP_S if math.dist(position_before, fake.flown_path[-1]) < 1e-5 else 0.0
        longest_stop_s = max(longest_stop_s, stop_s)
    assert longest_stop_s < 1.0
    assert fake.count_requests(StreamScript) == 1
    assert sum(bool(r.change.appended) for r in fake.requests if isinstance(r, ChangeScript)) > 3


# --- waits ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("on_timeout", "modes"),
    [("continue", ["land"]), ("hold", ["hold"]), ("return", ["rtl"]), ("land", ["land"])],
)
@pytest.mark.parametrize("until", ["person", "{value: satellites, above: 10}"])
def test_a_wait_that_takes_too_long_executes_its_timeout_action(until, on_timeout, modes):
    wait = f"step: wait, until: {until}, timeout_s: 5, on_timeout: {on_timeout}"
    fake = FakeFlight(mission(flight_steps(wait, FLY))).start()
    fake.set_reading(satellites=6)
    fake.until_state("done" if on_timeout == "continue" else "suspended")
    assert fake.requested_modes() == modes


def test_a_wait_ends_only_after_its_condition_was_true_without_interruption():
    wait = "step: wait, until: {value: wind_speed_m_s, below: 5, for_s: 3}, timeout_s: 60"
    fake = FakeFlight(mission(flight_steps(wait, FLY))).start().until_state("waiting")
    for wind in (4.0, 7.0, 4.0, None):
        fake.set_reading(wind_speed_m_s=wind)
        fake.fly(2.0)
        assert fake.status.state == "waiting"
    fake.set_reading(wind_speed_m_s=4.0)
    fake.until_state("flying")


# --- setpoints ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [k for k in FLOWN_BY_SETPOINTS if k not in ("velocity", "attitude")])
def test_setpoints_are_continuous_through_pause_resume_skip_and_hold(kind):
    fake = flight_in_step(kind)
    fake.set_reading(satellites=14)
    fake.pause()
    fake.until_state("paused").fly(1.0)
    fake.resume()
    fake.fly(2.0)
    fake.change_mode("hold", "command", "Bob commanded 'hold'")
    fake.fly(3.0)
    fake.resume()
    fake.fly(4.0)
    fake.skip()
    fake.until_state("done")
    positions = [
        (t, s.position_ned_m) for t, s in fake.sent_setpoints if isinstance(s, Trajectory | Position)
    ]
    for (t0, a), (t1, b) in itertools.pairwise(positions):
        assert math.dist(a, b) <= STEP_S * 12.0 + 0.35, (t0, t1)  # 12 m/s, 0.35 m of tolerance
