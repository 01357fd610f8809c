"""What the server knows about the plan on a vehicle: the items of the last transfer, and the vehicle's
ids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gcs_server.mavlink.mailbox import Reply
from gcs_server.vehicle.decoders import item_count
from gcs_server.vehicle.samples import Mission
from gcs_server.vehicle.services.mission_compare import Difference
from gcs_server.vehicle.services.mission_dialogue import NAME_OF, PARTS, Part
from missions.errors import PlanError
from missions.formats import mavlink_items
from missions.formats.mavlink_items import WireItem
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


Items = Mapping[Part, Sequence[WireItem]]
Ids = dict[Part, int]
"""By part: the id that the vehicle reports for its items; 0: no items."""


@dataclass(frozen=True, slots=True)
class PlanReference:
    """Identifies the plan of a transfer."""

    id: str | None
    """Id of the stored plan; null: the plan is not stored on this server."""
    version: int | None
    name: str | None


@dataclass(frozen=True, slots=True)
class ItemsOnVehicle:
    """Items on a vehicle at the end of a transfer."""

    items: Items
    ids: Ids
    plan: PlanReference | None
    """The plan, if this server has uploaded it or has found the same items; None: the items were only
    downloaded."""
    at_unix_s: float
    rejections: tuple[str, ...] = ()
    """Why the vehicle will not fly this mission, as clauses; empty: it has stated no reason."""


@dataclass(frozen=True, slots=True)
class Uploaded:
    """Result of an upload."""

    items_on_vehicle: ItemsOnVehicle
    not_kept: list[Difference] = field(default_factory=list[Difference])
    """Item parameters that the vehicle does not store."""


def ids_of(mission: Mission) -> Ids:
    """The vehicle's ids by part."""
    return {"mission": mission.mission_id, "fence": mission.fence_id, "rally": mission.rally_points_id}


def mission_of(message: Reply) -> Mission:
    """The sample of a MISSION_CURRENT, which does not contain `reached`."""
    return Mission(
        message.seq,
        item_count(message.total),
        None,
        message.mission_id,
        message.fence_id,
        message.rally_points_id,
    )


def failed_upload_text(sent_parts: Sequence[Part], before: Ids | None, after: Ids | None) -> str:
    """Sentences about the vehicle's items after a failed upload."""
    if after is None or before is None:
        if not sent_parts:
            return "The items on the vehicle are not known now: download them before you fly."
        names = " and ".join(NAME_OF[part] for part in sent_parts)
        return (
            f"The {names} of the plan have arrived. "
            "The other parts are not known: download them before you fly."
        )
    changed: list[Part] = [part for part in PARTS if before[part] != after[part]]
    if not changed:
        return "The vehicle still has its previous items."
    new = " and ".join(NAME_OF[part] for part in changed)
    old = " and ".join(NAME_OF[part] for part in PARTS if part not in changed)
    unchanged = f" Its {old} are as before." if old else ""
    return f"The vehicle now has a new {new}.{unchanged}"
