"""A leg of a mission or a return, from the previous to the current target."""

from __future__ import annotations

from vehicle_sim.autopilot.mission.heading import Heading
from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.smoothing import WaypointTriplet
from vehicle_sim.autopilot.steady_task import Motion, SteadyTask
from vehicle_sim.vehicle_view import Vector


class Leg:
    """One leg of one vehicle; the next waypoint determines the speed at the target."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._triplet = WaypointTriplet((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), None, 0.0)

    @property
    def triplet(self) -> WaypointTriplet:
        """Previous, target and next waypoint of the leg [m, NED]."""
        return self._triplet

    @property
    def target_ned_m(self) -> Vector:
        """The target of the leg."""
        return self._triplet.target_ned_m

    @property
    def acceptance_m(self) -> float:
        """Distance within which the target counts as reached."""
        return self._triplet.acceptance_m

    def set(self, target_ned_m: Vector, next_ned_m: Vector | None, acceptance_m: float) -> None:
        """Starts a leg from the last to a new target; the vehicle stops there if `next_ned_m` is None."""
        self._triplet = WaypointTriplet(self._triplet.target_ned_m, target_ned_m, next_ned_m, acceptance_m)
        self._path.target_ned_m = target_ned_m

    def restart(self) -> None:
        """Starts the leg at the current position of the trajectory."""
        position_ned_m = self._path.position_ned_m
        self._triplet = WaypointTriplet(position_ned_m, position_ned_m, None, self._triplet.acceptance_m)

    def steady_task(self, heading: Heading, arrived_at_s: float | None, hold_s: float) -> SteadyTask | None:
        """The motion until arrival, or after arrival until the hold time ends; None: the heading depends on
        the motion, or the trajectory does not follow the leg yet."""
        path, (target_n, target_e, _) = self._path, self.target_ned_m
        fixed_target = heading.fixed_target(self.target_ned_m, self.acceptance_m)
        if fixed_target is None or not path.follows(self._triplet):
            return None
        face_n, face_e, min_distance_m = fixed_target
        task = SteadyTask(
            Motion.LEG, path.cruise_m_s, path.climb_m_s, path.descent_m_s,
            face_north_m=face_n, face_east_m=face_e, face_min_distance_m=min_distance_m,
        )  # fmt: skip
        if arrived_at_s is not None:
            return task._replace(wait_start_s=arrived_at_s, wait_duration_s=hold_s)
        return task._replace(end_north_m=target_n, end_east_m=target_e, end_radius_m=self.acceptance_m)

    def fly(self) -> None:
        """Runs one tick along the leg."""
        self._path.fly_triplet(self._triplet)
