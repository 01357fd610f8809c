"""Checks before a mission is uploaded to a vehicle that flies its mission. PX4 begins a changed mission at
its first item at once; an identical one keeps its current item."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs_server.errors import PlanFindings, Refused
from gcs_server.flights.chosen import PlanSource, choose
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.services.mission_compare import differences
from gcs_server.vehicle.services.mission_on_vehicle import Items, PlanReference
from gcs_server.vehicle.vehicle import Vehicle
from missions.formats import mavlink_items
from missions.formats.mavlink_items import WireItem
from missions.geodesy import LocalOrigin
from missions.items import PlacedItem
from missions.route import is_flown_to
from missions.values import Altitude
from missions.waypoints.planned import item_title

if TYPE_CHECKING:
    from gcs_server.flights.flights import Flights

FLIES_NEW_PLAN = "flies_new_plan_at_once"
"""Code in `despite` that accepts that the vehicle flies to the first item of a changed mission at once."""
HOLD_REMEDY = "Hold first (`hold_first`), or name flies_new_plan_at_once in `despite`."
SEARCHED_ITEMS = 50
"""Number of items that are searched for the first place."""
DIRECTIONS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
REFERENCES = {"home": "above home", "amsl": "AMSL", "terrain": "above the ground"}


async def chosen_items(flights: Flights, source: PlanSource) -> tuple[PlanReference, Items]:
    """The plan to upload or to compare, and its items.

    Raises:
        InvalidRequest: the plan cannot be used, or the MAVLink mission protocol cannot represent it.
    """
    chosen = await choose(flights.plans, source, "waypoint_plan")
    subject = "" if chosen.reference.id is None else f"Plan {chosen.reference.name!r}, "
    items, _ = await chosen.document.items(flights.plan_work, subject)
    return chosen.reference, items


def flies_mission(vehicle: Vehicle) -> bool:
    """Whether the vehicle is armed in Mission mode."""
    return vehicle.flight_state.armed and vehicle.status.mode == "mission"


@dataclass(frozen=True, slots=True)
class _FirstPlace:
    """Item 1 of a mission, and the first item with a place."""

    title: str
    placed: tuple[int, str, PlacedItem] | None
    """Index, title and item of the first item with a place; None: none of the first items has a place."""

    def text(self, vehicle: Vehicle) -> str:
        """Where the vehicle flies, as a clause."""
        begins = f"it begins item 1 ({self.title}) at once"
        if self.placed is None:
            return f"{begins}; its first items have no place"
        index, title, item = self.placed
        flies = f"{begins}, and flies to item {index + 1} ({title})"
        if index == 0:
            flies = f"it flies to item 1 ({title}) at once"
        return f"{flies}: {_way_text(vehicle, item)}{_altitude_text(item.altitude)}"


async def upload_check(
    flights: Flights, vehicle: Vehicle, items: Items, despite: Collection[str]
) -> Callable[[], str | None]:
    """Compares a mission with the one on the vehicle. The returned function states what the vehicle would do
    with the new mission now, as a sentence; None: it does not fly it, or the caller accepts it."""
    mission, known = items["mission"], vehicle.mission.items_on_vehicle

    def compare() -> tuple[bool, _FirstPlace | None]:
        same = known is not None and not any(
            each.essential for each in differences("mission", mission, known.items["mission"])
        )
        return same, _first_place(mission)

    same, place = await flights.plan_work.in_thread(compare)

    def check() -> str | None:
        ids = vehicle.mission.ids()
        keeps_item = (
            same
            and known is not None
            and ids is not None
            and known is vehicle.mission.items_on_vehicle
            and ids["mission"] == known.ids["mission"] != 0
        )
        if FLIES_NEW_PLAN in despite or keeps_item or not flies_mission(vehicle):
            return None
        what = "it loses its mission" if place is None else place.text(vehicle)
        return f"Vehicle {vehicle.id} is flying its mission. With this plan, {what}."

    return check


def require_accepted(check: Callable[[], str | None]) -> None:
    """Raises PlanFindings if the vehicle would fly the new mission at once, which the caller does not
    accept."""
    if (text := check()) is not None:
        raise PlanFindings(text, codes=(FLIES_NEW_PLAN,), reasons=(text,), remedy=HOLD_REMEDY)


def require_unchanged(check: Callable[[], str | None]) -> None:
    """As `require_accepted`, directly before the mission is sent, when other parts have already been sent."""
    if (text := check()) is not None:
        raise Refused(f"{text} The mission was not sent.", remedy=HOLD_REMEDY)


def _first_place(mission: Sequence[WireItem]) -> _FirstPlace | None:
    items = mavlink_items.items_from_wire(mission[:SEARCHED_ITEMS])
    if not items:
        return None
    placed = next(
        (
            (index, item_title(each), each)
            for index, each in enumerate(items)
            if isinstance(each, PlacedItem) and is_flown_to(each)
        ),
        None,
    )
    return _FirstPlace(item_title(items[0]), placed)


def _way_text(vehicle: Vehicle, item: PlacedItem) -> str:
    position = VehicleEstimates(vehicle).global_position()
    if position is None:
        return f"{item.lat_deg:.6f}°, {item.lon_deg:.6f}° (the vehicle's position is not known)"
    here = LocalOrigin(position.lat_deg, position.lon_deg, position.alt_amsl_m)
    north_m, east_m, _ = here.to_ned(item.lat_deg, item.lon_deg, position.alt_amsl_m)
    direction = DIRECTIONS[round(math.degrees(math.atan2(east_m, north_m)) / 45.0) % 8]
    return f"{math.hypot(north_m, east_m):.0f} m to the {direction}"


def _altitude_text(altitude: Altitude) -> str:
    return f", at {altitude.value_m:g} m {REFERENCES[altitude.reference]}"
