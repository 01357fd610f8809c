"""The mission runner in each kind of step: operator commands, external commands, changes of control."""

import math

import pytest

from missions.runner.requests import CannotDo, SetMode, StopStream, StreamScript
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

# --- operator -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", STEPS)
def test_a_paused_mission_stops_the_vehicle_and_after_resume_ends_as_planned(kind):
    fake = flight_in_step(kind)
    fake.set_reading(satellites=14)
    fake.pause()
    state = "suspended" if kind in ("take_off", "land") else "paused"
    fake.until_state(state)
    stop_ned_m = fake.flown_path[-1]
    fake.fly(20.0)
    assert math.dist(fake.flown_path[-1], stop_ned_m) < 1e-6
    fake.resume()
    end_wait(fake, kind).until_state("done")
    assert fake.reading.armed is False
    assert math.dist(fake.flown_path[-1][:2], (30.0, 0.0)) < 1.0


@pytest.mark.parametrize("kind", STEPS)
def test_an_aborted_mission_switches_to_hold_and_requests_nothing_more(kind):
    fake = flight_in_step(kind)
    fake.abort()
    assert fake.status.state == "aborted"
    assert fake.requested_modes()[-1] == "hold"
    assert_nothing_is_requested(fake)
    with pytest.raises(CannotDo, match="has ended"):
        fake.resume()


@pytest.mark.parametrize(("action", "mode"), [("return", "rtl"), ("land", "land")])
def test_an_aborted_mission_can_switch_to_return_or_land(action, mode):
    fake = flight_in_step("orbit")
    fake.abort(action)
    assert fake.requested_modes() == [mode]


@pytest.mark.parametrize("kind", STEPS)
def test_a_step_that_is_skipped_is_followed_by_the_next_step(kind):
    fake = flight_in_step(kind)
    place = fake.status.place
    fake.skip()
    fake.until(lambda: fake.status.place != place or fake.status.state == "done", 30.0)
    fake.until_state("done")
    if kind == "land":
        assert (fake.requested_modes(), fake.reading.armed) == (["land", "hold"], True)
    else:
        assert math.dist(fake.flown_path[-1][:2], (30.0, 0.0)) < 1.0


def test_skipping_a_step_of_a_suspended_mission_requests_no_mode():
    fake = flight_in_step("orbit")
    fake.change_mode("hold", "command", "Bob commanded 'hold'")
    fake.until_state("suspended")
    request_count = fake.count_requests(SetMode)
    fake.skip()
    assert (fake.status.place, fake.count_requests(SetMode)) == ("step 3", request_count)


def test_a_pause_before_the_stream_begins_keeps_the_vehicle_at_the_start_of_the_path():
    fake = FakeFlight(mission(flight_steps(FLY))).start().until_state("taking_off")
    fake.runner.flight.paused = True
    fake.until_state("paused")
    assert fake.flown_path[-1] == pytest.approx((0.0, 0.0, -10.0), abs=0.5)


def test_on_the_ground_a_take_off_cannot_be_skipped():
    fake = FakeFlight(mission(flight_steps(FLY))).start()
    with pytest.raises(CannotDo, match="on the ground"):
        fake.skip()


# --- external commands ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", STEPS)
@pytest.mark.parametrize(
    ("mode", "source", "text"),
    [
        ("position", "pilot", "The RC pilot switched to Position."),
        ("rtl", "failsafe", "The vehicle's failsafe switched to Rtl."),
        ("position", "station", "Another ground station switched to Position."),
        ("hold", "command", "Bob commanded 'hold'."),
    ],
)
def test_an_external_command_suspends_the_mission_until_an_operator_resumes_it(kind, mode, source, text):
    fake = flight_in_step(kind, link_loss="continue", failure="return", low_battery="return")
    fake.change_mode(mode, source, "Bob commanded 'hold'")
    request_count = len(fake.requests)
    fake.fly(0.2)
    assert [type(request).__name__ for request in fake.requests[request_count:]] == ["StopStream", "Notify"]
    assert (fake.status.state, fake.event_texts[-1]) == ("suspended", text)
    fake.set_reading(battery_share=0.05, control_holder=None, estimates=frozenset())
    assert_nothing_is_requested(fake, 30.0)
    fake.set_reading(battery_share=0.9, control_holder="bob", estimates=None, satellites=14)
    fake.resume()
    fake.until(lambda: fake.status.state != "suspended")
    end_wait(fake, kind).until_state("done")


def test_a_pilot_who_takes_over_during_the_offboard_request_suspends_the_mission():
    fake = FakeFlight(mission(flight_steps(FLY))).start()
    fake.until(lambda: fake.count_requests(StreamScript) == 1)
    fake.sampler = None
    fake.set_reading(mode="position", mode_source="pilot", stream="starting", progress=None)
    fake.fly(0.2)
    assert fake.count_requests(StopStream) == 1
    assert fake.status.state == "suspended"


def test_disarming_in_flight_ends_the_mission():
    fake = flight_in_step("orbit")
    fake.set_reading(armed=False)
    fake.fly(0.2)
    assert (fake.status.state, fake.status.reason) == ("stopped", "The vehicle disarmed")
    assert_nothing_is_requested(fake)


def test_a_suspended_mission_ends_once_the_vehicle_has_landed():
    fake = flight_in_step("orbit")
    fake.change_mode("land", "pilot")
    fake.until_state("suspended").until_state("stopped")


# --- control --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", FLOWN_BY_SETPOINTS)
def test_a_change_of_control_pauses_the_mission(kind):
    fake = flight_in_step(kind)
    fake.set_reading(control_holder="bob", control_holder_name="Bob", satellites=14)
    fake.until_state("paused")
    assert "Bob has control now: paused." in fake.event_texts
    assert fake.reading.mode == "offboard"
    fake.resume()
    end_wait(fake, kind).until_state("done")


@pytest.mark.parametrize(("action", "modes"), [("hold", ["hold"]), ("return", ["rtl"]), ("land", ["land"])])
@pytest.mark.parametrize("kind", ["take_off", *FLOWN_BY_SETPOINTS])
def test_in_each_kind_of_step_expired_control_triggers_the_missions_action(kind, action, modes):
    fake = flight_in_step(kind, control_lost=action)
    fake.set_reading(control_holder=None)
    fake.fly(0.2)
    assert (fake.requested_modes(), fake.status.state) == (modes, "suspended")


@pytest.mark.parametrize(
    ("start_mode_and_source", "resume_source", "modes"),
    [
        (("external_1", "unknown"), None, []),
        (("external_1", "vehicle"), None, []),
        (("external_1", "command"), None, ["hold"]),
        (("external_1", "command"), "pilot", []),
        (("external_1", "unknown"), "failsafe", []),
        (("external_1", "unknown"), "command", ["hold"]),
        (("offboard", "unknown"), None, ["hold"]),
    ],
)
def test_expired_control_interrupts_only_flights_that_a_client_of_this_server_started(
    start_mode_and_source, resume_source, modes
):
    mode, source = start_mode_and_source
    fake = FakeFlight(mission(flight_steps(FLY, "step: hold, duration_s: 60")), mode=mode)
    fake.set_reading(mode=mode, mode_source=source, armed=True, landed="in_air", position_ned_m=(0, 0, -10))
    fake.start().until_state("flying")
    if resume_source is not None:
        fake.change_mode("position", "pilot")
        fake.until_state("suspended").change_mode(mode, resume_source)
        fake.resume()
        fake.until_state("flying")
    fake.requests.clear()
    fake.set_reading(control_holder=None)
    fake.fly(1.0)
    assert fake.requested_modes() == modes


def test_a_mission_that_continues_without_control_also_continues_when_a_client_takes_control():
    fake = flight_in_step("orbit", control_lost="continue")
    fake.set_reading(control_holder=None)
    fake.fly(1.0)
    fake.set_reading(control_holder="bob", control_holder_name="Bob")
    fake.until_state("done")
    assert sum("No client has control" in text for text in fake.event_texts) == 1
