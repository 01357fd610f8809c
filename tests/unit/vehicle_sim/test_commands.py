"""Commands a ground station may send at any time: what the vehicle does, and what it answers."""

import math

import pytest

from tests.unit.vehicle_sim.flown import flown, standing
from tests.unit.vehicle_sim.plan_station import MISSION_MODE, PlanStation
from tests.unit.vehicle_sim.sim_station import HOLD, NAN, POSITION, RTL, TAKEOFF

pytestmark = pytest.mark.flight

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, CANCELLED = 0, 1, 2, 3, 4, 6
ARM, SET_MODE, REPOSITION, CHANGE_ALTITUDE, CHANGE_SPEED = 400, 176, 192, 186, 178
TAKEOFF_COMMAND = 22
SET_HOME, ACTUATOR_TEST, GO_TO_LANDING, HIGH_LATENCY, ORBIT = 179, 310, 189, 2600, 34
STABILIZED, MANUAL = 0x70000, 0x10000


@pytest.fixture
def ground() -> PlanStation:
    return standing(PlanStation, 3.0, sensor_noise=False)


@pytest.fixture
def air() -> PlanStation:
    return flown(PlanStation, 8.0, sensor_noise=False)


def ask(s: PlanStation, command: int, *parameters: float) -> list[int]:
    asked_s = s.now_s
    s.command(command, *parameters)
    s.run(0.2)
    return s.acks(command, asked_s)


def amsl(s: PlanStation, height_m: float) -> float:
    return s.sim.autopilots[0].home.alt_amsl_m + height_m


def place(s: PlanStation) -> tuple[float, float]:
    north, east, _ = s.sim.simulation.truth.position_ned_m[0]
    return float(north), float(east)


def go_north(s: PlanStation, metres: float) -> None:
    there = s.item(16, metres)
    assert ask(s, REPOSITION, -1, 1, 0, NAN, there["x"] / 1e7, there["y"] / 1e7, amsl(s, 8.0)) == [ACCEPTED]


def go_to_before_lift_off(ground, height_m):
    ground.command(ARM, 1)
    ground.run(0.1)
    ground.command(TAKEOFF_COMMAND, -1, 0, 0, NAN, NAN, NAN, amsl(ground, 10.0))
    ground.run(0.5)
    there = ground.item(16, 40.0)
    goal = (there["x"] / 1e7, there["y"] / 1e7, amsl(ground, height_m))
    assert ask(ground, REPOSITION, -1, 1, 0, NAN, *goal) == [ACCEPTED]


def test_a_go_to_before_lift_off_lifts_and_flies_there(ground):
    go_to_before_lift_off(ground, 10.0)
    ground.run_until(lambda: place(ground)[0] > 39.0, 40)
    assert ground.height_m == pytest.approx(10.0, abs=0.6)


def test_a_go_to_before_lift_off_that_climbs_slower_than_0_3_m_s_stays_on_the_ground_as_px4_does(ground):
    go_to_before_lift_off(ground, 2.0)
    ground.run(4.0)
    assert max(map(abs, place(ground))) < 0.1


def test_no_command_overtakes_a_change_of_mode_sent_just_before(air):
    begun_s = air.now_s
    air.command(SET_MODE, 1, 4, 3)
    air.command(20)
    air.run(0.3)
    assert air.flown_mode == RTL
    assert [m.command for m in air.heard("COMMAND_ACK", since_s=begun_s)] == [SET_MODE, SET_MODE, 20]
    air.command(20)
    air.command(SET_MODE, 1, 4, 3)
    air.run(0.3)
    assert air.flown_mode == HOLD


def test_a_precision_landing_is_reported_as_landing(air):
    begun_s = air.now_s
    air.command(SET_MODE, 1, 4, 9)
    air.run(1.0)
    assert air.heard("EXTENDED_SYS_STATE", since_s=begun_s)[-1].landed_state == 4


def test_a_change_of_altitude_is_flown_over_the_place_and_ends_a_go_to(air):
    go_north(air, 60.0)
    air.run(4.0)
    left_at_m = place(air)[0]
    assert ask(air, CHANGE_ALTITUDE, amsl(air, 14.0)) == [ACCEPTED]
    air.run(12.0)
    assert air.height_m == pytest.approx(14.0, abs=0.5)
    assert left_at_m < place(air)[0] < left_at_m + 12.0, "it comes to rest, it does not fly on"
    assert air.flown_mode == HOLD


def test_a_change_of_altitude_beyond_the_fence_only_holds(air):
    air.sim.set_parameter(0, "GF_MAX_VER_DIST", 12.0)
    air.run(1.5)
    asked_s = air.now_s
    assert ask(air, CHANGE_ALTITUDE, amsl(air, 30.0)) == [ACCEPTED]
    air.run(5.0)
    assert air.height_m == pytest.approx(8.0, abs=0.5)
    assert "navigator_change_altitude_outside_geofence" in air.events(asked_s)


def test_a_go_to_with_nothing_in_it_stops(air):
    go_north(air, 60.0)
    air.run(4.0)
    left_at_m = place(air)[0]
    assert ask(air, REPOSITION, -1, 1, 0, NAN, NAN, NAN, NAN) == [ACCEPTED]
    air.run(8.0)
    assert left_at_m < place(air)[0] < left_at_m + 12.0
    assert air.height_m == pytest.approx(8.0, abs=0.5)


@pytest.mark.story
def test_a_go_to_with_an_altitude_alone_goes_on_to_its_place(air):
    go_north(air, 20.0)
    air.run(1.0)
    assert ask(air, REPOSITION, -1, 1, 0, NAN, NAN, NAN, amsl(air, 12.0)) == [ACCEPTED]
    air.run(12.0)
    assert place(air)[0] == pytest.approx(20.0, abs=1.0)
    assert air.height_m == pytest.approx(12.0, abs=0.5)


def test_a_go_to_outside_the_fence_ends_the_mission_and_holds(air):
    air.upload([air.item(16, 60.0), air.item(16, 60.0, 30.0)])
    assert ask(air, SET_MODE, 1, 4, 4)[-1] == ACCEPTED
    air.run(3.0)
    assert air.flown_mode == MISSION_MODE
    air.sim.set_parameter(0, "GF_MAX_HOR_DIST", 100.0)
    air.run(0.5)
    there, asked_s = air.item(16, 300.0), air.now_s
    assert ask(air, REPOSITION, -1, 1, 0, NAN, there["x"] / 1e7, there["y"] / 1e7, amsl(air, 8.0)) == [0]
    assert "navigator_reposition_outside_geofence" in air.events(asked_s)
    assert air.flown_mode == HOLD
    air.run(8.0)
    assert place(air)[0] < 45.0


def test_a_go_to_from_another_mode_forgets_a_changed_speed_and_one_in_hold_keeps_it(air):
    cruise = air.sim.autopilots[0].navigator.path
    ask(air, CHANGE_SPEED, 1, 2.0, -1)
    go_north(air, 5.0)
    assert cruise.cruise_m_s == 2.0
    air.send("MANUAL_CONTROL", target=1, x=0, y=0, z=500, r=0, buttons=0)
    air.run(0.2)
    assert ask(air, SET_MODE, 1, 3, 0)[-1] == ACCEPTED
    go_north(air, 5.0)
    assert math.isnan(cruise.cruise_m_s)


def test_the_landing_of_a_mission_can_be_asked_for(air):
    assert ask(air, GO_TO_LANDING) == [CANCELLED]
    air.upload([air.item(16, 30.0), air.action(189), air.item(16, 5.0), air.item(21, 0.0, height_m=0.0)])
    assert ask(air, GO_TO_LANDING) == [ACCEPTED]
    air.run(1.0)
    assert air.flown_mode == MISSION_MODE
    assert air.sim.autopilots[0].navigator.mission.current >= 1


@pytest.mark.parametrize(
    ("param1", "armed"), [(0.6, True), (1.4, True), (0.4, False), (-0.4, False), (NAN, False)]
)
def test_arming_takes_the_nearest_whole_number(ground, param1, armed):
    assert ask(ground, ARM, param1) == [ACCEPTED]
    assert ground.armed is armed


@pytest.mark.parametrize("param1", [1.5, 2.0, -0.6, math.inf, -math.inf, 3e38])
def test_arming_with_another_number_is_told_and_not_answered(ground, param1):
    asked_s = ground.now_s
    assert ask(ground, ARM, param1) == []
    assert "commander_unsupported_arm_disarm_param" in ground.events(asked_s)


@pytest.mark.parametrize(
    ("base", "mode"),
    [
        (4, MISSION_MODE),
        (64 | 8, POSITION),
        (64 | 16, STABILIZED),
        (64, MANUAL),
        (128 | 64, MANUAL),
        (16, HOLD),
    ],
)
def test_base_modes_choose_a_mode_too(ground, base, mode):
    assert ask(ground, SET_MODE, base, 0, 0)[-1] == ACCEPTED
    assert ground.flown_mode == mode


def test_home_stays_where_it_is_when_it_may_not_be_moved(ground):
    ground.sim.set_parameter(0, "COM_HOME_EN", 0)
    assert ask(ground, SET_HOME, 1) == [DENIED]
    ground.sim.set_parameter(0, "COM_HOME_EN", 1)
    assert ask(ground, SET_HOME, 0.7) == [ACCEPTED]
    assert ask(ground, SET_HOME, 0, 0, 0, NAN, NAN, 8.5, 490.0) == [DENIED]


def test_a_home_that_was_given_stays_when_the_vehicle_arms_and_takes_off(ground):
    there = ground.item(16, 40.0)
    given = (there["x"] / 1e7, there["y"] / 1e7)
    assert ask(ground, SET_HOME, 0, 0, 0, NAN, *given, amsl(ground, 0.0)) == [ACCEPTED]
    ground.fly_to(4.0)
    home = ground.sim.autopilots[0].home
    assert (home.lat_deg, home.lon_deg) == pytest.approx(given, abs=5e-6), "as a float carries it"
    assert ask(ground, SET_HOME, 1) == [ACCEPTED], "a command moves it"
    assert home.lat_deg != pytest.approx(given[0], abs=1e-4)


def test_without_leave_home_does_not_move_by_itself(ground):
    home = ground.sim.autopilots[0].home
    before = home.set_at_us
    ground.sim.set_parameter(0, "COM_HOME_EN", 0)
    ground.fly_to(4.0)
    assert home.set_at_us == before


@pytest.mark.parametrize(
    ("output", "answers"),
    [(1, [ACCEPTED]), (12, [ACCEPTED]), (13, []), (33, [ACCEPTED]), (41, []), (1101, [ACCEPTED])],
)
def test_an_actuator_test_of_an_unknown_output_is_not_answered(ground, output, answers):
    assert ask(ground, ACTUATOR_TEST, 0.0, 1.0, 0, 0, output) == answers


def test_actuator_tests_can_be_forbidden(ground):
    ground.sim.set_parameter(0, "COM_MOT_TEST_EN", 0)
    assert ask(ground, ACTUATOR_TEST, 0.0, 1.0, 0, 0, 1) == [DENIED]


def test_there_is_no_high_latency_link_to_control(ground):
    asked_s = ground.now_s
    assert ask(ground, HIGH_LATENCY, 1) == [FAILED]
    assert "commander_ctrl_high_latency_failed" in ground.events(asked_s)


def test_an_orbit_without_a_position_is_refused(air):
    air.sim.simulation.set_gps_enabled(0, False)
    air.run(9.0)
    asked_s = air.now_s
    assert ask(air, ORBIT, 10, 2, 0, NAN, NAN, NAN, NAN) == [TEMPORARILY_REJECTED]
    assert "Orbit refused" in air.texts(asked_s)


@pytest.mark.story
def test_a_take_off_below_the_vehicle_stays_on_the_ground_and_is_disarmed(ground: PlanStation) -> None:
    """As it goes to who gives a height above ground where one above the sea is asked for."""
    ground.command(400, 1)
    ground.run(0.1)
    ground.command(22, -1, 0, 0, NAN, NAN, NAN, 7.0)
    ground.run(8.0)
    assert ground.acks(22) == [0]
    assert "Already higher than takeoff altitude\t" in ground.texts()
    assert ground.flown_mode == TAKEOFF
    assert ground.height_m < 0.2
    ground.run(3.5)
    assert not ground.armed
    assert ground.texts()[-1].startswith("Disarmed by auto preflight disarming")


@pytest.mark.story
def test_a_take_off_climbs_as_far_as_was_asked_also_less_than_its_default(ground: PlanStation) -> None:
    ground.command(400, 1)
    ground.run(0.1)
    ground.command(22, -1, 0, 0, NAN, NAN, NAN, ground.sim.autopilots[0].home.alt_amsl_m + 1.2)
    ground.run(12.0)
    assert ground.flown_mode == HOLD
    assert ground.height_m == pytest.approx(1.2, abs=0.3)


def test_return_directly_after_hold_is_flown_and_each_is_acknowledged_twice(air: PlanStation) -> None:
    asked_s = air.now_s
    air.command(SET_MODE, 1, 4, 3)
    air.command(SET_MODE, 1, 4, 5)
    air.run(1.5)
    assert air.flown_mode == RTL
    assert air.acks(SET_MODE, asked_s) == [ACCEPTED] * 4
