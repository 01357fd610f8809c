"""Runs the controllers in order: position and attitude at 125 Hz, body rates and motors at 250 Hz.

PX4 runs the outer loops at each output of the estimator, which is every second IMU sample of the SIH, and the
rate loop at each IMU sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.control.allocation import Allocation
from vehicle_sim.control.attitude import AttitudeControl
from vehicle_sim.control.hover_thrust import HoverThrust
from vehicle_sim.control.position import PositionControl
from vehicle_sim.control.rate import RateControl
from vehicle_sim.control.setpoints import ControlLevel, Setpoints
from vehicle_sim.kernels import Column, Flags, Integers, Rows, kernel
from vehicle_sim.masks import any_nonzero, any_of
from vehicle_sim.parameters import Parameters
from vehicle_sim.rotations import constrain
from vehicle_sim.state import ROTOR_COUNT, EstimateState, FlightMoment, TargetState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

OUTER_EVERY_STEPS = 2
HOVER_THRUST_EVERY_UPDATES = 5
"""The hover thrust is estimated at each fifth update of the outer loops."""
# Plain numbers: NumPy compares with an enumeration member ten times slower.
_DISARMED, _MOTORS, _THRUST_TORQUE, _RATES, _ATTITUDE, _TRAJECTORY = (int(level) for level in ControlLevel)

_MIN_QUATERNION_NORM = 1e-3
_MAX_RATE_RAD_S = 100.0
MOTOR_DISARMED_US = 900.0
MOTOR_MIN_US = 1000.0
MOTOR_SPAN_US = 1000.0


class Cascade:
    """The controllers of N vehicles.

    A lower-level setpoint (attitude, rates, thrust and torque, or motors) that arrives while a vehicle is
    controlled at a higher level overrides the output of the higher controllers until they run again, as a
    uORB message does in PX4: see `Setpoints.override_level`.

    Args:
        count: N.
        dt_s: step.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        outer_s = dt_s * OUTER_EVERY_STEPS
        self.position = PositionControl(count, outer_s)
        self.hover = HoverThrust(count, outer_s * HOVER_THRUST_EVERY_UPDATES)
        self._attitude = AttitudeControl(count)
        self.rate = RateControl(count, dt_s)
        self._allocation = Allocation(count)
        self._steps = 0
        self._thrust = np.zeros(count)
        self._groups = _Groups.for_count(count)
        self._any_torque_or_motors = False
        """Whether any vehicle is at level THRUST_TORQUE or MOTORS."""
        self.motor_signal = np.zeros((count, ROTOR_COUNT))
        """(N, 4) 0..1, motor signals to the rotors."""
        self.motors_us = np.full((count, ROTOR_COUNT), MOTOR_DISARMED_US)
        """(N, 4) motor signals as PX4 reports them: 900 disarmed, 1000..2000 armed."""
        self.torque_frd = np.zeros((count, 3))
        """(N, 3) normalised, last torque setpoint of the mixer."""
        self.target = TargetState(
            q_ned_frd=np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (count, 1)),
            rates_frd_rad_s=np.zeros((count, 3)),
            thrust=np.zeros(count),
            position_ned_m=np.full((count, 3), np.nan),
            velocity_ned_m_s=np.full((count, 3), np.nan),
            acceleration_ned_m_s2=np.full((count, 3), np.nan),
            yaw_ned_rad=np.full(count, np.nan),
            yaw_rate_ned_rad_s=np.full(count, np.nan),
            hover_thrust=self.hover.value,
        )

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads all control parameters of vehicle `i`."""
        for controller in (self._allocation, self.position, self.hover, self._attitude, self.rate):
            controller.configure(i, parameters)

    def place(self, i: int, moment: FlightMoment) -> None:
        """Gives the controllers of vehicle `i` the memory of a moment of a flight."""
        self.position.place(i, moment.velocity_ned_m_s, moment.velocity_integral)
        self.rate.integral[i] = moment.rate_integral
        self.hover.value[i] = moment.hover_thrust

    def update(self, setpoints: Setpoints, estimate: EstimateState) -> None:
        """Runs one step; results are in `motor_signal`, `motors_us` and `target`."""
        groups = self._groups
        self._steps += 1
        if self._steps % OUTER_EVERY_STEPS == 0:
            self._update_outer_loops(setpoints, estimate)
        elif any_nonzero(setpoints.override_level):
            self._override_rates(setpoints)
        self.rate.update(
            groups.rates, estimate.rates_frd_rad_s, estimate.angular_acceleration_frd_rad_s2,
            self.target.rates_frd_rad_s, setpoints.landed, self._allocation.unallocated, self.torque_frd,
        )  # fmt: skip
        if self._any_torque_or_motors:
            torque = np.nan_to_num(setpoints.torque_frd)
            np.copyto(self.torque_frd, torque, where=(groups.level == _THRUST_TORQUE)[:, None])
        self._allocation.update(groups.powered, self.torque_frd, self._thrust, self.motor_signal)
        _write_motors(groups.level, setpoints.armed, setpoints.motors, self.motor_signal, self.motors_us)
        if any_nonzero(setpoints.override_level):
            self._override_motors(setpoints)

    def _override_motors(self, setpoints: Setpoints) -> None:
        """Applies setpoints at level THRUST_TORQUE or MOTORS that override a higher level, for this step
        only."""
        rows = (setpoints.override_level == _THRUST_TORQUE) & self._groups.powered
        if any_of(rows):
            torque = np.nan_to_num(setpoints.torque_frd)
            self._allocation.update(rows, torque, np.nan_to_num(setpoints.thrust), self.motor_signal)
            setpoints.override_level[rows] = _DISARMED
        rows = (setpoints.override_level == _MOTORS) & self._groups.powered
        if any_of(rows):
            signals = np.clip(np.nan_to_num(setpoints.motors), 0.0, 1.0)
            np.copyto(self.motor_signal, signals, where=rows[:, None])
            setpoints.override_level[rows] = _DISARMED

    def _override_rates(self, setpoints: Setpoints) -> None:
        """Applies body rates that override a higher level and were received between two runs of the outer
        loops."""
        rows = (setpoints.override_level == _RATES) & self._groups.trajectory
        if any_of(rows):
            rates = np.clip(np.nan_to_num(setpoints.rates_frd_rad_s), -_MAX_RATE_RAD_S, _MAX_RATE_RAD_S)
            np.copyto(self.target.rates_frd_rad_s, rates, where=rows[:, None])
            np.copyto(self._thrust, np.clip(np.nan_to_num(setpoints.thrust), 0.0, 1.0), where=rows)
            setpoints.override_level[rows] = _DISARMED

    def _update_outer_loops(self, setpoints: Setpoints, estimate: EstimateState) -> None:
        target, groups = self.target, self._groups
        self._any_torque_or_motors = _update_groups(
            setpoints.level, setpoints.armed, setpoints.landed, setpoints.ramp_thrust, groups.level,
            groups.powered, groups.rates, groups.attitude, groups.trajectory, groups.reset_integral,
            groups.reset_hover, self._thrust, target.rates_frd_rad_s,
        )  # fmt: skip
        self.position.filter_velocity(estimate)
        self.hover.reset(groups.reset_hover)
        self.position.update(
            groups.trajectory,
            groups.reset_integral,
            setpoints,
            estimate,
            self.hover.value,
            target,
            self._thrust,
        )
        _copy_lower_levels(
            groups.level, setpoints.override_level, setpoints.q_ned_frd, setpoints.rates_frd_rad_s,
            setpoints.thrust, target.q_ned_frd, target.rates_frd_rad_s, self._thrust,
        )  # fmt: skip
        self._attitude.update(
            groups.attitude, estimate.q_ned_frd, target.q_ned_frd, setpoints.yaw_rate_ned_rad_s,
            target.rates_frd_rad_s,
        )  # fmt: skip
        target.thrust[:] = self._thrust
        if self._steps % (OUTER_EVERY_STEPS * HOVER_THRUST_EVERY_UPDATES) == 0:
            self._estimate_hover_thrust(groups.trajectory & ~groups.reset_hover, estimate)

    def _estimate_hover_thrust(self, in_flight: BoolArray, estimate: EstimateState) -> None:
        if not any_of(in_flight):
            return
        q = estimate.q_ned_frd
        cos_tilt = 1.0 - 2.0 * (q[:, 1] * q[:, 1] + q[:, 2] * q[:, 2])
        old = self.hover.value.copy()
        self.hover.update(
            in_flight,
            self._thrust * cos_tilt,
            -estimate.acceleration_ned_m_s2[:, 2],
            estimate.velocity_ned_m_s,
        )
        new = self.hover.value
        self.position.compensate_hover_thrust(old != new, old, new, self.target)


@dataclass(frozen=True, slots=True)
class _Groups:
    """Vehicles by control level at the last run of the outer controllers; (N,) each, written in place."""

    level: IntArray
    """ControlLevel; DISARMED for vehicles that are not armed."""
    powered: BoolArray
    """Vehicles for which at least one controller runs."""
    rates: BoolArray
    """Vehicles whose body rates are controlled."""
    attitude: BoolArray
    """Vehicles whose attitude is controlled."""
    trajectory: BoolArray
    """Vehicles at level TRAJECTORY."""
    reset_integral: BoolArray
    """Vehicles at level TRAJECTORY that have just entered this level, or that are on the ground before the
    take-off ramp. PX4 starts to integrate at the start of the ramp, while the vehicle is still on the ground.
    The integral then reduces the thrust, so that the vehicle lifts off only about 3 s after the start of the
    ramp."""
    reset_hover: BoolArray
    """Vehicles that are not in flight: their hover thrust is reset to MPC_THR_HOVER."""

    @classmethod
    def for_count(cls, count: int) -> _Groups:
        """Groups of disarmed vehicles."""
        masks = np.zeros((6, count), dtype=np.bool_)
        return cls(np.zeros(count, dtype=np.int64), *masks)


@kernel
def _update_groups(
    requested_level: Integers, armed: Flags, landed: Flags, ramp_thrust: Flags, level: Integers,
    powered: Flags, rates: Flags, attitude: Flags, trajectory: Flags, reset_integral: Flags,
    reset_hover: Flags, thrust: Column, target_rates: Rows,
) -> bool:  # fmt: skip
    """Groups the vehicles; vehicles without a controller get zero thrust. Returns whether any vehicle is at
    level THRUST_TORQUE or MOTORS."""
    any_torque_or_motors = False
    for i in range(level.shape[0]):
        level[i] = current = requested_level[i] if armed[i] else _DISARMED
        powered[i], rates[i], attitude[i] = current > _DISARMED, current >= _RATES, current >= _ATTITUDE
        on_trajectory = current == _TRAJECTORY
        reset_integral[i] = on_trajectory and (not trajectory[i] or (landed[i] and not ramp_thrust[i]))
        trajectory[i] = on_trajectory
        reset_hover[i] = not armed[i] or landed[i] or ramp_thrust[i]
        if not powered[i]:
            thrust[i] = target_rates[i, 0] = target_rates[i, 1] = target_rates[i, 2] = 0.0
        any_torque_or_motors = any_torque_or_motors or (powered[i] and not rates[i])
    return any_torque_or_motors


@kernel
def _copy_lower_levels(
    level: Integers, override_level: Integers, q: Rows, rates: Rows, thrust: Column,
    target_q: Rows, target_rates: Rows, target_thrust: Column,
) -> None:  # fmt: skip
    """Copies the setpoints of vehicles at the levels ATTITUDE to MOTORS; an invalid quaternion is ignored.

    An attitude setpoint that overrides a trajectory is applied once.
    """
    for i in range(level.shape[0]):
        overrides = override_level[i] == _ATTITUDE and level[i] == _TRAJECTORY
        if override_level[i] == _ATTITUDE:
            override_level[i] = _DISARMED
        if level[i] == _DISARMED or (level[i] == _TRAJECTORY and not overrides):
            continue
        target_thrust[i] = 0.0 if math.isnan(thrust[i]) else constrain(thrust[i], 0.0, 1.0)
        if level[i] >= _ATTITUDE:
            norm = math.sqrt(q[i, 0] ** 2 + q[i, 1] ** 2 + q[i, 2] ** 2 + q[i, 3] ** 2)
            if math.isfinite(norm) and norm > _MIN_QUATERNION_NORM:
                for k in range(4):
                    target_q[i, k] = q[i, k] / norm
        elif level[i] == _RATES:
            for k in range(3):
                rate = rates[i, k]
                target_rates[i, k] = (
                    0.0 if math.isnan(rate) else constrain(rate, -_MAX_RATE_RAD_S, _MAX_RATE_RAD_S)
                )


@kernel
def _write_motors(level: Integers, armed: Flags, motors: Rows, signal: Rows, motors_us: Rows) -> None:
    """Writes the motor signals. At level MOTORS a motor with NaN or a negative signal stops."""
    for i in range(level.shape[0]):
        for k in range(ROTOR_COUNT):
            if not armed[i]:
                signal[i, k], motors_us[i, k] = 0.0, MOTOR_DISARMED_US
                continue
            running = True
            if level[i] == _MOTORS:
                running = motors[i, k] >= 0.0
                signal[i, k] = min(motors[i, k], 1.0) if running else 0.0
            motors_us[i, k] = MOTOR_MIN_US + MOTOR_SPAN_US * signal[i, k] if running else MOTOR_DISARMED_US
