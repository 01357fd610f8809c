"""The separation guard for the vehicles of one offboard mission.

Each vehicle has a setpoint stream only between take-off and landing, so the end of a stream does not mean
that the vehicle has left. A vehicle is checked while it is armed, including PX4's own take-off and
landing. The mission receives each finding, and stops the vehicles that have no stream.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from gcs_server.streamer.separation.guard import GroupGuard, MemberView
from gcs_server.streamer.values.stream_request import StreamRequest
from missions.separation import VelocityTrend


class MissionGuard(GroupGuard):
    """The guard of one mission. The guard acts once, and stops all vehicles of the mission.

    Args:
        name: name of the guard, different from the names of all groups.
        vehicles: ids of the mission's vehicles.
        minimum_m: the minimum separation.
        now_s: current time [s, monotonic].
    """

    def __init__(self, name: str, vehicles: Iterable[str], *, minimum_m: float, now_s: float) -> None:
        super().__init__(name, {}, {}, minimum_m=minimum_m, start_s=now_s, duration_s=math.inf)
        self.phase = "flying"
        self._vehicles = tuple(vehicles)
        self._trends = {vehicle: VelocityTrend() for vehicle in self._vehicles}

    @property
    def members(self) -> tuple[str, ...]:
        """The vehicles of the mission."""
        return self._vehicles

    def pending_request(self, vehicle: str) -> StreamRequest | None:
        """Always None, because the mission sets each vehicle's setpoints."""
        return None

    def _is_checked(self, view: MemberView) -> bool:
        return view.snapshot.armed

    def _leave_reason(self, vehicle: str, view: MemberView) -> str | None:
        return None

    def _nothing_to_stop(self, now_s: float, flying: list[str], views: Mapping[str, MemberView]) -> bool:
        return False
