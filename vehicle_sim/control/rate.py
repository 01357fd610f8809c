"""Body rate control: a PID on each axis gives normalised torques (mc_rate_control).

The derivative part uses the measured angular acceleration. The integral gain decreases at large errors, and
integration stops in the direction of saturation. The yaw torque passes a low-pass (MC_YAW_TQ_CUTOFF).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.kernels import Column, Flags, Rows, kernel
from vehicle_sim.parameters import Parameters
from vehicle_sim.rotations import constrain

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_MAX_INTEGRAL_ERROR_RAD_S = math.radians(400.0)
"""Rate error at which the integral gain has decreased to zero."""


class RateControl:
    """Body rate controllers of N vehicles.

    Args:
        count: N.
        dt_s: interval between two updates.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self.integral = np.zeros((count, 3))
        self._p = np.zeros((count, 3))
        self._integral_gain_dt = np.zeros((count, 3))
        """Integral gain times `dt_s`."""
        self._d = np.zeros((count, 3))
        self._ff = np.zeros((count, 3))
        self._integral_limit = np.zeros((count, 3))
        self._yaw_filter_gain = np.ones(count)
        self._yaw_torque = np.zeros(count)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads MC_*RATE_* of vehicle `i`."""
        for k, (axis, short_axis) in enumerate((("ROLL", "RR"), ("PITCH", "PR"), ("YAW", "YR"))):
            name = f"MC_{axis}RATE_"
            overall_gain = parameters.finite_value(name + "K")
            self._p[i, k] = overall_gain * parameters.finite_value(name + "P")
            self._integral_gain_dt[i, k] = overall_gain * parameters.finite_value(name + "I") * self._dt_s
            self._d[i, k] = overall_gain * parameters.finite_value(name + "D")
            self._ff[i, k] = parameters.finite_value(name + "FF")
            self._integral_limit[i, k] = parameters.finite_value(f"MC_{short_axis}_INT_LIM")
        cutoff_hz = parameters.finite_value("MC_YAW_TQ_CUTOFF")
        self._yaw_filter_gain[i] = (
            self._dt_s / (self._dt_s + 1.0 / (2.0 * math.pi * cutoff_hz)) if cutoff_hz > 0.0 else 1.0
        )

    def update(
        self, controlled: BoolArray, rates: FloatArray, acceleration: FloatArray, setpoint: FloatArray,
        landed: BoolArray, unallocated: FloatArray, torque: FloatArray,
    ) -> None:  # fmt: skip
        """Writes the normalised torques.

        Args:
            controlled: (N,) vehicles whose body rates are controlled; all others get zero torque.
            rates: (N, 3) filtered body rates.
            acceleration: (N, 3) filtered angular acceleration of the body.
            setpoint: (N, 3) rate setpoints.
            landed: (N,) vehicles on the ground; their integrators are not updated.
            unallocated: (N, 3) torque that the motors could not produce in the last step.
            torque: (N, 3) written.
        """
        _control_rates(
            controlled, rates, acceleration, setpoint, landed, unallocated, self._p, self._integral_gain_dt,
            self._d, self._ff, self._integral_limit, self._yaw_filter_gain, self.integral, self._yaw_torque,
            torque,
        )  # fmt: skip


@kernel
def _control_rates(
    controlled: Flags, rates: Rows, acceleration: Rows, setpoint: Rows, landed: Flags,
    unallocated: Rows, p: Rows, integral_gain_dt: Rows, d: Rows, feed_forward: Rows,
    max_integral: Rows, yaw_filter_gain: Column, integral: Rows, yaw_torque: Column, torque: Rows,
) -> None:  # fmt: skip
    for i in range(torque.shape[0]):
        if not controlled[i]:
            torque[i] = integral[i] = 0.0
            yaw_torque[i] = 0.0
            continue
        for k in range(3):
            error = setpoint[i, k] - rates[i, k]
            torque[i, k] = p[i, k] * error + integral[i, k] - d[i, k] * acceleration[i, k] + (
                feed_forward[i, k] * setpoint[i, k]
            )  # fmt: skip
            error_ratio = error / _MAX_INTEGRAL_ERROR_RAD_S
            increment = max(1.0 - error_ratio * error_ratio, 0.0) * error * integral_gain_dt[i, k]
            if landed[i] or unallocated[i, k] * increment > 0.0:
                increment = 0.0
            integral[i, k] = constrain(integral[i, k] + increment, -max_integral[i, k], max_integral[i, k])
        yaw_torque[i] += yaw_filter_gain[i] * (torque[i, 2] - yaw_torque[i])
        torque[i, 2] = yaw_torque[i]
