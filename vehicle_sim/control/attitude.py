"""Attitude control: the attitude error becomes body rates (mc_att_control).

Tilt first: the shortest turn that brings the thrust axis where it should point, then as much yaw as
MC_YAW_WEIGHT lets through.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import conjugate, quaternion_product, row_norm
from vehicle_sim.masks import any_nonzero, any_of
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]

# Arrays without dimensions: NumPy takes twice as long to multiply with a plain number.
_OPPOSITE = np.array(1e-6)
_ZERO = np.array(0.0)
_TWO = np.array(2.0)


class AttitudeControl:
    """Gains of N vehicles.

    Args:
        count: N.
    """

    def __init__(self, count: int) -> None:
        self._gain = np.zeros((count, 3))
        self._yaw_weight = np.ones(count)
        self._limit = np.zeros((count, 3))
        self._least = np.zeros((count, 3))

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read MC_* of vehicle `i`."""

        def value(name: str) -> float:
            return parameters.usable(name)

        weight = min(1.0, max(0.0, value("MC_YAW_WEIGHT")))
        self._yaw_weight[i] = weight
        yaw_gain = value("MC_YAW_P") / weight if weight > 1e-4 else value("MC_YAW_P")
        self._gain[i] = value("MC_ROLL_P"), value("MC_PITCH_P"), yaw_gain
        self._limit[i] = [math.radians(value(f"MC_{axis}RATE_MAX")) for axis in ("ROLL", "PITCH", "YAW")]
        self._least[i] = -self._limit[i]

    def update(self, q: FloatArray, wanted: FloatArray, yaw_rate_ned_rad_s: FloatArray) -> FloatArray:
        """Body rate setpoints (N, 3).

        Args:
            q: (N, 4) attitude.
            wanted: (N, 4) attitude setpoint.
            yaw_rate_ned_rad_s: (N,) feed-forward about the vertical; NaN is none.
        """
        error = quaternion_product(conjugate(q), wanted)
        w, x, y, z = error[:, 0], error[:, 1], error[:, 2], error[:, 3]
        # The wanted thrust axis seen from the body gives the pure tilt: error = tilt ⊗ twist about z.
        norm = np.sqrt(w * w + z * z)
        safe = np.maximum(norm, _OPPOSITE)
        half_yaw = np.arctan2(np.where(w < _ZERO, -z, z), np.abs(w)) * self._yaw_weight
        cos_half, sin_half = np.cos(half_yaw), np.sin(half_yaw)
        reduced = np.empty_like(error)
        tilt_x = (w * x - y * z) / safe
        tilt_y = (w * y + x * z) / safe
        reduced[:, 0] = norm * cos_half
        reduced[:, 1] = tilt_x * cos_half + tilt_y * sin_half
        reduced[:, 2] = tilt_y * cos_half - tilt_x * sin_half
        reduced[:, 3] = norm * sin_half
        opposite = norm < _OPPOSITE
        if any_of(opposite):
            reduced[opposite] = error[opposite] * np.where(error[opposite, :1] < 0.0, -1.0, 1.0)
        reduced /= row_norm(reduced)
        rates = _TWO * reduced[:, 1:] * self._gain
        turns = np.isfinite(yaw_rate_ned_rad_s)
        if any_of(turns):
            turn = np.where(turns, yaw_rate_ned_rad_s, _ZERO)
            if any_nonzero(turn):
                rates += _down_in_body(q) * turn[:, None]
        return np.minimum(np.maximum(rates, self._least), self._limit)


def _down_in_body(q: FloatArray) -> FloatArray:
    """The NED z axis in FRD, (N, 3)."""
    w, x, y, z = q[:, 0], q[:, 1], q[:, 2], q[:, 3]
    return np.stack(
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
        axis=1,
    )
