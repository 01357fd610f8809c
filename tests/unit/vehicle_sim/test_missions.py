"""Missions over MAVLink on simulated time: flights, texts, refusals."""

import math

import pytest

from tests.unit.vehicle_sim.plan_station import MISSION_MODE, PlanStation
from tests.unit.vehicle_sim.sim_station import HOLD_MODE, NAN, RTL_MODE

pytestmark = pytest.mark.flight

SET_MODE, MISSION_START, FENCE_VERTEX, VTOL_LAND, CONDITION_DELAY = 176, 300, 5001, 85, 112
TRIGGER_CONTROL, GIMBAL_PITCH_YAW, GIMBAL_CONFIGURE = 2003, 1000, 1001
WAYPOINT, RETURN, LAND, TAKEOFF, DELAY, JUMP, CHANGE_SPEED = 16, 20, 21, 22, 93, 177, 178
ROI, ROI_NONE, LOITER_UNLIMITED = 195, 197, 17


@pytest.fixture
def station() -> PlanStation:
    station = PlanStation(parameters={"MIS_TAKEOFF_ALT": 2.5}, sensor_noise=False)
    station.wait_until_ready_to_arm()
    return station


@pytest.mark.story
def test_a_mission_with_pause_speed_and_landing_is_flown_to_its_end(station: PlanStation) -> None:
    plan = [
        station.item(TAKEOFF, alt_home_m=4),
        station.command_item(CHANGE_SPEED, 1, 3.0, -1),
        station.item(WAYPOINT, 8, 0, 4, parameters=(1.0, 0, 0, NAN)),
        station.item(WAYPOINT, 8, 8, 4, parameters=(0, 0, 0, 180.0)),
        station.item(LAND, 2, 8, 0),
    ]
    assert station.upload(plan) == 0
    station.start_mission()
    assert station.status_texts()[:3] == [
        "Armed by mission start\t", "Executing Mission\t", "Climb to 4.0 meters above home\t",
    ]  # fmt: skip
    station.run_until(lambda: station.newest_messages["EXTENDED_SYS_STATE"].landed_state == 3, 4)
    station.run_until(lambda: station.mission.current == 2, 12)
    assert station.reached_items() == [1], "an item without a position was not reached with the take-off"
    assert [(m.command, m.param2) for m in station.received("COMMAND_LONG")] == [(CHANGE_SPEED, 3.0)]
    station.run(1.0)

    station.command(SET_MODE, 1, 4, 3)
    station.run(0.2)
    assert station.active_mode == HOLD_MODE
    station.run(7.0)  # the vehicle was accelerating, so it overshoots and flies back
    hold_ne_m = station.position_ne_m
    station.run(1.0)
    assert math.dist(hold_ne_m, station.position_ne_m) < 0.6, "the vehicle does not keep its position"
    station.command(SET_MODE, 1, 4, 4)
    station.run(0.1)
    assert station.status_texts()[-1] == "Executing Mission\t"
    assert station.mission.current == 2, "the mission resumed at another item"

    station.run_until(lambda: station.mission.current == 3, 10)
    station.run_until(lambda: station.mission.current == 4, 12)
    assert abs(math.degrees(station.newest_messages["ATTITUDE"].yaw)) == pytest.approx(180, abs=13), (
        "the heading error exceeds MIS_YAW_ERR"
    )
    assert max(math.hypot(m.vx, m.vy) for m in station.received("LOCAL_POSITION_NED")) < 3.0
    station.run_until(lambda: station.newest_messages["EXTENDED_SYS_STATE"].landed_state == 4, 12)
    assert station.position_ne_m == pytest.approx((2, 8), abs=2.1)
    station.run_until(lambda: not station.armed, 20)
    assert station.status_texts()[-3:] == [
        "Landing detected\t",
        "Mission finished, landed\t",
        "Disarmed by landing\t",
    ]
    station.run(1.1)
    assert station.mode == MISSION_MODE
    assert station.reached_items() == [1, 2, 3, 4]


@pytest.mark.parametrize("first_item", [-1, 1])
def test_a_mission_can_be_started_directly_after_its_upload(station: PlanStation, first_item: int) -> None:
    plan = [
        station.item(TAKEOFF, alt_home_m=4),
        station.item(WAYPOINT, 6, 0, 4),
        station.item(WAYPOINT, 6, 6, 4),
    ]
    station.send("MISSION_COUNT", target_system=1, target_component=1, count=len(plan), mission_type=0)
    for seq, item in enumerate(plan):
        station.send("MISSION_ITEM_INT", target_system=1, target_component=1, seq=seq, mission_type=0, **item)
    station.command(MISSION_START, first_item)
    station.run(0.1)
    assert station.acks(MISSION_START) == [0]
    assert station.armed
    assert station.mission.current == max(first_item, 0)


def test_a_vehicle_holds_at_the_last_waypoint_of_its_mission(station: PlanStation) -> None:
    station.upload([station.item(TAKEOFF, alt_home_m=4), station.item(WAYPOINT, 6, 0, 4)])
    station.start_mission()
    station.run_until(lambda: station.active_mode == HOLD_MODE, 25)
    assert station.status_texts()[-1] == "Mission finished, loitering\t"
    station.run(3)
    assert station.position_ne_m == pytest.approx((6, 0), abs=0.6)
    assert station.armed


@pytest.mark.story
def test_a_jump_repeats_items_and_a_delay_waits(station: PlanStation) -> None:
    station.upload([
        station.item(TAKEOFF, alt_home_m=3), station.item(WAYPOINT, 3, 0, 3, parameters=(0, 0.7, 0, NAN)),
        station.item(WAYPOINT, 0, 0, 3, parameters=(0, 0.7, 0, NAN)), station.command_item(JUMP, 1, 1),
        station.command_item(DELAY, 2.0),
        station.item(LOITER_UNLIMITED, 3, 0, 3),
    ])  # fmt: skip
    station.start_mission()
    station.run_until(lambda: station.mission.current == 4, 40)
    assert station.reached_items() == [0, 1, 2, 1, 2]
    delay_begin_s = station.now_s
    station.run_until(lambda: station.mission.current == 5, 4)
    assert station.now_s - delay_begin_s == pytest.approx(2.0, abs=0.1)
    station.run(6)
    assert (station.active_mode, station.mission.current) == (MISSION_MODE, 5), (
        "an unlimited loiter has ended"
    )
    station.send("MISSION_SET_CURRENT", target_system=1, target_component=1, seq=2)
    station.run(1.1)
    assert station.newest_messages["MISSION_CURRENT"].seq == 2


def test_a_region_of_interest_turns_the_vehicle_and_a_return_item_ends_the_mission(
    station: PlanStation,
) -> None:
    station.upload([
        station.item(TAKEOFF, alt_home_m=3), station.item(ROI, 4, -8, 0), station.item(WAYPOINT, 8, 0, 3),
        station.command_item(ROI_NONE), station.command_item(RETURN),
    ])  # fmt: skip
    station.start_mission()
    station.run_until(lambda: station.mission.current == 2, 12)
    station.run(4.0)
    north, east = station.position_ne_m
    bearing_rad = math.atan2(-8 - east, 4 - north)
    assert math.remainder(station.newest_messages["ATTITUDE"].yaw - bearing_rad, math.tau) == pytest.approx(
        0, abs=0.3
    )
    station.run_until(lambda: station.active_mode == RTL_MODE, 15)
    assert "Returning to launch\t" in station.status_texts()
    numbers = [m.command for m in station.received("COMMAND_LONG") if m.confirmation == 0]
    assert numbers == [
        ROI, ROI_NONE, RETURN, TRIGGER_CONTROL, GIMBAL_PITCH_YAW, GIMBAL_CONFIGURE, GIMBAL_CONFIGURE,
        GIMBAL_PITCH_YAW, GIMBAL_CONFIGURE,
    ]  # fmt: skip


def test_an_infeasible_mission_is_stored_and_its_start_refused(station: PlanStation) -> None:
    cases = {
        "navigator_mis_takeoff_not_first": [station.item(WAYPOINT, 5), station.item(TAKEOFF)],
        "navigator_mis_vtol_items": [station.item(TAKEOFF), station.item(VTOL_LAND, 5)],
        "navigator_mis_unsup_cmd": [station.item(TAKEOFF), station.command_item(CONDITION_DELAY, 5)],
        "navigator_mis_takeoff_too_low": [station.item(TAKEOFF, alt_home_m=0)],
    }
    for event, plan in cases.items():
        since_s = station.now_s
        assert station.upload(plan) == 0
        assert event in station.events(since_s)
        station.command(MISSION_START)
        station.run(0.1)
        assert station.acks(MISSION_START)[-1] == 2, event
        assert station.status_texts()[-1] == "Mission start denied! No valid mission\t"
    station.upload(
        [station.item(FENCE_VERTEX, *corner, parameters=(4, 0, 0, 0)) for corner in SQUARE], kind=1
    )
    since_s = station.now_s
    station.upload([station.item(TAKEOFF), station.item(WAYPOINT, 50)])
    assert "navigator_mis_geofence_violation" in station.events(since_s)
    station.upload([], kind=1)
    station.run(0.1)
    assert station.sim.autopilots[0].commander.checks.has_mission, "the mission is refused without the fence"


SQUARE = ((-20, -20), (-20, 20), (20, 20), (20, -20))


def test_a_mission_uploaded_in_flight_starts_at_once_and_clearing_it_ends_in_hold(
    station: PlanStation,
) -> None:
    station.upload([station.item(TAKEOFF, alt_home_m=3), station.item(LOITER_UNLIMITED, 3, 0, 3)])
    station.start_mission()
    station.run_until(lambda: station.mission.current == 1, 12)
    station.upload([station.item(WAYPOINT, 0, 5, 3), station.item(LOITER_UNLIMITED, 0, 5, 3)])
    assert (station.mission.current, station.active_mode) == (0, MISSION_MODE), (
        "the new mission has not started"
    )
    station.run_until(lambda: station.mission.current == 1, 10)
    station.send("MISSION_CLEAR_ALL", target_system=1, target_component=1, mission_type=0)
    station.run(0.2)
    assert station.active_mode == HOLD_MODE
    station.command(SET_MODE, 1, 4, 4)
    station.run(0.1)
    assert station.status_texts()[-1] == "Switching to Mission is currently not available\t"


@pytest.mark.story
def test_a_vehicle_put_into_hold_while_accelerating_overshoots_and_flies_back(station: PlanStation) -> None:
    assert station.upload([station.item(TAKEOFF, alt_home_m=4), station.item(WAYPOINT, 60, 0, 4)]) == 0
    station.start_mission()
    station.run_until(lambda: station.position_ne_m[0] > 0.3, 20)
    station.command(SET_MODE, 1, 4, 3)
    farthest_m = 0.0
    for _ in range(100):
        station.run(0.1)
        farthest_m = max(farthest_m, station.position_ne_m[0])
    assert 2.0 < farthest_m < 8.0
    assert station.position_ne_m[0] < farthest_m - 1.0
    hold_ne_m = station.position_ne_m
    station.run(3.0)
    assert math.dist(hold_ne_m, station.position_ne_m) < 0.3
