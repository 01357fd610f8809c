"""Estimates of time, length and energy, compared with numbers calculated by hand."""

from __future__ import annotations

import math

import pytest

from missions.camera_items import PhotoStart, TriggerDistance
from missions.estimates import estimate, land_time_s, travel_time_s
from missions.items import ChangeSpeed, Delay, Jump, Land, ReturnHome, Takeoff, Waypoint
from missions.plan import Plan
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
CLIMB_S = 20.0 / 1.5


def a_plan(*items: object) -> Plan:
    return Plan(planned_home=HOME, items=items)  # type: ignore[arg-type]


def test_a_straight_flight_takes_the_time_of_its_trapezoidal_profile() -> None:
    result = estimate(a_plan(TAKEOFF, waypoint_at(100)), VEHICLE)
    assert result.length_m == pytest.approx(120.0)
    assert result.time_s == pytest.approx(CLIMB_S + 100.0 / 5.0 + 5.0 / 3.0)
    assert result.climb_m == pytest.approx(20.0)
    assert (result.energy_wh, result.endless, result.known_altitudes) == (None, False, True)


def test_a_short_leg_is_flown_without_reaching_the_cruise_speed() -> None:
    assert travel_time_s(3.0, 5.0, 3.0) == pytest.approx(2.0)
    assert travel_time_s(0.0, 5.0, 3.0) == 0.0


def test_a_steep_leg_takes_the_time_of_its_climb() -> None:
    result = estimate(a_plan(TAKEOFF, waypoint_at(1, alt_m=80.0)), VEHICLE)
    assert result.time_s == pytest.approx(CLIMB_S + 60.0 / 3.0)


def test_the_estimate_includes_waits_speed_changes_and_jumps() -> None:
    without_waits_s = estimate(a_plan(TAKEOFF, waypoint_at(100)), VEHICLE).time_s
    with_waits_s = estimate(a_plan(TAKEOFF, Delay(delay_s=7.0), waypoint_at(100, hold_s=3.0)), VEHICLE).time_s
    assert with_waits_s == pytest.approx(without_waits_s + 10.0)
    with_speed_change_s = estimate(
        a_plan(TAKEOFF, ChangeSpeed(speed_m_s=10.0), waypoint_at(100)), VEHICLE
    ).time_s
    assert with_speed_change_s == pytest.approx(CLIMB_S + 100.0 / 10.0 + 10.0 / 3.0)
    with_jump = estimate(
        a_plan(TAKEOFF, waypoint_at(100), waypoint_at(200), Jump(target_index=1, repeat=2)), VEHICLE
    )
    assert with_jump.length_m == pytest.approx(20.0 + 100.0 + 5 * 100.0)  # climb, approach, 5 legs


def test_the_estimate_includes_the_descents_of_a_landing_and_a_return() -> None:
    with_landing = estimate(a_plan(TAKEOFF, Land(lat_deg=0.0, lon_deg=8.0, altitude=alt(0.0))), VEHICLE)
    assert with_landing.time_s == pytest.approx(CLIMB_S + land_time_s(20.0, VEHICLE))
    assert land_time_s(20.0, VEHICLE) == pytest.approx(15.0 / 1.5 + 5.0 / 0.7)
    with_return = estimate(a_plan(TAKEOFF, waypoint_at(100), ReturnHome()), VEHICLE)
    assert with_return.length_m == pytest.approx(
        20.0 + 100.0 + 10.0 + 100.0 + 30.0
    )  # out at 20 m, back at 30 m
    assert with_return.climb_m == pytest.approx(30.0)


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
