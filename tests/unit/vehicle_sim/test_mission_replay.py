"""The settings that PX4 repeats when a mission starts at a later item or continues after a pause."""

import pytest

from tests.unit.vehicle_sim.plan_station import PlanStation
from vehicle_sim.autopilot.mission.items import Item
from vehicle_sim.autopilot.mission.replay import Replay
from vehicle_sim.px4_version import V1_16

TAKEOFF, WAYPOINT, MISSION_START, START_CAPTURE, STOP_CAPTURE = 22, 16, 300, 2000, 2001
CHANGE_SPEED, TRIGGER_DISTANCE, TRIGGER_CONTROL, ROI = 178, 206, 2003, 195
CAMERA_MODE, GIMBAL_CONFIGURE, GIMBAL_PITCH_YAW = 530, 1001, 1000


def item(command, *p):
    return Item(2, command, True, (*p, 0.0, 0.0, 0.0, 0.0)[:4], 0.0, 0.0, 0.0)


MISSION_ITEMS = [
    item(TAKEOFF), item(CHANGE_SPEED, 1, 3), item(CHANGE_SPEED, 1, 5), item(ROI), item(GIMBAL_CONFIGURE),
    item(GIMBAL_PITCH_YAW, -90), item(CAMERA_MODE, 0, 2), item(WAYPOINT), item(TRIGGER_DISTANCE, 10),
    item(WAYPOINT), item(WAYPOINT), item(TRIGGER_DISTANCE), item(WAYPOINT),
]  # fmt: skip


def make_replay():
    commands = []
    return Replay(lambda each: commands.append((each.command, each.parameters[0]))), commands


def test_speed_is_repeated_at_once_and_gimbal_angles_and_pictures_later():
    replay, commands = make_replay()
    assert replay.begin(MISSION_ITEMS, 10) == 10
    assert commands == [(CHANGE_SPEED, 1), (CAMERA_MODE, 0)]
    replay.after_climb()
    assert commands[2:] == [(GIMBAL_CONFIGURE, 0), (GIMBAL_PITCH_YAW, -90)]
    replay.reached(10)
    assert len(commands) == 4, "repeated before the waypoint"
    replay.reached(11)
    replay.reached(12)
    replay.after_climb()
    assert commands[4:] == [(TRIGGER_DISTANCE, 10)]


@pytest.mark.parametrize(
    ("trigger", "is_repeated"),
    [(item(TRIGGER_DISTANCE, 0), False), (item(TRIGGER_CONTROL, 1), True), (item(TRIGGER_CONTROL, 0), False),
     (item(START_CAPTURE), True), (item(STOP_CAPTURE), False)],
)  # fmt: skip
def test_only_a_trigger_that_takes_pictures_is_repeated(trigger, is_repeated):
    replay, commands = make_replay()
    replay.begin([item(TRIGGER_DISTANCE, 5), trigger, item(WAYPOINT), item(WAYPOINT)], 2)
    replay.reached(3)
    assert (commands == [(trigger.command, trigger.parameters[0])]) is is_repeated


def test_a_mission_left_while_pictures_are_taken_continues_at_the_previous_waypoint():
    replay, commands = make_replay()
    replay.left_at_seq = 10
    assert replay.begin(MISSION_ITEMS, 10) == 9
    assert (CHANGE_SPEED, 1) not in commands, "the speed was not repeated at the waypoint"
    replay.reached(10)
    assert commands[-2:] == [(CHANGE_SPEED, 1), (TRIGGER_DISTANCE, 10)]
    replay.left_at_seq = 12
    assert replay.begin(MISSION_ITEMS, 12) == 12, "continued at an earlier waypoint without pictures"


@pytest.mark.flight
def test_a_mission_that_starts_at_a_later_item_uses_the_settings_of_the_items_before_it():
    station = PlanStation(parameters={"MIS_TAKEOFF_ALT": 2.5}, sensor_noise=False, px4=V1_16)
    station.wait_until_ready_to_arm()
    station.upload([
        station.item(TAKEOFF, alt_home_m=8), station.command_item(CHANGE_SPEED, 1, 3.0, -1),
        station.command_item(GIMBAL_PITCH_YAW, -90, 0), station.command_item(TRIGGER_DISTANCE, 10),
        station.item(WAYPOINT, 4, 0, 3), station.item(WAYPOINT, 40, 0, 3),
    ])  # fmt: skip
    station.command(MISSION_START, 4)
    station.run(0.1)
    numbers = [m.command for m in station.received("COMMAND_LONG") if m.confirmation == 0]
    assert numbers == [CHANGE_SPEED]
    assert "Climb to 3.0 meters above home\t" in station.status_texts(), "not the altitude of item 4"
    station.run_until(lambda: station.mission.current == 5, 20)
    station.run(0.1)
    assert [m.command for m in station.received("COMMAND_LONG") if m.confirmation == 0] == [
        CHANGE_SPEED,
        GIMBAL_PITCH_YAW,
        TRIGGER_DISTANCE,
    ]
    assert station.reached_items() == [4]
