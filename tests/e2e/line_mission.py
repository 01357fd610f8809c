"""A short waypoint plan to the north, and its flight."""

from __future__ import annotations

from typing import Any

from gcs_server.client import SyncVehicle
from tests.station import wait_until

HEIGHT_M = 12
STEP_DEG = 6e-4
"""Distance between the items to the north: 67 m."""


def plan_at(drone: SyncVehicle) -> dict[str, Any]:
    """A take-off, four waypoints to the north, and Return."""
    wait_until(lambda: drone.topic("home") is not None, "the vehicle's home")
    home = drone.topic("home")
    assert home is not None
    altitude = {"value_m": HEIGHT_M, "reference": "home"}
    places = [
        {"lat_deg": home["lat_deg"] + i * STEP_DEG, "lon_deg": home["lon_deg"], "altitude": altitude}
        for i in range(5)
    ]
    items = [{"kind": "takeoff" if i == 0 else "waypoint", **place} for i, place in enumerate(places)]
    return {"items": [*items, {"kind": "return_home"}]}


def current_item(drone: SyncVehicle) -> int:
    mission = drone.topic("mission")
    assert mission is not None
    return mission["current"]


def is_read(drone: SyncVehicle) -> bool:
    """Whether the server knows which items the vehicle has."""
    return drone.mission.state()["holds"]["known_unix_s"] is not None


def start_mission(drone: SyncVehicle) -> None:
    drone.mission.start(0, despite=["plan_not_known"])
    drone.until(lambda v: v["status"]["landed_state"] == "in_air", what="the take-off")
