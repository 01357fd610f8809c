"""A copy of a simulated flight continues bit for bit like the original, and neither affects the other."""

from typing import Any

import pytest

from tests.support.snapshot import snapshot
from tests.unit.vehicle_sim.sim_station import GCS_AND_API_LINKS, LAND_COMMAND, LAND_MODE, Station

GOTO_SETPOINT = {"coordinate_frame": 1, "type_mask": 0xDF8, "x": 3.0, "y": 1.0, "z": -4.0}


def continue_flight(station: Station) -> str:
    """Flies a go-to and a landing; returns all received messages as text."""
    station.send("SET_POSITION_TARGET_LOCAL_NED", target_system=1, target_component=1, **GOTO_SETPOINT)
    station.command(193, 5.0)  # DO_PAUSE_CONTINUE
    station.run(1.5)
    station.command(LAND_COMMAND)
    station.run_until(lambda: station.active_mode == LAND_MODE, 2)
    station.run(1.5)
    return repr([(time_s, link, message.name, message.values) for time_s, link, message in station.log])


@pytest.mark.story
@pytest.mark.flight
@pytest.mark.parametrize("fleet", [{"links": GCS_AND_API_LINKS, "camera": True}, {}], ids=["both", "gcs"])
def test_copies_continue_like_the_original(fleet: dict[str, Any]) -> None:
    original = Station(seed=4, **fleet)
    original.take_off_and_hover(3.0)
    first_copy, second_copy = snapshot(original), snapshot(original)
    log_of_copy = continue_flight(first_copy)
    assert continue_flight(original) == log_of_copy, "the flight of a copy changed the original"
    assert continue_flight(second_copy) == log_of_copy
