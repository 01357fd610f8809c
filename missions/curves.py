"""Smooth curves through timed points: position, velocity and acceleration at any time.

The curves consist of cubic Hermite pieces. The slope (velocity) at a point is that of the parabola through
the point and its two neighbours. The slope is zero at both ends, so the curve starts and ends at rest.
Position and velocity are continuous.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3, wrap_pi
from missions.setpoints import Path, Trajectory


@dataclass(frozen=True, slots=True)
class PathCurve:
    """A path that can be sampled at any time; a frozen value, so that another process can receive it."""

    times_s: tuple[float, ...]
    positions_ned_m: tuple[Vector3, ...]
    slopes_ned_m_s: tuple[Vector3, ...]
    """Velocity at each point."""
    yaws_rad: tuple[float, ...]
    """Yaws without jumps of a full turn; empty if a point has no yaw."""
    default_yaw_rad: float | None

    @classmethod
    def of(cls, path: Path, default_yaw_rad: float | None) -> PathCurve:
        """The curve through a path.

        Args:
            path: at least two points, times increasing from 0.
            default_yaw_rad: the heading where points have no yaw.
        """
        times_s = tuple(point.t_s for point in path.points)
        positions_ned_m = tuple(point.position_ned_m for point in path.points)
        yaws_rad = _unwrapped([point.yaw_ned_rad for point in path.points])
        return cls(times_s, positions_ned_m, _slopes(times_s, positions_ned_m), yaws_rad, default_yaw_rad)

    @property
    def duration_s(self) -> float:
        """Time from the first point to the last."""
        return self.times_s[-1]

    @property
    def point_count(self) -> int:
        """Number of points of the path."""
        return len(self.times_s)

    def at(self, t_s: float) -> Trajectory:
        """The setpoint `t_s` after the start. Before the start: the first point at rest; after the end: the
        last point at rest."""
        if not 0.0 < t_s < self.times_s[-1]:
            end = 0 if t_s <= 0.0 else -1
            yaw = self.yaws_rad[end] if self.yaws_rad else self.default_yaw_rad
            return Trajectory(self.positions_ned_m[end], (0.0, 0.0, 0.0), yaw_ned_rad=yaw)
        index = bisect.bisect_right(self.times_s, t_s) - 1
        piece_s = self.times_s[index + 1] - self.times_s[index]
        u = (t_s - self.times_s[index]) / piece_s
        start, end = self.positions_ned_m[index], self.positions_ned_m[index + 1]
        slope, next_slope = self.slopes_ned_m_s[index], self.slopes_ned_m_s[index + 1]
        position, velocity, acceleration = (
            _vector(
                _hermite(order, u, piece_s, *values)
                for values in zip(start, slope, end, next_slope, strict=True)
            )
            for order in range(3)
        )
        yaw = self.default_yaw_rad
        if self.yaws_rad:
            yaw = wrap_pi(self.yaws_rad[index] + u * (self.yaws_rad[index + 1] - self.yaws_rad[index]))
        return Trajectory(position, velocity, acceleration, yaw)

    def sample(self, times_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions (N, 3) [m] and velocities (N, 3) [m/s] at N times within the path; same values as
        `at`."""
        times = np.array(self.times_s)
        positions, slopes = np.array(self.positions_ned_m), np.array(self.slopes_ned_m_s)
        index = np.clip(np.searchsorted(times, times_s, side="right") - 1, 0, len(times) - 2)
        h = (times[index + 1] - times[index])[:, None]
        u = (times_s[:, None] - times[index][:, None]) / h
        values = (u, h, positions[index], slopes[index], positions[index + 1], slopes[index + 1])
        return _hermite(0, *values), _hermite(1, *values)


def _slopes(times_s: Sequence[float], positions: Sequence[Vector3]) -> tuple[Vector3, ...]:
    """The slope at each point [m/s]; vectorised, since a path may have thousands of points."""
    spans = np.diff(np.array(times_s))[:, None]
    steps = np.diff(np.array(positions), axis=0)
    before, after = spans[:-1], spans[1:]
    slopes = np.zeros((len(times_s), 3))
    slopes[1:-1] = (steps[:-1] / before * after + steps[1:] / after * before) / (before + after)
    return tuple((n, e, d) for n, e, d in slopes.tolist())


def _hermite(order: int, u: Any, h: Any, p0: Any, m0: Any, p1: Any, m1: Any) -> Any:
    """The value (order 0), or the first or second time derivative of a piece, at one time or at an array of
    times.

    Args:
        order: 0, 1 or 2.
        u: fraction of the piece's duration, 0 to 1.
        h: the piece's duration [s].
        p0: position at the start of the piece.
        m0: slope at the start.
        p1: position at the end.
        m1: slope at the end.
    """
    if order == 0:
        return (
            (2 * u**3 - 3 * u**2 + 1) * p0
            + (u**3 - 2 * u**2 + u) * h * m0
            + (3 * u**2 - 2 * u**3) * p1
            + (u**3 - u**2) * h * m1
        )
    if order == 1:
        return (6 * u**2 - 6 * u) * (p0 - p1) / h + (3 * u**2 - 4 * u + 1) * m0 + (3 * u**2 - 2 * u) * m1
    return (12 * u - 6) * (p0 - p1) / h**2 + ((6 * u - 4) * m0 + (6 * u - 2) * m1) / h


def _vector(values: Iterable[float]) -> Vector3:
    x, y, z = values
    return (x, y, z)


def _unwrapped(yaws: list[float | None]) -> tuple[float, ...]:
    """The yaws without jumps of a full turn; empty if a point has no yaw."""
    unwrapped: list[float] = []
    for yaw in yaws:
        if yaw is None:
            return ()
        unwrapped.append(yaw if not unwrapped else unwrapped[-1] + wrap_pi(yaw - unwrapped[-1]))
    return tuple(unwrapped)
