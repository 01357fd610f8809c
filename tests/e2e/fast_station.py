"""Simulated vehicles at three times real time, and manoeuvres that several tests use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gcs_server.client import SyncGcs, SyncVehicle

SPEED = 3
"""Simulated time per real time: one minute of flight takes 20 s, and 50 Hz are 17 per simulated second."""
FAST = ["--speed", str(SPEED), "--no-log"]
"""Options of a vehicle at this speed and without its onboard log, which would take a fifth of its CPU
time."""


@dataclass(frozen=True)
class Station:
    """Addresses of a test's server and vehicle."""

    url: str
    gcs: SyncGcs
    drone: SyncVehicle


def take_off_to_hold(drone: Any, height_m: float = 10) -> None:
    """Takes off and waits for Hold."""
    drone.takeoff(height_m)
    drone.until(
        lambda v: v["status"]["mode"] == "hold" and v["status"]["landed_state"] == "in_air",
        what="the end of the take-off",
    )


def move_aside(drone: SyncVehicle, east_m: float) -> None:
    """Flies a vehicle to the east, into Hold: simulated vehicles take off 3 m apart, too near for a group on
    a busy machine."""
    n, e, d = drone.position_ned_m()
    with drone.offboard(position_ned_m=(n, e + east_m, d), valid_for_s=60):
        drone.until(lambda v: (v["offboard"]["health"]["position_error_m"] or 9.0) < 1.0, what="the position")
