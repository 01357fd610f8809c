"""Position and velocity control: trajectory setpoints become an attitude and a thrust (mc_pos_control).

A P controller of the position gives a velocity; a PID controller of the velocity gives an acceleration, which
becomes a thrust vector and then an attitude. NaN in a setpoint means "not controlled". As in PX4, the sum of
a finite value and NaN is the finite value (`_sum`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.control.setpoints import Setpoints
from vehicle_sim.frames import GRAVITY_M_S2
from vehicle_sim.kernels import Column, Flags, Rows, formula, kernel
from vehicle_sim.parameters import Parameters
from vehicle_sim.rotations import Vector, constrain
from vehicle_sim.state import EstimateState, TargetState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_TINY = 1e-9
_MAX_SETPOINT = 1e6
"""Upper bound of setpoints, beyond any flyable value: m/s, m/s²."""
_SPEED_XY, _SPEED_UP, _SPEED_DOWN, _THRUST_MIN, _THRUST_MAX, _THRUST_XY_MARGIN, _TILT_MAX = range(7)
"""Columns of the limits."""


class PositionControl:
    """Position and velocity controllers of N vehicles.

    Args:
        count: N.
        dt_s: interval between two updates.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self.velocity_integral = np.zeros((count, 3))
        self._position_p = np.zeros((count, 3))
        self._velocity_p = np.ones((count, 3))
        self._velocity_i = np.zeros((count, 3))
        self._velocity_d = np.zeros((count, 3))
        self._limits = np.zeros((count, 7))
        self._decouple = np.ones(count, dtype=np.bool_)
        self._velocity_decay = np.zeros((count, 3))
        self._derivative_gain = np.ones((count, 3))
        self._velocity = np.zeros((count, 3))
        self._velocity_derivative = np.zeros((count, 3))
        self._last_heading_rad = np.zeros(count)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads MPC_* of vehicle `i`."""

        def value(name: str) -> float:
            return parameters.finite_value(name)

        def axes(horizontal: str, vertical: str) -> list[float]:
            return [value(horizontal), value(horizontal), value(vertical)]

        self._position_p[i] = axes("MPC_XY_P", "MPC_Z_P")
        self._velocity_p[i] = np.maximum(axes("MPC_XY_VEL_P_ACC", "MPC_Z_VEL_P_ACC"), 0.01)
        self._velocity_i[i] = axes("MPC_XY_VEL_I_ACC", "MPC_Z_VEL_I_ACC")
        self._velocity_d[i] = axes("MPC_XY_VEL_D_ACC", "MPC_Z_VEL_D_ACC")
        self._limits[i] = (
            value("MPC_XY_VEL_MAX"),
            value("MPC_Z_VEL_MAX_UP"),
            value("MPC_Z_VEL_MAX_DN"),
            value("MPC_THR_MIN"),
            value("MPC_THR_MAX"),
            value("MPC_THR_XY_MARG"),
            math.radians(value("MPC_TILTMAX_AIR")),
        )
        self._decouple[i] = value("MPC_ACC_DECOUPLE") != 0
        self._velocity_decay[i] = 1.0 - _low_pass_gain(value("MPC_VEL_LP"), self._dt_s)
        self._derivative_gain[i] = _low_pass_gain(value("MPC_VELD_LP"), self._dt_s)

    def place(self, i: int, velocity_ned_m_s: FloatArray, integral: FloatArray) -> None:
        """Sets filtered velocity and integral of vehicle `i`, which was moved."""
        self._velocity[i], self._velocity_derivative[i] = velocity_ned_m_s, 0.0
        self.velocity_integral[i] = integral

    def filter_velocity(self, estimate: EstimateState) -> None:
        """Updates the filtered velocity and its derivative; call it even if no position is controlled."""
        _filter_velocity(
            self._dt_s, estimate.velocity_ned_m_s, self._velocity_decay, self._derivative_gain,
            self._velocity, self._velocity_derivative,
        )  # fmt: skip

    def compensate_hover_thrust(
        self, changed: BoolArray, old: FloatArray, new: FloatArray, target: TargetState
    ) -> None:
        """Shifts the vertical integral so that a new hover thrust (N,) does not change the thrust."""
        acceleration = target.acceleration_ned_m_s2[:, 2]
        acceleration = np.where(np.isnan(acceleration), 0.0, acceleration)
        shift = (acceleration - GRAVITY_M_S2) * (old / new) + GRAVITY_M_S2 - acceleration
        self.velocity_integral[:, 2] += np.where(changed, shift, 0.0)

    def update(
        self, controlled: BoolArray, reset_integral: BoolArray, setpoints: Setpoints, estimate: EstimateState,
        hover_thrust: FloatArray, target: TargetState, thrust: FloatArray,
    ) -> None:  # fmt: skip
        """Runs one control step.

        Args:
            controlled: (N,) vehicles at level TRAJECTORY; other rows are not changed.
            reset_integral: (N,) vehicles whose velocity integral is cleared: position control has just begun,
                or the vehicle is on the ground before the take-off ramp.
            setpoints: the trajectory setpoints.
            estimate: estimated states of the vehicles.
            hover_thrust: (N,).
            target: written: the applied trajectory setpoint, and the attitude setpoint.
            thrust: (N,) written, collective 0..1.
        """
        _control(
            controlled, reset_integral, self._dt_s, setpoints.position_ned_m, setpoints.velocity_ned_m_s,
            setpoints.acceleration_ned_m_s2, setpoints.yaw_ned_rad, setpoints.ramp_thrust,
            setpoints.climb_limit_m_s, setpoints.descent_limit_m_s, setpoints.min_thrust,
            setpoints.thrust_limit, setpoints.tilt_limit_rad, estimate.position_ned_m, estimate.heading_rad,
            self._velocity, self._velocity_derivative, hover_thrust, self._position_p, self._velocity_p,
            self._velocity_i, self._velocity_d, self._limits, self._decouple, self.velocity_integral,
            self._last_heading_rad, target.velocity_ned_m_s, target.acceleration_ned_m_s2, target.q_ned_frd,
            thrust,
        )  # fmt: skip
        rows = controlled[:, None]
        np.copyto(target.position_ned_m, setpoints.position_ned_m, where=rows)
        np.copyto(target.yaw_ned_rad, setpoints.yaw_ned_rad, where=controlled)
        np.copyto(target.yaw_rate_ned_rad_s, setpoints.yaw_rate_ned_rad_s, where=controlled)


def _low_pass_gain(cutoff_hz: float, dt_s: float) -> float:
    """Gain of a first-order low-pass; 1 without a cutoff."""
    if cutoff_hz <= 0.0:
        return 1.0
    return dt_s / (dt_s + 1.0 / (2.0 * math.pi * cutoff_hz))


@formula
def _position_control(setpoint: FloatArray, position: FloatArray, gain: FloatArray) -> Vector:
    """P control of position: velocities [m/s], NaN where position is not controlled."""
    return (
        _bounded((setpoint[0] - position[0]) * gain[0]),
        _bounded((setpoint[1] - position[1]) * gain[1]),
        _bounded((setpoint[2] - position[2]) * gain[2]),
    )


@formula
def _thrust_vector(
    an: float, ae: float, ad: float, hover_thrust: float, decouple: bool, tilt_limit: float,
    min_thrust: float, max_thrust: float, horizontal_margin: float,
) -> tuple[Vector, Vector]:  # fmt: skip
    """The body's down axis and the thrust vector (NED) for an acceleration setpoint, including gravity.

    Vertical thrust has priority over horizontal thrust.
    """
    up = GRAVITY_M_S2 if decouple else max(GRAVITY_M_S2 - ad, _TINY)
    horizontal_m_s2 = _length(an, ae)
    tilt = min(math.atan2(horizontal_m_s2, up), tilt_limit)
    per_m_s2 = math.sin(tilt) / max(horizontal_m_s2, _TINY)
    zn, ze, zd = -an * per_m_s2, -ae * per_m_s2, math.cos(tilt)
    collective = max(hover_thrust * (1.0 - ad / GRAVITY_M_S2) / zd, min_thrust)
    tn, te, td = -zn * collective, -ze * collective, -zd * collective
    horizontal_thrust = _length(tn, te)
    reserved_thrust = min(horizontal_thrust, horizontal_margin)
    td = max(td, -math.sqrt(max(max_thrust * max_thrust - reserved_thrust * reserved_thrust, 0.0)))
    available = math.sqrt(max(max_thrust * max_thrust - td * td, 0.0))
    scale = min(1.0, available / max(horizontal_thrust, _TINY))
    return (zn, ze, zd), (tn * scale, te * scale, td)


@formula
def _integrate(
    dt_s: float, velocity_setpoint: FloatArray, velocity: FloatArray, acceleration_ne: tuple[float, float],
    thrust: Vector, hover_thrust: float, min_thrust: float, max_thrust: float, gain: FloatArray,
    integral_gain: FloatArray, integral: FloatArray,
) -> None:  # fmt: skip
    """Integrates the velocity error, with anti-windup while a thrust limit applies."""
    error_n, error_e = (
        _zero_if_nan(velocity_setpoint[0] - velocity[0]),
        _zero_if_nan(velocity_setpoint[1] - velocity[1]),
    )
    error_d = _zero_if_nan(velocity_setpoint[2] - velocity[2])
    if (thrust[2] >= -min_thrust and error_d >= 0.0) or (thrust[2] <= -max_thrust and error_d <= 0.0):
        error_d = 0.0
    achieved_n, achieved_e = thrust[0] * GRAVITY_M_S2 / hover_thrust, thrust[1] * GRAVITY_M_S2 / hover_thrust
    setpoint_n, setpoint_e = acceleration_ne
    if setpoint_n * setpoint_n + setpoint_e * setpoint_e > achieved_n * achieved_n + achieved_e * achieved_e:
        error_n -= (setpoint_n - achieved_n) * 2.0 / gain[0]
        error_e -= (setpoint_e - achieved_e) * 2.0 / gain[0]
    integral[0] += error_n * integral_gain[0] * dt_s
    integral[1] += error_e * integral_gain[1] * dt_s
    integral[2] = constrain(integral[2] + error_d * integral_gain[2] * dt_s, -GRAVITY_M_S2, GRAVITY_M_S2)


@formula
def _length(north: float, east: float) -> float:
    return math.sqrt(north * north + east * east)


@formula
def _sum(a: float, b: float) -> float:
    """a + b; if one is NaN, the other; NaN if both are NaN."""
    total = a + b
    if math.isnan(total):
        return b if math.isnan(a) else a
    return total


@formula
def _zero_if_nan(value: float) -> float:
    """Zero for NaN."""
    return 0.0 if math.isnan(value) else value


@formula
def _bounded(value: float) -> float:
    """Limits values that no vehicle can fly (infinite, 1e30) to prevent overflow; NaN stays NaN."""
    return constrain(value, -_MAX_SETPOINT, _MAX_SETPOINT)


@formula
def _constrain_sum(
    first_n: float, first_e: float, second_n: float, second_e: float, limit: float
) -> tuple[float, float]:
    """The first vector plus the largest part of the second vector for which the sum is within the limit."""
    first_length, second_length = _length(first_n, first_e), max(_length(second_n, second_e), _TINY)
    if first_length >= limit:
        scale = limit / max(first_length, _TINY)
        return first_n * scale, first_e * scale
    unit_n, unit_e = second_n / second_length, second_e / second_length
    along = first_n * unit_n + first_e * unit_e
    discriminant = max(along * along - first_length * first_length + limit * limit, 0.0)
    second_part = constrain(math.sqrt(discriminant) - along, 0.0, second_length)
    return first_n + unit_n * second_part, first_e + unit_e * second_part


@formula
def _write_attitude(zn: float, ze: float, zd: float, yaw_ned_rad: float, q: FloatArray) -> None:
    """Writes the attitude (4,) with the down axis (zn, ze, zd) and the nose towards the yaw.

    Not valid for rotations by 180° about an axis between the body axes; no controller needs them.
    """
    sin_yaw, cos_yaw = math.sin(yaw_ned_rad), math.cos(yaw_ned_rad)
    xn, xe, xd = cos_yaw * zd, sin_yaw * zd, -(cos_yaw * zn + sin_yaw * ze)
    norm = math.sqrt(xn * xn + xe * xe + xd * xd)
    xn, xe, xd = xn / norm, xe / norm, xd / norm
    yn, ye, yd = ze * xd - zd * xe, zd * xn - zn * xd, zn * xe - ze * xn
    w = math.sqrt(max(0.25 * (xn + ye + zd) + 0.25, 0.0))
    x = math.copysign(math.sqrt(max(0.25 * (xn - ye - zd) + 0.25, 0.0)), yd - ze)
    y = math.copysign(math.sqrt(max(0.25 * (ye - xn - zd) + 0.25, 0.0)), zn - xd)
    z = math.copysign(math.sqrt(max(0.25 * (zd - xn - ye) + 0.25, 0.0)), xe - yn)
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    q[0], q[1], q[2], q[3] = w / norm, x / norm, y / norm, z / norm


@kernel
def _filter_velocity(
    dt_s: float, measured: Rows, decay: Rows, derivative_gain: Rows, velocity: Rows,
    rate: Rows,
) -> None:  # fmt: skip
    for i in range(velocity.shape[0]):
        for k in range(3):
            filtered = measured[i, k] + (velocity[i, k] - measured[i, k]) * decay[i, k]
            rate[i, k] += derivative_gain[i, k] * ((filtered - velocity[i, k]) / dt_s - rate[i, k])
            velocity[i, k] = filtered


@formula
def _write_velocity(
    feed_forward: Column, correction: tuple[float, float, float], max_xy: float, climb: float, descent: float,
    setpoint: Column,
) -> None:  # fmt: skip
    """Writes the velocity setpoint; up to the limits, the position's correction has priority."""
    for k in range(2):
        setpoint[k] = _bounded(_sum(feed_forward[k], correction[k]))
    setpoint[2] = constrain(_bounded(_sum(feed_forward[2], correction[2])), -climb, descent)
    if _length(setpoint[0], setpoint[1]) > max_xy:
        first_n, first_e = _zero_if_nan(correction[0]), _zero_if_nan(correction[1])
        setpoint[0], setpoint[1] = _constrain_sum(
            first_n, first_e, _zero_if_nan(setpoint[0] - first_n), _zero_if_nan(setpoint[1] - first_e), max_xy
        )


@kernel
def _control(
    controlled: Flags, reset_integral: Flags, dt_s: float, setpoint_position: Rows,
    setpoint_velocity: Rows, setpoint_acceleration: Rows, setpoint_yaw: Column,
    ramp_thrust: Flags, climb_limit: Column, descent_limit: Column, min_thrust: Column, thrust_limit: Column,
    tilt_limit: Column, position: Rows, heading: Column, velocity: Rows,
    velocity_derivative: Rows, hover_thrust: Column, position_p: Rows, velocity_p: Rows,
    velocity_i: Rows, velocity_d: Rows, limits: Rows, decouple: Flags,
    integral: Rows, last_heading: Column, target_velocity: Rows,
    target_acceleration: Rows, target_q: Rows, thrust: Column,
) -> None:  # fmt: skip
    for i in range(controlled.shape[0]):
        if not controlled[i]:
            continue
        if reset_integral[i]:
            integral[i] = 0.0
        limit, hover = limits[i], hover_thrust[i]
        climb = limit[_SPEED_UP] if math.isnan(climb_limit[i]) else climb_limit[i]
        descent = limit[_SPEED_DOWN] if math.isnan(descent_limit[i]) else descent_limit[i]
        highest = min(limit[_THRUST_MAX], thrust_limit[i])
        lowest = min(limit[_THRUST_MIN] if math.isnan(min_thrust[i]) else min_thrust[i], highest)
        tilt = limit[_TILT_MAX] if math.isnan(tilt_limit[i]) else tilt_limit[i]

        velocity_setpoint = target_velocity[i]
        correction = _position_control(setpoint_position[i], position[i], position_p[i])
        _write_velocity(
            setpoint_velocity[i], correction, limit[_SPEED_XY], climb, descent, velocity_setpoint
        )  # fmt: skip
        acceleration = target_acceleration[i]
        for k in range(3):
            from_velocity = velocity_p[i, k] * (velocity_setpoint[k] - velocity[i, k]) + integral[i, k] - (
                velocity_d[i, k] * velocity_derivative[i, k]
            )  # fmt: skip
            feed_forward = math.nan if k == 2 and ramp_thrust[i] else setpoint_acceleration[i, k]
            acceleration[k] = _bounded(_sum(feed_forward, from_velocity))
        an, ae, ad = (
            _zero_if_nan(acceleration[0]),
            _zero_if_nan(acceleration[1]),
            _zero_if_nan(acceleration[2]),
        )

        (zn, ze, zd), (tn, te, td) = _thrust_vector(
            an, ae, ad, hover, decouple[i], tilt, lowest, highest, limit[_THRUST_XY_MARGIN]
        )
        _integrate(
            dt_s, velocity_setpoint, velocity[i], (an, ae), (tn, te, td), hover, lowest, highest,
            velocity_p[i], velocity_i[i], integral[i],
        )  # fmt: skip
        thrust[i] = math.sqrt(tn * tn + te * te + td * td)
        # Without a yaw setpoint PX4 uses the heading of the last update, which slightly slows a turn.
        yaw = setpoint_yaw[i] if math.isfinite(setpoint_yaw[i]) else last_heading[i]
        last_heading[i] = heading[i]
        if thrust[i] > _TINY:
            zn, ze, zd = -tn / thrust[i], -te / thrust[i], -td / thrust[i]
        _write_attitude(zn, ze, zd, yaw, target_q[i])
