"""The plans of a vehicle (mission, fence, rally points); mission protocol and navigator share them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vehicle_sim.autopilot.mission.items import Item, read_item

MISSION, FENCE, RALLY = 0, 1, 2
"""MAV_MISSION_TYPE."""


class Plans:
    """Three lists of items; each list's `revision` increases with every change."""

    def __init__(self) -> None:
        self._items: dict[int, tuple[Item, ...]] = {MISSION: (), FENCE: (), RALLY: ()}
        self._revisions = {MISSION: 0, FENCE: 0, RALLY: 0}
        self.changes = 0
        """Increases with every change of any list."""
        self.start_seq = 0
        """The mission item that the newest upload marked as current."""

    def store(self, kind: int, items: Sequence[Mapping[str, Any]]) -> None:
        """Replaces the plan of type `kind` (MAV_MISSION_TYPE); `items` are fields of MISSION_ITEM_INT."""
        self._items[kind] = tuple(read_item(fields) for fields in items)
        self._revisions[kind] += 1
        self.changes += 1
        if kind == MISSION:
            marked_seqs = [seq for seq, fields in enumerate(items) if fields["current"]]
            self.start_seq = marked_seqs[-1] if marked_seqs else 0

    def items(self, kind: int) -> tuple[Item, ...]:
        """The plan's items."""
        return self._items[kind]

    def revision(self, kind: int) -> int:
        """Number of changes of the plan."""
        return self._revisions[kind]

    @property
    def mission(self) -> tuple[Item, ...]:
        """The mission items."""
        return self._items[MISSION]
