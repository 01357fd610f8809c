"""The hover thrust as PX4 estimates it: a one-state Kalman filter on vertical acceleration and thrust.

Where MPC_USE_HTE is off, on the ground and while the take-off ramp runs, MPC_THR_HOVER is used as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import GRAVITY_M_S2
from vehicle_sim.masks import any_of
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_FIRST_ACCELERATION_VARIANCE = 5.0
_NOISE_LEARNING_S = 2.0
_LEAST_NOISE_M2_S4 = 1.0
"""What the vibration of turning rotors leaves in PX4's vertical acceleration (1.4 m/s² over two samples)."""
_FAST_NOISE_FACTOR = 10.0
"""How much less a measurement counts at speeds where drag is mistaken for weight."""


class HoverThrust:
    """The estimates of N vehicles.

    Args:
        count: N.
        dt_s: interval between two updates.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self.value = np.full(count, 0.5)
        """(N,) the hover thrust to control with, 0..1."""
        self._default = np.full(count, 0.5)
        self._use = np.ones(count, dtype=np.bool_)
        self._variance = np.zeros(count)
        self._start_variance = np.zeros(count)
        self._process_variance = np.zeros(count)
        self._noise = np.full(count, _FIRST_ACCELERATION_VARIANCE)
        self._gate = np.ones(count)
        self._range = np.zeros(count)
        self._speed_limits = np.zeros((count, 2))

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read HTE_* and MPC_THR_HOVER of vehicle `i`."""

        def value(name: str) -> float:
            return parameters.usable(name)

        default = min(0.8, max(0.1, value("MPC_THR_HOVER")))
        if self._variance[i] == 0.0 or default != self._default[i]:
            self.value[i] = default
        self._default[i] = default
        self._use[i] = value("MPC_USE_HTE") != 0
        self._start_variance[i] = value("HTE_HT_ERR_INIT") ** 2
        if self._variance[i] == 0.0:
            self._variance[i] = self._start_variance[i]
        self._process_variance[i] = value("HTE_HT_NOISE") ** 2
        self._gate[i] = value("HTE_ACC_GATE")
        self._range[i] = value("HTE_THR_RANGE")
        self._speed_limits[i] = value("HTE_VXY_THR"), value("HTE_VZ_THR")

    def reset(self, mask: BoolArray) -> None:
        """Back to MPC_THR_HOVER for the vehicles in `mask`."""
        self.value[mask] = self._default[mask]
        self._variance[mask] = self._start_variance[mask]
        self._noise[mask] = _FIRST_ACCELERATION_VARIANCE

    def update(
        self,
        active: BoolArray,
        lift: FloatArray,
        acceleration_up_m_s2: FloatArray,
        velocity_ned_m_s: FloatArray,
    ) -> None:
        """Learn from one measurement.

        Args:
            active: (N,) flying under thrust control.
            lift: (N,) thrust setpoint times the cosine of the tilt.
            acceleration_up_m_s2: (N,).
            velocity_ned_m_s: (N, 3).
        """
        active = active & self._use
        if not any_of(active):
            return
        hover = self.value
        self._variance += self._process_variance * self._dt_s * self._dt_s
        slope = -GRAVITY_M_S2 * lift / (hover * hover)
        innovation = acceleration_up_m_s2 - GRAVITY_M_S2 * (lift / hover - 1.0)
        level = np.hypot(velocity_ned_m_s[:, 0], velocity_ned_m_s[:, 1])
        fast = (level > self._speed_limits[:, 0]) | (
            np.abs(velocity_ned_m_s[:, 2]) > self._speed_limits[:, 1]
        )
        noise = self._noise * np.where(fast, _FAST_NOISE_FACTOR, 1.0)
        total = np.maximum(slope * slope * self._variance + noise, 1e-6)
        gain = self._variance * slope / total
        good = active & (innovation * innovation < self._gate * self._gate * total)
        lowest = np.maximum(self._default - self._range, 0.1)
        highest = np.minimum(self._default + self._range, 0.9)
        learned = np.minimum(np.maximum(hover + gain * innovation, lowest), highest)
        np.copyto(hover, learned, where=good)
        narrower = np.minimum(np.maximum((1.0 - gain * slope) * self._variance, 1e-10), 1.0)
        np.copyto(self._variance, narrower, where=good)
        learn = self._dt_s / (_NOISE_LEARNING_S + self._dt_s)
        seen = np.minimum(np.maximum(innovation * innovation, _LEAST_NOISE_M2_S4), 40.0)
        np.copyto(self._noise, self._noise + learn * (seen - self._noise), where=active)
