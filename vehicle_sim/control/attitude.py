"""Attitude control: the attitude error becomes body rate setpoints (mc_att_control).

Tilt has priority: the vehicle turns by the shortest rotation that aligns the thrust axes, and by the part of
the yaw rotation that MC_YAW_WEIGHT allows.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.kernels import Column, Flags, Rows, kernel
from vehicle_sim.parameters import Parameters
from vehicle_sim.rotations import constrain, quaternion_product

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_MIN_COS_HALF_TILT = 1e-6
"""Below this value the thrust axes are opposite, and the yaw part of the rotation is undefined."""


class AttitudeControl:
    """Attitude controllers of N vehicles.

    Args:
        count: N.
    """

    def __init__(self, count: int) -> None:
        self._gain = np.zeros((count, 3))
        self._yaw_weight = np.ones(count)
        self._limit = np.zeros((count, 3))

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads MC_* of vehicle `i`."""

        def value(name: str) -> float:
            return parameters.finite_value(name)

        weight = min(1.0, max(0.0, value("MC_YAW_WEIGHT")))
        self._yaw_weight[i] = weight
        yaw_gain = value("MC_YAW_P") / weight if weight > 1e-4 else value("MC_YAW_P")
        self._gain[i] = value("MC_ROLL_P"), value("MC_PITCH_P"), yaw_gain
        self._limit[i] = [math.radians(value(f"MC_{axis}RATE_MAX")) for axis in ("ROLL", "PITCH", "YAW")]

    def update(
        self, controlled: BoolArray, q: FloatArray, q_setpoint: FloatArray, yaw_rate_ned_rad_s: FloatArray,
        rates: FloatArray,
    ) -> None:  # fmt: skip
        """Writes the body rate setpoints.

        Args:
            controlled: (N,) vehicles whose attitude is controlled; other rows are not changed.
            q: (N, 4) attitude.
            q_setpoint: (N, 4) attitude setpoint.
            yaw_rate_ned_rad_s: (N,) feed-forward about the NED down axis; NaN: no feed-forward.
            rates: (N, 3) written.
        """
        _rotate_towards(
            controlled, q, q_setpoint, yaw_rate_ned_rad_s, self._gain, self._yaw_weight, self._limit, rates
        )


@kernel
def _rotate_towards(
    controlled: Flags, attitude: Rows, q_setpoint: Rows, yaw_rate_ned_rad_s: Column,
    gain: Rows, yaw_weight: Column, limit: Rows, rates: Rows,
) -> None:  # fmt: skip
    for i in range(rates.shape[0]):
        if not controlled[i]:
            continue
        q, target = attitude[i], q_setpoint[i]
        w, x, y, z = quaternion_product(q[0], -q[1], -q[2], -q[3], target[0], target[1], target[2], target[3])
        # Swing-twist decomposition: the error is a tilt, then a rotation about the body's z axis.
        cos_half_tilt = math.sqrt(w * w + z * z)
        if cos_half_tilt < _MIN_COS_HALF_TILT:
            sign = -1.0 if w < 0.0 else 1.0
            rw, rx, ry, rz = sign * w, sign * x, sign * y, sign * z
        else:
            half_yaw = math.atan2(-z if w < 0.0 else z, abs(w)) * yaw_weight[i]
            cos_half, sin_half = math.cos(half_yaw), math.sin(half_yaw)
            tilt_x, tilt_y = (w * x - y * z) / cos_half_tilt, (w * y + x * z) / cos_half_tilt
            rw, rz = cos_half_tilt * cos_half, cos_half_tilt * sin_half
            rx, ry = tilt_x * cos_half + tilt_y * sin_half, tilt_y * cos_half - tilt_x * sin_half
        error_norm = math.sqrt(rw * rw + rx * rx + ry * ry + rz * rz)
        roll, pitch, yaw = (
            2.0 * rx / error_norm * gain[i, 0],
            2.0 * ry / error_norm * gain[i, 1],
            2.0 * rz / error_norm * gain[i, 2],
        )
        feed_forward = yaw_rate_ned_rad_s[i]
        if math.isfinite(feed_forward):
            # The factors are the NED down axis in the body frame.
            roll += feed_forward * 2.0 * (q[1] * q[3] - q[0] * q[2])
            pitch += feed_forward * 2.0 * (q[2] * q[3] + q[0] * q[1])
            yaw += feed_forward * (q[0] * q[0] - q[1] * q[1] - q[2] * q[2] + q[3] * q[3])
        rates[i, 0] = constrain(roll, -limit[i, 0], limit[i, 0])
        rates[i, 1] = constrain(pitch, -limit[i, 1], limit[i, 1])
        rates[i, 2] = constrain(yaw, -limit[i, 2], limit[i, 2])
