"""Control allocation: collective thrust and torques become four motor signals, as in PX4 with airmode off.

The mixer is the normalised pseudo-inverse of the rotor geometry (CA_ROTOR*). If a signal is outside 0..1,
thrust is reduced first, then roll and pitch, then yaw, as in PX4; a margin keeps some yaw torque.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.kernels import Blocks, Column, Flags, Rows, formula, kernel
from vehicle_sim.parameters import Parameters
from vehicle_sim.rotations import constrain
from vehicle_sim.state import ROTOR_COUNT

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_YAW_MARGIN = 0.15
"""How far yaw torque may raise a motor signal above 1; the thrust is then reduced."""
_SMALL = 1e-6


class Allocation:
    """Mixers of N vehicles.

    Args:
        count: N.
    """

    def __init__(self, count: int) -> None:
        self._mixer = np.zeros((count, 4, ROTOR_COUNT))
        self._inverse_mixer = np.zeros((count, ROTOR_COUNT, 3))
        """(N, 4, 3) pseudo-inverse of the mixer, from motor signals to torques."""
        self.unallocated = np.zeros((count, 3))
        """(N, 3) in the last step: torque setpoint minus allocated torque."""

    def configure(self, i: int, parameters: Parameters) -> None:
        """Builds the mixer of vehicle `i` from CA_ROTOR*.

        Raises:
            ValueError: the rotors cannot control all four axes.
        """
        rows = mixer_from_parameters(parameters)
        self._mixer[i] = rows
        self._inverse_mixer[i] = np.linalg.pinv(rows)[:, :3]

    def update(self, powered: BoolArray, torque: FloatArray, thrust: FloatArray, motors: FloatArray) -> None:
        """Writes the motor signals.

        Args:
            powered: (N,) vehicles whose motors are controlled; all other motors stop.
            torque: (N, 3) normalised.
            thrust: (N,) collective.
            motors: (N, 4) written, 0..1.
        """
        _allocate(powered, torque, thrust, self._mixer, self._inverse_mixer, self.unallocated, motors)


@formula
def _limit_signals(
    mixer: FloatArray, roll: float, pitch: float, yaw: float, thrust: float, motors: FloatArray
) -> None:
    """Writes motor signals (4,) within 0..1 that approximate the setpoints; `mixer` is (4, 4)."""
    for k in range(ROTOR_COUNT):
        motors[k] = roll * mixer[0, k] + pitch * mixer[1, k] + thrust * mixer[3, k]
    _desaturate(motors, mixer[3], -1.0, 1.0, True)
    _desaturate(motors, mixer[0], 1.0, 1.0, False)
    _desaturate(motors, mixer[1], 1.0, 1.0, False)
    for k in range(ROTOR_COUNT):
        motors[k] += yaw * mixer[2, k]
    _desaturate(motors, mixer[2], 1.0, 1.0 + _YAW_MARGIN, False)
    _desaturate(motors, mixer[3], -1.0, 1.0, True)
    for k in range(ROTOR_COUNT):
        motors[k] = constrain(motors[k], 0.0, 1.0)


@formula
def _desaturate(motors: FloatArray, axis: FloatArray, sign: float, highest: float, one_way: bool) -> None:
    """Adds a multiple of `sign * axis` (4,) to the signals (4,) that minimises saturation, in two passes.

    Args:
        motors: signals that may be outside 0..highest.
        axis: change of the signals per unit of the torque or thrust that may be reduced.
        sign: 1 or -1.
        highest: upper limit.
        one_way: whether only a positive multiple is allowed.
    """
    first = _step_length(motors, axis, sign, highest)
    if one_way and first <= 0.0:
        return
    for k in range(ROTOR_COUNT):
        motors[k] += first * sign * axis[k]
    second = 0.5 * _step_length(motors, axis, sign, highest)
    for k in range(ROTOR_COUNT):
        motors[k] += second * sign * axis[k]


@formula
def _step_length(motors: FloatArray, axis: FloatArray, sign: float, highest: float) -> float:
    """The multiple of `sign * axis`: the largest positive plus the largest negative correction of a motor."""
    most_negative = most_positive = 0.0
    for k in range(ROTOR_COUNT):
        direction = sign * axis[k]
        if abs(direction) <= _SMALL:
            continue
        if motors[k] < 0.0:
            correction = -motors[k] / direction
        elif motors[k] > highest:
            correction = (highest - motors[k]) / direction
        else:
            continue
        most_negative, most_positive = min(most_negative, correction), max(most_positive, correction)
    return most_negative + most_positive


def mixer_from_parameters(parameters: Parameters) -> FloatArray:
    """(4, ROTOR_COUNT): motor signals per unit of roll, pitch, yaw torque and of collective thrust.

    Raises:
        ValueError: the rotors cannot control all four axes.
    """
    effectiveness = rotor_effectiveness(parameters)
    if np.linalg.matrix_rank(effectiveness, tol=_SMALL) < 4:
        raise ValueError("CA_ROTOR* describe rotors that cannot control all of roll, pitch, yaw and thrust")
    inverse = np.linalg.pinv(effectiveness)
    rows = inverse.T.astype(np.float64)
    roll, pitch, yaw, thrust = rows
    tilt_scale = max(math.sqrt(float(row @ row) / (ROTOR_COUNT / 2.0)) for row in (roll, pitch))
    yaw_scale = float(np.max(np.abs(yaw)))
    thrust_scale = float(np.mean(np.abs(thrust)))
    scales = np.array([tilt_scale, tilt_scale, yaw_scale, thrust_scale])
    rows /= scales[:, None]
    return rows


def rotor_effectiveness(parameters: Parameters) -> FloatArray:
    """(4, ROTOR_COUNT): roll, pitch, yaw torque and lift of each rotor at full signal, from CA_ROTOR*."""
    effectiveness = np.zeros((4, ROTOR_COUNT))
    for k in range(ROTOR_COUNT):

        def value(name: str, k: int = k) -> float:
            return parameters.finite_value(f"CA_ROTOR{k}_{name}")

        axis = np.array([value("AX"), value("AY"), value("AZ")])
        position = np.array([value("PX"), value("PY"), value("PZ")])
        axis = axis / max(float(np.linalg.norm(axis)), _SMALL)
        thrust_coefficient = value("CT")
        effectiveness[:3, k] = thrust_coefficient * (np.cross(position, axis) - value("KM") * axis)
        effectiveness[3, k] = -thrust_coefficient * axis[2]
    return effectiveness


@kernel
def _allocate(
    powered: Flags, torque: Rows, thrust: Column, mixer: Blocks, inverse_mixer: Blocks,
    unallocated: Rows, motors: Rows,
) -> None:  # fmt: skip
    for i in range(motors.shape[0]):
        unallocated[i] = 0.0
        if not powered[i]:
            motors[i] = 0.0
            continue
        roll, pitch, yaw = constrain(torque[i, 0], -1.0, 1.0), constrain(torque[i, 1], -1.0, 1.0), constrain(
            torque[i, 2], -1.0, 1.0
        )  # fmt: skip
        unsaturated = True
        for k in range(ROTOR_COUNT):
            motors[i, k] = roll * mixer[i, 0, k] + pitch * mixer[i, 1, k] + yaw * mixer[i, 2, k] + (
                thrust[i] * mixer[i, 3, k]
            )  # fmt: skip
            unsaturated = unsaturated and 0.0 <= motors[i, k] <= 1.0
        if unsaturated:
            continue
        _limit_signals(mixer[i], roll, pitch, yaw, thrust[i], motors[i])
        for axis, setpoint in ((0, roll), (1, pitch), (2, yaw)):
            unallocated_torque = setpoint
            for k in range(ROTOR_COUNT):
                unallocated_torque -= motors[i, k] * inverse_mixer[i, k, axis]
            unallocated[i, axis] = unallocated_torque if abs(unallocated_torque) >= _SMALL else 0.0
