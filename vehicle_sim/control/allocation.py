"""Control allocation: collective thrust and torques become four motor signals (PX4's, airmode off).

The mixer is the normalised pseudo-inverse of the rotor geometry (CA_ROTOR*). What does not fit into 0..1 is
taken back in PX4's order: thrust down, then roll and pitch, then yaw, with a margin that leaves some yaw.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.masks import all_of
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import ROTOR_COUNT

FloatArray = NDArray[np.float64]

_YAW_MARGIN = 0.15
_SMALL = 1e-6
# Arrays without dimensions: NumPy takes twice as long to compare with a plain number.
_ZERO, _ONE, _MINUS_ONE = np.array(0.0), np.array(1.0), np.array(-1.0)


class Allocation:
    """Mixers of N vehicles.

    Args:
        count: N.
    """

    def __init__(self, count: int) -> None:
        self._mix = np.zeros((count, 4, ROTOR_COUNT))
        self._unmix = np.zeros((count, ROTOR_COUNT, 3))
        self._demand = np.zeros((count, 1, 4))
        self._torque = self._demand[:, 0, :3]
        self._lift = self._demand[:, 0, 3]
        self._fell_short = False
        self.short_of = np.zeros((count, 3))
        """(N, 3) torque asked for less torque given in the last step."""

    def configure(self, i: int, parameters: Parameters) -> None:
        """Build the mixer of vehicle `i` from CA_ROTOR*.

        Raises:
            ValueError: rotors that cannot control all four axes.
        """
        rows = mixer_of(parameters)
        self._mix[i] = rows
        self._unmix[i] = np.linalg.pinv(rows)[:, :3]

    def update(self, torque: FloatArray, thrust: FloatArray) -> FloatArray:
        """Motor signals (N, 4) within 0..1 for torques (N, 3) and collective thrust (N,)."""
        demand = self._demand
        np.minimum(torque, _ONE, out=self._torque)
        np.maximum(self._torque, _MINUS_ONE, out=self._torque)
        self._lift[:] = thrust
        motors = (demand @ self._mix)[:, 0, :]
        within = (motors >= _ZERO) & (motors <= _ONE)
        if all_of(within):
            if self._fell_short:
                self.short_of.fill(0.0)
                self._fell_short = False
            return motors
        self._fell_short = True
        # Who has enough is not fitted with the others: its last bit must not depend on them.
        short = np.flatnonzero(~within.all(axis=1))
        motors[short] = fitted = self._fit(demand[short], self._mix[short])
        given = (fitted[:, None, :] @ self._unmix[short])[:, 0, :]
        missing = self._torque[short] - given
        missing[np.abs(missing) < _SMALL] = 0.0
        self.short_of.fill(0.0)
        self.short_of[short] = missing
        return motors

    @staticmethod
    def _fit(demand: FloatArray, mix: FloatArray) -> FloatArray:
        """Signals (M, 4) within 0..1 as near as can be to (M, 1, 4) demanded, by mixers (M, 4, 4)."""
        roll, pitch, yaw, lift = (mix[:, k, :] for k in range(4))
        part = demand[:, 0, :, None] * mix
        motors = part[:, 0] + part[:, 1] + part[:, 3]
        motors = _desaturate(motors, -lift, 1.0, one_way=True)
        motors = _desaturate(motors, roll, 1.0)
        motors = _desaturate(motors, pitch, 1.0)
        motors = motors + part[:, 2]
        motors = _desaturate(motors, yaw, 1.0 + _YAW_MARGIN)
        motors = _desaturate(motors, -lift, 1.0, one_way=True)
        return np.clip(motors, 0.0, 1.0)


def mixer_of(parameters: Parameters) -> FloatArray:
    """(4, ROTOR_COUNT): motor signals for a unit of roll, pitch, yaw torque and of collective thrust.

    Raises:
        ValueError: rotors that cannot control all four axes.
    """
    effect = rotor_effectiveness(parameters)
    if np.linalg.matrix_rank(effect, tol=_SMALL) < 4:
        raise ValueError("CA_ROTOR* describe rotors that cannot control all of roll, pitch, yaw and thrust")
    mix = np.linalg.pinv(effect)
    rows = mix.T.astype(np.float64)
    roll, pitch, yaw, thrust = rows
    tilt_scale = max(math.sqrt(float(row @ row) / (ROTOR_COUNT / 2.0)) for row in (roll, pitch))
    yaw_scale = float(np.max(np.abs(yaw)))
    thrust_scale = float(np.mean(np.abs(thrust)))
    scales = np.array([tilt_scale, tilt_scale, yaw_scale, thrust_scale])
    rows /= scales[:, None]
    return rows


def rotor_effectiveness(parameters: Parameters) -> FloatArray:
    """(4, ROTOR_COUNT): roll, pitch, yaw torque and lift of each rotor at full signal, by CA_ROTOR*."""
    effect = np.zeros((4, ROTOR_COUNT))
    for k in range(ROTOR_COUNT):

        def value(name: str, k: int = k) -> float:
            return parameters.usable(f"CA_ROTOR{k}_{name}")

        axis = np.array([value("AX"), value("AY"), value("AZ")])
        place = np.array([value("PX"), value("PY"), value("PZ")])
        axis = axis / max(float(np.linalg.norm(axis)), _SMALL)
        strength = value("CT")
        effect[:3, k] = strength * (np.cross(place, axis) - value("KM") * axis)
        effect[3, k] = -strength * axis[2]
    return effect


def _desaturate(
    motors: FloatArray, direction: FloatArray, highest: float, *, one_way: bool = False
) -> FloatArray:
    """Move along `direction` (N, 4) until the motors (N, 4) fit as well as they can; twice, as PX4 does.

    Args:
        motors: signals that may lie outside of 0..highest.
        direction: change of the signals for a unit of what may be given up.
        highest: upper limit.
        one_way: only a positive amount may be taken.
    """
    first = _amount(motors, direction, highest)
    if one_way:
        first = np.where(first < 0.0, 0.0, first)
        allowed = first > 0.0
    else:
        allowed = np.ones_like(first, dtype=np.bool_)
    motors = motors + first[:, None] * direction
    second = np.where(allowed, 0.5 * _amount(motors, direction, highest), 0.0)
    return motors + second[:, None] * direction


def _amount(motors: FloatArray, direction: FloatArray, highest: float) -> FloatArray:
    """How far to move: the largest need upwards plus the largest need downwards, (N,)."""
    usable = np.abs(direction) > _SMALL
    missing = np.where(motors < 0.0, -motors, np.where(motors > highest, highest - motors, 0.0))
    needs = np.where(usable, missing / np.where(usable, direction, 1.0), 0.0)
    return np.minimum(needs.min(axis=1), 0.0) + np.maximum(needs.max(axis=1), 0.0)
