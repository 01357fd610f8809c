"""Altitudes above home stay still while PX4 v1.17 corrects the altitude of home in flight."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame
from gcs_server.vehicle.state import HOME_CORRECTION_M, VehicleState

LAT_E7, LON_E7, GROUND_MM, HEIGHT_MM = 473977420, 85455940, 488_000, 10_000
CORRECTIONS_MM = (0, 2045, 2569, 1644, 2148, 0)
"""Changes of home's altitude in a hover at 10 m, recorded from PX4 v1.17 every two seconds."""
ON_GROUND, IN_AIR = d.MAV_LANDED_STATE_ON_GROUND, d.MAV_LANDED_STATE_IN_AIR


class FlightSetup:
    """A vehicle that hovers 10 m above the place where it was armed."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.state = VehicleState(1, self)
        self.report(armed=False, landed=ON_GROUND)
        self.home(-900)  # before arming: PX4 sets home again when it arms
        self.report(armed=True, landed=ON_GROUND)
        self.home(0)
        self.report(armed=True, landed=IN_AIR)

    def monotonic_s(self) -> float:
        return self.now_s

    def unix_s(self) -> float:
        return self.now_s

    async def sleep(self, seconds: float) -> None:
        raise AssertionError("the state does not sleep")

    def take(self, message: Any) -> None:
        self.now_s += 0.1
        raw = message.pack(d.MAVLink(None, 1, 1))
        self.state.take(Frame(message.get_msgId(), 1, 1, 0, raw, self.now_s))

    def report(self, *, armed: bool, landed: int) -> None:
        mode = d.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        self.take(d.MAVLink_heartbeat_message(2, d.MAV_AUTOPILOT_PX4, mode, 0x03040000, 4, 3))
        self.take(d.MAVLink_extended_sys_state_message(0, landed))

    def home(self, change_mm: int, north_e7: int = 0) -> None:
        """PX4 sends its home; its position in the local frame moves the other way."""
        z_m = -change_mm / 1e3
        position = (LAT_E7 + north_e7, LON_E7, GROUND_MM + change_mm, 0.0, 0.0, z_m)
        self.take(d.MAVLink_home_position_message(*position, (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0))
        relative_mm = HEIGHT_MM - change_mm
        global_position = (0, LAT_E7, LON_E7, GROUND_MM + HEIGHT_MM, relative_mm, 0, 0, 0, 0)
        self.take(d.MAVLink_global_position_int_message(*global_position))

    @property
    def values(self) -> tuple[float, float, float]:
        """Altitudes of vehicle above home, of home and of the origin of the local frame [m]."""
        home, position = self.state.topic("home"), self.state.topic("global_position")
        assert home is not None
        assert position is not None
        value: Any = home.value
        above: Any = position.value
        return above.alt_home_m, value.alt_amsl_m, value.alt_amsl_m + value.position_ned_m[2]


def test_corrections_of_home_in_flight_move_no_altitude() -> None:
    flight = FlightSetup()
    for change_mm in CORRECTIONS_MM:
        flight.home(change_mm)
        assert flight.values == pytest.approx((10.0, 488.0, 488.0))


def test_a_small_change_of_home_in_flight_is_used() -> None:
    """As in v1.16, which sets home again at the take-off."""
    flight = FlightSetup()
    for change_mm in (0, 41, -20):
        flight.home(change_mm)
        assert flight.values == pytest.approx((10.0 - change_mm / 1e3, 488.0 + change_mm / 1e3, 488.0))


def test_an_altitude_that_jumps_before_home_is_sent_again_does_not_jump() -> None:
    flight = FlightSetup()
    flight.home(0)
    jumped = (0, LAT_E7, LON_E7, GROUND_MM + HEIGHT_MM, HEIGHT_MM - 1150, 0, 0, 0, 0)
    flight.take(d.MAVLink_global_position_int_message(*jumped))
    assert flight.values[0] == 10.0


def test_a_vehicle_whose_position_is_read_once_after_several_corrections_has_the_same_altitude() -> None:
    flight = FlightSetup()
    for change_mm in CORRECTIONS_MM[:3]:
        flight.home(change_mm)
    assert flight.values == pytest.approx((10.0, 488.0, 488.0))


@pytest.mark.parametrize(
    ("change_mm", "north_e7"),
    [(int(HOME_CORRECTION_M[1] * 1e3) + 1, 0), (1000, 1000)],
    ids=["height", "place"],
)
def test_a_home_at_another_place_is_used_at_once(change_mm: int, north_e7: int) -> None:
    flight = FlightSetup()
    flight.home(change_mm, north_e7)
    above_m, home_m, origin_m = flight.values
    assert (above_m, home_m, origin_m) == pytest.approx(
        (10.0 - change_mm / 1e3, 488.0 + change_mm / 1e3, 488.0)
    )


def test_after_the_landing_and_at_the_next_arming_home_is_that_of_the_vehicle() -> None:
    flight = FlightSetup()
    flight.home(1500)
    flight.report(armed=True, landed=ON_GROUND)
    flight.home(1700)
    assert flight.values == pytest.approx((8.3, 489.7, 488.0))
    flight.report(armed=False, landed=ON_GROUND)
    flight.report(armed=True, landed=IN_AIR)  # the landed state came first
    flight.home(-1000)
    assert flight.values == pytest.approx((11.0, 487.0, 488.0)), "the home before arming is not held"
    flight.home(500)
    assert flight.values == pytest.approx((11.0, 487.0, 488.0))
