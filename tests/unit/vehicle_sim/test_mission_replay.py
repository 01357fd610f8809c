"""The settings that PX4 repeats when a mission is started at a later item, or continued after a pause."""

import pytest

from tests.unit.vehicle_sim.plan_station import PlanStation
from vehicle_sim.autopilot.mission.items import Item
from vehicle_sim.autopilot.mission.replay import Replay

TAKEOFF, WAYPOINT, RETURN = 22, 16, 20
SPEED, DISTANCE, CONTROL, ROI, MODE, CONFIGURE, PITCH_YAW = 178, 206, 2003, 195, 530, 1001, 1000


def item(command, *p):
    return Item(2, command, True, (*p, 0.0, 0.0, 0.0, 0.0)[:4], 0.0, 0.0, 0.0)


LINE = [
    item(TAKEOFF), item(SPEED, 1, 3), item(SPEED, 1, 5), item(ROI), item(CONFIGURE), item(PITCH_YAW, -90),
    item(MODE, 0, 2), item(WAYPOINT), item(DISTANCE, 10), item(WAYPOINT), item(WAYPOINT), item(DISTANCE),
    item(WAYPOINT),
]  # fmt: skip


def replay():
    issued = []
    return Replay(lambda each: issued.append((each.command, each.parameters[0]))), issued


def test_speed_is_repeated_at_once_gimbal_angles_after_the_climb_and_pictures_at_the_waypoint():
    repeated, issued = replay()
    assert repeated.begin(LINE, 10) == 10
    assert issued == [(SPEED, 1), (MODE, 0)]
    repeated.after_climb()
    assert issued[2:] == [(CONFIGURE, 0), (PITCH_YAW, -90)]
    repeated.reached(10)
    assert len(issued) == 4, "the waypoint is not reached yet"
    repeated.reached(11)
    repeated.reached(12)
    repeated.after_climb()
    assert issued[4:] == [(DISTANCE, 10)]


@pytest.mark.parametrize(
    ("last", "repeats"),
    [(item(DISTANCE, 0), False), (item(CONTROL, 1), True), (item(CONTROL, 0), False), (item(2000), True),
     (item(2001), False)],
)  # fmt: skip
def test_only_a_trigger_that_takes_pictures_is_repeated(last, repeats):
    repeated, issued = replay()
    repeated.begin([item(DISTANCE, 5), last, item(WAYPOINT), item(WAYPOINT)], 2)
    repeated.reached(3)
    assert (issued == [(last.command, last.parameters[0])]) is repeats


def test_a_mission_left_while_pictures_are_taken_continues_at_the_previous_waypoint():
    repeated, issued = replay()
    repeated.left_at = 10
    assert repeated.begin(LINE, 10) == 9
    assert (SPEED, 1) not in issued, "the speed is repeated at that position too"
    repeated.reached(10)
    assert issued[-2:] == [(SPEED, 1), (DISTANCE, 10)]
    repeated.left_at = 12
    assert repeated.begin(LINE, 12) == 12, "no pictures were taken there"


@pytest.mark.flight
def test_a_mission_that_was_not_flown_before_starts_at_an_item_with_the_earlier_settings():
    s = PlanStation(parameters={"MIS_TAKEOFF_ALT": 2.5}, sensor_noise=False)
    s.ready_to_arm()
    s.upload([
        s.item(TAKEOFF, height_m=8), s.action(SPEED, 1, 3.0, -1), s.action(PITCH_YAW, -90, 0),
        s.action(DISTANCE, 10), s.item(WAYPOINT, 4, 0, 3), s.item(WAYPOINT, 40, 0, 3),
    ])  # fmt: skip
    s.command(300, 4)
    s.run(0.1)
    numbers = [m.command for m in s.received("COMMAND_LONG") if m.confirmation == 0]
    assert numbers == [SPEED]
    assert "Climb to 3.0 meters above home\t" in s.texts(), "the altitude of item 4, not of the take-off"
    s.run_until(lambda: s.mission.current == 5, 20)
    s.run(0.1)
    assert [m.command for m in s.received("COMMAND_LONG") if m.confirmation == 0] == [
        SPEED,
        PITCH_YAW,
        DISTANCE,
    ]
    assert s.reached() == [4]
