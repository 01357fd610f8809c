"""Missions by MAVLink messages on simulated time: flights, texts, refusals."""

import math

import pytest

from tests.unit.vehicle_sim.plan_station import MISSION_MODE, PlanStation
from tests.unit.vehicle_sim.sim_station import HOLD, NAN, RTL

pytestmark = pytest.mark.flight

WAYPOINT, RETURN, LAND, TAKEOFF, DELAY, JUMP, SPEED = 16, 20, 21, 22, 93, 177, 178
ROI, ROI_NONE, LOITER_UNLIMITED = 195, 197, 17


@pytest.fixture
def s() -> PlanStation:
    station = PlanStation(parameters={"MIS_TAKEOFF_ALT": 2.5}, sensor_noise=False)
    station.ready_to_arm()
    return station


@pytest.mark.story
def test_a_mission_with_pause_speed_and_landing_is_flown_to_its_end(s: PlanStation) -> None:
    plan = [
        s.item(TAKEOFF, height_m=4),
        s.action(SPEED, 1, 3.0, -1),
        s.item(WAYPOINT, 8, 0, 4, p=(1.0, 0, 0, NAN)),
        s.item(WAYPOINT, 8, 8, 4, p=(0, 0, 0, 180.0)),
        s.item(LAND, 2, 8, 0),
    ]
    assert s.upload(plan) == 0
    s.start()
    assert s.texts()[:3] == [
        "Armed by mission start\t", "Executing Mission\t", "Climb to 4.0 meters above home\t",
    ]  # fmt: skip
    s.run_until(lambda: s.last["EXTENDED_SYS_STATE"].landed_state == 3, 4)
    s.run_until(lambda: s.mission.current == 2, 12)
    assert s.reached() == [1], "an item without a position is reached together with the take-off"
    assert [(m.command, m.param2) for m in s.received("COMMAND_LONG")] == [(178, 3.0)]
    s.run(1.0)

    s.command(176, 1, 4, 3)
    s.run(0.2)
    assert s.active_mode == HOLD
    s.run(7.0)  # the vehicle was accelerating, so it overshoots and flies back
    held = s.position_ne_m
    s.run(1.0)
    assert math.dist(held, s.position_ne_m) < 0.6, "the vehicle holds its position"
    s.command(176, 1, 4, 4)
    s.run(0.1)
    assert s.texts()[-1] == "Executing Mission\t"
    assert s.mission.current == 2, "the mission resumes at the same item"

    s.run_until(lambda: s.mission.current == 3, 10)
    s.run_until(lambda: s.mission.current == 4, 12)
    assert abs(math.degrees(s.last["ATTITUDE"].yaw)) == pytest.approx(180, abs=13), "MIS_YAW_ERR"
    assert max(math.hypot(m.vx, m.vy) for m in s.received("LOCAL_POSITION_NED")) < 3.0
    s.run_until(lambda: s.last["EXTENDED_SYS_STATE"].landed_state == 4, 12)
    assert s.position_ne_m == pytest.approx((2, 8), abs=2.1)
    s.run_until(lambda: not s.armed, 20)
    assert s.texts()[-3:] == ["Landing detected\t", "Mission finished, landed\t", "Disarmed by landing\t"]
    s.run(1.1)
    assert s.mode == MISSION_MODE
    assert s.reached() == [1, 2, 3, 4]


@pytest.mark.parametrize("first_item", [-1, 1])
def test_a_mission_can_be_started_directly_after_its_upload(s: PlanStation, first_item: int) -> None:
    plan = [s.item(TAKEOFF, height_m=4), s.item(WAYPOINT, 6, 0, 4), s.item(WAYPOINT, 6, 6, 4)]
    s.send("MISSION_COUNT", target_system=1, target_component=1, count=len(plan), mission_type=0)
    for seq, item in enumerate(plan):
        s.send("MISSION_ITEM_INT", target_system=1, target_component=1, seq=seq, mission_type=0, **item)
    s.command(300, first_item)
    s.run(0.1)
    assert s.acks(300) == [0]
    assert s.armed
    assert s.mission.current == max(first_item, 0)


def test_after_the_last_waypoint_the_vehicle_holds_there(s: PlanStation) -> None:
    s.upload([s.item(TAKEOFF, height_m=4), s.item(WAYPOINT, 6, 0, 4)])
    s.start()
    s.run_until(lambda: s.active_mode == HOLD, 25)
    assert s.texts()[-1] == "Mission finished, loitering\t"
    s.run(3)
    assert s.position_ne_m == pytest.approx((6, 0), abs=0.6)
    assert s.armed


@pytest.mark.story
def test_jumps_repeat_and_delays_wait(s: PlanStation) -> None:
    s.upload([
        s.item(TAKEOFF, height_m=3), s.item(WAYPOINT, 3, 0, 3, p=(0, 0.7, 0, NAN)),
        s.item(WAYPOINT, 0, 0, 3, p=(0, 0.7, 0, NAN)), s.action(JUMP, 1, 1), s.action(DELAY, 2.0),
        s.item(LOITER_UNLIMITED, 3, 0, 3),
    ])  # fmt: skip
    s.start()
    s.run_until(lambda: s.mission.current == 4, 40)
    assert s.reached() == [0, 1, 2, 1, 2]
    began_s = s.now_s
    s.run_until(lambda: s.mission.current == 5, 4)
    assert s.now_s - began_s == pytest.approx(2.0, abs=0.1)
    s.run(6)
    assert (s.active_mode, s.mission.current) == (MISSION_MODE, 5), "an unlimited loiter never ends"
    s.send("MISSION_SET_CURRENT", target_system=1, target_component=1, seq=2)
    s.run(1.1)
    assert s.last["MISSION_CURRENT"].seq == 2


def test_a_region_of_interest_turns_the_vehicle_and_a_return_item_ends_the_mission(s: PlanStation) -> None:
    s.upload([
        s.item(TAKEOFF, height_m=3), s.item(ROI, 4, -8, 0), s.item(WAYPOINT, 8, 0, 3),
        s.action(ROI_NONE), s.action(RETURN),
    ])  # fmt: skip
    s.start()
    s.run_until(lambda: s.mission.current == 2, 12)
    s.run(4.0)
    north, east = s.position_ne_m
    towards = math.atan2(-8 - east, 4 - north)
    assert math.remainder(s.last["ATTITUDE"].yaw - towards, math.tau) == pytest.approx(0, abs=0.3)
    s.run_until(lambda: s.active_mode == RTL, 15)
    assert "Returning to launch\t" in s.texts()
    numbers = [m.command for m in s.received("COMMAND_LONG") if m.confirmation == 0]
    assert numbers == [195, 197, 20, 2003, 1000, 1001, 1001, 1000, 1001]


def test_an_infeasible_mission_is_stored_and_its_start_refused(s: PlanStation) -> None:
    cases = {
        "navigator_mis_takeoff_not_first": [s.item(WAYPOINT, 5), s.item(TAKEOFF)],
        "navigator_mis_vtol_items": [s.item(TAKEOFF), s.item(85, 5)],
        "navigator_mis_unsup_cmd": [s.item(TAKEOFF), s.action(112, 5)],
        "navigator_mis_takeoff_too_low": [s.item(TAKEOFF, height_m=1)],
    }
    for event, plan in cases.items():
        since_s = s.now_s
        assert s.upload(plan) == 0
        assert event in s.events(since_s)
        s.command(300)
        s.run(0.1)
        assert s.acks(300)[-1] == 2, event
        assert s.texts()[-1] == "Mission start denied! No valid mission\t"
    s.upload([s.item(5001, *corner, p=(4, 0, 0, 0)) for corner in SQUARE], kind=1)
    since_s = s.now_s
    s.upload([s.item(TAKEOFF), s.item(WAYPOINT, 50)])
    assert "navigator_mis_geofence_violation" in s.events(since_s)
    s.upload([], kind=1)
    s.run(0.1)
    assert s.sim.autopilots[0].commander.checks.has_mission, "without the fence the mission is feasible"


SQUARE = ((-20, -20), (-20, 20), (20, 20), (20, -20))


def test_a_mission_uploaded_in_flight_starts_at_once_and_clearing_it_ends_in_hold(s: PlanStation) -> None:
    s.upload([s.item(TAKEOFF, height_m=3), s.item(LOITER_UNLIMITED, 3, 0, 3)])
    s.start()
    s.run_until(lambda: s.mission.current == 1, 12)
    s.upload([s.item(WAYPOINT, 0, 5, 3), s.item(LOITER_UNLIMITED, 0, 5, 3)])
    assert (s.mission.current, s.active_mode) == (0, MISSION_MODE), "the new mission starts at once"
    s.run_until(lambda: s.mission.current == 1, 10)
    s.send("MISSION_CLEAR_ALL", target_system=1, target_component=1, mission_type=0)
    s.run(0.2)
    assert s.active_mode == HOLD
    s.command(176, 1, 4, 4)
    s.run(0.1)
    assert s.texts()[-1] == "Switching to Mission is currently not available\t"


@pytest.mark.story
def test_a_vehicle_put_into_hold_while_accelerating_overshoots_and_flies_back(s: PlanStation) -> None:
    assert s.upload([s.item(TAKEOFF, height_m=4), s.item(WAYPOINT, 60, 0, 4)]) == 0
    s.start()
    s.run_until(lambda: s.position_ne_m[0] > 0.3, 20)
    s.command(176, 1, 4, 3)
    farthest_m = 0.0
    for _ in range(100):
        s.run(0.1)
        farthest_m = max(farthest_m, s.position_ne_m[0])
    assert 2.0 < farthest_m < 8.0
    assert s.position_ne_m[0] < farthest_m - 1.0
    held = s.position_ne_m
    s.run(3.0)
    assert math.dist(held, s.position_ne_m) < 0.3
