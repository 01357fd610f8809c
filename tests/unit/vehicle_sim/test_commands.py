"""Commands of a ground station: their effects and acknowledgements."""

import math

import pytest

from tests.unit.vehicle_sim.plan_station import MISSION_MODE, PlanStation
from tests.unit.vehicle_sim.prepared_stations import station_in_hover, station_on_ground
from tests.unit.vehicle_sim.sim_station import HOLD_MODE, NAN, POSITION_MODE, RTL_MODE, TAKEOFF_MODE

pytestmark = pytest.mark.flight

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, CANCELLED = 0, 1, 2, 3, 4, 6
ARM, SET_MODE, REPOSITION, CHANGE_ALTITUDE, CHANGE_SPEED = 400, 176, 192, 186, 178
TAKEOFF_COMMAND = 22
SET_HOME, ACTUATOR_TEST, LAND_START, HIGH_LATENCY, ORBIT = 179, 310, 189, 2600, 34
RETURN = 20
STABILIZED, MANUAL = 0x70000, 0x10000


@pytest.fixture
def landed_station() -> PlanStation:
    return station_on_ground(PlanStation, 3.0, sensor_noise=False)


@pytest.fixture
def hovering_station() -> PlanStation:
    return station_in_hover(PlanStation, 8.0, sensor_noise=False)


def acks_of(station: PlanStation, command: int, *parameters: float) -> list[int]:
    requested_s = station.now_s
    station.command(command, *parameters)
    station.run(0.2)
    return station.acks(command, requested_s)


def to_amsl_m(station: PlanStation, alt_home_m: float) -> float:
    return station.sim.autopilots[0].home.alt_amsl_m + alt_home_m


def position_of(station: PlanStation) -> tuple[float, float]:
    north, east, _ = station.sim.simulation.truth.position_ned_m[0]
    return float(north), float(east)


def go_north(station: PlanStation, north_m: float) -> None:
    target = station.item(16, north_m)
    assert acks_of(
        station, REPOSITION, -1, 1, 0, NAN, target["x"] / 1e7, target["y"] / 1e7, to_amsl_m(station, 8.0)
    ) == [ACCEPTED]


def command_go_to_before_lift_off(landed_station, alt_home_m):
    landed_station.command(ARM, 1)
    landed_station.run(0.1)
    landed_station.command(TAKEOFF_COMMAND, -1, 0, 0, NAN, NAN, NAN, to_amsl_m(landed_station, 10.0))
    landed_station.run(0.5)
    target = landed_station.item(16, 40.0)
    goal = (target["x"] / 1e7, target["y"] / 1e7, to_amsl_m(landed_station, alt_home_m))
    assert acks_of(landed_station, REPOSITION, -1, 1, 0, NAN, *goal) == [ACCEPTED]


def test_a_go_to_before_lift_off_is_flown(landed_station):
    command_go_to_before_lift_off(landed_station, 10.0)
    landed_station.run_until(lambda: position_of(landed_station)[0] > 39.0, 40)
    assert landed_station.height_m == pytest.approx(10.0, abs=0.6)


def test_a_go_to_before_lift_off_that_climbs_slower_than_0_3_m_s_stays_on_the_ground_as_px4_does(
    landed_station,
):
    command_go_to_before_lift_off(landed_station, 2.0)
    landed_station.run(4.0)
    assert max(map(abs, position_of(landed_station))) < 0.1


def test_a_mode_change_takes_effect_before_the_command_sent_after_it(hovering_station):
    begin_s = hovering_station.now_s
    hovering_station.command(SET_MODE, 1, 4, 3)
    hovering_station.command(RETURN)
    hovering_station.run(0.3)
    assert hovering_station.active_mode == RTL_MODE
    assert [m.command for m in hovering_station.received("COMMAND_ACK", since_s=begin_s)] == [
        SET_MODE,
        SET_MODE,
        RETURN,
    ]
    hovering_station.command(RETURN)
    hovering_station.command(SET_MODE, 1, 4, 3)
    hovering_station.run(0.3)
    assert hovering_station.active_mode == HOLD_MODE


def test_a_precision_landing_without_a_target_searches_before_it_is_reported_as_landing(hovering_station):
    begin_s = hovering_station.now_s
    hovering_station.sim.set_parameter(0, "PLD_SRCH_ALT", 7.0)
    hovering_station.command(SET_MODE, 1, 4, 9)
    hovering_station.run(11.5)
    assert {m.landed_state for m in hovering_station.received("EXTENDED_SYS_STATE", since_s=begin_s)} == {2}
    assert hovering_station.height_m == pytest.approx(7.0, abs=0.7)
    hovering_station.run(2.0)
    assert hovering_station.received("EXTENDED_SYS_STATE")[-1].landed_state == 4
    hovering_station.run(25.0)
    assert not hovering_station.sim.autopilots[0].commander.armed


def test_a_change_of_altitude_ends_a_go_to_and_is_flown_at_the_current_position(hovering_station):
    go_north(hovering_station, 60.0)
    hovering_station.run(4.0)
    north_at_command_m = position_of(hovering_station)[0]
    assert acks_of(hovering_station, CHANGE_ALTITUDE, to_amsl_m(hovering_station, 14.0)) == [ACCEPTED]
    hovering_station.run(12.0)
    assert hovering_station.height_m == pytest.approx(14.0, abs=0.5)
    assert north_at_command_m < position_of(hovering_station)[0] < north_at_command_m + 12.0, (
        "the vehicle did not stop"
    )
    assert hovering_station.active_mode == HOLD_MODE


def test_a_change_of_altitude_outside_the_fence_is_not_flown(hovering_station):
    hovering_station.sim.set_parameter(0, "GF_MAX_VER_DIST", 12.0)
    hovering_station.run(1.5)
    requested_s = hovering_station.now_s
    assert acks_of(hovering_station, CHANGE_ALTITUDE, to_amsl_m(hovering_station, 30.0)) == [ACCEPTED]
    hovering_station.run(5.0)
    assert hovering_station.height_m == pytest.approx(8.0, abs=0.5)
    assert "navigator_change_altitude_outside_geofence" in hovering_station.events(requested_s)


def test_a_go_to_without_values_stops_the_vehicle(hovering_station):
    go_north(hovering_station, 60.0)
    hovering_station.run(4.0)
    north_at_command_m = position_of(hovering_station)[0]
    assert acks_of(hovering_station, REPOSITION, -1, 1, 0, NAN, NAN, NAN, NAN) == [ACCEPTED]
    hovering_station.run(8.0)
    assert north_at_command_m < position_of(hovering_station)[0] < north_at_command_m + 12.0
    assert hovering_station.height_m == pytest.approx(8.0, abs=0.5)


@pytest.mark.story
def test_a_go_to_with_only_an_altitude_keeps_the_previous_target_position(hovering_station):
    go_north(hovering_station, 20.0)
    hovering_station.run(1.0)
    assert acks_of(
        hovering_station, REPOSITION, -1, 1, 0, NAN, NAN, NAN, to_amsl_m(hovering_station, 12.0)
    ) == [ACCEPTED]
    hovering_station.run(12.0)
    assert position_of(hovering_station)[0] == pytest.approx(20.0, abs=1.0)
    assert hovering_station.height_m == pytest.approx(12.0, abs=0.5)


def test_a_go_to_outside_the_fence_ends_the_mission_and_holds(hovering_station):
    hovering_station.upload([hovering_station.item(16, 60.0), hovering_station.item(16, 60.0, 30.0)])
    assert acks_of(hovering_station, SET_MODE, 1, 4, 4)[-1] == ACCEPTED
    hovering_station.run(3.0)
    assert hovering_station.active_mode == MISSION_MODE
    hovering_station.sim.set_parameter(0, "GF_MAX_HOR_DIST", 100.0)
    hovering_station.run(0.5)
    target, requested_s = hovering_station.item(16, 300.0), hovering_station.now_s
    assert acks_of(
        hovering_station,
        REPOSITION,
        -1,
        1,
        0,
        NAN,
        target["x"] / 1e7,
        target["y"] / 1e7,
        to_amsl_m(hovering_station, 8.0),
    ) == [ACCEPTED]
    assert "navigator_reposition_outside_geofence" in hovering_station.events(requested_s)
    assert hovering_station.active_mode == HOLD_MODE
    hovering_station.run(8.0)
    assert position_of(hovering_station)[0] < 45.0


def test_a_go_to_in_hold_keeps_a_changed_speed_and_a_go_to_from_another_mode_does_not(hovering_station):
    path = hovering_station.sim.autopilots[0].navigator.path
    acks_of(hovering_station, CHANGE_SPEED, 1, 2.0, -1)
    go_north(hovering_station, 5.0)
    assert path.cruise_m_s == 2.0
    hovering_station.send("MANUAL_CONTROL", target=1, x=0, y=0, z=500, r=0, buttons=0)
    hovering_station.run(0.2)
    assert acks_of(hovering_station, SET_MODE, 1, 3, 0)[-1] == ACCEPTED
    go_north(hovering_station, 5.0)
    assert math.isnan(path.cruise_m_s)


def test_the_landing_of_a_mission_can_be_commanded(hovering_station):
    assert acks_of(hovering_station, LAND_START) == [CANCELLED]
    hovering_station.upload(
        [
            hovering_station.item(16, 30.0),
            hovering_station.command_item(LAND_START),
            hovering_station.item(16, 5.0),
            hovering_station.item(21, 0.0, alt_home_m=0.0),
        ]
    )
    assert acks_of(hovering_station, LAND_START) == [ACCEPTED]
    hovering_station.run(1.0)
    assert hovering_station.active_mode == MISSION_MODE
    assert hovering_station.sim.autopilots[0].navigator.mission.current >= 1


@pytest.mark.parametrize(
    ("param1", "armed"), [(0.6, True), (1.4, True), (0.4, False), (-0.4, False), (NAN, False)]
)
def test_the_arming_parameter_is_rounded(landed_station, param1, armed):
    assert acks_of(landed_station, ARM, param1) == [ACCEPTED]
    assert landed_station.armed is armed


@pytest.mark.parametrize("param1", [1.5, 2.0, -0.6, math.inf, -math.inf, 3e38])
def test_an_unsupported_arming_parameter_is_reported_and_not_acknowledged(landed_station, param1):
    requested_s = landed_station.now_s
    assert acks_of(landed_station, ARM, param1) == []
    assert "commander_unsupported_arm_disarm_param" in landed_station.events(requested_s)


@pytest.mark.parametrize(
    ("base_mode", "mode"),
    [
        (4, MISSION_MODE),
        (64 | 8, POSITION_MODE),
        (64 | 16, STABILIZED),
        (64, MANUAL),
        (128 | 64, MANUAL),
        (16, HOLD_MODE),
    ],
)
def test_a_base_mode_alone_selects_a_mode(landed_station, base_mode, mode):
    assert acks_of(landed_station, SET_MODE, base_mode, 0, 0)[-1] == ACCEPTED
    assert landed_station.active_mode == mode


def test_invalid_or_disabled_changes_of_home_are_denied(landed_station):
    landed_station.sim.set_parameter(0, "COM_HOME_EN", 0)
    assert acks_of(landed_station, SET_HOME, 1) == [DENIED]
    landed_station.sim.set_parameter(0, "COM_HOME_EN", 1)
    assert acks_of(landed_station, SET_HOME, 0.7) == [ACCEPTED]
    assert acks_of(landed_station, SET_HOME, 0, 0, 0, NAN, NAN, 8.5, 490.0) == [DENIED]


def test_a_commanded_home_is_kept_when_the_vehicle_arms_and_takes_off(landed_station):
    target = landed_station.item(16, 40.0)
    target_deg = (target["x"] / 1e7, target["y"] / 1e7)
    assert acks_of(landed_station, SET_HOME, 0, 0, 0, NAN, *target_deg, to_amsl_m(landed_station, 0.0)) == [
        ACCEPTED
    ]
    landed_station.take_off_and_hover(4.0)
    home = landed_station.sim.autopilots[0].home
    assert (home.lat_deg, home.lon_deg) == pytest.approx(target_deg, abs=5e-6)  # precision of a float
    assert acks_of(landed_station, SET_HOME, 1) == [ACCEPTED], "home was not moved by a new command"
    assert home.lat_deg != pytest.approx(target_deg[0], abs=1e-4)


def test_home_is_not_set_automatically_while_com_home_en_is_off(landed_station):
    home = landed_station.sim.autopilots[0].home
    set_at_us = home.set_at_us
    landed_station.sim.set_parameter(0, "COM_HOME_EN", 0)
    landed_station.take_off_and_hover(4.0)
    assert home.set_at_us == set_at_us


@pytest.mark.parametrize(
    ("output", "acks"),
    [(1, [ACCEPTED]), (12, [ACCEPTED]), (13, []), (33, [ACCEPTED]), (41, []), (1101, [ACCEPTED])],
)
def test_an_actuator_test_of_an_unknown_output_is_not_acknowledged(landed_station, output, acks):
    assert acks_of(landed_station, ACTUATOR_TEST, 0.0, 1.0, 0, 0, output) == acks


def test_actuator_tests_can_be_disabled(landed_station):
    landed_station.sim.set_parameter(0, "COM_MOT_TEST_EN", 0)
    assert acks_of(landed_station, ACTUATOR_TEST, 0.0, 1.0, 0, 0, 1) == [DENIED]


def test_controlling_the_high_latency_link_fails(landed_station):
    requested_s = landed_station.now_s
    assert acks_of(landed_station, HIGH_LATENCY, 1) == [FAILED]
    assert "commander_ctrl_high_latency_failed" in landed_station.events(requested_s)


def test_an_orbit_without_a_position_is_refused(hovering_station):
    hovering_station.sim.simulation.set_gps_enabled(0, False)
    hovering_station.run(9.0)
    requested_s = hovering_station.now_s
    assert acks_of(hovering_station, ORBIT, 10, 2, 0, NAN, NAN, NAN, NAN) == [TEMPORARILY_REJECTED]
    assert "Orbit refused" in hovering_station.status_texts(requested_s)


@pytest.mark.story
def test_a_take_off_to_an_altitude_below_the_vehicle_stays_on_the_ground_and_is_disarmed(
    landed_station: PlanStation,
) -> None:
    """This is the effect of a height above ground that is sent as an altitude above sea level."""
    landed_station.command(ARM, 1)
    landed_station.run(0.1)
    landed_station.command(TAKEOFF_COMMAND, -1, 0, 0, NAN, NAN, NAN, 7.0)
    landed_station.run(8.0)
    assert landed_station.acks(TAKEOFF_COMMAND) == [ACCEPTED]
    assert "Already higher than takeoff altitude\t" in landed_station.status_texts()
    assert landed_station.active_mode == TAKEOFF_MODE
    assert landed_station.height_m < 0.2
    landed_station.run(3.5)
    assert not landed_station.armed
    assert landed_station.status_texts()[-1].startswith("Disarmed by auto preflight disarming")


@pytest.mark.story
def test_a_take_off_climbs_to_an_altitude_below_its_default(landed_station: PlanStation) -> None:
    landed_station.command(ARM, 1)
    landed_station.run(0.1)
    landed_station.command(
        TAKEOFF_COMMAND, -1, 0, 0, NAN, NAN, NAN, landed_station.sim.autopilots[0].home.alt_amsl_m + 1.2
    )
    landed_station.run(12.0)
    assert landed_station.active_mode == HOLD_MODE
    assert landed_station.height_m == pytest.approx(1.2, abs=0.3)


def test_return_directly_after_hold_is_flown_and_both_commands_are_acknowledged_twice(
    hovering_station: PlanStation,
) -> None:
    requested_s = hovering_station.now_s
    hovering_station.command(SET_MODE, 1, 4, 3)
    hovering_station.command(SET_MODE, 1, 4, 5)
    hovering_station.run(1.5)
    assert hovering_station.active_mode == RTL_MODE
    assert hovering_station.acks(SET_MODE, requested_s) == [ACCEPTED] * 4
