"""Fixtures of the keyboard tests: a server and two vehicles for each module."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from gcs_server.client import SyncGcs
from tests.e2e.fast_station import FAST_OPTIONS, Station
from tests.station import free_port, running_server, running_vehicles


@pytest.fixture(scope="module")
def port() -> int:
    """The port to which the vehicles send."""
    return free_port()


@pytest.fixture(scope="module")
def vehicles_pid(port: int) -> Iterator[int]:
    """Two simulated vehicles, 101 and 102, so that groups are available; the process id of the simulator."""
    with running_vehicles(port, instances=2, arguments=FAST_OPTIONS) as process:
        yield process.pid


@pytest.fixture(scope="module")
def module_station(port: int, vehicles_pid: int) -> Iterator[Station]:
    """One server and its two vehicles, for all tests of the module."""
    assert vehicles_pid
    with running_server([f"udpin://127.0.0.1:{port}"]) as (url, _), SyncGcs(url, client="e2e") as gcs:
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        gcs.wait_for_vehicle("102", ready=True, timeout_s=120)
        yield Station(url, gcs, drone)


@pytest.fixture
def flying_station(module_station: Station) -> Station:
    """The module's station, whose vehicle 101 is in flight in Hold."""
    if not module_station.drone.status()["armed"]:
        module_station.drone.takeoff(6)
    module_station.drone.hold()
    module_station.drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold in flight")
    return module_station
