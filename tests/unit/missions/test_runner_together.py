"""One mission for several vehicles: they start, meet, pause and end together."""

from __future__ import annotations

from pathlib import Path

import pytest

from missions.geodesy import LocalOrigin
from missions.offboard.positions import Start
from missions.offboard.reader import read
from missions.offboard.roles import compile_roles
from missions.offboard.state import MissionVehicle
from missions.runner.requests import TakeOff
from missions.runner.status import CannotDo
from tests.support.mission_squad import Squad

UP, DOWN = "{step: take_off, height_m: 10}", "{step: land}"
HIGH = "{step: take_off, height_m: 30}"


def fly(north: float) -> str:
    return f"{{step: fly, points: [{{offset_ned_m: [{north}, 0, -10]}}]}}"


def meet(name: str, timeout_s: float = 120) -> str:
    return f"{{step: meet, meeting: {name}, timeout_s: {timeout_s}}}"


def show(lead: str, left: str, **actions: str) -> str:
    action_fields = ", ".join(f"{name}: {action}" for name, action in actions.items())
    return (
        f"name: Show\nactions: {{{action_fields}}}\nroles:\n"
        f"  lead:\n    steps: [{lead}]\n  left:\n    steps: [{left}]\n"
    )


LONG = show(f"{UP}, {fly(200)}, {DOWN}", f"{UP}, {fly(200)}, {DOWN}")
FLYING = show(fly(200), fly(200))


def in_flight(**actions: str) -> Squad:
    """Two vehicles in the middle of a flight."""
    return (
        Squad(show(fly(200), fly(200), **actions), in_air=("lead", "left"))
        .start()
        .reach(lead="flying", left="flying")
        .fly(5.0)
    )


def test_both_take_off_at_the_same_time_and_each_flies_its_path():
    squad = Squad(show(f"{UP}, {DOWN}", f"{HIGH}, {DOWN}")).start()
    squad.until(lambda: squad.flights["lead"].count(TakeOff) > 0)
    assert squad.flights["left"].count(TakeOff) == 1
    squad.reach(lead="done", left="done")
    assert squad.together.over


def test_no_vehicle_starts_if_one_vehicle_cannot_start():
    squad = Squad(LONG)
    squad.flights["left"].set_reading(estimates=frozenset({"velocity"}))
    with pytest.raises(CannotDo, match="role left: there is no valid estimate of position"):
        squad.start()
    squad.fly(2)
    assert all(flight.requests == [] for flight in squad.flights.values())


def test_in_flight_no_vehicle_moves_until_all_are_in_offboard():
    squad = Squad(FLYING, in_air=("lead", "left"))
    delayed = squad.flights["left"]
    play, real_do = [], delayed.do
    delayed.do = lambda requests: play.extend(requests)  # the switch of "left" to Offboard is still pending
    squad.start().fly(5)
    assert squad.places() == {"lead": "lead, start", "left": "left, start"}
    assert squad.flights["lead"].path[-1][0] == 0.0
    delayed.do = real_do
    delayed.do(play)
    squad.until(lambda: set(squad.places().values()) == {"lead, step 1", "left, step 1"}, 2)
    squad.fly(5)
    lead, left = (flight.path[-1][0] for flight in squad.flights.values())
    assert lead == left > 5.0


def test_at_a_meeting_the_first_waits_for_the_last_and_both_leave_at_the_same_time():
    squad = Squad(
        show(f"{UP}, {meet('up')}, {fly(20)}, {DOWN}", f"{HIGH}, {meet('up')}, {fly(20)}, {DOWN}")
    ).start()
    squad.reach(lead="waiting", left="taking_off").fly(3)
    assert squad.places()["lead"] == "lead, step 2"
    squad.until(lambda: squad.places()["lead"] == "lead, step 3")
    squad.step()
    assert squad.places()["left"] == "left, step 3"
    squad.reach(lead="done", left="done")


def test_a_meeting_that_one_vehicle_does_not_reach_ends_the_mission_and_all_hold():
    squad = Squad(show(f"{meet('x', 5)}, {fly(20)}", f"{fly(500)}, {meet('x')}"), ("lead", "left")).start()
    squad.reach(lead="stopped", left="stopped")
    assert "Not all vehicles arrived at the meeting 'x' within 5 s" in str(
        squad.flights["left"].status.reason
    )
    assert [flight.modes() for flight in squad.flights.values()] == [["hold"], ["hold"]]


def at_meeting() -> Squad:
    """The vehicle "lead" waits at a meeting, and the vehicle "left" is flying to the meeting."""
    squad = Squad(show(f"{fly(5)}, {meet('x')}", f"{fly(200)}, {meet('x')}"), in_air=("lead", "left"))
    return (
        squad.start()
        .reach(lead="waiting", left="flying")
        .until(lambda: squad.places()["lead"] == "lead, step 2")
    )


def lose_position(flight) -> None:
    flight.set_reading(estimates=frozenset({"heading"}), position_ned_m=None)


def lose_link_for_a_moment(flight) -> None:
    flight.lose_link()
    flight.fly(1.0)
    flight.set_reading(link_active=True)


EVENTS = {
    "pilot": lambda flight: flight.mode("position", "pilot"),
    "failsafe": lambda flight: flight.mode("rtl", "failsafe"),
    "operator's Hold": lambda flight: flight.mode("hold", "command", "Bob commanded Hold"),
    "stream ended": lambda flight: flight.set_reading(stream="ending", stream_text="The stream failed"),
    "low battery": lambda flight: flight.set_reading(battery_share=0.1),
    "abort of its runner": lambda flight: flight.abort("land"),
    "link loss": lose_link_for_a_moment,
    "lost position": lose_position,
}


@pytest.mark.parametrize("squad_in", [in_flight, at_meeting])
@pytest.mark.parametrize("event", EVENTS)
def test_when_one_vehicle_leaves_the_mission_the_other_holds_and_the_mission_ends(event, squad_in):
    squad = squad_in()
    EVENTS[event](squad.flights["lead"])
    squad.until(lambda: squad.together.over, 2)
    assert squad.flights["left"].modes() == ["hold"]
    assert squad.flights["left"].status.state == "stopped"
    assert "lead has left the mission" in str(squad.flights["left"].status.reason)
    with pytest.raises(CannotDo, match="the mission has ended"):
        squad.together.resume(squad.now_s, squad.readings(), "Alice")


def test_a_vehicle_that_takes_off_also_holds_and_a_vehicle_that_lands_continues():
    squad = Squad(show(f"{HIGH}, {fly(20)}", f"{UP}, {DOWN}")).start()
    squad.reach(lead="taking_off", left="landing")
    squad.flights["lead"].mode("position", "pilot")
    squad.until(lambda: squad.together.over, 2)
    assert squad.flights["left"].modes() == ["land"]
    other = (
        Squad(show(f"{HIGH}, {fly(20)}", f"{UP}, {fly(90)}")).start().reach(lead="taking_off", left="flying")
    )
    other.flights["left"].mode("position", "pilot")
    other.until(lambda: other.together.over, 2)
    assert other.flights["lead"].modes() == ["hold"]


def test_a_pause_holds_all_vehicles_and_resume_continues_all():
    squad = in_flight()
    squad.do(squad.together.pause(squad.now_s, squad.readings(), "Alice"))
    squad.reach(lead="paused", left="paused").fly(3)
    before = [flight.path[-1] for flight in squad.flights.values()]
    squad.do(squad.together.resume(squad.now_s, squad.readings(), "Alice"))
    squad.fly(5)
    assert all(
        flight.path[-1][0] > position[0]
        for flight, position in zip(squad.flights.values(), before, strict=True)
    )


def test_a_change_of_control_of_one_vehicle_pauses_all_vehicles():
    squad = in_flight()
    squad.flights["left"].set_reading(control_holder="bob", control_holder_name="Bob")
    squad.reach(lead="paused", left="paused")
    assert not squad.together.over


def test_vehicles_paused_at_a_meeting_leave_it_only_after_resume():
    squad = Squad(
        show(f"{fly(10)}, {meet('x')}, {fly(90)}", f"{fly(60)}, {meet('x')}, {fly(0)}"), ("lead", "left")
    )
    squad.start().reach(lead="waiting", left="flying")
    squad.do(squad.together.pause(squad.now_s, squad.readings(), "Alice"))
    squad.fly(60)
    assert squad.places()["lead"] == "lead, step 2"
    squad.do(squad.together.resume(squad.now_s, squad.readings(), "Alice"))
    squad.until(lambda: squad.places() == {"lead": "lead, step 3", "left": "left, step 3"})


def test_no_vehicle_is_resumed_if_one_vehicle_cannot_be_resumed():
    squad = in_flight()
    with pytest.raises(CannotDo, match="role lead: the mission is not paused"):
        squad.together.resume(squad.now_s, squad.readings(), "Alice")
    assert squad.states() == {"lead": "flying", "left": "flying"}


def test_an_abort_ends_the_mission_of_all_vehicles():
    squad = in_flight()
    squad.do(squad.together.abort(squad.readings(), "Alice", "land"))
    squad.fly(1)
    assert squad.states() == {"lead": "aborted", "left": "aborted"}
    assert [flight.modes() for flight in squad.flights.values()] == [["land"], ["land"]]


def test_the_example_is_safe_for_vehicles_7_m_apart_and_flown_to_its_end():
    text = (Path(__file__).parents[3] / "missions/examples/two_vehicle_show.yaml").read_text()
    mission = read(text)
    origin = LocalOrigin(47.0, 8.0, 480.0)
    starts = {
        "lead": Start(origin=origin),
        "left": Start(position_ned_m=(0.0, 7.0, 0.0), origin=origin),
    }
    assert compile_roles(mission, dict.fromkeys(starts, MissionVehicle()), starts).findings == ()
    squad = Squad(text).start().reach(lead="done", left="done")
    assert [flight.modes() for flight in squad.flights.values()] == [["land"], ["land"]]
