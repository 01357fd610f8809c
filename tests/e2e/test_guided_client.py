"""Every guided command through the Python client and REST, with real processes and a link that loses a
fifth of its datagrams in each direction."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import pytest

from gcs_server.client import Refused, SyncGcs, SyncVehicle
from missions.geodesy import distance_m
from tests.e2e.fast_station import FAST_OPTIONS, Station, take_off_to_hold
from tests.station import free_port, running_server, running_vehicles
from tests.support.lossy_relay import lossy_relay

pytestmark = pytest.mark.story

LOSS = 0.2


@pytest.fixture
def station() -> Iterator[Station]:
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        lossy_relay(port, LOSS, seed=7) as vehicle_port,
        running_vehicles(vehicle_port, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
    ):
        yield Station(url, gcs, gcs.wait_for_vehicle("101", ready=True, timeout_s=120))


def away_m(position: dict[str, float], place: tuple[float, float]) -> float:
    return distance_m(position["lat_deg"], position["lon_deg"], *place)


def wait_for(drone: SyncVehicle, topic: str, reached: Callable[[dict[str, float]], bool], what: str) -> None:
    drone.until(lambda v: reached(v["topics"][topic]["value"]), what=what)


def test_every_guided_command_is_flown_although_a_fifth_of_the_datagrams_is_lost(station: Station) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    home = drone.topic("home")
    assert home is not None
    north = (home["lat_deg"] + 3e-4, home["lon_deg"])
    drone.goto(*north, alt_home_m=12, speed_m_s=4)
    wait_for(drone, "global_position", lambda p: away_m(p, north) < 2, "the position")
    drone.change_speed(3)
    drone.change_altitude(alt_home_m=18)
    wait_for(drone, "global_position", lambda p: abs(p["alt_home_m"] - 18) < 1.5, "the altitude")
    drone.change_heading(-90)
    position = drone.topic("global_position")
    assert position is not None
    assert abs(math.remainder(position["heading_deg"] - 270, 360)) < 12
    drone.orbit(*north, alt_home_m=18, radius_m=12, speed_m_s=3, clockwise=False)
    circle = drone.topic("orbit")
    assert circle is not None
    assert (circle["radius_m"], circle["clockwise"]) == (12, False)
    wait_for(drone, "global_position", lambda p: abs(away_m(p, north) - 12) < 2.5, "the circle")
    drone.hold()
    drone.set_home(*north)
    new_home = drone.topic("home")
    assert new_home is not None
    assert distance_m(new_home["lat_deg"], new_home["lon_deg"], *north) < 0.5
    assert any(mode["mode"] == "position" for mode in drone.modes())
    drone.set_mode("land")
    drone.until(lambda v: v["status"]["mode"] == "land", what="the landing")
    with pytest.raises(Refused, match=r"in Hold and Mission"):
        drone.change_speed(5)
