"""Six degrees of freedom for N quadrotors: rotors with lag, linear drag, gravity, and ground that holds.

The model is that of PX4's SIH: thrust and moments proportional to a rotor's lagged signal, drag linear in
speed and body rate, and ground contact that stops the vehicle dead while its weight exceeds its lift.
Forces of all vehicles come from one matrix product over (rotor thrusts, body rates, their products).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.airframe import Airframe
from vehicle_sim.frames import (
    GRAVITY_M_S2,
    cross_table,
    quaternion_from_yaw,
    quaternion_rate,
    rotation_matrix,
    row_norm,
)
from vehicle_sim.masks import any_of
from vehicle_sim.state import ROTOR_COUNT, TruthState

FloatArray = NDArray[np.float64]

_ZERO = np.array(0.0)
_RATES = slice(ROTOR_COUNT, ROTOR_COUNT + 3)
_PRODUCTS = slice(ROTOR_COUNT + 3, ROTOR_COUNT + 12)


class RigidBodies:
    """The bodies of N vehicles; `state` is the truth.

    Args:
        count: N.
        dt_s: step.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = np.array(dt_s)
        self._back_per_s = np.array(-1.0 / dt_s)
        self.state = TruthState(
            position_ned_m=np.zeros((count, 3)),
            velocity_ned_m_s=np.zeros((count, 3)),
            acceleration_ned_m_s2=np.zeros((count, 3)),
            q_ned_frd=quaternion_from_yaw(np.zeros(count)),
            rates_frd_rad_s=np.zeros((count, 3)),
            rotor_thrust=np.zeros((count, ROTOR_COUNT)),
            on_ground=np.ones(count, dtype=np.bool_),
        )
        self.matrix = rotation_matrix(self.state.q_ned_frd)
        """(N, 3, 3) of `state.q_ned_frd`."""
        self.wind_ned_m_s = np.zeros((count, 3))
        self.ground_ned_m = np.zeros(count)
        """(N,) down coordinate of what carries each body; 0: flat ground at home's level."""
        self._inputs = np.zeros((count, 1, ROTOR_COUNT + 12))
        self._response = np.zeros((count, ROTOR_COUNT + 12, 4))
        self._lag = np.ones((count, ROTOR_COUNT))
        self._drag_per_s = np.zeros((count, 3))
        self._gravity = np.tile([0.0, 0.0, GRAVITY_M_S2], (count, 1))
        # Views of arrays that are only ever written in place: to make them anew costs as much as a product.
        self._rotors_in = self._inputs[:, 0, :ROTOR_COUNT]
        self._rates_in = self._inputs[:, 0, _RATES]
        self._products_in = self._inputs[:, 0, _PRODUCTS].reshape(count, 3, 3)
        rates = self.state.rates_frd_rad_s
        self._rates_down, self._rates_across = rates[:, :, None], rates[:, None, :]
        self._down_m = self.state.position_ned_m[:, 2]
        self._sinking_m_s = self.state.velocity_ned_m_s[:, 2]

    def configure(self, i: int, airframe: Airframe) -> None:
        """Give vehicle `i` an airframe."""
        inverse = np.linalg.inv(airframe.inertia_kg_m2)
        wrench = airframe.wrench_table()
        response = self._response[i]
        response[:] = 0.0
        response[:ROTOR_COUNT, 0] = -wrench[:, 0] / airframe.mass_kg
        response[:ROTOR_COUNT, 1:] = wrench[:, 1:] @ inverse.T
        response[_RATES, 1:] = -airframe.drag_nm_per_rad_s * inverse.T
        gyroscopic = np.einsum("imk,mj->ijk", cross_table(), airframe.inertia_kg_m2).reshape(9, 3)
        response[_PRODUCTS, 1:] = -gyroscopic @ inverse.T
        self._drag_per_s[i] = airframe.drag_n_per_m_s / airframe.mass_kg
        dt_s = float(self._dt_s)
        self._lag[i] = min(1.0, dt_s / max(airframe.rotor_time_constant_s, dt_s))

    def place(self, i: int, position_ned_m: FloatArray, yaw_ned_rad: float) -> None:
        """Put vehicle `i` somewhere, level and at rest; below the surface counts as on it."""
        state = self.state
        state.position_ned_m[i] = position_ned_m
        state.position_ned_m[i, 2] = min(float(position_ned_m[2]), float(self.ground_ned_m[i]))
        for rows in (
            state.velocity_ned_m_s,
            state.acceleration_ned_m_s2,
            state.rates_frd_rad_s,
            state.rotor_thrust,
        ):
            rows[i] = 0.0
        state.q_ned_frd[i] = quaternion_from_yaw(np.array([yaw_ned_rad]))[0]
        state.on_ground[i] = state.position_ned_m[i, 2] >= self.ground_ned_m[i]
        self.matrix = rotation_matrix(state.q_ned_frd)

    def turn(self, i: int, q_ned_frd: FloatArray) -> None:
        """Hold vehicle `i` in another attitude (4,), at rest."""
        state = self.state
        state.q_ned_frd[i] = q_ned_frd
        state.rates_frd_rad_s[i] = state.velocity_ned_m_s[i] = state.acceleration_ned_m_s2[i] = 0.0
        self.matrix = rotation_matrix(state.q_ned_frd)

    def step(self, motor_signal: FloatArray) -> None:
        """Advance by one step with motor signals (N, 4), 0..1."""
        state, dt_s = self.state, self._dt_s
        rotors, rates = state.rotor_thrust, state.rates_frd_rad_s
        position, velocity = state.position_ned_m, state.velocity_ned_m_s
        rotors += self._lag * (motor_signal - rotors)

        self._rotors_in[:] = rotors
        self._rates_in[:] = rates
        np.multiply(self._rates_down, self._rates_across, out=self._products_in)
        response = (self._inputs @ self._response)[:, 0, :]

        acceleration = self.matrix[:, :, 2] * response[:, :1]
        acceleration += self._gravity
        acceleration -= self._drag_per_s * (velocity - self.wind_ned_m_s)

        position += dt_s * velocity
        rates += dt_s * response[:, 1:]
        # A sinking vehicle is stopped though its rotors slow it down; one that stands is held by its weight.
        held = self._down_m >= self.ground_ned_m
        if any_of(held):
            sinking = self._sinking_m_s
            held &= (sinking > _ZERO) | ((acceleration[:, 2] >= _ZERO) & (sinking >= _ZERO))
            if any_of(held):
                acceleration[held] = velocity[held] * self._back_per_s
                rates[held] = 0.0
                position[held, 2] = self.ground_ned_m[held]
        velocity += dt_s * acceleration
        state.acceleration_ned_m_s2[:] = acceleration
        state.on_ground[:] = held
        q = state.q_ned_frd
        q += dt_s * quaternion_rate(q, rates)
        q /= row_norm(q)
        self.matrix = rotation_matrix(q)
