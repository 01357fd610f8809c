"""The geofence and the types of return, by MAVLink messages and on simulated time."""

import math

import pytest

from tests.unit.vehicle_sim.plan_station import MISSION_MODE, TERMINATION_MODE, PlanStation
from tests.unit.vehicle_sim.prepared_stations import station_in_hover
from tests.unit.vehicle_sim.sim_station import HOLD_MODE, LAND_MODE, NAN, OFFBOARD_MODE, RTL_MODE
from vehicle_sim.autopilot.geofence import Breach, Cylinder, Zone, breaches, inside
from vehicle_sim.px4_version import V1_16, V1_17, Px4Version

pytestmark = pytest.mark.flight

SET_MODE, REPOSITION, RETURN, WAYPOINT, VERTEX, RALLY_POINT = 176, 192, 20, 16, 5001, 5100
SQUARE = ((-10, -10), (-10, 10), (10, 10), (10, -10))
CYLINDER = Cylinder(0.0, 0.0, 100.0, 50.0, 30.0)
M_PER_DEG = 111_194.9


def hovering_station(height_m: float = 3.0, **parameters: float) -> PlanStation:
    return station_in_hover(PlanStation, height_m, {"COM_FAIL_ACT_T": 1.0, **parameters}, sensor_noise=False)


def send_north(station: PlanStation, speed_m_s: float = 4.0) -> None:
    """Sends a velocity setpoint to the north."""
    station.send(
        "SET_POSITION_TARGET_LOCAL_NED", target_system=1, target_component=1, coordinate_frame=1,
        type_mask=3527, vx=speed_m_s,
    )  # fmt: skip


def fly_out(station: PlanStation, speed_m_s: float = 4.0) -> None:
    """Flies to the north in Offboard until the mode changes."""

    def stream() -> None:
        send_north(station, speed_m_s)

    station.run(1.1, stream)
    station.command(SET_MODE, 1, 6)
    station.run_until(lambda: station.active_mode == OFFBOARD_MODE, 1, stream)
    station.run_until(lambda: station.active_mode != OFFBOARD_MODE, 12, stream)


def to_amsl_m(station: PlanStation, alt_home_m: float) -> float:
    """Converts an altitude above home to an altitude above mean sea level."""
    return station.sim.autopilots[0].home.alt_amsl_m + alt_home_m


def test_positions_inside_and_outside_of_zones_and_the_cylinder_are_distinguished() -> None:
    square = ((0.0, 0.0), (0.0, 1e-3), (1e-3, 1e-3), (1e-3, 0.0))
    exclusion = Zone(False, ((5e-4, 5e-4),), 20.0)
    fence = (Zone(True, square), exclusion)
    assert inside(fence, 1e-4, 1e-4)
    assert not inside(fence, 5e-4, 5e-4), "in the exclusion zone"
    assert not inside(fence, 2e-3, 5e-4), "beside the square"
    assert inside((exclusion,), 2e-3, 5e-4), "outside the only exclusion zone"
    assert inside((*fence, Zone(True, ((2e-3, 0.0),), 30.0)), 2e-3, 0.0), "inside one of several inclusions"
    assert breaches((), CYLINDER, 0.0, 49 / M_PER_DEG, 129.0) == frozenset()
    assert breaches((), CYLINDER, 0.0, 51 / M_PER_DEG, 131.0) == {Breach.DISTANCE, Breach.ALTITUDE}


@pytest.mark.story
def test_a_vehicle_outside_the_fence_holds_and_then_returns() -> None:
    station = hovering_station(GF_ACTION=3, RTL_RETURN_ALT=5.0, RTL_DESCEND_ALT=4.0)
    assert (
        station.upload([station.item(VERTEX, *corner, parameters=(4, 0, 0, 0)) for corner in SQUARE], kind=1)
        == 0
    )
    station.send(
        "COMMAND_INT", target_system=1, target_component=1, command=REPOSITION, frame=0, param1=-1, param2=1,
        param4=NAN, x=station.item(WAYPOINT, 30)["x"], y=station.item(WAYPOINT, 30)["y"],
        z=to_amsl_m(station, 3.0),
    )  # fmt: skip
    station.run(0.1)
    assert (station.acks(REPOSITION), station.status_texts()[-1]) == ([0], "Reposition is outside geofence\t")
    fly_out_s = station.now_s
    fly_out(station)
    assert station.active_mode == HOLD_MODE
    assert station.position_ne_m[0] == pytest.approx(10, abs=1.5)
    assert station.status_texts(fly_out_s) == [
        "Geofence violation: approaching or outside geofence",
        "Failsafe activated: entering Hold for 1 seconds\t",
    ]
    assert "commander_failsafe_enter_generic_hold" in station.events(fly_out_s)
    station.run_until(lambda: station.active_mode == RTL_MODE, 1.5)
    station.run_until(lambda: not station.armed, 40)
    assert math.hypot(*station.position_ne_m) < 1.5
    station.run(1.1)
    assert station.mode == OFFBOARD_MODE, "not the requested mode after the failsafe"


def test_a_hold_at_the_fence_flies_back_to_where_the_breach_was_detected() -> None:
    # v1.17.0 at 3.8 m/s: detected within 0.8 m of the fence, stopped 3.2 m further and flew back.
    station = hovering_station(GF_ACTION=2, GF_MAX_HOR_DIST=12.0, COM_FAIL_ACT_T=0.0)
    fly_out(station)
    assert station.active_mode == HOLD_MODE
    north_m: list[float] = []

    def stream_and_record() -> None:
        send_north(station)  # a lost stream would be another failsafe
        north_m.append(float(station.sim.simulation.truth.position_ned_m[0, 0]))

    station.run(8.0, stream_and_record)
    assert max(north_m) > 14.0
    assert 11.9 < north_m[-1] < 13.2


@pytest.mark.parametrize(("action", "mode"), [(2, HOLD_MODE), (5, LAND_MODE), (4, TERMINATION_MODE)])
def test_the_altitude_limit_triggers_its_action(action: int, mode: int) -> None:
    station = hovering_station(2.5, GF_ACTION=action, COM_FAIL_ACT_T=0.0)
    station.run(1)
    station.sim.autopilots[0].view.parameters.set("GF_MAX_VER_DIST", 1.5)
    station.run(0.5)
    assert station.active_mode == mode
    assert any("maximum altitude" in text for text in station.status_texts())


def test_a_fence_that_only_warns_does_not_act_and_an_operator_can_take_over() -> None:
    station = hovering_station(2.5, GF_ACTION=1, GF_MAX_VER_DIST=1.5)
    station.run(1)
    assert station.active_mode == HOLD_MODE
    assert "commander_failsafe_enter_generic_warn" in station.events()
    station.sim.autopilots[0].view.parameters.set("GF_ACTION", 5)
    station.run(1.6)
    assert station.active_mode == LAND_MODE
    station.command(SET_MODE, 1, 4, 3)
    station.run(0.5)
    assert station.active_mode == HOLD_MODE, "the failsafe took over again"


@pytest.mark.parametrize(("px4", "reached", "mode"), [(V1_17, [0, 1], HOLD_MODE), (V1_16, [0], MISSION_MODE)])
def test_a_return_item_of_v1_17_finishes_the_mission_before_the_return_begins(
    px4: Px4Version, reached: list[int], mode: int
) -> None:
    # v1.17.0: the return was reached, "Mission finished, loitering", then the return; in Hold when disarmed.
    station = station_in_hover(PlanStation, 3.0, {"RTL_RETURN_ALT": 3.0}, sensor_noise=False, px4=px4)
    assert station.upload([station.item(WAYPOINT, 3, 0, 3.0), station.command_item(RETURN)]) == 0
    station.run(1.0)
    station.start_mission()
    station.run_until(lambda: station.active_mode == RTL_MODE, 15)
    station.run(1.2)
    assert station.reached_items() == reached
    finished = px4 is V1_17
    assert ("mission_finished_loiter" in station.events()) is finished
    if finished:
        assert station.received("MISSION_CURRENT")[-1].mission_state == 5
    station.run_until(lambda: not station.armed, 40)
    station.run(1.1)
    assert station.mode == mode


def test_a_return_beside_a_rally_point_above_the_vehicle_climbs_to_it() -> None:
    # v1.17.0, 9 m below and 3.4 m beside a rally point: "4 m above destination".
    station = hovering_station()
    assert station.upload([station.item(RALLY_POINT, 11, 0, 9, frame=3)], kind=2) == 0
    station.send(
        "COMMAND_INT", target_system=1, target_component=1, command=REPOSITION, frame=0, param1=-1, param2=1,
        param4=NAN, x=station.item(WAYPOINT, 10)["x"], y=station.item(WAYPOINT, 10)["y"],
        z=to_amsl_m(station, 3.0),
    )  # fmt: skip
    station.run(7)
    station.command(RETURN)
    station.run(0.1)
    distance_m = math.hypot(*(a - b for a, b in zip((11.0, 0.0), station.position_ne_m, strict=True)))
    assert distance_m < 2.0
    announced = next(text for text in reversed(station.status_texts()) if "start return" in text)
    assert f"({math.ceil(2.0 * distance_m)} m above destination)" in announced
    station.run_until(lambda: station.sim.simulation.truth.position_ned_m[0, 2] < -9.5, 8)


@pytest.mark.story
def test_the_vehicle_returns_to_the_nearest_rally_point() -> None:
    station = hovering_station(RTL_RETURN_ALT=4.0, RTL_DESCEND_ALT=3.0)
    assert (
        station.upload(
            [station.item(RALLY_POINT, 14, 0, 0, frame=3), station.item(RALLY_POINT, 0, 40, 0, frame=3)],
            kind=2,
        )
        == 0
    )
    station.send(
        "COMMAND_INT", target_system=1, target_component=1, command=REPOSITION, frame=0, param1=-1, param2=1,
        param4=NAN, x=station.item(WAYPOINT, 10)["x"], y=station.item(WAYPOINT, 10)["y"],
        z=to_amsl_m(station, 3.0),
    )  # fmt: skip
    station.run(6)
    station.command(RETURN)
    station.run_until(lambda: not station.armed, 40)
    assert station.position_ne_m == pytest.approx((14, 0), abs=1.5)


def test_rally_points_in_an_unsupported_frame_are_reported() -> None:
    station = PlanStation(sensor_noise=False)
    station.wait_until_ready_to_arm()
    station.upload([station.item(RALLY_POINT, 10, 0, 10, frame=6)], kind=2)
    station.run(1.0)
    assert station.status_texts()[-1] == "RTL: unsupported MAV_FRAME\t"


@pytest.mark.story
def test_a_return_may_end_in_flight_and_may_follow_the_mission_back() -> None:
    station = hovering_station(RTL_TYPE=2, RTL_LAND_DELAY=-1.0, RTL_DESCEND_ALT=2.5)
    station.upload(
        [
            station.item(22, alt_home_m=3),
            station.item(WAYPOINT, 8, 0, 3),
            station.item(WAYPOINT, 8, 8, 3),
            station.item(17, 12, 8, 3),
        ]
    )
    station.start_mission()
    station.run_until(lambda: station.mission.current == 3, 25)
    station.run(1.5)
    station.command(RETURN)
    track: list[tuple[float, float]] = []
    station.run_until(
        lambda: "RTL: completed, loitering\t" in station.status_texts(),
        40,
        lambda: track.append(station.position_ne_m),
    )
    assert min(math.dist(position, (8, 0)) for position in track) < 2.5, (
        "not over the waypoint of the outward flight"
    )
    station.run(2)
    assert (station.active_mode, station.armed) == (RTL_MODE, True)
    assert math.hypot(*station.position_ne_m) < 2.5


@pytest.mark.story
def test_a_return_without_a_delay_lands_directly_and_reports_each_target() -> None:
    station = hovering_station(12.0, RTL_RETURN_ALT=20.0)
    home = station.sim.autopilots[0].home
    item = station.item(REPOSITION, 30.0, 0.0)
    station.command(REPOSITION, -1, 1, 0, math.nan, item["x"] / 1e7, item["y"] / 1e7, home.alt_amsl_m + 12)
    station.run(15.0)
    return_s = station.now_s
    station.command(RETURN)
    station.run_until(lambda: station.height_m < 5.0 and station.now_s > return_s + 10.0, 60)
    target_alts_m: list[float] = []
    for message in station.received("POSITION_TARGET_GLOBAL_INT", since_s=return_s + 1.0):
        alt_m = round(message.alt - home.alt_amsl_m, 1)
        if not target_alts_m or target_alts_m[-1] != alt_m:
            target_alts_m.append(alt_m)
    assert target_alts_m == [20.0, 0.0], "as recorded: without a delay RTL_DESCEND_ALT is not used"
    assert "commander_arming_check_summary" not in station.events(return_s), (
        "no report for a mode that cannot arm"
    )


@pytest.mark.story
def test_a_landing_reports_a_target_below_the_vehicle() -> None:
    station = hovering_station(6.0)
    item = station.item(REPOSITION, 10.0, 5.0)
    alt_amsl_m = station.sim.autopilots[0].home.alt_amsl_m + 6
    station.command(REPOSITION, -1, 1, 0, NAN, item["x"] / 1e7, item["y"] / 1e7, alt_amsl_m)
    station.run(10.0)
    station.command(SET_MODE, 1, 4, 6)
    station.run(2.0)
    target = station.newest_messages["POSITION_TARGET_GLOBAL_INT"]
    assert target.alt == 0.0, "as recorded"
    assert target.lat_int == pytest.approx(item["x"], abs=100)  # about a metre
    assert target.lon_int == pytest.approx(item["y"], abs=150)
