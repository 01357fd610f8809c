"""What keeps a vehicle from being armed beside the checks, and what PX4 counts of its flights."""

import pytest

from tests.unit.vehicle_sim.flown import standing
from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.parameters import Parameters

pytestmark = pytest.mark.flight

ARM, SET_MODE, CALIBRATE = 400, 176, 241
POSITION, ALTITUDE, STABILIZED = 3, 2, 7


@pytest.fixture
def station() -> Station:
    return standing(Station, sensor_noise=False)


def with_sticks(station: Station, seconds: float, throttle: int) -> None:
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
def test_a_vehicle_that_would_leap_up_is_not_armed(station, mode, throttle, event):
    with_sticks(station, 1.0, throttle)
    station.command(SET_MODE, 1, mode, 0)
    with_sticks(station, 0.5, throttle)
    asked_s = station.now_s
    station.command(ARM, 1)
    with_sticks(station, 0.5, throttle)
    assert station.armed is (event is None)
    assert event is None or event in station.events(asked_s)


def test_nothing_is_armed_amid_a_calibration(station):
    station.command(CALIBRATE, 0, 1)
    station.run(0.5)
    asked_s = station.now_s
    station.command(ARM, 1)
    station.run(0.3)
    assert not station.armed
    assert "commander_arm_denied_calibrating" in station.events(asked_s)


@pytest.mark.story
def test_flights_are_counted_and_nobody_is_told():
    station = Station(sensor_noise=False)
    station.fly_to(3.0)
    value = station.sim.simulation.parameters[0].get
    assert value("COM_FLIGHT_UUID") == 0
    lifted_s, told = station.now_s, len(station.heard("PARAM_VALUE"))
    station.command(21)
    station.run_until(lambda: not station.armed, 40)
    assert value("COM_FLIGHT_UUID") == 1
    flown_us = value("LND_FLIGHT_T_LO")
    assert 1e6 * (station.now_s - lifted_s) < flown_us < 1e6 * (station.now_s - lifted_s + 12.0)
    assert value("LND_FLIGHT_T_HI") == 0
    station.run(1.0)
    assert len(station.heard("PARAM_VALUE")) == told
    station.command(ARM, 1)
    station.run(0.2)
    station.command(ARM, 0)
    station.run(0.2)
    assert value("COM_FLIGHT_UUID") == 2
    assert value("LND_FLIGHT_T_LO") == flown_us, "it did not fly"


def test_a_first_boot_tells_what_was_stored_and_a_second_does_not(tmp_path):
    first = Station(stores=[Parameters({"NAV_DLL_ACT": 2}, storage=tmp_path / "store.json")])
    first.run(3.0)
    told = [message.param_id for message in first.heard("PARAM_VALUE")]
    assert {"CAL_ACC0_ID", "CAL_MAG1_PRIO", "SYS_AUTOSTART", "NAV_DLL_ACT"} <= set(told)
    assert told == sorted(told, key=first.sim.simulation.parameters[0].index_of)
    first.sim.set_parameter(0, "MPC_XY_CRUISE", 6.0)
    second = Station(stores=[Parameters(storage=tmp_path / "store.json")])
    second.run(3.0)
    assert second.heard("PARAM_VALUE") == []
