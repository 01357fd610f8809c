"""A browser and two flying vehicles for the keyboard tests, one set for each module."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from gcs_server.client import SyncGcs
from tests.e2e.fast_station import FAST, Station
from tests.station import free_port, server, vehicle


@pytest.fixture(scope="module")
def port() -> int:
    """The port to which the vehicles send."""
    return free_port()


@pytest.fixture(scope="module")
def vehicles(port: int) -> Iterator[int]:
    """The process group of two vehicles, so that groups are available; 101 flies."""
    with vehicle(port, instances=2, arguments=FAST) as process:
        yield process.pid


@pytest.fixture(scope="module")
def field(port: int, vehicles: int) -> Iterator[Station]:
    """One station for all tests of the module."""
    assert vehicles
    with server([f"udpin://127.0.0.1:{port}"]) as (url, _), SyncGcs(url, client="e2e") as gcs:
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        gcs.wait_for_vehicle("102", ready=True, timeout_s=120)
        yield Station(url, gcs, drone)


@pytest.fixture
def flying(field: Station) -> Station:
    """The station with its vehicle in flight, in Hold."""
    if not field.drone.status()["armed"]:
        field.drone.takeoff(6)
    field.drone.hold()
    field.drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold in flight")
    return field
