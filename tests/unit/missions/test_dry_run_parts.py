"""Pure functions of a dry run: the vehicle's data, random conditions, distances."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from missions import vehicle
from missions.dry_run.clearance import FenceDistance, obstacle_distance_m
from missions.dry_run.fleet import Fleet
from missions.dry_run.setup import (
    SIMULATED_PX4,
    Aircraft,
    Conditions,
    Obstacle,
    release_name,
    simulated_release,
)
from missions.dry_run.spread import Chance, Spread
from missions.errors import PlanError
from missions.trajectory import limits
from missions.trajectory.limits import MotionLimits
from missions.values import FenceCircle, Point
from missions.vehicle import VehicleModel
from tests.support.dry_runs import AIRCRAFT, HOME, ORIGIN
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import DEFAULT, VERSIONS

WALL = Obstacle("wall", 10.0, 0.0, 2.0, 6.0, 5.0)


def test_airframe_parameters_of_a_real_vehicle_are_not_used_and_those_of_a_simulator_are():
    parameters = {
        "MPC_XY_CRUISE": 7.0,
        "MC_ROLLRATE_P": 0.3,
        "MPC_THR_HOVER": 0.3,
        "CAL_ACC0_ID": 0.0,
        "RTL_TYPE": math.nan,
    }
    assert Aircraft(HOME, parameters=parameters).simulated_parameters() == {"MPC_XY_CRUISE": 7.0}
    identified = Aircraft(HOME, parameters=parameters, body={"SIH_MASS": 2.0}).simulated_parameters()
    assert identified == {"MPC_XY_CRUISE": 7.0, "SIH_MASS": 2.0}
    of_simulator = Aircraft(HOME, parameters={**parameters, "SIH_MASS": 1.4}).simulated_parameters()
    assert set(of_simulator) == {"MPC_XY_CRUISE", "MC_ROLLRATE_P", "MPC_THR_HOVER", "SIH_MASS"}


def test_each_vehicle_has_the_defaults_of_its_own_release_of_px4():
    assert [release_name(each) for each in SIMULATED_PX4] == list(VERSIONS)
    assert Aircraft(HOME).px4 == DEFAULT.name, "without a vehicle"
    aircraft = [replace(AIRCRAFT, px4=release_name(each)) for each in SIMULATED_PX4]
    stores = Fleet(aircraft, [Conditions()] * 2).sim.simulation.parameters
    assert [(store.get("MC_ROLL_P"), store.get("COM_FLTT_LOW_ACT")) for store in stores] == [
        (6.5, 3),
        (4.0, 0),
    ]
    assert [store.px4.corrects_home for store in stores] == [False, True]
    assert [store.get("MPC_XY_CRUISE") for store in stores] == [8.0, 8.0]


@pytest.mark.parametrize(
    ("model", "parameters"),
    [(VehicleModel(), vehicle.PARAMETERS), (MotionLimits(), limits.PARAMETERS)],
    ids=["estimates", "trajectories"],
)
def test_plans_without_a_vehicle_are_computed_with_the_defaults_that_are_simulated(model, parameters):
    store = Parameters(px4=VERSIONS[Aircraft(HOME).px4])
    simulated = {name: float(store.get(name)) for name in parameters.values() if name in store}
    assert len(simulated) >= len(parameters) - 1, "MIS_DIST_1WP is not listed by PX4"
    assert asdict(type(model).from_parameters(simulated)) == pytest.approx(asdict(model), rel=1e-6)


@pytest.mark.parametrize(
    ("release", "simulated"),
    [(None, (1, 17)), ((1, 14), (1, 16)), ((1, 16), (1, 16)), ((1, 17), (1, 17)), ((2, 0), (1, 17))],
)
def test_the_nearest_release_is_simulated(release, simulated):
    assert simulated_release(release) == simulated


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"wind_ned_m_s": (math.nan, 0.0, 0.0)}, "wind_ned_m_s"),
        ({"wind_ned_m_s": (30.0, 30.0, 0.0)}, "between 0 and 40"),
        ({"mass_scale": 0.0}, "mass_scale"),
        ({"gusts_m_s": -1.0}, "gusts_m_s"),
    ],
)
def test_the_refusal_of_impossible_conditions_names_the_field_or_range(fields, expected):
    with pytest.raises(PlanError, match=expected):
        Conditions(**fields)


def test_random_conditions_depend_on_seed_and_number_and_have_the_given_spread():
    nominal, spread = Conditions(wind_ned_m_s=(3.0, 0.0, 0.0), gusts_m_s=1.0), Spread(wind_m_s=2.0)
    drawn_conditions = [spread.draw(nominal, 5, number) for number in range(400)]
    assert drawn_conditions[17] == spread.draw(nominal, 5, 17)
    assert drawn_conditions[17] != spread.draw(nominal, 6, 17)
    north = np.array([each.wind_ned_m_s[0] for each in drawn_conditions])
    assert north.mean() == pytest.approx(3.0, abs=0.4)
    assert north.std() == pytest.approx(2.0, abs=0.3)
    assert abs(north - 3.0).max() <= 6.0
    assert Spread(0.0, 0.0, 0.0, 0.0, 0.0).draw(nominal, 5, 1) == nominal


def test_a_probability_has_an_interval_that_depends_on_the_number_of_flights():
    assert Chance.from_counts(0, 100).upper == pytest.approx(0.037, abs=0.001)
    assert Chance.from_counts(0, 10).upper > 0.25
    assert Chance.from_counts(50, 100).share == 0.5
    assert Chance.from_counts(10, 10).upper == pytest.approx(1.0)


def test_the_distance_to_the_fence_is_negative_outside_and_includes_the_vehicles_cylinder():
    centre = Point(lat_deg=HOME.lat_deg, lon_deg=HOME.lon_deg)
    zones = (
        FenceCircle(inclusion=True, center=centre, radius_m=50.0),
        FenceCircle(inclusion=False, center=centre, radius_m=10.0),
    )
    positions = np.array([[30.0, 0.0, -5.0], [60.0, 0.0, -5.0], [0.0, 5.0, -5.0]])
    assert FenceDistance(zones, ORIGIN, 0.0, 0.0).distance_m(positions) == pytest.approx(
        [20.0, -10.0, -5.0], abs=0.1
    )
    cylinder = FenceDistance((), ORIGIN, 40.0, 8.0)
    assert cylinder.distance_m(positions) == pytest.approx([3.0, -20.0, 3.0], abs=0.01)
    assert FenceDistance((), ORIGIN, 0.0, 0.0).distance_m(positions).tolist() == [math.inf] * 3


def test_the_distance_to_an_obstacle_is_measured_to_its_nearest_side_edge_or_roof():
    positions = np.array([[0.0, 0.0, -2.0], [10.0, 0.0, -8.0], [10.0, 0.0, -2.0], [14.0, 7.0, -5.0]])
    distances, nearest = obstacle_distance_m([Obstacle("far", 500.0, 0.0, 1.0, 1.0, 1.0), WALL], positions)
    assert distances == pytest.approx([9.0, 3.0, 0.0, 5.0])
    assert nearest.tolist() == [1, 1, 1, 1]
    turned_wall = Obstacle("wall", 10.0, 0.0, 2.0, 6.0, 5.0, yaw_ned_rad=math.pi / 2)
    assert obstacle_distance_m([turned_wall], positions)[0][0] == pytest.approx(7.0)


def test_the_autopilot_of_a_vehicle_whose_flight_has_ended_is_not_updated():
    def fail() -> None:
        raise AssertionError("the autopilot of vehicle 1 was updated")

    fleet = Fleet([AIRCRAFT, AIRCRAFT], [Conditions(), Conditions()])
    fleet.vehicles[1].autopilot.update = fail
    with pytest.raises(AssertionError):
        fleet.tick()
    fleet.retire(1)
    before_s = fleet.vehicles[0].autopilot.view.time_s
    fleet.tick()
    assert fleet.vehicles[0].autopilot.view.time_s > before_s
