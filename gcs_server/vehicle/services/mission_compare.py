"""Compares a vehicle's items with those that were sent. No I/O.

Items are compared as PX4 stores them: another form of the same item is no difference. A parameter that PX4
does not store is reported, but is not an error. Any other difference means that the vehicle has another
plan.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gcs_server.vehicle.services.mission_dialogue import NAME_OF, Part
from missions.formats.mavlink_items import WireItem
from missions.formats.px4_storage import is_lost, is_yaw, stored_items

MAX_DIFFERENCES = 50
YAW_TOLERANCE_DEG = 0.01
"""Larger than the error of an angle in 32-bit radians, smaller than any yaw that matters."""
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
    stored_of_both = zip(stored_items(part, planned), stored_items(part, on_vehicle), strict=True)
    pairs = zip(planned, on_vehicle, stored_of_both, strict=True)
    for seq, (planned_item, item_on_vehicle, (expected, stored)) in enumerate(pairs):
        for name in _FIELDS:
            number = int(name[-1]) if name.startswith("param") else None
            values = _value(planned_item, name), _value(item_on_vehicle, name)
            tolerance_deg = YAW_TOLERANCE_DEG if number and is_yaw(part, expected, number) else 0.0
            if not _equal(_value(expected, name), _value(stored, name), tolerance_deg):
                result.append(Difference(part, seq, name, *values, essential=True))
            elif number and is_lost(part, expected, number) and (values[0] or 0.0) != (values[1] or 0.0):
                result.append(Difference(part, seq, name, *values, essential=False))
    result.sort(key=lambda each: not each.essential)
    return result[:MAX_DIFFERENCES]


def _equal(expected: float | None, stored: float | None, yaw_tolerance_deg: float) -> bool:
    if expected is None or stored is None or not yaw_tolerance_deg:
        return expected == stored
    return abs((expected - stored + 180.0) % 360.0 - 180.0) <= yaw_tolerance_deg


def _value(item: WireItem, name: str) -> float | None:
    value = getattr(item, name)
    return float(value) if math.isfinite(value) else None


def _value_text(value: float | None) -> str:
    return "not set" if value is None else f"{value:.9g}"
