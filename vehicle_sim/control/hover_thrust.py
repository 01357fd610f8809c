"""The hover thrust as PX4 estimates it: a one-state Kalman filter on vertical acceleration and thrust.

On the ground and during the take-off ramp, or if MPC_USE_HTE is off, MPC_THR_HOVER is used unchanged.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import GRAVITY_M_S2
from vehicle_sim.kernels import Column, Flags, Rows, kernel
from vehicle_sim.parameters import Parameters
from vehicle_sim.rotations import constrain

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_INITIAL_NOISE_M2_S4 = 5.0
_NOISE_TIME_CONSTANT_S = 2.0
_MIN_NOISE_M2_S4 = 1.0
"""Lower limit of the noise variance: PX4's vertical acceleration contains rotor vibration (1.4 m/s², mean of
two samples)."""
_MAX_NOISE_M2_S4 = 40.0
_FAST_NOISE_FACTOR = 10.0
"""Factor on the measurement noise at high speed, where drag acts like additional weight."""


class HoverThrust:
    """The estimates of N vehicles.

    Args:
        count: N.
        dt_s: interval between two updates.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self.value = np.full(count, 0.5)
        """(N,) hover thrust that the controllers use, 0..1."""
        self._default = np.full(count, 0.5)
        self._enabled = np.ones(count, dtype=np.bool_)
        self._variance = np.zeros(count)
        self._start_variance = np.zeros(count)
        self._process_variance = np.zeros(count)
        self._noise = np.full(count, _INITIAL_NOISE_M2_S4)
        self._gate = np.ones(count)
        self._thrust_range = np.zeros(count)
        self._speed_limits = np.zeros((count, 2))

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads HTE_* and MPC_THR_HOVER of vehicle `i`."""

        def value(name: str) -> float:
            return parameters.finite_value(name)

        default = min(0.8, max(0.1, value("MPC_THR_HOVER")))
        if self._variance[i] == 0.0 or default != self._default[i]:
            self.value[i] = default
        self._default[i] = default
        self._enabled[i] = value("MPC_USE_HTE") != 0
        self._start_variance[i] = value("HTE_HT_ERR_INIT") ** 2
        if self._variance[i] == 0.0:
            self._variance[i] = self._start_variance[i]
        self._process_variance[i] = value("HTE_HT_NOISE") ** 2
        self._gate[i] = value("HTE_ACC_GATE")
        self._thrust_range[i] = value("HTE_THR_RANGE")
        self._speed_limits[i] = value("HTE_VXY_THR"), value("HTE_VZ_THR")

    def reset(self, rows: BoolArray) -> None:
        """Resets the estimates of the vehicles in `rows` (N,) to MPC_THR_HOVER."""
        _reset(rows, self._default, self._start_variance, self.value, self._variance, self._noise)

    def update(
        self,
        active: BoolArray,
        lift: FloatArray,
        acceleration_up_m_s2: FloatArray,
        velocity_ned_m_s: FloatArray,
    ) -> None:
        """Updates the estimates with one measurement.

        Args:
            active: (N,) vehicles in flight at level TRAJECTORY.
            lift: (N,) thrust setpoint times the cosine of the tilt.
            acceleration_up_m_s2: (N,).
            velocity_ned_m_s: (N, 3).
        """
        _update(
            self._dt_s, active, self._enabled, lift, acceleration_up_m_s2, velocity_ned_m_s, self._default,
            self._process_variance, self._gate, self._thrust_range, self._speed_limits, self.value,
            self._variance, self._noise,
        )  # fmt: skip


@kernel
def _reset(
    rows: Flags, default: Column, start_variance: Column, value: Column,
    variance: Column, noise: Column,
) -> None:  # fmt: skip
    for i in range(value.shape[0]):
        if rows[i]:
            value[i], variance[i], noise[i] = default[i], start_variance[i], _INITIAL_NOISE_M2_S4


@kernel
def _update(
    dt_s: float, active: Flags, enabled: Flags, lift: Column, acceleration_up_m_s2: Column,
    velocity: Rows, default: Column, process_variance: Column, gate: Column,
    thrust_range: Column, speed_limits: Rows, value: Column, variance: Column, noise: Column,
) -> None:  # fmt: skip
    weight = dt_s / (_NOISE_TIME_CONSTANT_S + dt_s)
    for i in range(value.shape[0]):
        if not (active[i] and enabled[i]):
            continue
        hover = value[i]
        variance[i] += process_variance[i] * dt_s * dt_s
        sensitivity = -GRAVITY_M_S2 * lift[i] / (hover * hover)
        innovation = acceleration_up_m_s2[i] - GRAVITY_M_S2 * (lift[i] / hover - 1.0)
        horizontal_speed = math.sqrt(velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1])
        fast = horizontal_speed > speed_limits[i, 0] or abs(velocity[i, 2]) > speed_limits[i, 1]
        measurement_noise = noise[i] * (_FAST_NOISE_FACTOR if fast else 1.0)
        innovation_variance = max(sensitivity * sensitivity * variance[i] + measurement_noise, 1e-6)
        gain = variance[i] * sensitivity / innovation_variance
        if innovation * innovation < gate[i] * gate[i] * innovation_variance:
            lowest, highest = max(default[i] - thrust_range[i], 0.1), min(default[i] + thrust_range[i], 0.9)
            value[i] = min(max(hover + gain * innovation, lowest), highest)
            variance[i] = constrain((1.0 - gain * sensitivity) * variance[i], 1e-10, 1.0)
        noise_sample = constrain(innovation * innovation, _MIN_NOISE_M2_S4, _MAX_NOISE_M2_S4)
        noise[i] += weight * (noise_sample - noise[i])
