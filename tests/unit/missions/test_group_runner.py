"""One mission for several vehicles: they start, meet, pause and end together."""

from __future__ import annotations

from pathlib import Path

import pytest

from missions.geodesy import LocalOrigin
from missions.offboard.positions import Start
from missions.offboard.reader import read
from missions.offboard.roles import compile_roles
from missions.offboard.state import MissionVehicle
from missions.runner.requests import CannotDo, TakeOff
from tests.support.group_flight import GroupFlight

TAKE_OFF, LAND = "{step: take_off, height_m: 10}", "{step: land}"
HIGH_TAKE_OFF = "{step: take_off, height_m: 30}"


def fly_step(north_m: float) -> str:
    return f"{{step: fly, points: [{{offset_ned_m: [{north_m}, 0, -10]}}]}}"


def meet_step(name: str, timeout_s: float = 120) -> str:
    return f"{{step: meet, meeting: {name}, timeout_s: {timeout_s}}}"


def mission_text(lead: str, left: str, **actions: str) -> str:
    action_fields = ", ".join(f"{name}: {action}" for name, action in actions.items())
    return (
        f"name: Show\nactions: {{{action_fields}}}\nroles:\n"
        f"  lead:\n    steps: [{lead}]\n  left:\n    steps: [{left}]\n"
    )


LONG_MISSION = mission_text(f"{TAKE_OFF}, {fly_step(200)}, {LAND}", f"{TAKE_OFF}, {fly_step(200)}, {LAND}")
IN_FLIGHT_MISSION = mission_text(fly_step(200), fly_step(200))


def in_flight(**actions: str) -> GroupFlight:
    """Two vehicles in the middle of a flight."""
    return (
        GroupFlight(mission_text(fly_step(200), fly_step(200), **actions), in_air=("lead", "left"))
        .start()
        .until_states(lead="flying", left="flying")
        .fly(5.0)
    )


def test_both_vehicles_take_off_at_the_same_time_and_complete_the_mission():
    group_flight = GroupFlight(mission_text(f"{TAKE_OFF}, {LAND}", f"{HIGH_TAKE_OFF}, {LAND}")).start()
    group_flight.until(lambda: group_flight.flights["lead"].count_requests(TakeOff) > 0)
    assert group_flight.flights["left"].count_requests(TakeOff) == 1
    group_flight.until_states(lead="done", left="done")
    assert group_flight.runner.over


def test_no_vehicle_starts_if_one_vehicle_cannot_start():
    group_flight = GroupFlight(LONG_MISSION)
    group_flight.flights["left"].set_reading(estimates=frozenset({"velocity"}))
    with pytest.raises(CannotDo, match="role left: there is no valid estimate of position"):
        group_flight.start()
    group_flight.fly(2)
    assert all(flight.requests == [] for flight in group_flight.flights.values())


def test_no_vehicle_in_flight_moves_until_all_are_in_offboard():
    group_flight = GroupFlight(IN_FLIGHT_MISSION, in_air=("lead", "left"))
    delayed_flight = group_flight.flights["left"]
    delayed_requests, real_execute = [], delayed_flight.execute
    # The switch of "left" to Offboard is still pending.
    delayed_flight.execute = lambda requests: delayed_requests.extend(requests)
    group_flight.start().fly(5)
    assert group_flight.current_steps() == {"lead": "lead, start", "left": "left, start"}
    assert group_flight.flights["lead"].flown_path[-1][0] == 0.0
    delayed_flight.execute = real_execute
    delayed_flight.execute(delayed_requests)
    group_flight.until(
        lambda: set(group_flight.current_steps().values()) == {"lead, step 1", "left, step 1"}, 2
    )
    group_flight.fly(5)
    lead, left = (flight.flown_path[-1][0] for flight in group_flight.flights.values())
    assert lead == left > 5.0


def test_the_first_vehicle_at_a_meeting_waits_and_both_leave_at_the_same_time():
    group_flight = GroupFlight(
        mission_text(
            f"{TAKE_OFF}, {meet_step('up')}, {fly_step(20)}, {LAND}",
            f"{HIGH_TAKE_OFF}, {meet_step('up')}, {fly_step(20)}, {LAND}",
        )
    ).start()
    group_flight.until_states(lead="waiting", left="taking_off").fly(3)
    assert group_flight.current_steps()["lead"] == "lead, step 2"
    group_flight.until(lambda: group_flight.current_steps()["lead"] == "lead, step 3")
    group_flight.step()
    assert group_flight.current_steps()["left"] == "left, step 3"
    group_flight.until_states(lead="done", left="done")


def test_a_meeting_that_one_vehicle_does_not_reach_ends_the_mission_and_all_hold():
    group_flight = GroupFlight(
        mission_text(f"{meet_step('x', 5)}, {fly_step(20)}", f"{fly_step(500)}, {meet_step('x')}"),
        ("lead", "left"),
    ).start()
    group_flight.until_states(lead="stopped", left="stopped")
    assert "Not all vehicles arrived at the meeting 'x' within 5 s" in str(
        group_flight.flights["left"].status.reason
    )
    assert [flight.requested_modes() for flight in group_flight.flights.values()] == [["hold"], ["hold"]]


def at_meeting() -> GroupFlight:
    """The vehicle "lead" waits at a meeting, and the vehicle "left" is flying to the meeting."""
    group_flight = GroupFlight(
        mission_text(f"{fly_step(5)}, {meet_step('x')}", f"{fly_step(200)}, {meet_step('x')}"),
        in_air=("lead", "left"),
    )
    return (
        group_flight.start()
        .until_states(lead="waiting", left="flying")
        .until(lambda: group_flight.current_steps()["lead"] == "lead, step 2")
    )


def lose_position(flight) -> None:
    flight.set_reading(estimates=frozenset({"heading"}), position_ned_m=None)


def lose_link_for_a_moment(flight) -> None:
    flight.lose_link()
    flight.fly(1.0)
    flight.set_reading(link_active=True)


EVENTS = {
    "pilot": lambda flight: flight.change_mode("position", "pilot"),
    "failsafe": lambda flight: flight.change_mode("rtl", "failsafe"),
    "operator's Hold": lambda flight: flight.change_mode("hold", "command", "Bob commanded Hold"),
    "stream ended": lambda flight: flight.set_reading(stream="ending", stream_text="The stream failed"),
    "low battery": lambda flight: flight.set_reading(battery_share=0.1),
    "abort of one runner": lambda flight: flight.abort("land"),
    "link loss": lose_link_for_a_moment,
    "lost position": lose_position,
}


@pytest.mark.parametrize("start_flight", [in_flight, at_meeting])
@pytest.mark.parametrize("event", EVENTS)
def test_when_one_vehicle_leaves_the_mission_the_other_holds_and_the_mission_ends(event, start_flight):
    group_flight = start_flight()
    EVENTS[event](group_flight.flights["lead"])
    group_flight.until(lambda: group_flight.runner.over, 2)
    assert group_flight.flights["left"].requested_modes() == ["hold"]
    assert group_flight.flights["left"].status.state == "stopped"
    assert "lead has left the mission" in str(group_flight.flights["left"].status.reason)
    with pytest.raises(CannotDo, match="the mission has ended"):
        group_flight.runner.resume(group_flight.now_s, group_flight.readings(), "Alice")


def test_when_one_vehicle_does_not_follow_all_hold():
    group_flight = in_flight()
    group_flight.flights["lead"].interrupt()
    group_flight.until(lambda: group_flight.runner.over, 2)
    assert all(flight.requested_modes() == ["hold"] for flight in group_flight.flights.values())
    assert "lead does not follow" in str(group_flight.flights["left"].status.reason)


def test_when_one_vehicle_leaves_a_take_off_is_stopped_and_a_landing_continues():
    group_flight = GroupFlight(
        mission_text(f"{HIGH_TAKE_OFF}, {fly_step(20)}", f"{TAKE_OFF}, {LAND}")
    ).start()
    group_flight.until_states(lead="taking_off", left="landing")
    group_flight.flights["lead"].change_mode("position", "pilot")
    group_flight.until(lambda: group_flight.runner.over, 2)
    assert group_flight.flights["left"].requested_modes() == ["land"]
    second_flight = (
        GroupFlight(mission_text(f"{HIGH_TAKE_OFF}, {fly_step(20)}", f"{TAKE_OFF}, {fly_step(90)}"))
        .start()
        .until_states(lead="taking_off", left="flying")
    )
    second_flight.flights["left"].change_mode("position", "pilot")
    second_flight.until(lambda: second_flight.runner.over, 2)
    assert second_flight.flights["lead"].requested_modes() == ["hold"]


def test_a_pause_holds_all_vehicles_and_resume_continues_all():
    group_flight = in_flight()
    group_flight.execute(group_flight.runner.pause(group_flight.now_s, group_flight.readings(), "Alice"))
    group_flight.until_states(lead="paused", left="paused").fly(3)
    positions_before = [flight.flown_path[-1] for flight in group_flight.flights.values()]
    group_flight.execute(group_flight.runner.resume(group_flight.now_s, group_flight.readings(), "Alice"))
    group_flight.fly(5)
    assert all(
        flight.flown_path[-1][0] > position[0]
        for flight, position in zip(group_flight.flights.values(), positions_before, strict=True)
    )


def test_a_change_of_control_of_one_vehicle_pauses_all_vehicles():
    group_flight = in_flight()
    group_flight.flights["left"].set_reading(control_holder="bob", control_holder_name="Bob")
    group_flight.until_states(lead="paused", left="paused")
    assert not group_flight.runner.over


def test_vehicles_paused_at_a_meeting_leave_it_only_after_resume():
    group_flight = GroupFlight(
        mission_text(
            f"{fly_step(10)}, {meet_step('x')}, {fly_step(90)}",
            f"{fly_step(60)}, {meet_step('x')}, {fly_step(0)}",
        ),
        ("lead", "left"),
    )
    group_flight.start().until_states(lead="waiting", left="flying")
    group_flight.execute(group_flight.runner.pause(group_flight.now_s, group_flight.readings(), "Alice"))
    group_flight.fly(60)
    assert group_flight.current_steps()["lead"] == "lead, step 2"
    group_flight.execute(group_flight.runner.resume(group_flight.now_s, group_flight.readings(), "Alice"))
    group_flight.until(
        lambda: group_flight.current_steps() == {"lead": "lead, step 3", "left": "left, step 3"}
    )


def test_no_vehicle_is_resumed_if_one_vehicle_cannot_be_resumed():
    group_flight = in_flight()
    with pytest.raises(CannotDo, match="role lead: the mission is not paused"):
        group_flight.runner.resume(group_flight.now_s, group_flight.readings(), "Alice")
    assert group_flight.states() == {"lead": "flying", "left": "flying"}


def test_an_abort_ends_the_mission_of_all_vehicles():
    group_flight = in_flight()
    group_flight.execute(group_flight.runner.abort(group_flight.readings(), "Alice", "land"))
    group_flight.fly(1)
    assert group_flight.states() == {"lead": "aborted", "left": "aborted"}
    assert [flight.requested_modes() for flight in group_flight.flights.values()] == [["land"], ["land"]]


def test_the_two_vehicle_example_is_safe_at_7_m_and_is_flown_to_its_end():
    text = (Path(__file__).parents[3] / "missions/examples/two_vehicle_show.yaml").read_text()
    mission = read(text)
    origin = LocalOrigin(47.0, 8.0, 480.0)
    starts = {
        "lead": Start(origin=origin),
        "left": Start(position_ned_m=(0.0, 7.0, 0.0), origin=origin),
    }
    assert compile_roles(mission, dict.fromkeys(starts, MissionVehicle()), starts).findings == ()
    group_flight = GroupFlight(text).start().until_states(lead="done", left="done")
    assert [flight.requested_modes() for flight in group_flight.flights.values()] == [["land"], ["land"]]
