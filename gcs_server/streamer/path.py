"""A path through points in time as a smooth curve: position, velocity and acceleration at any moment.

Cubic Hermite pieces whose slopes at the points are those of the parabola through each three neighbours
(zero at both ends: it begins and ends standing), so that position and velocity are continuous.
"""

from __future__ import annotations

import bisect
import math

import numpy as np
from numpy.typing import NDArray

from gcs_server.streamer.setpoints import Path, Trajectory, Vector3


class Curve:
    """A path made ready to be sampled.

    Args:
        path: at least two points, times rising from 0.
        yaw_kept_rad: the heading where the path names none.
    """

    def __init__(self, path: Path, yaw_kept_rad: float | None) -> None:
        self._times = [point.t_s for point in path.points]
        self._places = [point.position_ned_m for point in path.points]
        self._slopes = _slopes(self._times, self._places)
        self._yaws = _unwrapped([point.yaw_ned_rad for point in path.points])
        self._yaw_kept_rad = yaw_kept_rad

    @property
    def duration_s(self) -> float:
        """From the first point to the last."""
        return self._times[-1]

    def at(self, t_s: float) -> Trajectory:
        """What to fly `t_s` after the begin; before and after the path its ends, standing."""
        if not 0.0 < t_s < self._times[-1]:
            end = 0 if t_s <= 0.0 else -1
            yaw = self._yaws[end] if self._yaws else self._yaw_kept_rad
            return Trajectory(self._places[end], (0.0, 0.0, 0.0), yaw_ned_rad=yaw)
        index = bisect.bisect_right(self._times, t_s) - 1
        long_s = self._times[index + 1] - self._times[index]
        u = (t_s - self._times[index]) / long_s
        begin, end = self._places[index], self._places[index + 1]
        slope, next_slope = self._slopes[index], self._slopes[index + 1]
        position, velocity, acceleration = (
            _vector(
                _hermite(order, u, long_s, *values)
                for values in zip(begin, slope, end, next_slope, strict=True)
            )
            for order in range(3)
        )
        yaw = self._yaw_kept_rad
        if self._yaws:
            yaw = math.remainder(
                self._yaws[index] + u * (self._yaws[index + 1] - self._yaws[index]), math.tau
            )
        return Trajectory(position, velocity, acceleration, yaw)

    def many(self, times_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions (N, 3) and velocities (N, 3) at many moments of the path, as `at` has them."""
        times = np.array(self._times)
        places, slopes = np.array(self._places), np.array(self._slopes)
        index = np.clip(np.searchsorted(times, times_s, side="right") - 1, 0, len(times) - 2)
        h = (times[index + 1] - times[index])[:, None]
        u = (times_s[:, None] - times[index][:, None]) / h
        p0, p1, m0, m1 = places[index], places[index + 1], slopes[index], slopes[index + 1]
        position = (
            (2 * u**3 - 3 * u**2 + 1) * p0
            + (u**3 - 2 * u**2 + u) * h * m0
            + (3 * u**2 - 2 * u**3) * p1
            + (u**3 - u**2) * h * m1
        )
        velocity = (6 * u**2 - 6 * u) * (p0 - p1) / h + (3 * u**2 - 4 * u + 1) * m0 + (3 * u**2 - 2 * u) * m1
        return position, velocity


def _slopes(times_s: list[float], places: list[Vector3]) -> list[Vector3]:
    """At each point; of all points at once, since a path may have thousands."""
    spans = np.diff(np.array(times_s))[:, None]
    steps = np.diff(np.array(places), axis=0)
    before, after = spans[:-1], spans[1:]
    slopes = np.zeros((len(times_s), 3))
    slopes[1:-1] = (steps[:-1] / before * after + steps[1:] / after * before) / (before + after)
    return [(n, e, d) for n, e, d in slopes.tolist()]


def _hermite(order: int, u: float, h: float, p0: float, m0: float, p1: float, m1: float) -> float:
    """A piece's value (order 0), first or second derivative by time."""
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


def _vector(values: object) -> Vector3:
    x, y, z = values  # type: ignore[misc]
    return (x, y, z)


def _unwrapped(yaws: list[float | None]) -> list[float]:
    """Each yaw as the nearest turn to the one before; empty where the path names none."""
    turned: list[float] = []
    for yaw in yaws:
        if yaw is None:
            return []
        turned.append(yaw if not turned else turned[-1] + math.remainder(yaw - turned[-1], math.tau))
    return turned
