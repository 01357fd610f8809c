"""Position and velocity control: trajectory setpoints become an attitude and a thrust (mc_pos_control).

P on position, PID on velocity, acceleration to thrust vector, thrust vector to attitude. NaN in a setpoint
means "not controlled" and is added as PX4 adds it: a finite part stands alone where the other is NaN.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.control.setpoints import Setpoints
from vehicle_sim.frames import GRAVITY_M_S2, cross, quaternion_from_matrix, row_norm
from vehicle_sim.masks import all_of, any_of
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import EstimateState, TargetState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Arrays without dimensions: NumPy takes twice as long to multiply with a plain number.
_TINY = np.array(1e-9)
_ZERO = np.array(0.0)
_ONE = np.array(1.0)
_GRAVITY = np.array(GRAVITY_M_S2)
_BEYOND = np.array(1e6)
"""Faster and harder than anything: m/s, m/s²."""
_SLOWEST = np.array(-1e6)


class PositionControl:
    """Gains and integrators of N vehicles.

    Args:
        count: N.
        dt_s: interval between two updates.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = np.array(dt_s)
        self.velocity_integral = np.zeros((count, 3))
        self._position_p = np.zeros((count, 3))
        self._velocity_p = np.ones((count, 3))
        self._velocity_i = np.zeros((count, 3))
        self._velocity_d = np.zeros((count, 3))
        self._speed_xy = np.zeros((count, 1))
        self._speed_up = np.zeros(count)
        self._speed_down = np.zeros(count)
        self._thrust_min = np.zeros(count)
        self._thrust_max = np.zeros(count)
        self._thrust_xy_margin = np.zeros(count)
        self._tilt_max = np.zeros(count)
        self._decouple = np.ones(count, dtype=np.bool_)
        self._all_decoupled = True
        self._limits: _Limits | None = None
        self._limits_asked = b""
        self._velocity_keep = np.zeros((count, 3))
        self._derivative_gain = np.ones((count, 3))
        self._velocity = np.zeros((count, 3))
        self._velocity_rate = np.zeros((count, 3))
        self._heading_before_rad = np.zeros(count)
        self.q_ned_frd = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (count, 1))
        """(N, 4) attitude setpoint."""
        self.thrust = np.zeros(count)
        """(N,) collective thrust setpoint."""

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read MPC_* of vehicle `i`."""

        def value(name: str) -> float:
            return parameters.usable(name)

        def axes(horizontal: str, vertical: str) -> list[float]:
            return [value(horizontal), value(horizontal), value(vertical)]

        self._position_p[i] = axes("MPC_XY_P", "MPC_Z_P")
        self._velocity_p[i] = np.maximum(axes("MPC_XY_VEL_P_ACC", "MPC_Z_VEL_P_ACC"), 0.01)
        self._velocity_i[i] = axes("MPC_XY_VEL_I_ACC", "MPC_Z_VEL_I_ACC")
        self._velocity_d[i] = axes("MPC_XY_VEL_D_ACC", "MPC_Z_VEL_D_ACC")
        self._speed_xy[i] = value("MPC_XY_VEL_MAX")
        self._speed_up[i] = value("MPC_Z_VEL_MAX_UP")
        self._speed_down[i] = value("MPC_Z_VEL_MAX_DN")
        self._thrust_min[i] = value("MPC_THR_MIN")
        self._thrust_max[i] = value("MPC_THR_MAX")
        self._thrust_xy_margin[i] = value("MPC_THR_XY_MARG")
        self._tilt_max[i] = math.radians(value("MPC_TILTMAX_AIR"))
        self._decouple[i] = value("MPC_ACC_DECOUPLE") != 0
        self._all_decoupled = all_of(self._decouple)
        self._limits = None
        self._velocity_keep[i] = 1.0 - _alpha(value("MPC_VEL_LP"), float(self._dt_s))
        self._derivative_gain[i] = _alpha(value("MPC_VELD_LP"), float(self._dt_s))

    def reset(self, mask: BoolArray) -> None:
        """Forget what was integrated for the vehicles in `mask`."""
        self.velocity_integral[mask] = 0.0

    def track(self, estimate: EstimateState) -> None:
        """Keep the filtered velocity and its derivative up to date, also while nobody asks for control."""
        velocity = (
            estimate.velocity_ned_m_s + (self._velocity - estimate.velocity_ned_m_s) * self._velocity_keep
        )
        slope = (velocity - self._velocity) / self._dt_s
        self._velocity_rate += self._derivative_gain * (slope - self._velocity_rate)
        self._velocity = velocity

    def hover_thrust_changed(self, old: FloatArray, new: FloatArray, target: TargetState) -> None:
        """Move the vertical integral so that a new hover thrust (N,) does not change the thrust."""
        demand = target.acceleration_ned_m_s2[:, 2]
        demand = np.where(np.isnan(demand), _ZERO, demand)
        self.velocity_integral[:, 2] += (demand - GRAVITY_M_S2) * (old / new) + GRAVITY_M_S2 - demand

    def update(
        self, setpoints: Setpoints, estimate: EstimateState, hover_thrust: FloatArray, target: TargetState
    ) -> None:
        """One control step for all N; results in `q_ned_frd`, `thrust` and `target`."""
        limits = self._limits_of(setpoints)
        wanted = self._velocity_setpoint(setpoints, estimate, limits)
        error = wanted - self._velocity
        demand = self._velocity_p * error
        demand += self.velocity_integral
        demand -= self._velocity_d * self._velocity_rate
        feedforward = setpoints.acceleration_ned_m_s2
        if any_of(setpoints.ramp_thrust):
            feedforward = feedforward.copy()
            feedforward[setpoints.ramp_thrust, 2] = np.nan
        demand = _bounded(_add_finite(feedforward, demand))
        target.velocity_ned_m_s[:] = wanted
        target.acceleration_ned_m_s2[:] = demand
        unknown = np.isnan(demand)
        if any_of(unknown):
            demand = np.where(unknown, _ZERO, demand)
        unknown = np.isnan(error)
        if any_of(unknown):
            np.copyto(error, _ZERO, where=unknown)

        body_z, thrust = self._acceleration_to_thrust(demand, hover_thrust, limits)
        self._anti_windup(demand, error, thrust, hover_thrust, limits)
        self.thrust[:] = np.sqrt(np.add.reduce(thrust * thrust, axis=1))
        yaw = setpoints.yaw_ned_rad
        # Without a yaw PX4 holds the heading it read one update ago, which brakes a commanded turn a little.
        yaw = np.where(np.isfinite(yaw), yaw, self._heading_before_rad)
        self._heading_before_rad[:] = estimate.heading_rad
        self.q_ned_frd = _attitude(body_z, thrust, self.thrust, yaw)
        target.position_ned_m[:] = setpoints.position_ned_m
        target.yaw_ned_rad[:] = setpoints.yaw_ned_rad
        target.yaw_rate_ned_rad_s[:] = setpoints.yaw_rate_ned_rad_s

    def _velocity_setpoint(
        self, setpoints: Setpoints, estimate: EstimateState, limits: _Limits
    ) -> FloatArray:
        """P control of position on top of the velocity feed-forward, within the speed limits."""
        by_position = _bounded((setpoints.position_ned_m - estimate.position_ned_m) * self._position_p)
        wanted = _bounded(_add_finite(setpoints.velocity_ned_m_s, by_position))
        horizontal = wanted[:, :2]
        too_fast = _length_xy(wanted)[:, None] > self._speed_xy
        if any_of(too_fast):
            first = np.nan_to_num(by_position[:, :2])
            limited = _constrain_xy(first, np.nan_to_num(horizontal - first), self._speed_xy)
            np.copyto(horizontal, limited, where=too_fast)
        down = wanted[:, 2]
        np.minimum(down, self._speed_down, out=down)
        np.maximum(down, limits.climbing_m_s, out=down)
        return wanted

    def _limits_of(self, setpoints: Setpoints) -> _Limits:
        """What holds now; worked out anew only when the autopilot or a parameter changed it."""
        climb, least = setpoints.climb_limit_m_s, setpoints.min_thrust
        most, tilt = setpoints.thrust_limit, setpoints.tilt_limit_rad
        asked = climb.tobytes() + least.tobytes() + most.tobytes() + tilt.tobytes()
        if self._limits is None or asked != self._limits_asked:
            highest = np.minimum(self._thrust_max, most)
            lowest = np.minimum(np.where(np.isnan(least), self._thrust_min, least), highest)
            self._limits_asked = asked
            self._limits = _Limits(
                climbing_m_s=-np.where(np.isnan(climb), self._speed_up, climb),
                lowest=lowest,
                highest=highest,
                lowest_down=-lowest,
                highest_down=-highest,
                highest_squared=highest * highest,
                tilt_rad=np.where(np.isnan(tilt), self._tilt_max, tilt),
            )
        return self._limits

    def _acceleration_to_thrust(
        self, demand: FloatArray, hover_thrust: FloatArray, limits: _Limits
    ) -> tuple[FloatArray, FloatArray]:
        """Tilt towards the demand, lift against gravity; height has precedence over the horizontal part."""
        direction = -demand
        if self._all_decoupled:
            direction[:, 2] = GRAVITY_M_S2
        else:
            direction[:, 2] = _GRAVITY + np.where(self._decouple, _ZERO, direction[:, 2])
            np.maximum(direction[:, 2], _TINY, out=direction[:, 2])
        level = _length_xy(direction)
        tilt = np.minimum(np.arctan2(level, direction[:, 2]), limits.tilt_rad)
        cos_tilt = np.cos(tilt)
        body_z = np.empty_like(direction)
        body_z[:, :2] = direction[:, :2] * (np.sin(tilt) / np.maximum(level, _TINY))[:, None]
        body_z[:, 2] = cos_tilt
        lift = hover_thrust * (_ONE - demand[:, 2] / _GRAVITY)
        collective = np.maximum(lift / cos_tilt, limits.lowest)
        thrust = -body_z * collective[:, None]

        horizontal = _length_xy(thrust)
        margin = np.minimum(horizontal, self._thrust_xy_margin)
        vertical_max = np.sqrt(np.maximum(limits.highest_squared - margin * margin, _ZERO))
        down = thrust[:, 2]
        np.maximum(down, -vertical_max, out=down)
        horizontal_max = np.sqrt(np.maximum(limits.highest_squared - down * down, _ZERO))
        scale = np.minimum(_ONE, horizontal_max / np.maximum(horizontal, _TINY))
        thrust[:, :2] *= scale[:, None]
        return body_z, thrust

    def _anti_windup(
        self,
        demand: FloatArray,
        error: FloatArray,
        thrust: FloatArray,
        hover_thrust: FloatArray,
        limits: _Limits,
    ) -> None:
        """Integrate the velocity error, less what the thrust limits keep from happening."""
        vertical, down = error[:, 2], thrust[:, 2]
        at_least, at_most = down >= limits.lowest_down, down <= limits.highest_down
        if any_of(at_least | at_most):
            stuck = (at_least & (vertical >= _ZERO)) | (at_most & (vertical <= _ZERO))
            np.copyto(vertical, _ZERO, where=stuck)
        produced = thrust[:, :2] * (_GRAVITY / hover_thrust)[:, None]
        wanted = demand[:, :2]
        short = _squared_xy(wanted) > _squared_xy(produced)
        if any_of(short):
            back = (wanted - produced) * (2.0 / self._velocity_p[:, :1])
            back *= short[:, None]
            error[:, :2] -= back
        self.velocity_integral += error * self._velocity_i * self._dt_s
        vertical = self.velocity_integral[:, 2]
        np.maximum(vertical, -_GRAVITY, out=vertical)
        np.minimum(vertical, _GRAVITY, out=vertical)


@dataclass(frozen=True, slots=True)
class _Limits:
    """What parameters and take-off state allow, (N,) each; NED, so upwards is negative."""

    climbing_m_s: FloatArray
    lowest: FloatArray
    highest: FloatArray
    lowest_down: FloatArray
    highest_down: FloatArray
    highest_squared: FloatArray
    tilt_rad: FloatArray


def _squared_xy(vector: FloatArray) -> FloatArray:
    """Squared horizontal length (N,); two columns are added in half the time of a sum over an axis."""
    squares = vector * vector
    return squares[:, 0] + squares[:, 1]


def _length_xy(vector: FloatArray) -> FloatArray:
    return np.sqrt(_squared_xy(vector))


def _alpha(cutoff_hz: float, dt_s: float) -> float:
    """Gain of a first-order low-pass; one without a cutoff."""
    if cutoff_hz <= 0.0:
        return 1.0
    return dt_s / (dt_s + 1.0 / (2.0 * math.pi * cutoff_hz))


def _add_finite(a: FloatArray, b: FloatArray) -> FloatArray:
    """a + b where both are numbers, else the one that is, else NaN."""
    total = a + b
    unknown = np.isnan(total)
    if any_of(unknown):
        total = np.where(unknown, np.where(np.isnan(a), b, a), total)
    return total


def _bounded(values: FloatArray) -> FloatArray:
    """Keep what nobody can fly (infinite, 1e30) from overflowing; NaN stays NaN."""
    return np.maximum(np.minimum(values, _BEYOND), _SLOWEST)


def _constrain_xy(first: FloatArray, second: FloatArray, limit: FloatArray) -> FloatArray:
    """`first` and as much of `second` as keeps the length within `limit` (N, 1)."""
    first_norm = np.sqrt((first * first).sum(axis=1, keepdims=True))
    second_norm = np.maximum(np.sqrt((second * second).sum(axis=1, keepdims=True)), _TINY)
    unit = second / second_norm
    along = (first * unit).sum(axis=1, keepdims=True)
    room = np.maximum(along * along - first_norm * first_norm + limit * limit, 0.0)
    length = np.clip(-along + np.sqrt(room), 0.0, second_norm)
    shortened = first * (limit / np.maximum(first_norm, _TINY))
    return np.where(first_norm >= limit, shortened, first + unit * length)


def _attitude(
    body_z: FloatArray, thrust: FloatArray, collective: FloatArray, yaw_ned_rad: FloatArray
) -> FloatArray:
    """Attitude that lifts along `thrust` (`body_z` where its length is nothing), nose towards the yaw."""
    norm = collective[:, None]
    some = norm > _TINY
    z = -thrust / norm if all_of(some) else np.where(some, -thrust / np.maximum(norm, _TINY), body_z)
    sin_yaw, cos_yaw, down = np.sin(yaw_ned_rad), np.cos(yaw_ned_rad), z[:, 2]
    matrix = np.empty((z.shape[0], 3, 3))
    x = matrix[:, :, 0]
    x[:, 0] = cos_yaw * down
    x[:, 1] = sin_yaw * down
    x[:, 2] = -(cos_yaw * z[:, 0] + sin_yaw * z[:, 1])
    x /= row_norm(x)
    matrix[:, :, 1] = cross(z, x)
    matrix[:, :, 2] = z
    return quaternion_from_matrix(matrix)
