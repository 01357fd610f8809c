"""The mission runner, told as flights: whatever happens, in every kind of step."""

import itertools
import math

import pytest

from missions.runner.requests import Photo, Play, PointGimbal, SetMode, Steer, StopStream, TakeOff
from missions.runner.runner import CannotDo
from missions.setpoints import Position, Trajectory
from tests.support.mission_vehicle import STEP_S, FlownMission
from tests.support.offboard_missions import flown, mission

CENTER = "center: {offset_ned_m: [20, 0, -10]}, radius_m: 8"
FLY = "step: fly, points: [{offset_ned_m: [30, 0, -10]}]"
STEPS = {
    "take_off": None,
    "fly": "step: fly, points: [{offset_ned_m: [40, 0, -10]}, {offset_ned_m: [40, 30, -14]}]",
    "hold": "step: hold, duration_s: 10",
    "orbit": f"step: orbit, {CENTER}",
    "helix": f"step: helix, {CENTER}, climb_m: 5",
    "spiral": f"step: spiral, {CENTER}, end_radius_m: 15",
    "figure_eight": "step: figure_eight, center: {offset_ned_m: [0, 0, -10]}, length_m: 40, width_m: 20",
    "velocity": "step: velocity, velocity_ned_m_s: [2, 1, 0], duration_s: 12",
    "attitude": "step: attitude, thrust: 0.5, duration_s: 10",
    "photo": "step: photo, count: 20, interval_s: 1",
    "person": "step: wait, until: person, timeout_s: 60, message: Sharp?",
    "condition": "step: wait, until: {value: satellites, above: 10}, timeout_s: 60",
    "repeat": f"step: repeat, times: 2, steps: [{{{FLY}}}, {{step: hold, duration_s: 8}}]",
    "land": None,
}
IN_OFFBOARD = [kind for kind in STEPS if kind not in ("take_off", "land")]


def flight(kind: str, **actions: str) -> FlownMission:
    """In the middle of such a step."""
    wanted = STEPS[kind] or "step: hold, duration_s: 4"
    document = mission(flown(wanted, FLY))
    document = document.model_copy(update={"actions": document.actions.model_copy(update=actions)})
    fake = FlownMission(document).start()
    if kind in ("take_off", "land"):
        state = "taking_off" if kind == "take_off" else "landing"
        return fake.until(lambda: fake.status.state == state and fake.reading.landed == "in_air").fly(1.0)
    fake.until(lambda: fake.status.state in ("flying", "waiting") and str(fake.status.place)[:6] == "step 2")
    return fake.fly(2.5)


def asks_nothing(fake: FlownMission, for_s: float = 5.0) -> None:
    """Nothing is asked of the vehicle, and nothing is sent."""
    asked, sent = len(fake.asked), len(fake.sent)
    fake.fly(for_s)
    assert fake.asked[asked:] == []
    assert len(fake.sent) == sent


# --- whole flights --------------------------------------------------------------------------------


def test_a_whole_flight_takes_off_flies_its_path_and_lands():
    fake = FlownMission(mission(flown(*(step for step in STEPS.values() if step)))).start()
    fake.know(satellites=14)
    fake.in_state("waiting")
    assert fake.status.question == "Sharp?"
    fake.go_on()
    fake.in_state("done")
    assert fake.modes() == ["land"]
    assert fake.count(TakeOff) == 1
    assert fake.count(Play) == 1  # one stream from take-off to landing
    assert fake.count(Photo) == 20
    assert fake.reading.armed is False
    assert math.dist(fake.path[-1][:2], (30.0, 0.0)) < 1.0


def test_pictures_are_taken_and_the_gimbal_is_pointed_on_time():
    look = "step: gimbal, track: look_at, place: {offset_ned_m: [20, 0, 0]}"
    fake = FlownMission(
        mission(flown(look, f"step: orbit, {CENTER}, photo_every_m: 5", "step: gimbal, track: release", FLY))
    )
    fake.start().in_state("done")
    assert fake.count(Photo) == math.ceil(math.tau * 8 / 5)
    points = [request for request in fake.asked if isinstance(request, PointGimbal)]
    assert all(-math.pi / 2 <= p.pitch_rad < 0 for p in points)
    orbit_s = fake.runner.flight.course.segments[3].duration_s
    assert len(points) > 5 * orbit_s
    assert fake.runner.flight.pointed is None


def test_a_wait_on_the_ground_streams_nothing_and_the_take_off_follows():
    steps = "- {step: wait, until: {value: satellites, above: 10, for_s: 2}, timeout_s: 60}\n"
    fake = FlownMission(mission(steps + flown(FLY))).start()
    fake.know(satellites=6)
    fake.fly(5)
    assert (fake.status.state, fake.sent, fake.count(TakeOff)) == ("waiting", [], 0)
    fake.know(satellites=12)
    fake.fly(1.5)
    assert fake.count(TakeOff) == 0
    fake.in_state("taking_off").in_state("done")


def test_after_a_landing_the_mission_takes_off_again():
    again = "- {step: wait, until: person, timeout_s: 600}\n"
    fake = FlownMission(mission(flown(FLY) + again + flown("step: hold, duration_s: 1"))).start()
    fake.in_state("waiting")
    assert fake.reading.armed is False
    sent = len(fake.sent)
    fake.fly(3)
    assert len(fake.sent) == sent
    fake.go_on()
    fake.in_state("done")
    assert (fake.count(TakeOff), fake.modes()) == (2, ["land", "land"])


def test_a_mission_that_ends_in_the_air_holds_there():
    fake = FlownMission(mission("- {step: take_off, height_m: 10}\n- {" + FLY + "}\n")).start()
    fake.in_state("done")
    assert fake.modes() == ["hold"]


@pytest.mark.parametrize(("share", "east"), [(0.8, 20.0), (0.3, -20.0), (None, -20.0)])
def test_a_branch_is_decided_when_it_is_reached(share, east):
    branch = (
        "step: branch, condition: {value: battery_share, above: 0.5}, "
        "then: [{step: fly, points: [{offset_ned_m: [0, 20, -10]}]}], "
        "otherwise: [{step: fly, points: [{offset_ned_m: [0, -20, -10]}]}]"
    )
    fake = FlownMission(mission(flown(FLY, branch, "step: hold, duration_s: 1"))).start()
    fake.know(battery_share=share)
    fake.in_state("done")
    assert fake.path[-1][1] == pytest.approx(east, abs=0.5)
    assert fake.count(Play) == 1


def test_a_long_mission_is_handed_over_bit_by_bit_in_time():
    laps = f"step: repeat, times: 30, steps: [{{step: orbit, {CENTER}}}, {{{FLY}}}]"
    fake = FlownMission(mission(flown(laps))).start()
    fake.in_state("flying")
    play = next(r for r in fake.asked if isinstance(r, Play))
    assert sum(s.duration_s for s in play.script.segments) < 200.0
    longest_still_s = still_s = 0.0
    fake.fly(2.0)
    while fake.status.state == "flying" and fake.runner.flight.segment is not None:
        before = fake.path[-1]
        fake.step()
        still_s = still_s + STEP_S if math.dist(before, fake.path[-1]) < 1e-5 else 0.0
        longest_still_s = max(longest_still_s, still_s)
    assert longest_still_s < 1.0
    assert fake.count(Play) == 1
    assert sum(bool(r.steering.appended) for r in fake.asked if isinstance(r, Steer)) > 3


# --- waits ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("on_timeout", "modes"),
    [("continue", ["land"]), ("hold", ["hold"]), ("return", ["rtl"]), ("land", ["land"])],
)
@pytest.mark.parametrize("until", ["person", "{value: satellites, above: 10}"])
def test_a_wait_that_takes_too_long_does_what_the_step_says(until, on_timeout, modes):
    wait = f"step: wait, until: {until}, timeout_s: 5, on_timeout: {on_timeout}"
    fake = FlownMission(mission(flown(wait, FLY))).start()
    fake.know(satellites=6)
    fake.in_state("done" if on_timeout == "continue" else "suspended")
    assert fake.modes() == modes


def test_a_condition_must_hold_without_a_break():
    wait = "step: wait, until: {value: wind_speed_m_s, below: 5, for_s: 3}, timeout_s: 60"
    fake = FlownMission(mission(flown(wait, FLY))).start().in_state("waiting")
    for wind in (4.0, 7.0, 4.0, None):
        fake.know(wind_speed_m_s=wind)
        fake.fly(2.0)
        assert fake.status.state == "waiting"
    fake.know(wind_speed_m_s=4.0)
    fake.in_state("flying")


# --- people ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", STEPS)
def test_paused_it_stands_still_and_resumed_it_ends_as_planned(kind):
    fake = flight(kind)
    fake.know(satellites=14)
    fake.pause()
    state = "suspended" if kind in ("take_off", "land") else "paused"
    fake.in_state(state)
    there = fake.path[-1]
    fake.fly(20.0)
    assert math.dist(fake.path[-1], there) < 1e-6
    fake.resume()
    if kind == "person":
        fake.fly(3.0)
        fake.go_on()
    fake.in_state("done")
    assert fake.reading.armed is False
    assert math.dist(fake.path[-1][:2], (30.0, 0.0)) < 1.0


@pytest.mark.parametrize("kind", STEPS)
def test_aborted_it_holds_and_asks_for_nothing_more(kind):
    fake = flight(kind)
    fake.abort()
    assert fake.status.state == "aborted"
    assert fake.modes()[-1] == "hold"
    asks_nothing(fake)
    with pytest.raises(CannotDo, match="over"):
        fake.resume()


@pytest.mark.parametrize(("then", "mode"), [("return", "rtl"), ("land", "land")])
def test_an_abort_may_return_or_land(then, mode):
    fake = flight("orbit")
    fake.abort(then)
    assert fake.modes() == [mode]


@pytest.mark.parametrize("kind", STEPS)
def test_a_step_that_is_skipped_is_followed_by_the_next_one(kind):
    fake = flight(kind)
    place = fake.status.place
    fake.skip()
    fake.until(lambda: fake.status.place != place or fake.status.state == "done", 30.0)
    fake.in_state("done")
    if kind == "land":
        assert (fake.modes(), fake.reading.armed) == (["land", "hold"], True)
    else:
        assert math.dist(fake.path[-1][:2], (30.0, 0.0)) < 1.0


def test_a_suspended_mission_is_skipped_ahead_without_a_command():
    fake = flight("orbit")
    fake.mode("hold", "command", "Bob commanded 'hold'")
    fake.in_state("suspended")
    asked = fake.count(SetMode)
    fake.skip()
    assert (fake.status.place, fake.count(SetMode)) == ("step 3", asked)


def test_a_pause_before_the_stream_begins_holds_at_its_begin():
    fake = FlownMission(mission(flown(FLY))).start().in_state("taking_off")
    fake.runner.flight.paused = True
    fake.in_state("paused")
    assert fake.path[-1] == pytest.approx((0.0, 0.0, -10.0), abs=0.5)


def test_on_the_ground_a_take_off_cannot_be_skipped():
    fake = FlownMission(mission(flown(FLY))).start()
    with pytest.raises(CannotDo, match="on the ground"):
        fake.skip()


# --- somebody else has the vehicle ----------------------------------------------------------------


@pytest.mark.parametrize("kind", STEPS)
@pytest.mark.parametrize(
    ("mode", "source", "text"),
    [
        ("position", "pilot", "The pilot switched to Position."),
        ("rtl", "failsafe", "The vehicle's failsafe switched to Rtl."),
        ("position", "station", "Another ground station switched to Position."),
        ("hold", "command", "Bob commanded 'hold'."),
    ],
)
def test_whoever_takes_the_vehicle_has_it_until_a_person_resumes_the_mission(kind, mode, source, text):
    fake = flight(kind, link_loss="continue", failure="return", low_battery="return")
    fake.mode(mode, source, "Bob commanded 'hold'")
    asked = len(fake.asked)
    fake.fly(0.2)
    assert [type(request).__name__ for request in fake.asked[asked:]] == ["StopStream", "Tell"]
    assert (fake.status.state, fake.told[-1]) == ("suspended", text)
    fake.know(battery_share=0.05, holder=None, estimates=frozenset())
    asks_nothing(fake, 30.0)
    fake.know(battery_share=0.9, holder="bob", estimates=None, satellites=14)
    fake.resume()
    fake.until(lambda: fake.status.state != "suspended")
    if kind == "person":
        fake.in_state("waiting")
        fake.go_on()
    fake.in_state("done")


def test_a_pilot_who_takes_the_vehicle_while_offboard_is_asked_for_is_not_fought():
    fake = FlownMission(mission(flown(FLY))).start()
    fake.until(lambda: fake.count(Play) == 1)
    fake.player = None
    fake.know(mode="position", mode_source="pilot", stream="starting", played=None)
    fake.fly(0.2)
    assert fake.count(StopStream) == 1
    assert fake.status.state == "suspended"


def test_motors_that_stop_in_flight_end_the_mission():
    fake = flight("orbit")
    fake.know(armed=False)
    fake.fly(0.2)
    assert (fake.status.state, fake.status.reason) == ("stopped", "The vehicle disarmed")
    asks_nothing(fake)


def test_a_suspended_mission_is_over_once_the_vehicle_has_landed():
    fake = flight("orbit")
    fake.mode("land", "pilot")
    fake.in_state("suspended").in_state("stopped")


# --- control --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", IN_OFFBOARD)
def test_another_who_takes_control_finds_the_mission_paused(kind):
    fake = flight(kind)
    fake.know(holder="bob", holder_name="Bob", satellites=14)
    fake.in_state("paused")
    assert "Bob has control now: paused." in fake.told
    assert fake.reading.mode == "offboard"
    fake.resume()
    if kind == "person":
        fake.in_state("waiting")
        fake.go_on()
    fake.in_state("done")


@pytest.mark.parametrize(("action", "modes"), [("hold", ["hold"]), ("return", ["rtl"]), ("land", ["land"])])
@pytest.mark.parametrize("kind", ["take_off", *IN_OFFBOARD])
def test_control_that_ends_does_what_the_document_says(kind, action, modes):
    fake = flight(kind, control_lost=action)
    fake.know(holder=None)
    fake.fly(0.2)
    assert (fake.modes(), fake.status.state) == (modes, "suspended")


def test_with_nobody_in_control_a_mission_may_go_on_and_the_next_holder_finds_it_flying():
    fake = flight("orbit", control_lost="continue")
    fake.know(holder=None)
    fake.fly(1.0)
    fake.know(holder="bob", holder_name="Bob")
    fake.in_state("done")
    assert sum("Nobody has control" in text for text in fake.told) == 1


# --- faults ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", STEPS)
@pytest.mark.parametrize("action", ["hold", "return", "land", "continue"])
def test_a_low_battery_does_what_the_document_says_once(kind, action):
    fake = flight(kind, low_battery=action)
    before = fake.modes()
    fake.know(battery_share=0.1, satellites=14)
    fake.fly(0.2)
    if action == "continue" or kind == "land":
        assert fake.modes() == before
        if kind == "person":
            fake.go_on()
        fake.in_state("done")
    else:
        assert fake.modes() == [{"hold": "hold", "return": "rtl", "land": "land"}[action]]
        assert fake.status.state == "suspended"
    assert sum("Battery" in text for text in fake.told) == 1


@pytest.mark.parametrize("kind", IN_OFFBOARD)
def test_a_lost_position_lands(kind):
    fake = flight(kind, failure="continue")
    fake.know(estimates=frozenset({"heading"}), position_ned_m=None)
    fake.fly(0.5)
    assert fake.modes() == []
    fake.fly(1.0)
    assert fake.modes() == ["land"]
    assert fake.status.state == "suspended"
    assert "No valid estimate of position" in str(fake.status.reason)


def test_an_estimate_that_is_missed_for_a_moment_changes_nothing():
    fake = flight("orbit")
    fake.know(estimates=frozenset({"heading"}))
    fake.fly(0.5)
    fake.know(estimates=None)
    fake.in_state("done")


@pytest.mark.parametrize("kind", IN_OFFBOARD)
@pytest.mark.parametrize(("action", "modes"), [("hold", ["hold"]), ("return", ["rtl"]), ("land", ["land"])])
def test_a_link_that_was_lost_and_is_back_does_what_the_document_says(kind, action, modes):
    fake = flight(kind, link_loss=action)
    fake.lose_link()
    asks_nothing(fake, 10.0)
    fake.know(link_heard=True)
    fake.fly(0.2)
    assert (fake.modes(), fake.status.state) == (modes, "suspended")


@pytest.mark.parametrize("kind", IN_OFFBOARD)
def test_a_mission_that_continues_after_a_lost_link_goes_on_from_the_vehicles_hold(kind):
    fake = flight(kind, link_loss="continue")
    fake.lose_link()
    fake.fly(10.0)
    fake.know(link_heard=True, satellites=14)
    fake.until(lambda: "The link was lost and is back: going on." in fake.told)
    if kind == "person":
        fake.in_state("waiting")
        fake.go_on()
    fake.in_state("done")


@pytest.mark.parametrize("action", ["continue", "hold", "return", "land"])
def test_after_a_lost_link_a_vehicle_that_its_failsafe_flies_is_left_to_it(action):
    fake = flight("orbit", link_loss=action)
    fake.mode("rtl", "failsafe", "its own failsafe")
    fake.know(link_heard=False)
    fake.fly(10.0)
    fake.know(link_heard=True)
    fake.fly(5.0)
    assert (fake.modes(), fake.status.state) == ([], "suspended")


@pytest.mark.parametrize("kind", ["take_off", "land"])
def test_px4_flies_take_off_and_landing_on_while_the_link_is_gone(kind):
    fake = flight(kind, link_loss="return")
    before = fake.modes()
    fake.know(link_heard=False)
    fake.fly(1.0)
    fake.know(link_heard=True)
    fake.in_state("done")
    assert fake.modes() == [*before, "land"][-1:]


@pytest.mark.parametrize(("action", "modes"), [("hold", ["hold"]), ("return", ["rtl"]), ("land", ["land"])])
def test_a_stream_that_ends_by_itself_is_a_failure(action, modes):
    fake = flight("orbit", failure=action)
    fake.know(stream="ending", stream_text="The setpoint leaves the fence.")
    fake.fly(0.2)
    assert (fake.modes(), fake.status.state) == (modes, "suspended")
    assert "The setpoint leaves the fence" in str(fake.status.reason)


def test_a_take_off_that_is_refused_suspends_the_mission_on_the_ground():
    fake = FlownMission(mission(flown(FLY)))
    fake.refused[TakeOff] = "Arming denied: no GPS."
    fake.start().fly(1.0)
    assert fake.status.state == "suspended"
    assert "Arming denied" in str(fake.status.reason)
    fake.refused.clear()
    fake.resume()
    fake.in_state("done")


def test_a_take_off_that_takes_too_long_is_a_failure():
    fake = FlownMission(mission("- {step: take_off, height_m: 400, timeout_s: 5}\n- {step: land}\n")).start()
    fake.in_state("suspended")
    assert fake.modes() == ["hold"]


def test_a_mode_that_is_refused_is_told_and_the_stream_is_left_to_expire():
    fake = flight("orbit")
    fake.refused[SetMode] = "No reply within 6 s."
    fake.know(battery_share=0.1)
    fake.fly(0.2)
    assert "did not change its mode" in fake.told[-1]
    steers = fake.count(Steer)
    fake.fly(3.0)
    assert fake.count(Steer) == steers


def test_pictures_that_fail_are_told_once_and_the_mission_goes_on():
    fake = FlownMission(mission(flown("step: photo, count: 5, interval_s: 1", FLY)))
    fake.refused[Photo] = "no camera"
    fake.start().in_state("done")
    assert sum("picture" in text for text in fake.told) == 1


def test_a_mission_does_not_begin_without_the_estimates_it_needs():
    fake = FlownMission(mission(flown(FLY)))
    fake.know(estimates=frozenset({"heading"}))
    with pytest.raises(CannotDo, match="position"):
        fake.start()


def test_a_step_that_flies_without_a_take_off_is_not_begun_on_the_ground():
    fake = FlownMission(mission("- {" + FLY + "}\n")).start()
    fake.fly(1.0)
    assert fake.status.state == "suspended"
    assert "needs a take-off" in str(fake.status.reason)
    assert fake.sent == []


# --- what is sent ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [k for k in IN_OFFBOARD if k not in ("velocity", "attitude")])
def test_setpoints_never_jump_through_pause_resume_skip_and_hold(kind):
    fake = flight(kind)
    fake.know(satellites=14)
    fake.pause()
    fake.in_state("paused").fly(1.0)
    fake.resume()
    fake.fly(2.0)
    fake.mode("hold", "command", "Bob commanded 'hold'")
    fake.fly(3.0)
    fake.resume()
    fake.fly(4.0)
    fake.skip()
    fake.in_state("done")
    places = [(t, s.position_ned_m) for t, s in fake.sent if isinstance(s, Trajectory | Position)]
    for (t0, a), (t1, b) in itertools.pairwise(places):
        assert math.dist(a, b) <= STEP_S * 12.0 + 0.35, (t0, t1)
