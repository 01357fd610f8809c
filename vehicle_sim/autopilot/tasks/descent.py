"""Landing: down where the vehicle is, slower near the ground."""

from __future__ import annotations

from vehicle_sim.autopilot.body import Body
from vehicle_sim.autopilot.home import Home
from vehicle_sim.autopilot.path import Path

RANGE_FINDER_HEIGHT_M = 0.2
"""What PX4's range finder reads on the ground: it slows down so much lower than MPC_LAND_ALT3."""


class Descent:
    """The flight task of mode Land, and the last part of a return."""

    def __init__(self, body: Body, path: Path, home: Home) -> None:
        self._body = body
        self._path = path
        self._home = home

    def run(self) -> None:
        """One tick of the descent."""
        self._path.advance_horizontal()
        self._path.z_towards(self._land_speed())
        self._path.keep_near()
        self._path.write()

    def height_above_ground_m(self) -> float:
        """Over where the vehicle took off (it has no working range finder)."""
        return self._home.position_ned_m[2] - self._body.belief.position_ned_m[2]

    def _land_speed(self) -> float:
        parameter = self._body.parameter
        height = self.height_above_ground_m()
        fast, slow = parameter("MPC_Z_V_AUTO_DN"), parameter("MPC_LAND_SPEED")
        high, low = parameter("MPC_LAND_ALT1"), parameter("MPC_LAND_ALT2")
        if height >= high:
            return fast
        if height > low and high > low:
            return slow + (fast - slow) * (height - low) / (high - low)
        if height <= parameter("MPC_LAND_ALT3") - RANGE_FINDER_HEIGHT_M:
            return min(slow, parameter("MPC_LAND_CRWL"))
        return slow
