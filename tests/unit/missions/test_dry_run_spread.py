"""Each spread of a Monte Carlo run changes the flights; without a spread all flights are equal."""

from __future__ import annotations

import functools
from dataclasses import asdict, fields, replace

import pytest

from missions.dry_run.document import FlightSummary
from missions.dry_run.monte_carlo import monte_carlo
from missions.dry_run.setup import Conditions
from missions.dry_run.spread import Spread
from tests.support.dry_runs import AIRCRAFT, flyable_plan, short_plan

pytestmark = pytest.mark.flight

STEADY_CONDITIONS = Conditions(wind_ned_m_s=(0.0, 2.0, 0.0), gusts_m_s=0.0, sensor_noise=0.0)
NOISY_CONDITIONS = replace(STEADY_CONDITIONS, sensor_noise=1.0)
NO_SPREAD = Spread(wind_m_s=0.0, gusts=0.0, mass=0.0, battery=0.0, sensor_noise=0.0)
SPREAD_OF = {"mass_scale": "mass", "battery_scale": "battery", "sensor_noise": "sensor_noise"}
"""The field of `Spread` that varies each field of `Conditions`."""


@functools.cache
def flights(spread: Spread, conditions: Conditions) -> tuple[FlightSummary, ...]:
    return monte_carlo(
        flyable_plan(short_plan(8.0, fence_radius_m=30.0)), AIRCRAFT, conditions, spread, flights=2, seed=4
    ).flights


def test_without_spread_noise_and_gusts_all_flights_are_equal():
    first, second = flights(NO_SPREAD, STEADY_CONDITIONS)
    assert first == second
    assert asdict(first).items() >= asdict(STEADY_CONDITIONS).items()


@pytest.mark.parametrize("condition", SPREAD_OF)
def test_a_spread_varies_only_its_own_condition_and_changes_each_flight(condition):
    nominal = NOISY_CONDITIONS if condition == "sensor_noise" else STEADY_CONDITIONS
    varied_flights, unvaried_flights = (
        flights(replace(NO_SPREAD, **{SPREAD_OF[condition]: 0.3}), nominal),
        flights(NO_SPREAD, nominal),
    )
    values = [getattr(each, condition) for each in varied_flights]
    assert values[0] != values[1]
    assert getattr(nominal, condition) not in values
    other_conditions = {each.name for each in fields(Conditions)} - {condition}
    for with_spread, without_spread in zip(varied_flights, unvaried_flights, strict=True):
        assert with_spread.finished
        assert all(getattr(with_spread, name) == getattr(nominal, name) for name in other_conditions)
        if condition != "sensor_noise":
            assert with_spread.battery_end_share != without_spread.battery_end_share
        path_changed = with_spread.fence_distance_m != without_spread.fence_distance_m
        assert path_changed == (condition != "battery_scale"), "only the battery leaves the path unchanged"


@pytest.mark.parametrize("condition", ["mass_scale", "battery_scale"])
def test_a_heavier_vehicle_and_a_smaller_battery_leave_less_charge(condition):
    spread = replace(NO_SPREAD, **{SPREAD_OF[condition]: 0.3})
    flight_with_lower_value, flight_with_higher_value = sorted(
        flights(spread, STEADY_CONDITIONS), key=lambda each: getattr(each, condition)
    )
    assert flight_with_lower_value.battery_end_share is not None
    assert flight_with_higher_value.battery_end_share is not None
    difference = flight_with_lower_value.battery_end_share - flight_with_higher_value.battery_end_share
    assert (difference > 0.0) == (condition == "mass_scale")
    assert abs(difference) > 1e-3
