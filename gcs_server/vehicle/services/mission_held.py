"""What a vehicle holds, as far as it is known: by the items of a transfer, and by the vehicle's own ids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gcs_server.mavlink.mailbox import Reply
from gcs_server.vehicle.decoders import item_count
from gcs_server.vehicle.samples import Mission
from gcs_server.vehicle.services.mission_compare import Difference
from gcs_server.vehicle.services.mission_dialogue import NAME_OF, PARTS, Part
from missions.formats.mavlink_items import WireItem

Items = Mapping[Part, Sequence[WireItem]]
Ids = dict[Part, int]
"""Of each part the vehicle's own id of what it holds; 0: nothing."""


@dataclass(frozen=True, slots=True)
class PlanName:
    """Which plan a transfer was about."""

    id: str | None
    """The plan's id on this server; null: it is not kept here."""
    version: int | None
    name: str | None


@dataclass(frozen=True, slots=True)
class Held:
    """What a vehicle held when a transfer with it ended."""

    items: Items
    ids: Ids
    plan: PlanName | None
    """The plan that it is, where it was uploaded from here or compared equal; None: only downloaded."""
    at_unix_s: float


@dataclass(frozen=True, slots=True)
class Uploaded:
    """What an upload came to."""

    held: Held
    not_kept: list[Difference] = field(default_factory=list[Difference])
    """Parameters that the vehicle does not keep."""


def ids_of(mission: Mission) -> Ids:
    """The vehicle's ids by part."""
    return {"mission": mission.mission_id, "fence": mission.fence_id, "rally": mission.rally_points_id}


def current_of(message: Reply) -> Mission:
    """From a MISSION_CURRENT; `reached` is not in it."""
    return Mission(
        message.seq,
        item_count(message.total),
        None,
        message.mission_id,
        message.fence_id,
        message.rally_points_id,
    )


def holding_words(done: Sequence[Part], before: Ids | None, after: Ids | None) -> str:
    """What a vehicle holds after an upload that failed, as sentences."""
    if after is None or before is None:
        if not done:
            return "What the vehicle holds now is not known: download it before you fly."
        names = " and ".join(NAME_OF[part] for part in done)
        return f"The {names} of the plan have arrived; the rest is not known: download it before you fly."
    changed: list[Part] = [part for part in PARTS if before[part] != after[part]]
    if not changed:
        return "The vehicle still holds what it held before."
    new = " and ".join(NAME_OF[part] for part in changed)
    old = " and ".join(NAME_OF[part] for part in PARTS if part not in changed)
    kept = f" Its {old} are as before." if old else ""
    return f"The vehicle now holds a new {new}.{kept}"
