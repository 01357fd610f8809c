"""Converts the items on a vehicle to a plan."""

from __future__ import annotations

from gcs_server.vehicle.services.mission_on_vehicle import ItemsOnVehicle
from missions.errors import PlanError
from missions.formats import mavlink_items
from missions.formats.px4_storage import as_flown
from missions.plan import Plan


def plan_from_items(downloaded: ItemsOnVehicle) -> tuple[Plan, list[str]]:
    """The downloaded items as a plan, with notes on content that the plan cannot represent."""
    notes: list[str] = []
    mission = mavlink_items.items_from_wire([as_flown(item) for item in downloaded.items["mission"]])
    fence = rally = ()
    try:
        fence = mavlink_items.fence_from_wire(downloaded.items["fence"])
    except PlanError as error:
        notes.append(f"The geofence is left out. {error}")
    try:
        rally = mavlink_items.rally_from_wire(downloaded.items["rally"])
    except PlanError as error:
        notes.append(f"The rally points are left out. {error}")
    return Plan(items=mission, fence=fence, rally_points=rally), notes
