"""PREFLIGHT_STORAGE: resets, refusals, and the arming checks without calibrations."""

import pytest

from tests.unit.vehicle_sim.prepared_stations import station_on_ground
from tests.unit.vehicle_sim.sim_station import NAN, Station

pytestmark = [pytest.mark.flight, pytest.mark.story]

STORAGE, ARM = 245, 400
ACCEPTED, TEMPORARILY_REJECTED = 0, 1


@pytest.fixture
def station() -> Station:
    station = station_on_ground(Station)
    station.sim.set_parameter(0, "MPC_XY_CRUISE", 7.0)
    station.sim.set_parameter(0, "COM_FLIGHT_UUID", 42)
    station.run(0.2)
    return station


def parameter(station: Station, name: str) -> float:
    return station.sim.simulation.parameters[0].get(name)


def request_storage(station: Station, action: float) -> list[int]:
    """Sends PREFLIGHT_STORAGE with this action; returns the results of its acknowledgements."""
    requested_s = station.now_s
    station.command(STORAGE, action)
    station.run(4.0)
    return station.acks(STORAGE, requested_s)


@pytest.mark.parametrize(
    ("action", "cruise_m_s", "flight_uuid", "calibrated"),
    [(0, 7.0, 42, True), (1, 7.0, 42, True), (2, 5.0, 42, False), (3, 7.0, 42, False), (4, 5.0, 0, False)],
)
def test_each_action_resets_its_parameters(station, action, cruise_m_s, flight_uuid, calibrated):
    assert set(request_storage(station, action)) == {ACCEPTED}
    assert parameter(station, "MPC_XY_CRUISE") == cruise_m_s
    assert parameter(station, "COM_FLIGHT_UUID") == flight_uuid
    assert (parameter(station, "CAL_GYRO0_ID") != 0) is calibrated
    assert parameter(station, "PWM_MAIN_FUNC1") == 101, "a default of the airframe was reset"


def test_without_calibrations_arming_is_denied_and_a_text_names_each_sensor(station):
    request_storage(station, 2)
    requested_s = station.now_s
    station.command(ARM, 1)
    station.run(1.0)
    assert station.acks(ARM, requested_s) == [TEMPORARILY_REJECTED]
    assert not station.armed
    for sensor in ("Accel", "Gyro", "Compass"):
        assert f"Preflight Fail: {sensor} 0 uncalibrated" in station.status_texts()
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


@pytest.mark.parametrize("action", [-1, 5, NAN])
def test_unsupported_actions_are_not_acknowledged(station, action):
    assert request_storage(station, action) == []


def test_a_reset_is_refused_while_armed(station):
    station.command(ARM, 1)
    station.run(1.0)
    assert set(request_storage(station, 2)) == {TEMPORARILY_REJECTED}
    assert parameter(station, "MPC_XY_CRUISE") == 7.0
