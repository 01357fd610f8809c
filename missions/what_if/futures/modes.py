"""PX4's own modes in the flights of a future: trajectories of Hold, Land and Orbit, all at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from missions.what_if.futures.circles import Circles
from missions.what_if.futures.commands import GoTo, Land, ModeCommand, Orbit
from missions.what_if.futures.start import Start
from vehicle_sim.autopilot.navigator import STOP_REACTION_S
from vehicle_sim.autopilot.path import FACING_YAW_MODES
from vehicle_sim.autopilot.smoothing import PREVIOUS, SETTINGS, TARGET, YAW_ACCELERATION_DEG_S2
from vehicle_sim.autopilot.steady import fly_tasks, task_row
from vehicle_sim.autopilot.tick_arrays import TILT, Motion, SteadyTask, TickArrays
from vehicle_sim.autopilot.trajectory import POSITION, VELOCITY, YAW, YAW_TARGET, max_speed_for_distance
from vehicle_sim.control.setpoints import ControlLevel, Setpoints
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import EstimateState

SLOW_M_S = 1.0
"""A vehicle in Hold that moves slower may keep its position."""
STAYS_M = 1.5
"""A vehicle in Hold this near to its target stays there."""
Values = NDArray[np.float64]
FACED_M = 1.0
"""The nose does not turn to a nearer target, as in `Path.face`."""


class ModeFlights:
    """The trajectories of N flights.

    Args:
        command: what is flown.
        start: the vehicle's state.
        store: its parameters.
        keeps_speed: (N,) see `Deviations`.
        estimate: estimates of the flights.
        setpoints: where the trajectories are written.
    """

    def __init__(
        self,
        command: ModeCommand,
        start: Start,
        store: Parameters,
        keeps_speed: NDArray[np.float64],
        estimate: EstimateState,
        setpoints: Setpoints,
    ) -> None:
        self._command, self._start, self._store = command, start, store
        self._estimate, self._setpoints = estimate, setpoints
        count = len(setpoints.level)
        continues = start.in_hold and isinstance(command, GoTo)
        self._turns_with_m_s, self._moves = (
            self._continued(keeps_speed) if continues else (np.zeros(count), np.ones(count))
        )
        """Speeds with which the trajectories may turn at first, and the part of the estimated velocity with
        which they begin."""
        self._arrays = TickArrays.for_count(count)
        settings = np.array([store.finite_value(name) for name in SETTINGS])
        if not store.px4.smooths_heading:
            settings[YAW_ACCELERATION_DEG_S2] = 0.0
        self._arrays.settings[:] = settings
        self._arrays.motion[:, TILT] = math.pi  # the limit that rises after a take-off has risen
        self._circles = Circles(command, store, estimate, setpoints) if isinstance(command, Orbit) else None
        self._tasks = np.zeros((count, len(task_row(_LEG, 0.0, 0.0))))
        self._heading_good = np.ones(count, dtype=np.bool_)

    def _continued(self, keeps_speed: Values) -> tuple[Values, Values]:
        """The same of trajectories that continue in Hold.

        A trajectory turns with the speed that it had as its limit before: PX4 slows down before its target.
        That of a vehicle that stays at its target is at rest, whatever the wind does with the vehicle.
        """
        start, cruise_m_s = self._start, self._value("MPC_XY_CRUISE")
        if start.hold_target_ned_m is None:
            slow = math.hypot(*start.velocity_ned_m_s) < SLOW_M_S
            return cruise_m_s * keeps_speed, keeps_speed if slow else np.ones_like(keeps_speed)
        north_m, east_m, _ = np.array(start.hold_target_ned_m) - start.position_ned_m
        away_m = math.hypot(north_m, east_m)
        limit_m_s = max_speed_for_distance(
            self._value("MPC_JERK_AUTO"), self._value("MPC_ACC_HOR"), away_m, 0.0
        )
        stays = math.dist(start.hold_target_ned_m, start.position_ned_m) < STAYS_M
        ones = np.ones_like(keeps_speed)
        return min(cruise_m_s, limit_m_s) * ones, 0.0 * ones if stays else ones

    def begin(self, rows: NDArray[np.bool_]) -> None:
        """The command arrives in these flights: the trajectory starts at the estimated motion."""
        arrays, estimate = self._arrays, self._estimate
        if self._circles is not None:
            self._circles.begin(rows)
        for row in np.flatnonzero(rows).tolist():
            position, velocity = estimate.position_ned_m[row], estimate.velocity_ned_m_s[row]
            arrays.axes[row] = 0.0
            arrays.axes[row, :, POSITION] = position
            arrays.axes[row, :, VELOCITY] = self._moves[row] * velocity
            arrays.before_turn_m_s[row] = self._turns_with_m_s[row]
            arrays.yaw[row] = 0.0
            arrays.yaw[row, YAW] = arrays.yaw[row, YAW_TARGET] = estimate.heading_rad[row]
            target, task = self._task(row, position.tolist(), velocity.tolist())
            arrays.triplet[row] = (
                *position.tolist(), *target, math.nan, math.nan, math.nan, self._value("NAV_ACC_RAD"),
            )  # fmt: skip
            self._tasks[row] = task_row(task, self._start.ground_down_m, 0.0)
        self._setpoints.level[rows] = ControlLevel.TRAJECTORY

    def fly(self, rows: NDArray[np.bool_]) -> None:
        """Advances the trajectories of these flights by one tick, and writes their setpoints."""
        arrays, estimate, setpoints = self._arrays, self._estimate, self._setpoints
        circles = self._circles
        if circles is not None:
            circles.fly(rows)
            rows = rows & ~circles.around
            arrays.triplet[rows, PREVIOUS : PREVIOUS + 3] = estimate.position_ned_m[rows]
            arrays.triplet[rows, TARGET : TARGET + 3] = circles.nearest_ned_m()[rows]
            direction, _ = circles.outward()
            arrays.yaw[rows, YAW_TARGET] = np.arctan2(-direction[rows, 1], -direction[rows, 0])
        # As the range finder measures it; far above the ground it measures nothing, nor is it used.
        height_m = self._start.ground_down_m - estimate.position_ned_m[:, 2]
        fly_tasks(
            np.flatnonzero(rows), self._tasks, arrays.axes, arrays.settings, arrays.triplet,
            arrays.before_turn_m_s, arrays.yaw, arrays.last_heading_rad, arrays.motion,
            estimate.position_ned_m, estimate.q_ned_frd, height_m, self._heading_good,
            setpoints.position_ned_m, setpoints.velocity_ned_m_s, setpoints.acceleration_ned_m_s2,
            setpoints.yaw_ned_rad, setpoints.yaw_rate_ned_rad_s, setpoints.tilt_limit_rad,
            setpoints.climb_limit_m_s,
        )  # fmt: skip

    def _task(self, row: int, position: list[float], velocity: list[float]) -> tuple[list[float], SteadyTask]:
        """Target and motion of a flight to which the command has come."""
        command = self._command
        if isinstance(command, Land):
            stop = self._stop(position, velocity)
            return [*stop[:2], position[2]], SteadyTask(Motion.DESCENT, math.nan, math.nan, math.nan)
        if not isinstance(command, GoTo):
            return self._stop(position, velocity), _LEG
        target, yaw = list(command.target_ned_m), self._arrays.yaw[row]
        speed = math.nan if command.speed_m_s is None else command.speed_m_s
        task = _LEG._replace(cruise_m_s=speed)
        if command.yaw_ned_rad is not None:
            yaw[YAW_TARGET] = command.yaw_ned_rad
            return target, task
        north_m, east_m = target[0] - position[0], target[1] - position[1]
        if int(self._store.get("MPC_YAW_MODE")) in FACING_YAW_MODES and math.hypot(north_m, east_m) > FACED_M:
            yaw[YAW_TARGET] = math.atan2(east_m, north_m)
            task = task._replace(
                face_north_m=target[0], face_east_m=target[1],
                face_min_distance_m=self._value("NAV_ACC_RAD"),
            )  # fmt: skip
        return target, task

    def _stop(self, position: list[float], velocity: list[float]) -> list[float]:
        """Where Hold stops the vehicle, as `Navigator` computes it."""
        speed = math.hypot(velocity[0], velocity[1])
        ahead_s = 0.5 * speed / max(0.1, self._value("MPC_ACC_HOR")) + STOP_REACTION_S
        return [position[0] + velocity[0] * ahead_s, position[1] + velocity[1] * ahead_s, position[2]]

    def _value(self, name: str) -> float:
        return self._store.finite_value(name)


_LEG = SteadyTask(Motion.LEG, math.nan, math.nan, math.nan)
