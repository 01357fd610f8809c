"""Six degrees of freedom of N quadrotors: rotors with lag, linear drag, gravity, and ground contact.

The model is that of PX4's SIH. Thrust and moments are proportional to a rotor's lagged signal, and drag is
linear in speed and body rate. The ground supports a vehicle whose weight exceeds its lift. One matrix
converts rotor thrusts, body rates and products of body rates to thrust and angular accelerations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.airframe import Airframe
from vehicle_sim.frames import GRAVITY_M_S2, cross_table, quaternion_from_yaw, rotation_matrix
from vehicle_sim.kernels import Blocks, Column, Flags, Rows, kernel
from vehicle_sim.rotations import rotate_attitude, write_matrix
from vehicle_sim.state import ROTOR_COUNT, FlightMoment, TruthState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_RATE_INPUTS = slice(ROTOR_COUNT, ROTOR_COUNT + 3)
_RATE_PRODUCT_INPUTS = slice(ROTOR_COUNT + 3, ROTOR_COUNT + 12)


class RigidBodies:
    """The rigid bodies of N vehicles; `state` is the true state.

    Args:
        count: N.
        dt_s: step.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
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
        """(N, 3, 3) rotation matrices of `state.q_ned_frd`."""
        self.wind_ned_m_s = np.zeros((count, 3))
        self.ground_down_m = np.zeros(count)
        """(N,) position down of the surface below each body; 0: the level of home."""
        self._response = np.zeros((count, ROTOR_COUNT + 12, 4))
        """(N, 16, 4) acceleration by thrust along the down axis of the body [m/s²], and angular accelerations
        [rad/s²], for each input: 4 rotor thrusts, 3 body rates, 9 products of body rates."""
        self._rotor_gain = np.ones((count, ROTOR_COUNT))
        """(N, 4) change of a rotor's thrust in one step, relative to the difference of signal and thrust."""
        self._drag_per_s = np.zeros((count, 3))

    def configure(self, i: int, airframe: Airframe) -> None:
        """Sets the airframe of vehicle `i`."""
        inverse = np.linalg.inv(airframe.inertia_kg_m2)
        wrench = airframe.wrench_table()
        response = self._response[i]
        response[:] = 0.0
        response[:ROTOR_COUNT, 0] = -wrench[:, 0] / airframe.mass_kg
        response[:ROTOR_COUNT, 1:] = wrench[:, 1:] @ inverse.T
        response[_RATE_INPUTS, 1:] = -airframe.drag_nm_per_rad_s * inverse.T
        gyroscopic = np.einsum("imk,mj->ijk", cross_table(), airframe.inertia_kg_m2).reshape(9, 3)
        response[_RATE_PRODUCT_INPUTS, 1:] = -gyroscopic @ inverse.T
        self._drag_per_s[i] = airframe.drag_n_per_m_s / airframe.mass_kg
        self._rotor_gain[i] = min(1.0, self._dt_s / max(airframe.rotor_time_constant_s, self._dt_s))

    def place(self, i: int, position_ned_m: FloatArray, yaw_ned_rad: float) -> None:
        """Places vehicle `i` level and without motion; raises a position below the surface to the surface."""
        state = self.state
        state.position_ned_m[i] = position_ned_m
        state.position_ned_m[i, 2] = min(float(position_ned_m[2]), float(self.ground_down_m[i]))
        for rows in (
            state.velocity_ned_m_s,
            state.acceleration_ned_m_s2,
            state.rates_frd_rad_s,
            state.rotor_thrust,
        ):
            rows[i] = 0.0
        state.q_ned_frd[i] = quaternion_from_yaw(np.array([yaw_ned_rad]))[0]
        state.on_ground[i] = state.position_ned_m[i, 2] >= self.ground_down_m[i]
        self.matrix[:] = rotation_matrix(state.q_ned_frd)

    def place_in_flight(self, i: int, moment: FlightMoment) -> None:
        """Gives vehicle `i` the motion of a moment of a flight."""
        state = self.state
        state.position_ned_m[i] = moment.position_ned_m
        state.velocity_ned_m_s[i] = moment.velocity_ned_m_s
        state.q_ned_frd[i] = moment.q_ned_frd
        state.rates_frd_rad_s[i] = moment.rates_frd_rad_s
        state.rotor_thrust[i] = moment.rotor_thrust
        state.on_ground[i] = False
        self.matrix[:] = rotation_matrix(state.q_ned_frd)

    def set_attitude(self, i: int, q_ned_frd: FloatArray) -> None:
        """Sets the attitude (4,) of vehicle `i`, and stops its motion."""
        state = self.state
        state.q_ned_frd[i] = q_ned_frd
        state.rates_frd_rad_s[i] = state.velocity_ned_m_s[i] = state.acceleration_ned_m_s2[i] = 0.0
        self.matrix[:] = rotation_matrix(state.q_ned_frd)

    def step(self, motor_signal: FloatArray, motor_health: FloatArray) -> None:
        """Advances by one step.

        Args:
            motor_signal: (N, 4) 0..1.
            motor_health: (N, 4) fraction of the signal that each motor converts to thrust.
        """
        state = self.state
        _advance(
            self._dt_s, motor_signal, motor_health, self._rotor_gain, self._response, self._drag_per_s,
            self.wind_ned_m_s, self.ground_down_m, state.position_ned_m, state.velocity_ned_m_s,
            state.acceleration_ned_m_s2, state.q_ned_frd, self.matrix, state.rates_frd_rad_s,
            state.rotor_thrust, state.on_ground,
        )  # fmt: skip


@kernel
def _advance(
    dt_s: float, motor_signal: Rows, motor_health: Rows, rotor_gain: Rows, response: Blocks,
    drag_per_s: Rows, wind_ned_m_s: Rows, ground_down_m: Column, position: Rows,
    velocity: Rows, acceleration: Rows, q: Rows, matrix: Blocks, rates: Rows,
    rotors: Rows, on_ground: Flags,
) -> None:  # fmt: skip
    """Advances by one step: positions with the old velocities, velocities and attitudes with the new
    accelerations."""
    for i in range(position.shape[0]):
        thrust_m_s2 = roll_rad_s2 = pitch_rad_s2 = yaw_rad_s2 = 0.0
        for k in range(ROTOR_COUNT):
            rotors[i, k] += rotor_gain[i, k] * (motor_signal[i, k] * motor_health[i, k] - rotors[i, k])
            thrust_m_s2 += rotors[i, k] * response[i, k, 0]
            roll_rad_s2 += rotors[i, k] * response[i, k, 1]
            pitch_rad_s2 += rotors[i, k] * response[i, k, 2]
            yaw_rad_s2 += rotors[i, k] * response[i, k, 3]
        for k in range(3):
            rate_input = ROTOR_COUNT + k
            roll_rad_s2 += rates[i, k] * response[i, rate_input, 1]
            pitch_rad_s2 += rates[i, k] * response[i, rate_input, 2]
            yaw_rad_s2 += rates[i, k] * response[i, rate_input, 3]
        for j in range(3):
            for k in range(3):
                product_input, rate_product = ROTOR_COUNT + 3 + 3 * j + k, rates[i, j] * rates[i, k]
                roll_rad_s2 += rate_product * response[i, product_input, 1]
                pitch_rad_s2 += rate_product * response[i, product_input, 2]
                yaw_rad_s2 += rate_product * response[i, product_input, 3]
        for k in range(3):
            gravity = GRAVITY_M_S2 if k == 2 else 0.0
            drag_m_s2 = drag_per_s[i, k] * (velocity[i, k] - wind_ned_m_s[i, k])
            acceleration[i, k] = matrix[i, k, 2] * thrust_m_s2 + gravity - drag_m_s2
            position[i, k] += dt_s * velocity[i, k]
        rates[i, 0] += dt_s * roll_rad_s2
        rates[i, 1] += dt_s * pitch_rad_s2
        rates[i, 2] += dt_s * yaw_rad_s2
        # The ground stops a descending vehicle even while the vehicle decelerates. A vehicle at rest stays on
        # the ground while its weight exceeds its lift.
        descent_m_s = velocity[i, 2]
        supported = position[i, 2] >= ground_down_m[i] and (
            descent_m_s > 0.0 or (acceleration[i, 2] >= 0.0 and descent_m_s >= 0.0)
        )
        on_ground[i] = supported
        if supported:
            position[i, 2] = ground_down_m[i]
            for k in range(3):
                acceleration[i, k] = -velocity[i, k] / dt_s
                velocity[i, k] = rates[i, k] = 0.0
        else:
            for k in range(3):
                velocity[i, k] += dt_s * acceleration[i, k]
        rotate_attitude(q[i], dt_s * rates[i, 0], dt_s * rates[i, 1], dt_s * rates[i, 2])
        write_matrix(q[i], matrix[i])
