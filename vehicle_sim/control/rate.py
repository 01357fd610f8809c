"""Body rate control: a PID on each axis gives normalised torques (mc_rate_control).

The derivative works on the measured angular acceleration, the integrator fades at large errors and stops
towards a saturated axis, and the yaw torque passes a low-pass (MC_YAW_TQ_CUTOFF).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.masks import any_nonzero, any_of
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_INTEGRAL_FADE_RAD_S = math.radians(400.0)
# Arrays without dimensions: NumPy takes twice as long to multiply with a plain number.
_FADE = np.array(1.0 / _INTEGRAL_FADE_RAD_S)
_ZERO = np.array(0.0)
_ONE = np.array(1.0)


class RateControl:
    """Gains and integrators of N vehicles.

    Args:
        count: N.
        dt_s: interval between two updates.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self.integral = np.zeros((count, 3))
        self._p = np.zeros((count, 3))
        self._i_dt = np.zeros((count, 3))
        self._d = np.zeros((count, 3))
        self._ff = np.zeros((count, 3))
        self._feeds_forward = False
        self._limit = np.zeros((count, 3))
        self._least = np.zeros((count, 3))
        self._yaw_gain = np.ones(count)
        self._yaw_torque = np.zeros(count)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read MC_*RATE_* of vehicle `i`."""
        for k, (axis, short) in enumerate((("ROLL", "RR"), ("PITCH", "PR"), ("YAW", "YR"))):
            name = f"MC_{axis}RATE_"
            overall = parameters.usable(name + "K")
            self._p[i, k] = overall * parameters.usable(name + "P")
            self._i_dt[i, k] = overall * parameters.usable(name + "I") * self._dt_s
            self._d[i, k] = overall * parameters.usable(name + "D")
            self._ff[i, k] = parameters.usable(name + "FF")
            self._limit[i, k] = parameters.usable(f"MC_{short}_INT_LIM")
        self._least[i] = -self._limit[i]
        self._feeds_forward = any_nonzero(self._ff)
        cutoff_hz = parameters.usable("MC_YAW_TQ_CUTOFF")
        self._yaw_gain[i] = (
            self._dt_s / (self._dt_s + 1.0 / (2.0 * math.pi * cutoff_hz)) if cutoff_hz > 0.0 else 1.0
        )

    def reset(self, mask: BoolArray) -> None:
        """Forget what was integrated for the vehicles in `mask`."""
        self.integral[mask] = 0.0
        self._yaw_torque[mask] = 0.0

    def update(
        self,
        rates: FloatArray,
        acceleration: FloatArray,
        wanted: FloatArray,
        landed: BoolArray,
        short_of: FloatArray,
    ) -> FloatArray:
        """Normalised torques (N, 3).

        Args:
            rates: (N, 3) filtered body rates.
            acceleration: (N, 3) filtered angular acceleration.
            wanted: (N, 3) rate setpoints.
            landed: (N,) do not integrate.
            short_of: (N, 3) torque that the motors could not give in the last step.
        """
        error = wanted - rates
        torque = self._p * error
        torque += self.integral
        torque -= self._d * acceleration
        if self._feeds_forward:
            torque += self._ff * wanted
        yaw, yaw_torque = self._yaw_torque, torque[:, 2]
        yaw += self._yaw_gain * (yaw_torque - yaw)
        yaw_torque[:] = yaw

        faded = error * _FADE
        growth = np.maximum(_ONE - faded * faded, _ZERO) * error * self._i_dt
        if any_of(landed):
            growth[landed] = 0.0
        if any_nonzero(short_of):
            np.copyto(growth, _ZERO, where=short_of * growth > _ZERO)
        self.integral += growth
        np.minimum(self.integral, self._limit, out=self.integral)
        np.maximum(self.integral, self._least, out=self.integral)
        return torque
