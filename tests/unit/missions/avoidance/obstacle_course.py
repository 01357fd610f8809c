"""A point mass that follows setpoints with PX4's lag, among boxes that a lidar measures."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.avoidance.avoider import Avoider
from missions.avoidance.scans import Scan
from missions.avoidance.values import AdjustedMotion, AvoidanceWay, DetourLimits, MotionState, WantedMotion
from missions.frames import Vector3
from missions.setpoints import Position

Array = NDArray[np.float64]

STEP_S = 0.05
SCAN_EVERY = 4
"""Steps from one scan to the next: 5 Hz."""
MAX_YAW_RATE_RAD_S = 1.0
VELOCITY_LAG_S, MAX_ACCELERATION_M_S2 = 0.5, 3.0
"""Time constant with which the vehicle follows a velocity setpoint, and its greatest acceleration."""
RANGE_M = 20.0
SECTORS = 72
_headings = np.arange(8) * math.pi / 4
DOWNWARD_RAYS = np.vstack(
    [
        [0.0, 0.0, 1.0],
        np.stack([0.5 * np.cos(_headings), 0.5 * np.sin(_headings), np.full(8, math.sqrt(0.75))], axis=1),
    ]
)
"""Rays of a downward sensor: a cone with a half-angle of 30°. A single ray would miss obstacles beside it."""


@dataclass(frozen=True)
class BoxObstacle:
    """An upright box on the ground with its sides along north and east."""

    north_m: tuple[float, float]
    east_m: tuple[float, float]
    height_m: float

    def distance_m(self, position_ned_m: Array) -> float:
        """Distance from a position to its nearest surface; zero inside."""
        n, e, d = position_ned_m
        return math.hypot(
            max(self.north_m[0] - n, 0.0, n - self.north_m[1]),
            max(self.east_m[0] - e, 0.0, e - self.east_m[1]),
            max(-d - self.height_m, 0.0),
        )

    def ray_distance_m(self, position_ned_m: Array, directions: Array) -> Array:
        """Distance (R,) along rays (R, 3) to the box; infinite for rays that miss it."""
        low = np.array([self.north_m[0], self.east_m[0], -self.height_m])
        high = np.array([self.north_m[1], self.east_m[1], 0.0])
        with np.errstate(divide="ignore", invalid="ignore"):
            to_low, to_high = (low - position_ned_m) / directions, (high - position_ned_m) / directions
        near = np.nanmax(np.minimum(to_low, to_high), axis=1)
        far = np.nanmin(np.maximum(to_low, to_high), axis=1)
        return np.where((far >= near) & (far >= 0.0), np.maximum(near, 0.0), np.inf)


def _vector(array: Array) -> Vector3:
    n, e, d = array.tolist()
    return n, e, d


class ObstacleFlight:
    """One flight among obstacles.

    Args:
        boxes: obstacles; the ground is at a down coordinate of 0.
        all_directions: whether the lidar measures in 72 directions; otherwise only straight ahead.
        down: whether there is a downward sensor.
        start: position at the start (NED).
        way: whether the vehicle avoids obstacles over or around them.
        limits: limits of the detour.
        drift_ned_m_s: error of the velocity estimate: true minus estimated velocity.
        vertical_noise_m_s: amplitude of an oscillation in the estimated vertical velocity.
    """

    def __init__(
        self,
        boxes: Iterable[BoxObstacle],
        *,
        start: Vector3 = (0.0, 0.0, -2.0),
        all_directions: bool = True,
        down: bool = True,
        way: AvoidanceWay = "over",
        limits: DetourLimits | None = None,
        drift_ned_m_s: Vector3 = (0.0, 0.0, 0.0),
        vertical_noise_m_s: float = 0.0,
    ) -> None:
        self.boxes = tuple(boxes)
        self.avoider = Avoider(way)
        self.limits = limits or DetourLimits()
        self.drift, self.vertical_noise_m_s = np.array(drift_ned_m_s), vertical_noise_m_s
        self.position_ned_m, self.velocity, self.yaw = np.array(start, float), np.zeros(3), 0.0
        self.now_s, self.steps = 100.0, 0
        self.all_directions, self.has_downward_sensor, self.sensors_are_off = all_directions, down, False
        self.scans: tuple[Scan, ...] = ()
        self.nearest_m, self.highest_m = math.inf, -math.inf
        self.states: list[str] = []
        self.adjusted = AdjustedMotion("clear")

    def _measure(self, directions: Array) -> tuple[float | None, ...]:
        distances_m = np.full(len(directions), np.inf)
        for box in self.boxes:
            distances_m = np.minimum(distances_m, box.ray_distance_m(self.position_ned_m, directions))
        with np.errstate(divide="ignore"):
            ground_m = np.where(directions[:, 2] > 1e-9, -self.position_ned_m[2] / directions[:, 2], np.inf)
        distances_m = np.minimum(distances_m, ground_m)
        return tuple(float(m) if m <= RANGE_M else None for m in distances_m)

    def _update_scans(self) -> None:
        headings = self.yaw + np.arange(SECTORS if self.all_directions else 1) * 2 * math.pi / SECTORS
        level_rays = np.stack([np.cos(headings), np.sin(headings), np.zeros(len(headings))], axis=1)
        self.scans = (self._make_scan(level_rays, math.radians(2.5)),)
        if self.has_downward_sensor:
            self.scans += (self._make_scan(DOWNWARD_RAYS, 0.0),)

    def _make_scan(self, directions: Array, half_angle_rad: float) -> Scan:
        rays = tuple((float(n), float(e), float(d)) for n, e, d in directions)
        return Scan(self.now_s, rays, self._measure(directions), RANGE_M, half_angle_rad)

    def step(self, requested: WantedMotion) -> None:
        """Simulates STEP_S with this requested motion."""
        if self.steps % SCAN_EVERY == 0 and not self.sensors_are_off:
            self._update_scans()
        noise_m_s = np.array([0.0, 0.0, self.vertical_noise_m_s * math.sin(7.0 * self.now_s)])
        state = MotionState(_vector(self.position_ned_m), _vector(self.velocity + noise_m_s), self.yaw)
        self.adjusted = self.avoider.adjust(self.now_s, state, requested, self.scans, self.limits)
        motion = self.adjusted.motion or Position(requested.position_ned_m)
        if isinstance(motion, Position):
            # PX4's defaults: MPC_XY_P 0.95, cruise 5 m/s, climb 3 m/s, descent 1.5 m/s.
            velocity_setpoint = 0.95 * (np.array(motion.position_ned_m) - self.position_ned_m)
            if self.adjusted.motion is None:
                velocity_setpoint += np.array(requested.velocity_ned_m_s)
            speed_m_s = math.hypot(velocity_setpoint[0], velocity_setpoint[1])
            velocity_setpoint[:2] *= min(1.0, 5.0 / speed_m_s) if speed_m_s else 1.0
            velocity_setpoint[2] = min(1.5, max(-3.0, velocity_setpoint[2]))
        else:
            velocity_setpoint = np.array(motion.velocity_ned_m_s)
        acceleration = (velocity_setpoint - self.velocity) / VELOCITY_LAG_S
        acceleration *= min(1.0, MAX_ACCELERATION_M_S2 / max(float(np.linalg.norm(acceleration)), 1e-9))
        self.velocity = self.velocity + acceleration * STEP_S
        self.position_ned_m = self.position_ned_m + (self.velocity + self.drift) * STEP_S
        yaw = requested.yaw_ned_rad if self.adjusted.yaw_ned_rad is None else self.adjusted.yaw_ned_rad
        yaw_error = 0.0 if yaw is None else (yaw - self.yaw + math.pi) % (2 * math.pi) - math.pi
        self.yaw += max(-MAX_YAW_RATE_RAD_S * STEP_S, min(MAX_YAW_RATE_RAD_S * STEP_S, yaw_error))
        self.nearest_m = min([self.nearest_m, *(box.distance_m(self.position_ned_m) for box in self.boxes)])
        self.highest_m = max(self.highest_m, -float(self.position_ned_m[2]))
        if not self.states or self.states[-1] != self.adjusted.state:
            self.states.append(self.adjusted.state)
        self.now_s += STEP_S
        self.steps += 1

    def fly(self, goal: Vector3, seconds: float = 60.0, yaw: float = 0.0) -> None:
        """Flies until the vehicle reaches the goal or this time is over."""
        for _ in range(round(seconds / STEP_S)):
            self.step(WantedMotion(goal, yaw_ned_rad=yaw))
            if self.adjusted.state == "clear" and math.dist(self.position_ned_m, goal) < 0.3:
                return

    def reached(self, goal: Vector3) -> bool:
        """Whether the vehicle is within 0.5 m of the goal."""
        return math.dist(self.position_ned_m, goal) < 0.5
