"""Missions that are in the middle of a step, for tests of events during each kind of step.

A step without a duration is combined with a step that has a duration: a gimbal track with a hold, a branch
or a call with a hold in its list. Photos are one second apart; the event occurs between two photos.
"""

from __future__ import annotations

from typing import get_args

from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.reader import read
from missions.offboard.steps import MissionStep
from tests.support.mission_vehicle import FakeFlight
from tests.support.offboard_missions import flight_steps

CENTER = "center: {offset_ned_m: [20, 0, -10]}, radius_m: 8"
FLY = "step: fly, points: [{offset_ned_m: [30, 0, -10]}]"
HOLD = "step: hold, duration_s: 10"
STEPS: dict[str, tuple[str, ...]] = {
    "take_off": ("step: take_off, height_m: 10",),
    "fly": ("step: fly, points: [{offset_ned_m: [40, 0, -10]}, {offset_ned_m: [40, 30, -14]}]",),
    "hold": (HOLD,),
    "orbit": (f"step: orbit, {CENTER}",),
    "helix": (f"step: helix, {CENTER}, climb_m: 5",),
    "spiral": (f"step: spiral, {CENTER}, end_radius_m: 15",),
    "figure_eight": ("step: figure_eight, center: {offset_ned_m: [0, 0, -10]}, length_m: 40, width_m: 20",),
    "table": ("step: table, file: slope",),
    "velocity": ("step: velocity, velocity_ned_m_s: [2, 1, 0], duration_s: 12",),
    "attitude": ("step: attitude, thrust: 0.5, duration_s: 10",),
    "gimbal": ("step: gimbal, track: sweep, sweep_yaw_rad: 1, period_s: 8", HOLD),
    "photo": ("step: photo, count: 20, interval_s: 1",),
    "person": ("step: wait, until: person, timeout_s: 60, message: Sharp?",),
    "condition": ("step: wait, until: {value: satellites, above: 10}, timeout_s: 60",),
    "repeat": (f"step: repeat, times: 2, steps: [{{{FLY}}}, {{step: hold, duration_s: 8}}]",),
    "branch": (
        f"step: branch, condition: {{value: battery_share, above: 0.5}}, then: [{{{HOLD}}}], otherwise: []",
    ),
    "call": ("step: call, mission: stay",),
    "meet": ("step: meet, meeting: here",),
    "land": ("step: land",),
}
"""For each kind of step, the steps of its flight. The event occurs during the last step."""
FLOWN_BY_PX4 = ("take_off", "land")
FLOWN_BY_SETPOINTS = [kind for kind in STEPS if kind not in FLOWN_BY_PX4]


def all_step_kinds() -> set[str]:
    """All kinds of steps that a mission's document can have."""
    return {step_model.model_fields["step"].default for step_model in get_args(get_args(MissionStep)[0])}


def step_kinds(steps: tuple[str, ...]) -> set[str]:
    """The kinds of these steps, without the steps inside them."""
    return {step.removeprefix("step: ").partition(",")[0] for step in steps}


def mission_with_lists(steps: str, stay: str = HOLD, table: str | None = None) -> OffboardMission:
    """A mission with these steps, the list "stay" for a `call` step and the file "slope" for a table.

    Args:
        steps: YAML of the steps.
        stay: YAML of the only step of the list "stay".
        table: CSV of the file "slope"; None: `slope()`.
    """
    document = read(f"name: Test\nmissions: {{stay: [{{{stay}}}]}}\nsteps:\n{steps}")
    return document.model_copy(update={"tables": {"slope": table or slope()}})


def mission_for_two(*steps: str) -> OffboardMission:
    """A mission of the roles "lead" and "left", both with these steps."""
    step_list = ", ".join(f"{{{step}}}" for step in steps)
    roles = ", ".join(f"{role}: {{steps: [{step_list}]}}" for role in ("lead", "left"))
    return read(f"name: Test\nroles: {{{roles}}}")


def slope(first_down_m: float = -10.0, duration_s: float = 12.0) -> str:
    """A table of a straight line 12 m north, 6 m east and 4 m up, at rest at both ends."""
    rows = ["t_s,north_m,east_m,down_m"]
    for step in range(101):
        fraction = step / 100
        travelled = fraction**3 * (10 - 15 * fraction + 6 * fraction * fraction)
        north_m, east_m, down_m = 12 * travelled, 6 * travelled, first_down_m - 4 * travelled
        rows.append(f"{fraction * duration_s:.3f},{north_m:.5f},{east_m:.5f},{down_m:.5f}")
    return "\n".join(rows)


def flight_in_step(kind: str, **actions: str) -> FakeFlight:
    """A running mission in the middle of a step of this kind."""
    flight = _flight_with_meeting(actions) if kind == "meet" else _flight_of_one_vehicle(kind, actions)
    if kind in FLOWN_BY_PX4:
        state = "taking_off" if kind == "take_off" else "landing"
        flight.until(lambda: flight.status.state == state and flight.reading.landed == "in_air")
        return flight.fly(1.0)
    place = f"step {1 + len(STEPS[kind])}"
    flight.until(lambda: flight.status.state in ("flying", "waiting") and place in str(flight.status.place))
    return flight.fly(2.5)


def _flight_of_one_vehicle(kind: str, actions: dict[str, str]) -> FakeFlight:
    steps = ("step: hold, duration_s: 4",) if kind in FLOWN_BY_PX4 else STEPS[kind]
    return FakeFlight(_mission_with_actions(mission_with_lists(flight_steps(*steps, FLY)), actions)).start()


def _flight_with_meeting(actions: dict[str, str]) -> FakeFlight:
    """The role "lead" of a mission for two vehicles; `end_wait` replaces the arrival of the role "left"."""
    document = _mission_with_actions(
        mission_for_two(*STEPS["take_off"], *STEPS["meet"], FLY, *STEPS["land"]), actions
    )
    flight = FakeFlight(document, timeline=compile_mission(document, role="lead")).start()
    return end_wait(flight, "meet")


def _mission_with_actions(document: OffboardMission, actions: dict[str, str]) -> OffboardMission:
    return document.model_copy(update={"actions": document.actions.model_copy(update=actions)})


def end_wait(flight: FakeFlight, kind: str) -> FakeFlight:
    """Ends a wait for the pilot or for the other role; other kinds of steps end by themselves."""
    if kind == "person":
        flight.until_state("waiting").continue_after_question()
    elif kind == "meet":
        flight.until_state("waiting")
        setpoint_part = flight.runner.setpoint_part
        assert setpoint_part is not None
        setpoint_part.leave_meeting()
    return flight


def assert_nothing_is_requested(flight: FakeFlight, for_s: float = 5.0) -> None:
    """Checks that the mission requests nothing and sends no setpoint for this time [s]."""
    request_count, sent_count = len(flight.requests), len(flight.sent_setpoints)
    flight.fly(for_s)
    assert flight.requests[request_count:] == []
    assert len(flight.sent_setpoints) == sent_count
