"""The mission runner: its actions on faults during each kind of step."""

import math

import pytest

from missions.runner.requests import CannotDo, ChangeScript, Photo, SetMode, StreamScript, TakeOff
from tests.support.mission_steps import (
    FLOWN_BY_SETPOINTS,
    FLY,
    STEPS,
    assert_nothing_is_requested,
    end_wait,
    flight_in_step,
)
from tests.support.mission_vehicle import FakeFlight
from tests.support.offboard_missions import flight_steps, mission


@pytest.mark.parametrize("kind", STEPS)
@pytest.mark.parametrize("action", ["hold", "return", "land", "continue"])
def test_a_low_battery_triggers_the_low_battery_action_once(kind, action):
    fake = flight_in_step(kind, low_battery=action)
    modes_before = fake.requested_modes()
    fake.set_reading(battery_share=0.1, satellites=14)
    fake.fly(0.2)
    if action == "continue" or kind == "land":
        assert fake.requested_modes() == modes_before
        end_wait(fake, kind).until_state("done")
    else:
        assert fake.requested_modes() == [{"hold": "hold", "return": "rtl", "land": "land"}[action]]
        assert fake.status.state == "suspended"
    assert sum("Battery" in text for text in fake.event_texts) == 1


@pytest.mark.parametrize("kind", FLOWN_BY_SETPOINTS)
def test_a_lost_position_estimate_triggers_a_landing(kind):
    fake = flight_in_step(kind, failure="continue")
    fake.set_reading(estimates=frozenset({"heading"}), position_ned_m=None)
    fake.fly(0.5)
    assert fake.requested_modes() == []
    fake.fly(1.0)
    assert fake.requested_modes() == ["land"]
    assert fake.status.state == "suspended"
    assert "No valid estimate of position" in str(fake.status.reason)


def test_px4_handles_a_position_lost_during_take_off_and_the_mission_then_lands():
    fake = flight_in_step("take_off", failure="continue")
    fake.set_reading(estimates=frozenset({"heading"}), position_ned_m=None)
    fake.fly(2.0)
    assert (fake.requested_modes(), fake.status.state, fake.sent_setpoints) == ([], "taking_off", [])
    fake.until_state("suspended")
    assert fake.requested_modes() == ["land"]
    assert "position" in str(fake.status.reason)


def test_a_landing_continues_after_a_lost_position():
    fake = flight_in_step("land", failure="hold")
    modes_before = fake.requested_modes()
    fake.set_reading(estimates=frozenset({"heading"}), position_ned_m=None)
    fake.until_state("done")
    assert (fake.requested_modes(), fake.reading.armed) == (modes_before, False)


def test_an_estimate_that_is_missing_for_a_moment_does_not_stop_the_mission():
    fake = flight_in_step("orbit")
    fake.set_reading(estimates=frozenset({"heading"}))
    fake.fly(0.5)
    fake.set_reading(estimates=None)
    fake.until_state("done")


@pytest.mark.parametrize("kind", FLOWN_BY_SETPOINTS)
@pytest.mark.parametrize(("action", "modes"), [("hold", ["hold"]), ("return", ["rtl"]), ("land", ["land"])])
def test_the_link_loss_action_is_executed_when_the_link_is_restored(kind, action, modes):
    fake = flight_in_step(kind, link_loss=action)
    fake.lose_link()
    assert_nothing_is_requested(fake, 10.0)
    fake.set_reading(link_active=True)
    fake.fly(0.2)
    assert (fake.requested_modes(), fake.status.state) == (modes, "suspended")


@pytest.mark.parametrize("kind", FLOWN_BY_SETPOINTS)
def test_a_mission_that_continues_after_a_lost_link_resumes_from_hold(kind):
    fake = flight_in_step(kind, link_loss="continue")
    fake.lose_link()
    fake.fly(10.0)
    fake.set_reading(link_active=True, satellites=14)
    fake.until(lambda: "Connection lost and restored: continuing." in fake.event_texts)
    end_wait(fake, kind).until_state("done")


@pytest.mark.parametrize("action", ["continue", "hold", "return", "land"])
def test_a_vehicle_in_failsafe_is_not_commanded_after_a_lost_link(action):
    fake = flight_in_step("orbit", link_loss=action)
    fake.change_mode("rtl", "failsafe", "failsafe")
    fake.set_reading(link_active=False)
    fake.fly(10.0)
    fake.set_reading(link_active=True)
    fake.fly(5.0)
    assert (fake.requested_modes(), fake.status.state) == ([], "suspended")


@pytest.mark.parametrize("kind", ["take_off", "land"])
def test_px4_continues_take_off_and_landing_during_a_lost_link(kind):
    fake = flight_in_step(kind, link_loss="return")
    fake.set_reading(link_active=False)
    fake.fly(1.0)
    fake.set_reading(link_active=True)
    fake.until_state("done")
    assert fake.requested_modes() == ["land"]


@pytest.mark.parametrize(("action", "modes"), [("hold", ["hold"]), ("return", ["rtl"]), ("land", ["land"])])
def test_a_stream_that_ends_by_itself_triggers_the_failure_action(action, modes):
    fake = flight_in_step("orbit", failure=action)
    fake.set_reading(stream="ending", stream_text="The setpoint leaves the fence.")
    fake.fly(0.2)
    assert (fake.requested_modes(), fake.status.state) == (modes, "suspended")
    assert "The setpoint leaves the fence" in str(fake.status.reason)


def test_a_refused_take_off_suspends_the_mission_on_the_ground():
    fake = FakeFlight(mission(flight_steps(FLY)))
    fake.refused_requests[TakeOff] = "Arming denied: no GPS."
    fake.start().fly(1.0)
    assert fake.status.state == "suspended"
    assert "Arming denied" in str(fake.status.reason)
    fake.refused_requests.clear()
    fake.resume()
    fake.until_state("done")


def test_a_take_off_that_takes_too_long_triggers_the_failure_action():
    fake = FakeFlight(mission("- {step: take_off, height_m: 400, timeout_s: 5}\n- {step: land}\n")).start()
    fake.until_state("suspended")
    assert fake.requested_modes() == ["hold"]


def test_a_refused_mode_is_reported_and_the_stream_expires():
    fake = flight_in_step("orbit")
    fake.refused_requests[SetMode] = "No reply within 6 s."
    fake.set_reading(battery_share=0.1)
    fake.fly(0.2)
    assert "did not change its mode" in fake.event_texts[-1]
    script_change_count = fake.count_requests(ChangeScript)
    fake.fly(3.0)
    assert fake.count_requests(ChangeScript) == script_change_count


def test_failed_photos_are_reported_once_and_the_mission_continues():
    fake = FakeFlight(mission(flight_steps("step: photo, count: 5, interval_s: 1", FLY)))
    fake.refused_requests[Photo] = "no camera"
    fake.start().until_state("done")
    assert sum("photo" in text for text in fake.event_texts) == 1


def test_a_mission_does_not_start_without_the_estimates_it_needs():
    fake = FakeFlight(mission(flight_steps(FLY)))
    fake.set_reading(estimates=frozenset({"heading"}))
    with pytest.raises(CannotDo, match="position"):
        fake.start()


def test_a_flying_step_before_a_take_off_does_not_start_on_the_ground():
    fake = FakeFlight(mission("- {" + FLY + "}\n")).start()
    fake.fly(1.0)
    assert fake.status.state == "suspended"
    assert "needs a take-off" in str(fake.status.reason)
    assert fake.sent_setpoints == []


@pytest.mark.parametrize("kind", FLOWN_BY_SETPOINTS)
def test_after_a_gap_the_mission_goes_on_from_where_the_vehicle_is(kind):
    fake = flight_in_step(kind)
    place, number = fake.status.place, fake.count_requests(StreamScript)
    fake.interrupt()
    fake.fly(3.3)
    assert (fake.status.state, fake.status.place, fake.requested_modes()) == ("not_following", place, [])
    assert fake.count_requests(StreamScript) == number
    place_ned_m = fake.return_at(north_m=-6.0, down_m=1.2)
    fake.set_reading(satellites=14)
    sent_before = len(fake.sent_setpoints)
    fake.fly(0.3)
    assert fake.count_requests(StreamScript) == number + 1
    first = fake.sent_setpoints[sent_before][1]
    if hasattr(first, "position_ned_m"):
        assert math.dist(first.position_ned_m, place_ned_m) < 1.0
    assert fake.status.state != "not_following"
    texts = " ".join(fake.event_texts)
    assert "does not follow" in texts
    assert "going on from where it is" in texts
    end_wait(fake, kind).until_state("done")


def test_a_skip_during_an_interruption_continues_with_the_next_step():
    fake = flight_in_step("orbit")
    fake.interrupt()
    fake.fly(1.0)
    fake.skip()
    fake.return_at(north_m=0.0, down_m=0.0)
    fake.fly(0.3)
    assert fake.status.place == "step 3"


def test_a_pause_during_an_interruption_keeps_the_vehicle_at_its_place():
    fake = flight_in_step("fly")
    fake.interrupt()
    fake.fly(1.0)
    fake.pause()
    place_ned_m = fake.return_at(north_m=-6.0, down_m=1.2)
    fake.fly(10.0)
    assert fake.status.state == "paused"
    assert math.dist(fake.flown_path[-1], place_ned_m) < 1.0


def test_an_interruption_that_ends_the_stream_suspends_the_mission():
    fake = flight_in_step("fly")
    fake.interrupt()
    fake.fly(3.0)
    fake.set_reading(stream="idle", stream_text="The vehicle left Offboard")
    fake.fly(0.3)
    assert (fake.status.state, fake.requested_modes()) == ("suspended", [])
    assert "failsafe" in str(fake.status.reason)


def test_mission_time_stops_without_a_position_and_goes_on_with_it():
    fake = flight_in_step("fly")
    position_ned_m = fake.reading.position_ned_m
    fake.set_reading(position_ned_m=None)
    fake.fly(3.0)
    stopped = fake.sent_setpoints[-1][1]
    assert fake.status.state == "not_following"
    assert math.hypot(*stopped.velocity_ned_m_s) == 0.0
    assert any("no position" in text for text in fake.event_texts)
    fake.set_reading(position_ned_m=position_ned_m)
    fake.until_state("flying")


def test_a_lost_link_is_not_shown_as_flying():
    fake = flight_in_step("fly", link_loss="continue")
    fake.lose_link()
    fake.fly(0.3)
    assert fake.status.state == "not_following"
