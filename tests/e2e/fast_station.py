"""Simulated vehicles three times as fast as real time, and what several stories have them do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gcs_server.client import SyncGcs, SyncVehicle

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


def airborne(drone: Any, height_m: float = 10) -> None:
    """Takes off and waits for Hold at the top."""
    drone.takeoff(height_m)
    drone.until(
        lambda v: v["status"]["mode"] == "hold" and v["status"]["landed_state"] == "in_air",
        what="the end of the take-off",
    )


def move_aside(drone: SyncVehicle, east_m: float) -> None:
    """Flies a vehicle there, into Hold: simulated ones take off 3 m apart, which leaves little of a group's
    margin on a busy machine."""
    n, e, d = drone.position_ned_m()
    with drone.offboard(position_ned_m=(n, e + east_m, d), valid_for_s=60):
        drone.until(lambda v: (v["offboard"]["health"]["position_error_m"] or 9.0) < 1.0, what="the place")
