"""The geofence and the types of return, by MAVLink messages and on simulated time."""

import math

import pytest

from tests.unit.vehicle_sim.plan_station import PlanStation
from tests.unit.vehicle_sim.prepared_stations import hovering
from tests.unit.vehicle_sim.sim_station import HOLD, LAND, NAN, OFFBOARD, RTL
from vehicle_sim.autopilot.geofence import Breach, Cylinder, Zone, breaches, inside

pytestmark = pytest.mark.flight

SQUARE = ((-10, -10), (-10, 10), (10, 10), (10, -10))
LIMITS = Cylinder(0.0, 0.0, 100.0, 50.0, 30.0)
DEGREE_M = 111_194.9


def flying(height_m: float = 3.0, **parameters: float) -> PlanStation:
    return hovering(PlanStation, height_m, {"COM_FAIL_ACT_T": 1.0, **parameters}, sensor_noise=False)


def fly_out(s: PlanStation, speed_m_s: float = 4.0) -> None:
    """Flies to the north in Offboard until the mode changes."""

    def stream() -> None:
        s.send(
            "SET_POSITION_TARGET_LOCAL_NED", target_system=1, target_component=1, coordinate_frame=1,
            type_mask=3527, vx=speed_m_s,
        )  # fmt: skip

    s.run(1.1, stream)
    s.command(176, 1, 6)
    s.run_until(lambda: s.active_mode == OFFBOARD, 1, stream)
    s.run_until(lambda: s.active_mode != OFFBOARD, 12, stream)


def amsl(s: PlanStation, height_m: float) -> float:
    """Converts a height above home to an altitude above mean sea level."""
    return s.sim.autopilots[0].home.alt_amsl_m + height_m


def test_inside_and_outside_of_zones_and_the_cylinder() -> None:
    square = ((0.0, 0.0), (0.0, 1e-3), (1e-3, 1e-3), (1e-3, 0.0))
    hole = Zone(False, ((5e-4, 5e-4),), 20.0)
    fence = (Zone(True, square), hole)
    assert inside(fence, 1e-4, 1e-4)
    assert not inside(fence, 5e-4, 5e-4), "in the exclusion zone"
    assert not inside(fence, 2e-3, 5e-4), "beside the square"
    assert inside((hole,), 2e-3, 5e-4), "with exclusions only, everything else is allowed"
    assert inside((*fence, Zone(True, ((2e-3, 0.0),), 30.0)), 2e-3, 0.0), "inside one of several inclusions"
    assert breaches((), LIMITS, 0.0, 49 / DEGREE_M, 129.0) == frozenset()
    assert breaches((), LIMITS, 0.0, 51 / DEGREE_M, 131.0) == {Breach.DISTANCE, Breach.ALTITUDE}


@pytest.mark.story
def test_outside_the_fence_the_vehicle_holds_and_then_returns() -> None:
    s = flying(GF_ACTION=3, RTL_RETURN_ALT=5.0, RTL_DESCEND_ALT=4.0)
    assert s.upload([s.item(5001, *corner, p=(4, 0, 0, 0)) for corner in SQUARE], kind=1) == 0
    s.send(
        "COMMAND_INT", target_system=1, target_component=1, command=192, frame=0, param1=-1, param2=1,
        param4=NAN, x=s.item(16, 30)["x"], y=s.item(16, 30)["y"], z=amsl(s, 3.0),
    )  # fmt: skip
    s.run(0.1)
    assert (s.acks(192), s.texts()[-1]) == ([0], "Reposition is outside geofence\t")
    out_s = s.now_s
    fly_out(s)
    assert s.active_mode == HOLD
    assert s.position_ne_m[0] == pytest.approx(10, abs=1.5)
    assert s.texts(out_s) == [
        "Geofence: approaching or outside geofence",
        "Failsafe activated: entering Hold for 1 seconds\t",
    ]
    assert "commander_failsafe_enter_generic_hold" in s.events(out_s)
    s.run_until(lambda: s.active_mode == RTL, 1.5)
    s.run_until(lambda: not s.armed, 40)
    assert math.hypot(*s.position_ne_m) < 1.5
    s.run(1.1)
    assert s.mode == OFFBOARD, "the requested mode, after the failsafe has ended"


@pytest.mark.parametrize(("action", "mode"), [(2, HOLD), (5, LAND), (4, 0x0A0000)])
def test_the_height_limit_triggers_its_action(action: int, mode: int) -> None:
    s = flying(2.5, GF_ACTION=action, COM_FAIL_ACT_T=0.0)
    s.run(1)
    s.sim.autopilots[0].view.parameters.set("GF_MAX_VER_DIST", 1.5)
    s.run(0.5)
    assert s.active_mode == mode
    assert any("maximum altitude" in text for text in s.texts())


def test_a_fence_that_only_warns_does_not_act_and_an_operator_can_take_over() -> None:
    s = flying(2.5, GF_ACTION=1, GF_MAX_VER_DIST=1.5)
    s.run(1)
    assert s.active_mode == HOLD
    assert "commander_failsafe_enter_generic_warn" in s.events()
    s.sim.autopilots[0].view.parameters.set("GF_ACTION", 5)
    s.run(1.6)
    assert s.active_mode == LAND
    s.command(176, 1, 4, 3)
    s.run(0.5)
    assert s.active_mode == HOLD, "the operator's mode is kept although the fence is still breached"


@pytest.mark.story
def test_the_vehicle_returns_to_the_nearest_rally_point() -> None:
    s = flying(RTL_RETURN_ALT=4.0, RTL_DESCEND_ALT=3.0)
    assert s.upload([s.item(5100, 14, 0, 0, frame=3), s.item(5100, 0, 40, 0, frame=3)], kind=2) == 0
    s.send(
        "COMMAND_INT", target_system=1, target_component=1, command=192, frame=0, param1=-1, param2=1,
        param4=NAN, x=s.item(16, 10)["x"], y=s.item(16, 10)["y"], z=amsl(s, 3.0),
    )  # fmt: skip
    s.run(6)
    s.command(20)
    s.run_until(lambda: not s.armed, 40)
    assert s.position_ne_m == pytest.approx((14, 0), abs=1.5)


def test_rally_points_in_an_unsupported_frame_are_reported() -> None:
    s = PlanStation(sensor_noise=False)
    s.ready_to_arm()
    s.upload([s.item(5100, 10, 0, 10, frame=6)], kind=2)
    s.run(1.0)
    assert s.texts()[-1] == "RTL: unsupported MAV_FRAME\t"


@pytest.mark.story
def test_a_return_may_end_in_flight_and_may_follow_the_mission_back() -> None:
    s = flying(RTL_TYPE=2, RTL_LAND_DELAY=-1.0, RTL_DESCEND_ALT=2.5)
    s.upload([s.item(22, height_m=3), s.item(16, 8, 0, 3), s.item(16, 8, 8, 3), s.item(17, 12, 8, 3)])
    s.start()
    s.run_until(lambda: s.mission.current == 3, 25)
    s.run(1.5)
    s.command(20)
    track: list[tuple[float, float]] = []
    s.run_until(lambda: "RTL: completed, loitering\t" in s.texts(), 40, lambda: track.append(s.position_ne_m))
    assert min(math.dist(place, (8, 0)) for place in track) < 2.5, (
        "back over the waypoint of the outward flight"
    )
    s.run(2)
    assert (s.active_mode, s.armed) == (RTL, True)
    assert math.hypot(*s.position_ne_m) < 2.5


@pytest.mark.story
def test_a_return_without_a_delay_lands_directly_and_reports_each_target() -> None:
    s = flying(12.0, RTL_RETURN_ALT=20.0)
    home = s.sim.autopilots[0].home
    item = s.item(192, 30.0, 0.0)
    s.command(192, -1, 1, 0, math.nan, item["x"] / 1e7, item["y"] / 1e7, home.alt_amsl_m + 12)
    s.run(15.0)
    began_s = s.now_s
    s.command(20)
    s.run_until(lambda: s.height_m < 5.0 and s.now_s > began_s + 10.0, 60)
    heights: list[float] = []
    for message in s.received("POSITION_TARGET_GLOBAL_INT", since_s=began_s + 1.0):
        height = round(message.alt - home.alt_amsl_m, 1)
        if not heights or heights[-1] != height:
            heights.append(height)
    assert heights == [20.0, 0.0], "as recorded: without a delay RTL_DESCEND_ALT is not used"
    assert "commander_arming_check_summary" not in s.events(began_s), "no report for a mode that cannot arm"


@pytest.mark.parametrize("sub_mode", [6, 9])
@pytest.mark.story
def test_each_kind_of_landing_reports_the_position_under_the_vehicle(sub_mode: int) -> None:
    s = flying(6.0)
    item = s.item(192, 10.0, 5.0)
    alt_amsl_m = s.sim.autopilots[0].home.alt_amsl_m + 6
    s.command(192, -1, 1, 0, NAN, item["x"] / 1e7, item["y"] / 1e7, alt_amsl_m)
    s.run(10.0)
    s.command(176, 1, 4, sub_mode)
    s.run(2.0)
    target = s.last["POSITION_TARGET_GLOBAL_INT"]
    assert target.alt == 0.0, "as recorded"
    assert target.lat_int == pytest.approx(item["x"], abs=100), "a metre"
    assert target.lon_int == pytest.approx(item["y"], abs=150)
