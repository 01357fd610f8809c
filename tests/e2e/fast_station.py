"""Simulated vehicles at three times real time, and manoeuvres that several tests use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gcs_server.client import SyncGcs, SyncVehicle

SPEED_FACTOR = 3
"""Simulated time per real time: one minute of flight takes 20 s. A stream at 50 Hz sends 17 setpoints in one
simulated second."""
FAST_OPTIONS = ["--speed", str(SPEED_FACTOR), "--no-log"]
"""Options of a simulated vehicle: this speed, and no onboard log (it would take a fifth of the CPU time)."""


@dataclass(frozen=True)
class Station:
    """URL of a test's server, a client of this server, and the test's vehicle."""

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
    """Flies a vehicle to the east, and leaves it in Hold. Simulated vehicles take off 3 m apart, which is too
    near for a group on a busy machine."""
    north, east, down = drone.position_ned_m()
    with drone.offboard(position_ned_m=(north, east + east_m, down), valid_for_s=60):
        drone.until(lambda v: (v["offboard"]["health"]["position_error_m"] or 9.0) < 1.0, what="the position")
