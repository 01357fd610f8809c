"""Take-off: climbs vertically to the commanded altitude."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.tick_arrays import Motion, SteadyTask
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import VehicleView

MIN_CLIMB_M = 0.2
"""A smaller climb does not start a take-off."""


class Climb:
    """The flight task of mode Takeoff."""

    def __init__(self, view: VehicleView, announcer: Announcer, path: Path, home: Home) -> None:
        self._view = view
        self._announcer = announcer
        self._path = path
        self._home = home
        self.alt_amsl_m = math.nan
        """Commanded altitude, kept until the climb begins; NaN: MIS_TAKEOFF_ALT above the vehicle."""

    def enter(self) -> None:
        """Sets the target to the commanded altitude or, without one, to MIS_TAKEOFF_ALT above the vehicle.

        A commanded altitude below the vehicle is replaced by the vehicle's altitude.
        """
        default_m = self._view.parameter("MIS_TAKEOFF_ALT")
        current_amsl_m = self._view.estimate.alt_amsl_m
        alt_amsl_m, self.alt_amsl_m = self.alt_amsl_m, math.nan
        if not math.isfinite(alt_amsl_m):
            alt_amsl_m = current_amsl_m + default_m
            self._announcer.announce(
                6,
                f"Using default takeoff altitude: {default_m:.1f} m",
                "navigator_takeoff_default_alt",
                "f",
                default_m,
            )
        elif alt_amsl_m < current_amsl_m:
            alt_amsl_m = current_amsl_m
            self._announcer.announce(
                2, "Already higher than takeoff altitude", "navigator_takeoff_already_higher"
            )
        self.begin(alt_amsl_m)

    @property
    def wants_to_climb(self) -> bool:
        """Whether the target altitude is above the vehicle; otherwise the vehicle stays on the ground."""
        down = self._path.target_ned_m[2]
        return down is not None and down < self._view.estimate.position_ned_m[2] - MIN_CLIMB_M

    def begin(self, alt_amsl_m: float) -> None:
        """Sets the target to this altitude at the current horizontal position; missions also call this."""
        north, east, _ = self._view.estimate.position_ned_m
        self._path.target_ned_m = (north, east, self._view.origin[2] - alt_amsl_m)

    @property
    def goal_alt_amsl_m(self) -> float:
        """The target altitude of the climb."""
        down = self._path.target_ned_m[2]
        return math.nan if down is None else self._view.origin[2] - down

    def steady_task(
        self, *, end_alt_amsl_m: float = math.inf, altitude_radius_m: float = math.nan
    ) -> SteadyTask | None:
        """Steady task that ends at an altitude AMSL, or within a radius of the target; None: no target
        yet."""
        task = self._path.steady_task(Motion.CLIMB)
        if task is None or math.isnan(task.target_down_m):
            return None
        if not math.isnan(altitude_radius_m):
            task = task._replace(end_down_m=task.target_down_m + altitude_radius_m)
        return task._replace(end_alt_amsl_m=end_alt_amsl_m)

    def run(self) -> None:
        """Runs one tick of the climb."""
        self._path.climb(self._home.position_ned_m[2])
