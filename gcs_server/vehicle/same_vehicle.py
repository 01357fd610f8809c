"""Revises, while vehicles are connected, which endpoints belong to one vehicle.

`endpoint.same_vehicle` decides within seconds, often before uids and boot times are known. Later, a uid
decides at once, and boot times when they have agreed or differed for some seconds. No I/O.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from gcs_server.vehicle.endpoint import BOOT_TIME_EVERY_S, NO_DATA_AFTER_S, Endpoint

SAME_BOOT_S = 0.3
"""Boot times of one vehicle differ by at most this, over a long time [s]."""
OTHER_BOOT_S = 5.0
"""Boot times of two vehicles differ by at least this [s]; in between, they decide nothing."""
SAME_FOR_S, OTHER_FOR_S = 5.0, 10.0
"""Time for which boot times must agree, or differ, before they decide [s]."""


class SameVehicleWatch:
    """Evidence about each pair of endpoints with the same system id, over time."""

    def __init__(self) -> None:
        self._since: dict[frozenset[Endpoint], tuple[bool, float]] = {}
        """The current evidence of a pair (one vehicle or two), and since when it has not changed."""

    def update(self, endpoints: Sequence[Endpoint], now_s: float) -> None:
        """Compares the boot times of these endpoints; forgets all others. Called a few times a second."""
        since = self._since
        self._since = {}
        for first, second in itertools.combinations(endpoints, 2):
            if first.system_id != second.system_id or (same := _same_boot(first, second, now_s)) is None:
                continue
            pair = frozenset((first, second))
            before = since.get(pair)
            self._since[pair] = before if before is not None and before[0] == same else (same, now_s)

    def is_same(self, first: Endpoint, second: Endpoint, now_s: float) -> bool | None:
        """Whether two endpoints belong to one vehicle; None: not decided."""
        if first.unique_uid is not None and second.unique_uid is not None:
            return first.unique_uid == second.unique_uid
        same, since_s = self._since.get(frozenset((first, second)), (None, now_s))
        if same is None or now_s - since_s < (SAME_FOR_S if same else OTHER_FOR_S):
            return None
        return same

    def are_one(self, first: Sequence[Endpoint], second: Sequence[Endpoint], now_s: float) -> bool:
        """Whether these endpoints of two vehicles belong to one vehicle."""
        decisions = [self.is_same(a, b, now_s) for a, b in itertools.product(first, second)]
        return True in decisions and False not in decisions


def _same_boot(first: Endpoint, second: Endpoint, now_s: float) -> bool | None:
    """Whether the newest boot times agree; None: unknown, or they decide nothing."""
    oldest_s = min(first.boot_next_s, second.boot_next_s) - BOOT_TIME_EVERY_S
    if first.boot_at_s is None or second.boot_at_s is None or now_s - oldest_s > NO_DATA_AFTER_S:
        return None
    if first.connection is second.connection:
        return False  # one vehicle has one address on a link
    difference_s = abs(first.boot_at_s - second.boot_at_s)
    return True if difference_s < SAME_BOOT_S else False if difference_s > OTHER_BOOT_S else None
