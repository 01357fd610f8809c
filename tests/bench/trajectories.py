"""Trajectories through random points: this project's solver compared with installed libraries.

All solvers get the same points and limits (PX4's defaults). The libraries limit each axis separately, so the
limit of a vector is divided among the axes. The table shows the actual maxima, also of values that a library
does not limit.
"""

from __future__ import annotations

import importlib.util
import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from missions.trajectory.limits import MotionLimits
from missions.trajectory.points import PassPoint
from missions.trajectory.solve import curve_through_points

COUNTS = (10, 50, 200)
RUNS = 5
MAX_TOTAL_MS = 5000.0
"""No further run after this total time; the table has the fastest run."""
STEP_S = 0.01
CRUISE_M_S = 3.0
"""Assumed speed for the leg times of minimum snap, which are then stretched."""
LIMITS = MotionLimits(climb_m_s=1.5)
"""Equal limits up and down: the libraries have symmetric limits only."""
AXES_V = np.array([LIMITS.speed_m_s / math.sqrt(2)] * 2 + [LIMITS.descent_m_s])
AXES_A = np.array([LIMITS.acceleration_m_s2 / math.sqrt(2)] * 2 + [LIMITS.vertical_acceleration_m_s2])
AXES_J = np.full(3, LIMITS.jerk_m_s3 / math.sqrt(3))
"""Limits of speed, acceleration and jerk for each axis."""


@dataclass(frozen=True)
class Trajectory:
    """A solver's trajectory: velocity and acceleration every `STEP_S`, (N, 3)."""

    duration_s: float
    velocity: np.ndarray
    acceleration: np.ndarray


def positions(count: int, seed: int = 4) -> np.ndarray:
    """A random walk with steps of about 20 m, (N, 3)."""
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(0.0, 1.0, (count, 3)) * (15.0, 15.0, 2.0), axis=0)


def solve_with_bends(points: np.ndarray) -> Trajectory:
    return _solve([PassPoint(tuple(p), corner_m=2.0) for p in points.tolist()], exact=False)


def solve_exact(points: np.ndarray) -> Trajectory:
    return _solve([PassPoint(tuple(p)) for p in points.tolist()], exact=True)


def solve_with_stops(points: np.ndarray) -> Trajectory:
    return _solve([PassPoint(tuple(p), stop=True) for p in points.tolist()], exact=False)


def _solve(points: list[PassPoint], exact: bool) -> Trajectory:
    curve = curve_through_points(points, LIMITS, exact=exact)
    found = curve.sample(np.arange(0.0, curve.duration_s, STEP_S))
    return Trajectory(curve.duration_s, found.velocity_ned_m_s, found.acceleration_ned_m_s2)


def solve_minsnap(points: np.ndarray) -> Trajectory:
    """Minimum snap: leg times from trapezoidal speed profiles, all stretched until every limit is met."""
    import minsnap_trajectories as ms

    legs_m = np.linalg.norm(np.diff(points, axis=0), axis=1)
    times = np.concatenate(
        ([0.0], np.cumsum(np.sqrt(legs_m / LIMITS.acceleration_m_s2) + legs_m / CRUISE_M_S))
    )
    references = [ms.Waypoint(time=float(t), position=p) for t, p in zip(times, points, strict=True)]
    at_rest = np.zeros(3)
    for end in (0, -1):
        references[end] = ms.Waypoint(
            time=float(times[end]), position=points[end], velocity=at_rest, acceleration=at_rest
        )
    trajectory = ms.generate_trajectory(
        references, degree=7, idx_minimized_orders=4, num_continuous_orders=4, algorithm="closed-form"
    )
    t = np.arange(0.0, times[-1], STEP_S)
    values = ms.compute_trajectory_derivatives(trajectory, t, 4)
    v, a, j = values[1], values[2], values[3]
    stretch = max(
        worst_speed(v), math.sqrt(worst_acceleration(a)), np.cbrt(_norms(j).max() / LIMITS.jerk_m_s3)
    )
    return Trajectory(float(times[-1] * stretch), v / stretch, a / stretch**2)


def solve_toppra(points: np.ndarray) -> Trajectory:
    """toppra: limits of speed and acceleration, not of jerk."""
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    length = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    path = toppra.SplineInterpolator(length, points)
    limits = [
        constraint.JointVelocityConstraint(np.stack((-AXES_V, AXES_V), axis=1)),
        constraint.JointAccelerationConstraint(np.stack((-AXES_A, AXES_A), axis=1)),
    ]
    trajectory = algorithm.TOPPRA(limits, path, parametrizer="ParametrizeConstAccel").compute_trajectory()
    t = np.arange(0.0, trajectory.duration, STEP_S)
    return Trajectory(float(trajectory.duration), trajectory(t, 1), trajectory(t, 2))


def solve_ruckig(points: np.ndarray) -> Trajectory:
    """ruckig: from stop to stop, since its waypoints need a cloud service."""
    import ruckig

    solver = ruckig.Ruckig(3)
    duration_s, v, a = 0.0, [], []
    for start, end in itertools.pairwise(points):
        problem = ruckig.InputParameter(3)
        problem.current_position, problem.target_position = start.tolist(), end.tolist()
        problem.max_velocity, problem.max_acceleration = AXES_V.tolist(), AXES_A.tolist()
        problem.max_jerk = AXES_J.tolist()
        trajectory = ruckig.Trajectory(3)
        solver.calculate(problem, trajectory)
        for t in np.arange(0.0, trajectory.duration, STEP_S).tolist():
            _, velocity, acceleration = trajectory.at_time(t)
            v.append(velocity)
            a.append(acceleration)
        duration_s += trajectory.duration
    return Trajectory(duration_s, np.array(v), np.array(a))


def solve_clarabel(points: np.ndarray) -> Trajectory:
    """clarabel: the squared speed on a grid of this project's exact curve, as a cone program; without a jerk
    limit."""
    import clarabel
    from scipy import sparse

    from missions.trajectory import lines

    path = lines.smooth_curve([PassPoint(tuple(p)) for p in points.tolist()])
    first_derivative = np.concatenate((path.derivative(1)[:, 0, :3], path.derivative(1)[-1:, -1, :3]))
    second_derivative = np.concatenate((path.derivative(2)[:, 0, :3], path.derivative(2)[-1:, -1, :3]))
    n, h = len(first_derivative), path.spans
    acceleration_of = sparse.diags_array([-0.5 / h, 0.5 / h], offsets=[0, 1], shape=(n - 1, n))
    rows, bounds = [], []
    for axis in range(3):
        for end in (0, 1):  # both ends of each interval, in which the acceleration along the path is constant
            squared_speed_at_end = sparse.eye_array(n - 1, n, k=end)
            row = sparse.diags_array(first_derivative[end : n - 1 + end, axis]) @ acceleration_of
            row = row + sparse.diags_array(second_derivative[end : n - 1 + end, axis]) @ squared_speed_at_end
            rows += [row, -row]
            bounds += [np.full(2 * (n - 1), AXES_A[axis])]
    max_squared_speed = np.min(np.divide(AXES_V, np.abs(first_derivative) + 1e-12) ** 2, axis=1)
    max_squared_speed[[0, -1]] = 0.0
    rows += [sparse.eye_array(n), -sparse.eye_array(n)]
    bounds += [max_squared_speed, np.zeros(n)]
    matrix = sparse.csc_matrix(sparse.vstack(rows))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    zero = sparse.csc_matrix((n, n))
    limit = np.concatenate(bounds)
    cone = [clarabel.NonnegativeConeT(len(limit))]
    squared_speed = np.maximum(
        clarabel.DefaultSolver(zero, -np.ones(n), matrix, limit, cone, settings).solve().x, 0.0
    )
    speed = np.sqrt(squared_speed)
    steps_s = 2.0 * h / np.maximum(speed[1:] + speed[:-1], 1e-9)
    path_acceleration = np.diff(squared_speed) / (2.0 * h)
    a = first_derivative[:-1] * path_acceleration[:, None] + second_derivative[:-1] * squared_speed[:-1, None]
    times = np.concatenate(([0.0], np.cumsum(steps_s)))
    t = np.arange(0.0, times[-1], STEP_S)
    index = np.clip(np.searchsorted(times, t, side="right") - 1, 0, n - 2)
    return Trajectory(float(times[-1]), first_derivative[index] * speed[index][:, None], a[index])


def worst_speed(v: np.ndarray) -> float:
    """The largest speed as a part of its limit."""
    return float(
        max(np.hypot(v[:, 0], v[:, 1]).max() / LIMITS.speed_m_s, np.abs(v[:, 2]).max() / LIMITS.descent_m_s)
    )


def worst_acceleration(a: np.ndarray) -> float:
    """The largest acceleration as a part of its limit."""
    horizontal = np.hypot(a[:, 0], a[:, 1]).max() / LIMITS.acceleration_m_s2
    return float(max(horizontal, np.abs(a[:, 2]).max() / LIMITS.vertical_acceleration_m_s2))


def _norms(values: np.ndarray) -> np.ndarray:
    return np.sqrt((values**2).sum(axis=1))


SOLVERS: dict[str, tuple[str | None, str, Callable[[np.ndarray], Trajectory]]] = {
    "ours, bends of 2 m": (None, "acceleration", solve_with_bends),
    "ours, exact": (None, "acceleration", solve_exact),
    "ours, stops": (None, "acceleration", solve_with_stops),
    "minsnap-trajectories, exact": ("minsnap_trajectories", "snap", solve_minsnap),
    "toppra, exact": ("toppra", "velocity", solve_toppra),
    "ruckig, stops": ("ruckig", "acceleration", solve_ruckig),
    "clarabel, exact": ("clarabel", "velocity", solve_clarabel),
}
"""Name: the library it needs, the highest derivative that is continuous, and the solver."""


def table() -> Iterator[str]:
    """Rows of the table."""
    limits = "speed, acceleration, jerk / limit"
    yield f"| solver | points | CPU time [ms] | flight [s] | {limits} | continuous to |"
    yield "|---|---|---|---|---|---|"
    for name, (library, continuous_to, solve) in SOLVERS.items():
        if library is not None and importlib.util.find_spec(library) is None:
            yield f"| {name} | | not installed | | | |"
            continue
        for count in COUNTS:
            yield f"| {name} | {count} | {_row(solve, positions(count), continuous_to)}"


def _row(solve: Callable[[np.ndarray], Trajectory], points: np.ndarray, continuous_to: str) -> str:
    times_ms: list[float] = []
    flight: Any = None
    for _ in range(RUNS):
        before = time.process_time()
        try:
            flight = solve(points)
        except Exception as error:
            return f"failed: {error!s:.60} | | | |"
        times_ms.append(1000.0 * (time.process_time() - before))
        if sum(times_ms) > MAX_TOTAL_MS:
            break
    jerk = _norms(np.diff(flight.acceleration, axis=0)).max() / STEP_S / LIMITS.jerk_m_s3
    shares = f"{worst_speed(flight.velocity):.2f}, {worst_acceleration(flight.acceleration):.2f}, {jerk:.2f}"
    return f"{min(times_ms):.0f} | {flight.duration_s:.1f} | {shares} | {continuous_to} |"
