"""A trajectory that can be sampled at any time. It consists of constant arrays, so that another process can
receive it.

Position, velocity, acceleration, yaw and yaw rate are continuous; the jerk is limited, but not continuous.
The trajectory starts and ends at rest.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from missions.frames import wrap_pi
from missions.setpoints import Trajectory

Array = NDArray[np.float64]
Piece = tuple[float, float, float, tuple[tuple[float, ...], ...]]
"""Start, span and squared span of one piece, and for each axis the coefficients c0 to c5, then 2 c2, 3 c3,
4 c4, 6 c3 and 12 c4 for the derivatives."""
Phase = tuple[float, float, float, float, float]
"""Start time of one phase; path parameter, its speed and acceleration at that time, and its jerk."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """A trajectory at N times. If the trajectory has no yaw, yaw and yaw rate are zero."""

    position_ned_m: Array
    """(N, 3); velocity and acceleration too."""
    velocity_ned_m_s: Array
    acceleration_ned_m_s2: Array
    yaw_ned_rad: Array
    """(N,), without jumps of a full turn."""
    yaw_rate_ned_rad_s: Array


@dataclass(frozen=True, slots=True, eq=False)
class TimedCurve:
    """A path of polynomial pieces, and the path parameter as a function of time."""

    coefficients: Array
    """(N pieces, 6 powers, 4 axes) polynomial coefficients for north, east, down [m] and yaw [rad]; the
    variable goes from 0 to 1 in a piece."""
    starts: Array
    """(N,) path parameter at the start of each piece."""
    spans: Array
    """(N,) length of each piece in the path parameter."""
    phase_start_s: Array
    """(K,) start time of each phase; the path parameter has constant jerk in a phase."""
    phase_parameter: Array
    """(K,) path parameter at the start of each phase. The next three fields are its derivatives by time:
    speed and acceleration at the start of the phase, and the constant jerk."""
    phase_speed: Array
    phase_acceleration: Array
    phase_jerk: Array
    duration_s: float
    length_m: float
    """Length of the path."""
    point_times_s: tuple[float, ...]
    """Time at each given point; at a rounded corner, the time at the middle of the bend."""
    has_yaw: bool
    _pieces: dict[int, Piece] = field(default_factory=dict[int, Piece], init=False, repr=False)
    _phases: dict[int, Phase] = field(default_factory=dict[int, Phase], init=False, repr=False)
    """Pieces and phases that `at` has used, as plain numbers, which are faster to read than elements of
    arrays."""

    def at(self, t_s: float) -> Trajectory:
        """The setpoint `t_s` after the start; before the start: the first point at rest; after the end: the
        last point at rest."""
        # For one number, bisect on the memory of an array is several times as fast as NumPy.
        ended = t_s >= self.duration_s
        if ended or t_s <= 0.0:
            u, v, a = (float(self.starts[-1] + self.spans[-1]) if ended else 0.0), 0.0, 0.0
        else:
            k = bisect_right(self.phase_start_s.data, t_s) - 1
            start_s, u0, v0, a0, j = self._phases.get(k) or self._read_phase(k)
            dt = t_s - start_s
            u = u0 + dt * (v0 + dt * (a0 / 2.0 + dt * j / 6.0))
            v = v0 + dt * (a0 + dt * j / 2.0)
            a = a0 + dt * j
        n = max(0, bisect_right(self.starts.data, u) - 1)
        start, span, span_squared, axes = self._pieces.get(n) or self._read_piece(n)
        x = min(1.0, (u - start) / span)
        x5, x20 = x * 5, x * 20
        position: list[float] = []
        first_derivative: list[float] = []
        second_derivative: list[float] = []
        for c0, c1, c2, c3, c4, c5, c2_2, c3_3, c4_4, c3_6, c4_12 in axes:
            position.append(c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5)))))
            first_derivative.append((c1 + x * (c2_2 + x * (c3_3 + x * (c4_4 + x5 * c5)))) / span)
            second_derivative.append((c2_2 + x * (c3_6 + x * (c4_12 + x20 * c5))) / span_squared)
        north, east, down, yaw = position
        v_squared = v * v
        return Trajectory(
            (north, east, down),
            (first_derivative[0] * v, first_derivative[1] * v, first_derivative[2] * v),
            (
                second_derivative[0] * v_squared + first_derivative[0] * a,
                second_derivative[1] * v_squared + first_derivative[1] * a,
                second_derivative[2] * v_squared + first_derivative[2] * a,
            ),
            wrap_pi(yaw) if self.has_yaw else None,
            first_derivative[3] * v if self.has_yaw else None,
        )

    def _read_phase(self, k: int) -> Phase:
        phase = self._phases[k] = (
            self.phase_start_s.item(k), self.phase_parameter.item(k), self.phase_speed.item(k),
            self.phase_acceleration.item(k), self.phase_jerk.item(k),
        )  # fmt: skip
        return phase

    def _read_piece(self, n: int) -> Piece:
        span = self.spans.item(n)
        axes = tuple(
            (*c, 2 * c[2], 3 * c[3], 4 * c[4], 6 * c[3], 12 * c[4]) for c in self.coefficients[n].T.tolist()
        )
        piece = self._pieces[n] = (self.starts.item(n), span, span**2, axes)
        return piece

    def sample(self, times_s: Array) -> Samples:
        """The trajectory at many times; the same values as `at`."""
        t = np.clip(np.asarray(times_s, dtype=float), 0.0, self.duration_s)
        if len(self.phase_start_s):
            k = np.maximum(self.phase_start_s.searchsorted(t, side="right") - 1, 0)
            dt = t - self.phase_start_s[k]
            v0, a0, j = self.phase_speed[k], self.phase_acceleration[k], self.phase_jerk[k]
            u = self.phase_parameter[k] + dt * (v0 + dt * (a0 / 2.0 + dt * j / 6.0))
            v, a = v0 + dt * (a0 + dt * j / 2.0), a0 + dt * j
        else:
            u = v = a = np.zeros_like(t)
        outside = (t <= 0.0) | (t >= self.duration_s)
        v, a = np.where(outside, 0.0, v), np.where(outside, 0.0, a)
        n = np.maximum(self.starts.searchsorted(u, side="right") - 1, 0)
        x = np.minimum((u - self.starts[n]) / self.spans[n], 1.0)[:, None]
        c, span = np.moveaxis(self.coefficients[n], 1, 0), self.spans[n][:, None]
        position = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))
        first_derivative = (c[1] + x * (2 * c[2] + x * (3 * c[3] + x * (4 * c[4] + x * 5 * c[5])))) / span
        second_derivative = (2 * c[2] + x * (6 * c[3] + x * (12 * c[4] + x * 20 * c[5]))) / span**2
        velocity = first_derivative * v[:, None]
        acceleration = second_derivative * (v * v)[:, None] + first_derivative * a[:, None]
        return Samples(position[:, :3], velocity[:, :3], acceleration[:, :3], position[:, 3], velocity[:, 3])

    def time_at(self, parameter: float) -> float:
        """The time at which the path parameter is reached [s]."""
        if not len(self.phase_start_s) or parameter <= 0.0:
            return 0.0
        if parameter >= float(self.starts[-1] + self.spans[-1]):
            return self.duration_s
        k = max(0, int(self.phase_parameter.searchsorted(parameter, side="right")) - 1)
        end_s = float(self.phase_start_s[k + 1]) if k + 1 < len(self.phase_start_s) else self.duration_s
        low_s, high_s = 0.0, end_s - float(self.phase_start_s[k])
        v, a, j = float(self.phase_speed[k]), float(self.phase_acceleration[k]), float(self.phase_jerk[k])
        distance = parameter - float(self.phase_parameter[k])
        for _ in range(50):
            dt = (low_s + high_s) / 2.0
            is_too_short = dt * (v + dt * (a / 2.0 + dt * j / 6.0)) < distance
            low_s, high_s = (dt, high_s) if is_too_short else (low_s, dt)
        return float(self.phase_start_s[k]) + low_s
