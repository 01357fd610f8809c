"""The controllers in their order: position and attitude at 125 Hz, body rates and motors at 250 Hz.

PX4 runs the outer loops whenever the estimator publishes, every second IMU sample of the SIH, and the rate
loop on each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.control.allocation import Allocation
from vehicle_sim.control.attitude import AttitudeControl
from vehicle_sim.control.hover_thrust import HoverThrust
from vehicle_sim.control.position import PositionControl
from vehicle_sim.control.rate import RateControl
from vehicle_sim.control.setpoints import ControlLevel, Setpoints
from vehicle_sim.frames import row_norm
from vehicle_sim.masks import all_of, any_nonzero, any_of
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import ROTOR_COUNT, EstimateState, TargetState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

OUTER_EVERY_STEPS = 2
HOVER_EVERY_OUTER = 5
# Plain numbers: NumPy compares with an enumeration member ten times slower.
_DISARMED, _MOTORS, _THRUST_TORQUE, _RATES, _ATTITUDE, _TRAJECTORY = (int(level) for level in ControlLevel)

_SHORTEST_QUATERNION = 1e-3
_FASTEST_RAD_S = 100.0
MOTOR_DISARMED_US = 900.0
MOTOR_MIN_US = 1000.0
MOTOR_SPAN_US = 1000.0
# Arrays without dimensions: NumPy takes twice as long to multiply with a plain number.
_MIN_US, _SPAN_US = np.array(MOTOR_MIN_US), np.array(MOTOR_SPAN_US)


class Cascade:
    """The controllers of N vehicles.

    Args:
        count: N.
        dt_s: step.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        outer_s = dt_s * OUTER_EVERY_STEPS
        self._position = PositionControl(count, outer_s)
        self._hover = HoverThrust(count, outer_s * HOVER_EVERY_OUTER)
        self._attitude = AttitudeControl(count)
        self._rate = RateControl(count, dt_s)
        self._allocation = Allocation(count)
        self._steps = 0
        self._thrust = np.zeros(count)
        self._split = _split(Setpoints.idle(count))
        self._split_of = b""
        self._was_trajectory = np.zeros(count, dtype=np.bool_)
        self.motor_signal = np.zeros((count, ROTOR_COUNT))
        """(N, 4) 0..1, what the rotors follow."""
        self.motors_us = np.full((count, ROTOR_COUNT), MOTOR_DISARMED_US)
        """(N, 4) the same as PX4 reports it: 900 disarmed, 1000..2000 armed."""
        self.torque_frd = np.zeros((count, 3))
        """(N, 3) normalised, what was asked of the mixer last."""
        self.target = TargetState(
            q_ned_frd=np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (count, 1)),
            rates_frd_rad_s=np.zeros((count, 3)),
            thrust=np.zeros(count),
            position_ned_m=np.full((count, 3), np.nan),
            velocity_ned_m_s=np.full((count, 3), np.nan),
            acceleration_ned_m_s2=np.full((count, 3), np.nan),
            yaw_ned_rad=np.full(count, np.nan),
            yaw_rate_ned_rad_s=np.full(count, np.nan),
            hover_thrust=self._hover.value,
        )

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read all control parameters of vehicle `i`."""
        for block in (self._allocation, self._position, self._hover, self._attitude, self._rate):
            block.configure(i, parameters)

    def reset(self, i: int) -> None:
        """Vehicle `i` starts anew."""
        mask = np.zeros(self._thrust.shape, dtype=np.bool_)
        mask[i] = True
        self._position.reset(mask)
        self._hover.reset(mask)
        self._rate.reset(mask)
        self._thrust[i] = 0.0
        self.motor_signal[i] = 0.0
        self.motors_us[i] = MOTOR_DISARMED_US
        self._was_trajectory = self._was_trajectory.copy()
        self._was_trajectory[i] = False

    def update(self, setpoints: Setpoints, estimate: EstimateState) -> None:
        """One step; results in `motor_signal`, `motors_us` and `target`."""
        self._steps += 1
        if self._steps % OUTER_EVERY_STEPS == 0:
            self._outer(setpoints, estimate)
        elif any_nonzero(setpoints.cut_in):
            self._cut_in_rates(setpoints)
        split = self._split
        if not split.any_powered:
            self.motor_signal.fill(0.0)
            self.torque_frd.fill(0.0)
        else:
            torque = self._rate.update(
                estimate.rates_frd_rad_s,
                estimate.angular_acceleration_frd_rad_s2,
                self.target.rates_frd_rad_s,
                setpoints.landed,
                self._allocation.short_of,
            )
            if split.any_below_rates:
                np.copyto(torque, np.nan_to_num(setpoints.torque_frd), where=split.below_rates[:, None])
            if split.all_powered:
                self.torque_frd[:] = torque
            else:
                # Else the mixer would look in vain for signals that give a vehicle on the ground a torque.
                np.multiply(torque, split.powered[:, None], out=self.torque_frd)
            motors = self._allocation.update(self.torque_frd, self._thrust)
            if split.all_powered:
                self.motor_signal[:] = motors
            else:
                np.multiply(motors, split.powered[:, None], out=self.motor_signal)
        np.multiply(self.motor_signal, _SPAN_US, out=self.motors_us)
        self.motors_us += _MIN_US
        if split.any_by_motors:
            self._drive_motors(setpoints)
        if not all_of(setpoints.armed):
            self.motors_us[~setpoints.armed] = MOTOR_DISARMED_US
            self.motor_signal[~setpoints.armed] = 0.0

    def _drive_motors(self, setpoints: Setpoints) -> None:
        """Motor signals that bypass all controllers; a motor with NaN or a negative signal stands still."""
        wanted = np.minimum(setpoints.motors, 1.0)
        turning = wanted >= 0.0
        rows = self._split.by_motors[:, None]
        signal = np.where(turning, wanted, 0.0)
        np.copyto(self.motor_signal, signal, where=rows)
        pulses = np.where(turning, MOTOR_MIN_US + MOTOR_SPAN_US * signal, MOTOR_DISARMED_US)
        np.copyto(self.motors_us, pulses, where=rows)

    def _cut_in_rates(self, setpoints: Setpoints) -> None:
        """Body rates that arrived between two outputs of the outer controllers are flown at once."""
        rows = (setpoints.cut_in == _RATES) & self._was_trajectory
        if any_of(rows):
            rates = np.clip(np.nan_to_num(setpoints.rates_frd_rad_s), -_FASTEST_RAD_S, _FASTEST_RAD_S)
            np.copyto(self.target.rates_frd_rad_s, rates, where=rows[:, None])
            np.copyto(self._thrust, np.clip(np.nan_to_num(setpoints.thrust), 0.0, 1.0), where=rows)
            setpoints.cut_in[rows] = _DISARMED

    def _outer(self, setpoints: Setpoints, estimate: EstimateState) -> None:
        target, split = self.target, self._split_now(setpoints)
        trajectory = split.trajectory
        if not split.all_powered:
            idle = ~split.powered
            self._rate.reset(idle)
            self._thrust[idle] = 0.0
            target.rates_frd_rad_s[idle] = 0.0
        self._position.track(estimate)
        if split.any_grounded:
            self._hover.reset(split.grounded)
        if split.any_trajectory:
            fresh = split.standing
            if self._was_trajectory is not trajectory:
                fresh = fresh | (trajectory & ~self._was_trajectory)
            if any_of(fresh):
                self._position.reset(fresh)
            self._position.update(setpoints, estimate, self._hover.value, target)
            if split.all_trajectory:
                target.q_ned_frd[:] = self._position.q_ned_frd
                self._thrust[:] = self._position.thrust
            else:
                np.copyto(target.q_ned_frd, self._position.q_ned_frd, where=trajectory[:, None])
                np.copyto(self._thrust, self._position.thrust, where=trajectory)
        self._was_trajectory = trajectory
        if split.any_lower:
            self._take_lower_levels(split, setpoints)
        if any_nonzero(setpoints.cut_in):
            self._take_attitudes(setpoints, (setpoints.cut_in == _ATTITUDE) & trajectory)
            setpoints.cut_in[setpoints.cut_in == _ATTITUDE] = _DISARMED
        if split.any_turned:
            rates = self._attitude.update(estimate.q_ned_frd, target.q_ned_frd, setpoints.yaw_rate_ned_rad_s)
            if split.all_turned:
                target.rates_frd_rad_s[:] = rates
            else:
                np.copyto(target.rates_frd_rad_s, rates, where=split.turned[:, None])
        target.thrust[:] = self._thrust
        if self._steps % (OUTER_EVERY_STEPS * HOVER_EVERY_OUTER) == 0:
            self._learn_hover(split.airborne, estimate)

    def _split_now(self, setpoints: Setpoints) -> _Split:
        """Groups the vehicles by control level; computed again only when a level, arming or take-off state
        changes."""
        armed, landed, ramp = setpoints.armed, setpoints.landed, setpoints.ramp_thrust
        split_of = setpoints.level.tobytes() + armed.tobytes() + landed.tobytes() + ramp.tobytes()
        if split_of != self._split_of:
            self._split, self._split_of = _split(setpoints), split_of
        return self._split

    def _take_lower_levels(self, split: _Split, setpoints: Setpoints) -> None:
        """Attitude, rate and thrust setpoints of vehicles flown by them; no number changes nothing."""
        self._take_attitudes(setpoints, split.by_attitude)
        rates = np.clip(np.nan_to_num(setpoints.rates_frd_rad_s), -_FASTEST_RAD_S, _FASTEST_RAD_S)
        np.copyto(self.target.rates_frd_rad_s, rates, where=split.by_rates[:, None])
        thrust = np.clip(np.nan_to_num(setpoints.thrust), 0.0, 1.0)
        np.copyto(self._thrust, thrust, where=split.direct)
        if split.any_below_rates or split.any_by_motors:
            self._rate.reset(split.below_rates | split.by_motors)

    def _take_attitudes(self, setpoints: Setpoints, rows: BoolArray) -> None:
        """Attitude and thrust as asked for the vehicles in `rows`."""
        length = row_norm(setpoints.q_ned_frd)
        usable = rows[:, None] & np.isfinite(length) & (length > _SHORTEST_QUATERNION)
        q = setpoints.q_ned_frd / np.where(usable, length, 1.0)
        np.copyto(self.target.q_ned_frd, q, where=usable)
        np.copyto(self._thrust, np.clip(np.nan_to_num(setpoints.thrust), 0.0, 1.0), where=rows)

    def _learn_hover(self, flying: BoolArray, estimate: EstimateState) -> None:
        if not any_of(flying):
            return
        q = estimate.q_ned_frd
        cos_tilt = 1.0 - 2.0 * (q[:, 1] * q[:, 1] + q[:, 2] * q[:, 2])
        old = self._hover.value.copy()
        self._hover.update(
            flying,
            self._thrust * cos_tilt,
            -estimate.acceleration_ned_m_s2[:, 2],
            estimate.velocity_ned_m_s,
        )
        self._position.hover_thrust_changed(old, self._hover.value, self.target)


@dataclass(frozen=True, slots=True)
class _Split:
    """Masks (N,) of the vehicles by control level, read-only, and whether any or all of them are true."""

    powered: BoolArray
    any_powered: bool
    all_powered: bool
    by_motors: BoolArray
    any_by_motors: bool
    below_rates: BoolArray
    any_below_rates: bool
    by_rates: BoolArray
    by_attitude: BoolArray
    direct: BoolArray
    """Past the attitude controller."""
    any_lower: bool
    """Whether any is flown by attitude or directly."""
    turned: BoolArray
    """By the attitude controller."""
    any_turned: bool
    all_turned: bool
    trajectory: BoolArray
    any_trajectory: bool
    all_trajectory: bool
    standing: BoolArray
    """Of those on a trajectory: nothing is integrated yet. PX4 integrates from the start of the take-off ramp
    on, though the vehicle still stands: that downward part is what lets it lift about 3 s after the ramp
    began."""
    grounded: BoolArray
    any_grounded: bool
    airborne: BoolArray
    """Of those on a trajectory: the hover thrust can be learnt."""


def _split(setpoints: Setpoints) -> _Split:
    armed, landed, ramp = setpoints.armed, setpoints.landed, setpoints.ramp_thrust
    level = np.where(armed, setpoints.level, _DISARMED)
    powered, turned, trajectory = level > _DISARMED, level >= _ATTITUDE, level == _TRAJECTORY
    by_motors, below_rates, by_attitude = level == _MOTORS, level == _THRUST_TORQUE, level == _ATTITUDE
    direct = powered & ~turned
    grounded = ~armed | landed | ramp
    return _Split(
        powered=powered,
        any_powered=any_of(powered),
        all_powered=all_of(powered),
        by_motors=by_motors,
        any_by_motors=any_of(by_motors),
        below_rates=below_rates,
        any_below_rates=any_of(below_rates),
        by_rates=level == _RATES,
        by_attitude=by_attitude,
        direct=direct,
        any_lower=any_of(by_attitude | direct),
        turned=turned,
        any_turned=any_of(turned),
        all_turned=all_of(turned),
        trajectory=trajectory,
        any_trajectory=any_of(trajectory),
        all_trajectory=all_of(trajectory),
        standing=trajectory & landed & ~ramp,
        grounded=grounded,
        any_grounded=any_of(grounded),
        airborne=trajectory & ~grounded,
    )
