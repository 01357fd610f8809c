"""Wind, gusts, mass and sensor noise differ per vehicle, and no vehicle's flight depends on the others."""

import dataclasses

import numpy as np
import pytest

from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.parameters import Parameters
from vehicle_sim.script import script_from_fields
from vehicle_sim.simulation import ControlLevel, Simulation, row_east
from vehicle_sim.yaml_fields import parse_yaml

STEPS = 250  # 1 s


def climbing_simulation(count: int, first_vehicle: int = 0, seed: int = 3, **options) -> Simulation:
    simulation = Simulation(
        count,
        seed=seed,
        noise_numbers=range(first_vehicle, first_vehicle + count),
        start_ned_m=row_east(count, first_vehicle),
        **options,
    )
    simulation.setpoints.armed[:] = True
    simulation.setpoints.level[:] = ControlLevel.TRAJECTORY
    simulation.setpoints.position_ned_m[:] = (5.0, 3.0, -10.0)
    simulation.setpoints.yaw_ned_rad[:] = 0.3
    return simulation


def state_of(simulation: Simulation, row: int) -> dict[str, np.ndarray]:
    """The whole state of one vehicle."""
    return {
        f"{kind}.{field.name}": value[row].copy()
        for kind in ("truth", "sensors", "estimate", "target")
        for field in dataclasses.fields(getattr(simulation, kind))
        if isinstance(value := getattr(getattr(simulation, kind), field.name), np.ndarray)
    }


@pytest.mark.parametrize(("count", "first_vehicle"), [(3, 0), (40, 1), (41, 0)])
def test_a_vehicles_flight_is_bit_identical_in_a_fleet_of_any_size(count, first_vehicle):
    single, fleet = climbing_simulation(1, 2), climbing_simulation(count, first_vehicle)
    row = 2 - first_vehicle
    single.set_gusts(1.5)
    fleet.set_gusts(1.5, row)
    for step in range(STEPS):
        if step == 100:
            fleet.set_gusts(4.0)
            fleet.set_gusts(1.5, row)
        single.step()
        fleet.step()
    assert single.truth.position_ned_m[0, 2] < -0.3, "the vehicle did not take off"
    expected, actual = state_of(single, 0), state_of(fleet, row)
    differences = [
        name for name, value in expected.items() if not np.array_equal(value, actual[name], equal_nan=True)
    ]
    assert not differences
    assert not np.array_equal(fleet.truth.velocity_ned_m_s[row], fleet.truth.velocity_ned_m_s[0])


def test_wind_gusts_and_noise_are_set_per_vehicle():
    simulation = climbing_simulation(3)
    simulation.set_wind(np.array([0.0, 6.0, 0.0]), 1)
    simulation.set_gusts(2.0, 2)
    simulation.set_sensor_noise(0, 0.0)
    for _ in range(STEPS):
        simulation.step()
    wind = simulation._bodies.wind_ned_m_s
    assert wind[:2].tolist() == [[0.0, 0.0, 0.0], [0.0, 6.0, 0.0]]
    assert wind[2].all()
    sensors, truth = simulation.sensors, simulation.truth
    gyro_noise = np.abs(sensors.gyro_frd_rad_s - truth.rates_frd_rad_s).max(axis=1)
    assert gyro_noise[0] < 0.05 < gyro_noise[1:].min()


def test_a_heavier_vehicle_hovers_with_more_thrust():
    stores = [Parameters({"SIH_MASS": mass}) for mass in (1.0, 1.2)]
    starts_ned_m = np.array([[0.0, 0.0, -50.0], [0.0, 3.0, -50.0]])
    simulation = Simulation(2, parameters=stores, start_ned_m=starts_ned_m)
    simulation.setpoints.armed[:] = True
    simulation.setpoints.level[:] = ControlLevel.TRAJECTORY
    simulation.setpoints.velocity_ned_m_s[:] = 0.0
    for _ in range(4 * STEPS):
        simulation.step()
    light_thrust, heavy_thrust = simulation.truth.rotor_thrust.mean(axis=1)
    assert heavy_thrust == pytest.approx(1.2 * light_thrust, rel=0.1)


@pytest.mark.parametrize("factor", [-1.0, float("nan"), float("inf")])
def test_an_invalid_noise_factor_is_refused(factor):
    with pytest.raises(ValueError, match="give a factor of 0 or more"):
        Simulation(2).set_sensor_noise(1, factor)


def test_scripted_wind_gusts_and_noise_affect_only_the_named_vehicles():
    event = "{at_s: 0.1, vehicles: [2], wind_ned_m_s: [0, 8, 0], gusts_m_s: 2, sensor_noise: 3}"
    sim = SimulatedFleet(
        2, links=(), script=script_from_fields(parse_yaml(f"events:\n  - {event}\n", "wind.yaml"))
    )
    sim.step(0.5)
    wind = sim.simulation._bodies.wind_ned_m_s
    assert not wind[0].any()
    assert wind[1, 1] > 2.0
    accelerations = []
    for _ in range(100):
        sim.step(0.004)
        accelerations.append(sim.simulation.sensors.accel_frd_m_s2[:, 0].copy())
    usual_noise, scripted_noise = np.std(accelerations, axis=0)
    assert scripted_noise > 2.0 * usual_noise
