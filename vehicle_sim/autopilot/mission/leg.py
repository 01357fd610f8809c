"""A leg of a mission or a return: from the last target to this one, with a look at the next."""

from __future__ import annotations

from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.smoothing import Way
from vehicle_sim.vehicle_view import Vector


class Leg:
    """From `previous` to `target`, with a look at `next`; all NED metres."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._way = Way((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), None, 0.0)

    @property
    def target_ned_m(self) -> Vector:
        """Where it leads."""
        return self._way.target_ned_m

    @property
    def acceptance_m(self) -> float:
        """So near the target it is reached."""
        return self._way.acceptance_m

    def set(self, target_ned_m: Vector, next_ned_m: Vector | None, acceptance_m: float) -> None:
        """Fly to a new target from where the last one was; no next: stop there."""
        self._way = Way(self._way.target_ned_m, target_ned_m, next_ned_m, acceptance_m)
        self._path.target_ned_m = target_ned_m

    def restart(self) -> None:
        """Begin where the trajectory is."""
        here = self._path.position_ned_m
        self._way = Way(here, here, None, self._way.acceptance_m)

    def fly(self) -> None:
        """One tick along the leg."""
        self._path.fly_way(self._way)
