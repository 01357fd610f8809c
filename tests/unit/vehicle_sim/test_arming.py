"""Arming is denied for reasons other than the arming checks; PX4 counts flights and flight time."""

import pytest

from tests.unit.vehicle_sim.prepared_stations import station_on_ground
from tests.unit.vehicle_sim.sim_station import LAND_COMMAND, Station
from vehicle_sim.parameters import Parameters

pytestmark = pytest.mark.flight

ARM, SET_MODE, CALIBRATE = 400, 176, 241
POSITION, ALTITUDE, STABILIZED = 3, 2, 7


@pytest.fixture
def station() -> Station:
    return station_on_ground(Station, sensor_noise=False)


def run_with_throttle(station: Station, seconds: float, throttle: int) -> None:
    station.run(
        seconds,
        lambda: station.send("MANUAL_CONTROL", target=1, x=0, y=0, z=throttle, r=0, buttons=0),
    )


@pytest.mark.parametrize(
    ("mode", "throttle", "event"),
    [
        (POSITION, 500, None),
        (POSITION, 580, None),
        (POSITION, 620, "commander_arm_denied_throttle_center"),
        (ALTITUDE, 1000, "commander_arm_denied_throttle_center"),
        (STABILIZED, 0, None),
        (STABILIZED, 90, None),
        (STABILIZED, 120, "commander_arm_denied_throttle_high"),
        (STABILIZED, 500, "commander_arm_denied_throttle_high"),
    ],
)
def test_arming_is_denied_while_the_throttle_is_too_high(station, mode, throttle, event):
    run_with_throttle(station, 1.0, throttle)
    station.command(SET_MODE, 1, mode, 0)
    run_with_throttle(station, 0.5, throttle)
    requested_s = station.now_s
    station.command(ARM, 1)
    run_with_throttle(station, 0.5, throttle)
    assert station.armed is (event is None)
    assert event is None or event in station.events(requested_s)


def test_arming_is_denied_during_a_calibration(station):
    station.command(CALIBRATE, 0, 1)
    station.run(0.5)
    requested_s = station.now_s
    station.command(ARM, 1)
    station.run(0.3)
    assert not station.armed
    assert "commander_arm_denied_calibrating" in station.events(requested_s)


@pytest.mark.story
def test_flight_counters_change_without_parameter_messages():
    station = Station(sensor_noise=False)
    station.take_off_and_hover(3.0)
    parameter = station.sim.simulation.parameters[0].get
    assert parameter("COM_FLIGHT_UUID") == 0
    took_off_s, message_count = station.now_s, len(station.received("PARAM_VALUE"))
    station.command(LAND_COMMAND)
    station.run_until(lambda: not station.armed, 40)
    assert parameter("COM_FLIGHT_UUID") == 1
    flown_us = parameter("LND_FLIGHT_T_LO")
    assert 1e6 * (station.now_s - took_off_s) < flown_us < 1e6 * (station.now_s - took_off_s + 12.0)
    assert parameter("LND_FLIGHT_T_HI") == 0
    station.run(1.0)
    assert len(station.received("PARAM_VALUE")) == message_count
    station.command(ARM, 1)
    station.run(0.2)
    station.command(ARM, 0)
    station.run(0.2)
    assert parameter("COM_FLIGHT_UUID") == 2
    assert parameter("LND_FLIGHT_T_LO") == flown_us  # without a take-off no flight time is added


def test_only_the_first_boot_sends_the_parameters_that_it_stored(tmp_path):
    first = Station(stores=[Parameters({"NAV_DLL_ACT": 2}, storage=tmp_path / "store.json")])
    first.run(3.0)
    sent = [message.param_id for message in first.received("PARAM_VALUE")]
    assert {"CAL_ACC0_ID", "CAL_MAG1_PRIO", "SYS_AUTOSTART", "NAV_DLL_ACT"} <= set(sent)
    assert sent == sorted(sent, key=first.sim.simulation.parameters[0].index_of)
    first.sim.set_parameter(0, "MPC_XY_CRUISE", 6.0)
    second = Station(stores=[Parameters(storage=tmp_path / "store.json")])
    second.run(3.0)
    assert second.received("PARAM_VALUE") == []
