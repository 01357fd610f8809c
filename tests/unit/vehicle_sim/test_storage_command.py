"""PREFLIGHT_STORAGE: what it resets, what it refuses, and what a vehicle without calibrations says."""

import pytest

from tests.unit.vehicle_sim.flown import standing
from tests.unit.vehicle_sim.sim_station import NAN, Station

pytestmark = pytest.mark.flight

STORAGE, ARM = 245, 400
ACCEPTED, TEMPORARILY_REJECTED = 0, 1


@pytest.fixture
def station() -> Station:
    station = standing(Station)
    station.sim.set_parameter(0, "MPC_XY_CRUISE", 7.0)
    station.sim.set_parameter(0, "COM_FLIGHT_UUID", 42)
    station.run(0.2)
    return station


def value(station: Station, name: str) -> float:
    return station.sim.simulation.parameters[0].get(name)


def ask(station: Station, what: float) -> list[int]:
    asked_s = station.now_s
    station.command(STORAGE, what)
    station.run(4.0)
    return station.acks(STORAGE, asked_s)


@pytest.mark.parametrize(
    ("what", "cruise", "flights", "calibrated"),
    [(0, 7.0, 42, True), (1, 7.0, 42, True), (2, 5.0, 42, False), (3, 7.0, 42, False), (4, 5.0, 0, False)],
)
def test_what_each_number_resets(station, what, cruise, flights, calibrated):
    assert set(ask(station, what)) == {ACCEPTED}
    assert value(station, "MPC_XY_CRUISE") == cruise
    assert value(station, "COM_FLIGHT_UUID") == flights
    assert (value(station, "CAL_GYRO0_ID") != 0) is calibrated
    assert value(station, "PWM_MAIN_FUNC1") == 101, "the airframe's own defaults are no changes"


def test_without_calibrations_nothing_can_be_armed_and_each_sensor_is_named(station):
    ask(station, 2)
    asked_s = station.now_s
    station.command(ARM, 1)
    station.run(1.0)
    assert station.acks(ARM, asked_s) == [TEMPORARILY_REJECTED]
    assert not station.armed
    for sensor in ("Accel", "Gyro", "Compass"):
        assert f"Preflight Fail: {sensor} 0 uncalibrated" in station.texts()
    assert {"check_accel_not_calibrated", "check_gyro_not_calibrated", "check_mag_not_calibrated"} <= set(
        station.events()
    )


def test_a_compass_that_is_not_required_need_not_be_calibrated(station):
    station.sim.set_parameter(0, "SYS_HAS_MAG", 0)
    station.sim.set_parameter(0, "CAL_MAG0_ID", 0)
    station.run(4.0)
    station.command(ARM, 1)
    station.run(1.0)
    assert station.armed


@pytest.mark.parametrize("what", [-1, 5, NAN])
def test_other_numbers_get_no_answer(station, what):
    assert ask(station, what) == []


def test_armed_it_is_refused(station):
    station.command(ARM, 1)
    station.run(1.0)
    assert set(ask(station, 2)) == {TEMPORARILY_REJECTED}
    assert value(station, "MPC_XY_CRUISE") == 7.0
