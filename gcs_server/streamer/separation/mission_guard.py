"""The guard of a group, for the vehicles of one offboard mission.

They need no common setpoint stream: each has its own between take-off and landing, and none counts as having
left. A vehicle counts while it is armed, also in PX4's own take-off and landing. What cannot be stopped by a
stream is stopped by the mission, which hears of each finding.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from gcs_server.streamer.separation.guard import GroupGuard, MemberView
from gcs_server.streamer.values.order import Order
from missions.separation import SpeedTrend


class MissionGuard(GroupGuard):
    """Acts once: it stops all vehicles of the mission.

    Args:
        name: the mission's, unlike that of any group.
        vehicles: of the mission.
        minimum_m: the minimum separation.
        now_s: monotonic.
    """

    def __init__(self, name: str, vehicles: Iterable[str], *, minimum_m: float, now_s: float) -> None:
        super().__init__(name, {}, {}, minimum_m=minimum_m, start_s=now_s, lasts_s=math.inf)
        self.phase = "flying"
        self._vehicles = tuple(vehicles)
        self._trends = {vehicle: SpeedTrend() for vehicle in self._vehicles}

    @property
    def members(self) -> tuple[str, ...]:
        """The vehicles of the mission."""
        return self._vehicles

    def order_to_come(self, vehicle: str) -> Order | None:
        """None: the mission sets each vehicle's setpoints."""
        return None

    def _counts(self, seen: MemberView) -> bool:
        return seen.snapshot.armed

    def _gone(self, vehicle: str, seen: MemberView) -> str | None:
        return None

    def _gone_together(self, now_s: float, flying: list[str], seen: Mapping[str, MemberView]) -> bool:
        return False
