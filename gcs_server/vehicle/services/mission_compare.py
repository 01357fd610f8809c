"""Compares a vehicle's items with those that were sent. No I/O.

PX4 returns items in its own form: frames with _INT, and `current` at its current item. PX4 returns
a parameter that it does not store as 0 or NaN; such a difference is reported, but is not an error. Any other
difference means that the vehicle has another plan.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gcs_server.vehicle.services.mission_dialogue import NAME_OF, Part
from missions.formats.mavlink_items import WireItem

INT_FRAMES = {0: 5, 3: 6, 10: 11}
"""MAV_FRAME → the same frame with _INT."""
MAX_DIFFERENCES = 50
_FIELDS = ("command", "frame", "x", "y", "z", "autocontinue", "param1", "param2", "param3", "param4")


@dataclass(frozen=True, slots=True)
class Difference:
    """One value that differs on the vehicle."""

    part: Part
    seq: int | None
    """Index of the item in its part, from 0; None: the difference is the number of items."""
    field: str
    """count, command, frame, x, y, z, param1 … param4, autocontinue: as MISSION_ITEM_INT has them."""
    planned: float | None
    """Planned value; null: not set."""
    held: float | None
    """Value on the vehicle; null: not set."""
    essential: bool
    """Whether the flight changes; false: a parameter that the vehicle does not store."""

    def text(self) -> str:
        """The difference as a sentence without full stop."""
        if self.seq is None:
            return f"the {NAME_OF[self.part]} has {self.held:g} items, the plan {self.planned:g}"
        return (
            f"item {self.seq + 1} of the {NAME_OF[self.part]}, {self.field}: {_value_text(self.planned)} "
            f"in the plan, {_value_text(self.held)} on the vehicle"
        )


def differences(part: Part, planned: Sequence[WireItem], on_vehicle: Sequence[WireItem]) -> list[Difference]:
    """Differences of one part, at most `MAX_DIFFERENCES`; essential ones first."""
    if len(planned) != len(on_vehicle):
        return [Difference(part, None, "count", len(planned), len(on_vehicle), essential=True)]
    result: list[Difference] = []
    for seq, (planned_item, item_on_vehicle) in enumerate(zip(planned, on_vehicle, strict=True)):
        for name in _FIELDS:
            planned_value, value_on_vehicle = _value(planned_item, name), _value(item_on_vehicle, name)
            if planned_value != value_on_vehicle:
                dropped = name.startswith("param") and value_on_vehicle in (0.0, None)
                result.append(
                    Difference(part, seq, name, planned_value, value_on_vehicle, essential=not dropped)
                )
    result.sort(key=lambda each: not each.essential)
    return result[:MAX_DIFFERENCES]


def _value(item: WireItem, name: str) -> float | None:
    value = getattr(item, name)
    if name == "frame":
        return INT_FRAMES.get(value, value)
    return float(value) if math.isfinite(value) else None


def _value_text(value: float | None) -> str:
    return "not set" if value is None else f"{value:.9g}"
