"""Landing: descends at the current position, slower near the ground.

The range finder measures the height above ground. Without a measurement, the altitude above the local
origin is used instead, and the crawl speed MPC_LAND_CRWL is not used.
"""

from __future__ import annotations

import math

from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.steady_task import Motion, SteadyTask
from vehicle_sim.vehicle_view import VehicleView


class Descent:
    """The flight task of mode Land, and of the last phase of a return."""

    def __init__(self, view: VehicleView, path: Path) -> None:
        self._view = view
        self._path = path

    def run(self) -> None:
        """Runs one tick of the descent."""
        advanced_s = self._path.advance_horizontal()
        self._path.advance_vertical_speed(self._land_speed(), advanced_s)
        self._path.write()

    def steady_task(self) -> SteadyTask | None:
        """The descent until ground contact; None while the vehicle still brakes horizontally."""
        return self._path.steady_task(Motion.DESCENT)

    def _land_speed(self) -> float:
        parameter = self._view.parameter
        estimate = self._view.estimate
        range_m = estimate.height_above_ground_m
        height_m = -estimate.position_ned_m[2] if math.isnan(range_m) else range_m
        fast, slow = parameter("MPC_Z_V_AUTO_DN"), parameter("MPC_LAND_SPEED")
        high_m, low_m = parameter("MPC_LAND_ALT1"), parameter("MPC_LAND_ALT2")
        if range_m <= parameter("MPC_LAND_ALT3"):
            return parameter("MPC_LAND_CRWL")
        if height_m >= high_m:
            return fast
        if height_m > low_m and high_m > low_m:
            return slow + (fast - slow) * (height_m - low_m) / (high_m - low_m)
        return slow
