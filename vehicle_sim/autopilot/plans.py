"""The plans of a vehicle (mission, fence, rally points); mission protocol and navigator share them."""

from __future__ import annotations

from collections.abc import Sequence

from vehicle_sim.autopilot.mission.items import Item

MISSION, FENCE, RALLY = 0, 1, 2
"""MAV_MISSION_TYPE."""


class Plans:
    """Three lists of items; each list's `revision` increases with every change."""

    def __init__(self) -> None:
        self._items: dict[int, tuple[Item, ...]] = {MISSION: (), FENCE: (), RALLY: ()}
        self._revisions = {MISSION: 0, FENCE: 0, RALLY: 0}
        self.changes = 0
        """Increases with every change of any list."""
        self.start_seq: int | None = 0
        """The mission item that the newest upload marked as current; None: none, the current item's number
        stays."""

    def store(self, kind: int, items: Sequence[Item], start_seq: int | None = 0) -> None:
        """Replaces the plan of type `kind` (MAV_MISSION_TYPE)."""
        self._items[kind] = tuple(items)
        self._revisions[kind] += 1
        self.changes += 1
        if kind == MISSION:
            self.start_seq = start_seq

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
