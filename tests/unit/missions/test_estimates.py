"""Estimates of time, length and energy, compared with flights of a real PX4 and by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from missions.camera_items import PhotoStart, TriggerDistance
from missions.estimates import estimate, step_estimates
from missions.flight_times import (
    LegTimer,
    change_altitude_time_s,
    corner_speed_m_s,
    land_time_s,
    return_height_m,
    takeoff_time_s,
)
from missions.items import ChangeSpeed, Delay, Jump, Land, ReturnHome, Takeoff, Waypoint
from missions.plan import Plan
from missions.route import route_of
from missions.values import Altitude, HomePosition
from missions.vehicle import PARAMETERS, PowerModel, VehicleModel, hover_power_w

HOME = HomePosition(lat_deg=0.0, lon_deg=8.0, alt_amsl_m=100.0)
DEG_PER_M = 1.0 / (math.radians(1.0) * 6_371_000.0)
VEHICLE = VehicleModel()


def alt(value_m: float) -> Altitude:
    return Altitude(value_m=value_m, reference="home")


def waypoint_at(north_m: float, alt_m: float = 20.0, hold_s: float = 0.0) -> Waypoint:
    return Waypoint(lat_deg=north_m * DEG_PER_M, lon_deg=8.0, altitude=alt(alt_m), hold_s=hold_s)


TAKEOFF = Takeoff(lat_deg=0.0, lon_deg=8.0, altitude=alt(20.0))
CLIMB_S = takeoff_time_s(20.0, VEHICLE)


def a_plan(*items: object) -> Plan:
    return Plan(planned_home=HOME, items=items)  # type: ignore[arg-type]


def test_a_straight_flight_is_slower_than_its_length_by_the_set_speed() -> None:
    result = estimate(a_plan(TAKEOFF, waypoint_at(100)), VEHICLE)
    assert result.length_m == pytest.approx(120.0)
    assert CLIMB_S + 100.0 / 5.0 + 1.0 < result.time_s < CLIMB_S + 100.0 / 5.0 + 8.0
    assert result.climb_m == pytest.approx(20.0)
    assert (result.energy_wh, result.endless, result.known_altitudes) == (None, False, True)


def test_a_steep_leg_takes_the_time_of_its_climb() -> None:
    result = estimate(a_plan(TAKEOFF, waypoint_at(1, alt_m=80.0)), VEHICLE)
    assert result.time_s == pytest.approx(CLIMB_S + change_altitude_time_s(60.0, VEHICLE))
    assert change_altitude_time_s(60.0, VEHICLE) == pytest.approx(60.0 / 3.0, abs=4.0)


def test_the_estimate_includes_waits_speed_changes_and_jumps() -> None:
    without_waits_s = estimate(a_plan(TAKEOFF, waypoint_at(100)), VEHICLE).time_s
    with_waits_s = estimate(a_plan(TAKEOFF, Delay(delay_s=7.0), waypoint_at(100, hold_s=3.0)), VEHICLE).time_s
    assert with_waits_s == pytest.approx(without_waits_s + 10.0)
    faster_s = estimate(a_plan(TAKEOFF, ChangeSpeed(speed_m_s=10.0), waypoint_at(100)), VEHICLE).time_s
    assert CLIMB_S + 100.0 / 10.0 + 1.0 < faster_s < without_waits_s - 3.0
    with_jump = estimate(
        a_plan(TAKEOFF, waypoint_at(100), waypoint_at(200), Jump(target_index=1, repeat=2)), VEHICLE
    )
    assert with_jump.length_m == pytest.approx(20.0 + 100.0 + 5 * 100.0)  # climb, approach, 5 legs


def test_the_estimate_includes_the_descents_of_a_landing_and_a_return() -> None:
    with_landing = estimate(a_plan(TAKEOFF, Land(lat_deg=0.0, lon_deg=8.0, altitude=alt(0.0))), VEHICLE)
    assert with_landing.time_s == pytest.approx(CLIMB_S + land_time_s(20.0, VEHICLE))
    with_return = estimate(a_plan(TAKEOFF, waypoint_at(100), ReturnHome()), VEHICLE)
    assert with_return.length_m == pytest.approx(
        20.0 + 100.0 + 10.0 + 100.0 + 30.0
    )  # out at 20 m, back at 30 m
    assert with_return.climb_m == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("hold_s", "next_alt_m"), [(0.0, 20.0), (2.0, 20.0), (0.0, 25.0)], ids=["passed", "hold", "climb"]
)
def test_the_vehicle_stops_at_a_waypoint_with_a_hold_or_before_a_climb(hold_s, next_alt_m) -> None:
    passed_s = estimate(a_plan(TAKEOFF, waypoint_at(200)), VEHICLE).time_s
    plan = a_plan(TAKEOFF, waypoint_at(100, hold_s=hold_s), waypoint_at(200, next_alt_m))
    extra_s = estimate(plan, VEHICLE).time_s - passed_s - hold_s
    is_passed = hold_s == 0.0 and next_alt_m == 20.0
    assert extra_s == pytest.approx(0.0, abs=0.6) if is_passed else 2.0 < extra_s < 8.0


def test_a_leg_after_a_sharp_turn_takes_longer_than_after_a_gentle_one() -> None:
    def second_leg_s(turn_deg: float) -> float:
        timer = LegTimer(VEHICLE)
        turn_rad = math.radians(turn_deg)
        timer.fly(60.0, 0.0, 5.0, turn_rad)
        return timer.fly(60.0, turn_rad, 5.0, None)

    times_s = [second_leg_s(turn_deg) for turn_deg in (0.0, 20.0, 60.0, 90.0, 120.0, 180.0)]
    assert times_s == sorted(times_s)
    assert corner_speed_m_s(0.0, 5.0, VEHICLE) == 5.0
    assert corner_speed_m_s(math.radians(90.0), 5.0, VEHICLE) == pytest.approx(math.sqrt(0.5 * 3.0 * 2.0))
    assert corner_speed_m_s(math.pi, 5.0, VEHICLE) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("height_m", "distance_m", "return_m"),
    [(15.0, 60.0, 30.0), (40.0, 60.0, 40.0), (10.0, 0.7, 10.0), (5.0, 8.0, 8.0), (1.0, 3.0, 4.0)],
)
def test_near_home_the_vehicle_returns_within_a_cone(height_m, distance_m, return_m) -> None:
    assert return_height_m(height_m, distance_m, VEHICLE) == pytest.approx(return_m)
    without_cone = replace(VEHICLE, return_cone_deg=0.0)
    assert return_height_m(height_m, distance_m, without_cone) == max(height_m, 30.0)


# --- flights of a real PX4 ------------------------------------------------------------------------------


def at(item_class: type, north_m: float, east_m: float, alt_m: float, **fields: float) -> object:
    return item_class(
        lat_deg=north_m * DEG_PER_M, lon_deg=8.0 + east_m * DEG_PER_M, altitude=alt(alt_m), **fields
    )


def survey() -> Plan:
    """Six lines of 50 m, 8 m apart, at 12 m with 4 m/s."""
    lines = [(at(Waypoint, 10, 8 * n, 12), at(Waypoint, 60, 8 * n, 12)) for n in range(6)]
    ends = [end for n, line in enumerate(lines) for end in (line if n % 2 == 0 else line[::-1])]
    return a_plan(at(Takeoff, 0, 0, 12), ChangeSpeed(speed_m_s=4.0), *ends)


def return_s(plan: Plan) -> float:
    """The estimate of a plan's last item: the return."""
    *_, last = step_estimates(plan, VEHICLE, route_of(plan))
    return last.time_s


SQUARE = (at(Waypoint, 40, 0, 10), at(Waypoint, 40, 40, 10), at(Waypoint, 0, 40, 10), at(Waypoint, 0, 0, 10))
WITH_HOLDS = (
    at(Takeoff, 0, 0, 10), at(Waypoint, 25, 0, 10, hold_s=5.0), at(Waypoint, 25, 25, 15),
    at(Waypoint, 0, 25, 10, hold_s=5.0), at(Land, 0, 5, 0),
)  # fmt: skip
RECORDED: dict[str, tuple[Callable[[], float], float]] = {
    "take-off to 2.5 m": (lambda: takeoff_time_s(2.5, VEHICLE), 6.71),
    "take-off to 10 m": (lambda: takeoff_time_s(10.0, VEHICLE), 12.37),
    "take-off to 30 m": (lambda: takeoff_time_s(30.0, VEHICLE), 21.88),
    "landing from 10.7 m": (lambda: land_time_s(10.7, VEHICLE), 21.52),
    "landing from 5 m": (lambda: land_time_s(5.0, VEHICLE), 13.63),
    "60 m from hover to hover": (lambda: LegTimer(VEHICLE).fly(60.0, 0.0, 5.0, None), 15.7),
    "return from 15 m, 60 m away": (
        lambda: return_s(a_plan(at(Takeoff, 0, 0, 15), at(Waypoint, 60, 0, 15), ReturnHome())), 59.6,
    ),
    "return from 10 m, 60 m away": (
        lambda: return_s(a_plan(at(Takeoff, 0, 0, 10), at(Waypoint, 61, 0, 10), ReturnHome())), 61.0,
    ),
    "square": (
        lambda: estimate(a_plan(at(Takeoff, 0, 0, 10), *SQUARE, ReturnHome()), VEHICLE).time_s, 83.6,
    ),
    "mission with holds": (lambda: estimate(a_plan(*WITH_HOLDS), VEHICLE).time_s, 78.8),
    "survey without its return": (lambda: estimate(survey(), VEHICLE).time_s, 135.0),
}  # fmt: skip
"""By flight: the estimate, and the time of a real PX4 v1.16 with default parameters [s], from arming or the
command until the item is reached or the motors stop."""


@pytest.mark.parametrize("flight", RECORDED)
def test_the_time_of_a_recorded_flight_is_estimated_within_ten_percent(flight: str) -> None:
    estimated, flown_s = RECORDED[flight]
    assert estimated() == pytest.approx(flown_s, rel=0.1)


def test_pictures_are_counted_along_the_path() -> None:
    plan = a_plan(
        TAKEOFF,
        TriggerDistance(distance_m=30.0, at_once=1.0),
        waypoint_at(100),
        TriggerDistance(distance_m=0.0),
        waypoint_at(200),
        PhotoStart(count=3.0),
    )
    assert estimate(plan, VEHICLE).photos == 1 + 3 + 3  # at once, every 30 m, PhotoStart


def test_energy_is_hover_power_plus_the_work_of_climbing() -> None:
    power = PowerModel(hover_power_w=180.0, battery_wh=50.0, mass_kg=1.5, efficiency=0.5, reserve=0.2)
    result = estimate(a_plan(TAKEOFF, waypoint_at(100)), VEHICLE, power)
    assert result.energy_wh == pytest.approx((180.0 * result.time_s + 1.5 * 9.80665 * 20.0 / 0.5) / 3600.0)
    assert power.usable_wh == pytest.approx(40.0)


def test_hover_power_follows_momentum_theory() -> None:
    assert hover_power_w(1.5, 0.2, 0.6) == pytest.approx(
        14.71**1.5 / math.sqrt(2 * 1.225 * 0.2) / 0.6, rel=1e-4
    )
    assert hover_power_w(3.0, 0.2) == pytest.approx(hover_power_w(1.5, 0.2) * 2.0**1.5)


def test_valid_parameters_of_the_vehicle_are_used_and_invalid_parameters_are_ignored() -> None:
    result = VehicleModel.from_parameters(
        {
            "MPC_XY_CRUISE": 7.0,
            "MPC_XY_VEL_MAX": math.nan,
            "MPC_ACC_HOR": 0.0,
            "MIS_TKO_LAND_REQ": 4.0,
            "X": 1.0,
        }
    )
    assert result == VehicleModel(cruise_m_s=7.0, takeoff_land_required=4)
    assert set(PARAMETERS) == set(VehicleModel.__dataclass_fields__)


def test_unknown_altitudes_are_reported() -> None:
    above_terrain = Waypoint(lat_deg=0.0, lon_deg=8.0, altitude=Altitude(value_m=20.0, reference="terrain"))
    assert not estimate(a_plan(TAKEOFF, above_terrain), VEHICLE).known_altitudes
