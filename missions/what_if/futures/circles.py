"""The flights of a future that circle in PX4's Orbit mode, all at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from missions.what_if.futures.commands import ORBIT_YAWS, Orbit
from vehicle_sim.autopilot.path import TICK_S
from vehicle_sim.autopilot.tasks.orbit import ON_CIRCLE_M, RADIUS_GAIN_PER_S
from vehicle_sim.control.setpoints import Setpoints
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import EstimateState

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Circles:
    """The setpoints on a circle of N flights.

    Args:
        orbit: the circle.
        store: the vehicle's parameters.
        estimate: estimates of the flights.
        setpoints: where the setpoints are written.
    """

    def __init__(
        self, orbit: Orbit, store: Parameters, estimate: EstimateState, setpoints: Setpoints
    ) -> None:
        self._orbit, self._estimate, self._setpoints = orbit, estimate, setpoints
        self._altitude_m = store.finite_value("NAV_MC_ALT_RAD")
        self._speed_change_m_s = store.finite_value("MPC_ACC_HOR") * TICK_S
        choice = int(store.get("MC_ORBIT_YAW_MOD"))
        default = ORBIT_YAWS[choice] if 0 <= choice < len(ORBIT_YAWS) else "center"
        self._yaw = orbit.yaw or default
        count = len(setpoints.level)
        self.around = np.zeros(count, dtype=np.bool_)
        """(N,) flights that have reached the circle."""
        self._speed_m_s, self._down_m, self._yaw_rad = np.zeros(count), np.zeros(count), np.zeros(count)

    def begin(self, rows: Flags) -> None:
        """The command arrives in these flights, which keep their present heading if the circle lets them."""
        self._yaw_rad[rows] = self._estimate.heading_rad[rows]

    def outward(self) -> tuple[Values, Values]:
        """(N, 2) directions from the centre to the flights, and (N,) distances from it."""
        offset = self._estimate.position_ned_m[:, :2] - np.array(self._orbit.centre_ned_m[:2])
        distance_m = np.hypot(offset[:, 0], offset[:, 1])
        near = distance_m <= 0.01
        direction = offset / np.maximum(distance_m, 0.01)[:, None]
        direction[near] = (1.0, 0.0)
        return direction, distance_m

    def nearest_ned_m(self) -> Values:
        """(N, 3) nearest point of the circle."""
        direction, _ = self.outward()
        points = np.empty((len(direction), 3))
        points[:] = self._orbit.centre_ned_m
        points[:, :2] += self._orbit.radius_m * direction
        return points

    def fly(self, begun: Flags) -> None:
        """One tick of the flights that have reached the circle."""
        orbit, setpoints, position = self._orbit, self._setpoints, self._estimate.position_ned_m
        direction, distance_m = self.outward()
        reached = (
            begun & ~self.around & (np.abs(distance_m - orbit.radius_m) < ON_CIRCLE_M)
            & (np.abs(position[:, 2] - orbit.centre_ned_m[2]) < self._altitude_m)
        )  # fmt: skip
        self._down_m[reached] = position[reached, 2]
        self.around |= reached
        rows = self.around
        change = np.clip(orbit.speed_m_s - self._speed_m_s, -self._speed_change_m_s, self._speed_change_m_s)
        self._speed_m_s += np.where(rows, change, 0.0)
        north, east = direction[:, 0], direction[:, 1]
        radial, speed = RADIUS_GAIN_PER_S * (orbit.radius_m - distance_m), self._speed_m_s
        inward = -orbit.speed_m_s * orbit.speed_m_s / orbit.radius_m
        nan, zero = np.full(len(north), math.nan), np.zeros(len(north))
        setpoints.position_ned_m[rows] = np.stack([nan, nan, self._down_m], axis=1)[rows]
        velocity = np.stack([north * radial - east * speed, east * radial + north * speed, zero], axis=1)
        setpoints.velocity_ned_m_s[rows] = velocity[rows]
        setpoints.acceleration_ned_m_s2[rows] = np.stack([north * inward, east * inward, nan], axis=1)[rows]
        outward_rad = np.arctan2(east, north)
        turn_rad_s = orbit.speed_m_s / orbit.radius_m
        if self._yaw == "uncontrolled":
            yaw_rad, turn_rad_s = nan, math.nan
        elif self._yaw == "initial":
            yaw_rad, turn_rad_s = self._yaw_rad, 0.0
        elif self._yaw == "tangent":
            yaw_rad = outward_rad + math.copysign(0.5 * math.pi, orbit.speed_m_s)
        else:
            yaw_rad = outward_rad + math.pi
        setpoints.yaw_ned_rad[rows] = yaw_rad[rows]
        setpoints.yaw_rate_ned_rad_s[rows] = turn_rad_s
