"""A station for the end-to-end tests: real processes, real bytes, simulated time three times as fast."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from gcs_server.client import SyncGcs, SyncVehicle
from tests.station import free_port, server, vehicle

os.environ["GCS_CLIENT_ID"] = "e2e"
"""All programs and pages of a test are one client, in control of its vehicle, unless they say otherwise."""

SPEED = 3
"""Simulated over real time: a minute of flight takes 20 s, and 50 Hz are still 17 a simulated second."""
FAST = ["--speed", str(SPEED), "--no-log"]
"""A vehicle at that speed; its onboard log would take a fifth of its work."""


@dataclass(frozen=True)
class Station:
    """Where a test's server and its vehicle are."""

    url: str
    gcs: SyncGcs
    drone: SyncVehicle


@pytest.fixture
def station() -> Iterator[Station]:
    """Server and one vehicle that is ready to arm."""
    port = free_port()
    with (
        server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        vehicle(port, more=FAST),
        SyncGcs(url, client="e2e") as gcs,
    ):
        yield Station(url, gcs, gcs.wait_for_vehicle("101", ready=True, timeout_s=120))


def move_aside(drone: SyncVehicle, east_m: float) -> None:
    """Flies a vehicle there, into Hold: simulated ones take off 3 m apart, which leaves little of a group's
    margin on a busy machine."""
    n, e, d = drone.position_ned_m()
    with drone.offboard(position_ned_m=(n, e + east_m, d), valid_for_s=60):
        drone.until(lambda v: (v["offboard"]["health"]["position_error_m"] or 9.0) < 1.0, what="the place")
