"""Flies a part of a logged flight again: row 0 as it was, row 1 with changes.

Both start at one moment with the logged position, velocity, attitude, rates and motor signals. Before it, the
controllers see the logged flight for some seconds, and their integrals are moved until their output is the
logged one: so they start as the vehicle's own did. From then on the simulated bodies follow the logged
setpoints. Estimates are the truth: errors of the vehicle's estimator are not simulated, nor what would have
changed the setpoints themselves (modes, missions, failsafes, obstacle avoidance).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.what_if.flight import LoggedFlight, NotFlyable
from vehicle_sim.airframe import Airframe
from vehicle_sim.control.cascade import Cascade
from vehicle_sim.control.setpoints import ControlLevel, Setpoints
from vehicle_sim.estimator.estimator import blank_estimate
from vehicle_sim.estimator.gyro_filter import GyroFilter
from vehicle_sim.frames import GRAVITY_M_S2, rotation_matrix, yaw_of
from vehicle_sim.parameters import Parameters, ParameterValue
from vehicle_sim.physics.rigid_body import RigidBodies
from vehicle_sim.px4_version import DEFAULT, Px4Version
from vehicle_sim.simulation import STEP_S
from vehicle_sim.state import FlightMoment

Values = NDArray[np.float64]

AS_IT_WAS, CHANGED = 0, 1
ALL_WORK = (1.0, 1.0, 1.0, 1.0)
NOT_MOVED = (0.0, 0.0, 0.0)
SETTLE_S = 0.4
"""Time constant with which an integral takes up the difference of the logged and the simulated output."""


@dataclass(frozen=True, slots=True)
class Change:
    """What is different in the changed flight; empty: nothing."""

    parameters: Mapping[str, float]
    wind_ned_m_s: tuple[float, float, float] | None = None
    """Steady wind instead of the one found in the log."""
    motor_health: tuple[float, float, float, float] = ALL_WORK
    """Factor on each motor's thrust; 0: the motor stops."""
    moved_ned_m: tuple[float, float, float] = NOT_MOVED
    """What is added to the position setpoints."""


@dataclass(frozen=True, slots=True)
class Track:
    """What one vehicle did; M samples after the start."""

    position_ned_m: Values
    """(M, 3)."""
    velocity_ned_m_s: Values
    """(M, 3)."""
    q_ned_frd: Values
    """(M, 4)."""


class RecordedParameters(Parameters):
    """Parameters that know which of them were read."""

    def __init__(self, overrides: Mapping[str, float], px4: Px4Version = DEFAULT) -> None:
        self.used: set[str] = set()
        known = Parameters(px4=px4)
        super().__init__({name: value for name, value in overrides.items() if name in known}, px4=px4)

    def get(self, name: str) -> ParameterValue:
        """The value; see the base class."""
        self.used.add(name)
        return super().get(name)


class Rerun:
    """The two flights.

    Args:
        flight: the logged flight, from some seconds before the start.
        parameters: of the aircraft, including the model of its body (SIH_*).
        wind_ned_m_s: (N, 3) wind at each sample of the flight.
        change: what is different in row 1.

    Raises:
        NotFlyable: a changed parameter is not used by this simulation, or describes no valid aircraft.
    """

    def __init__(
        self,
        flight: LoggedFlight,
        parameters: Mapping[str, float],
        wind_ned_m_s: Values,
        change: Change,
    ) -> None:
        self._flight = flight
        self._bodies = RigidBodies(2, STEP_S)
        self._bodies.ground_down_m[:] = flight.position_ned_m[
            :, 2
        ].max()  # the lowest it was: nothing is known below
        self._cascade = Cascade(2, STEP_S)
        self._gyro = GyroFilter(2, STEP_S)
        self._estimate = blank_estimate(2)
        self._setpoints = Setpoints.idle(2)
        self._wind_ned_m_s, self._changed_wind_ned_m_s = wind_ned_m_s, change.wind_ned_m_s
        self._moved_ned_m = np.array([NOT_MOVED, change.moved_ned_m])
        self._health = np.array([(1.0,) * 4, change.motor_health])
        own = RecordedParameters(parameters)
        self._configure(AS_IT_WAS, own)
        unused = sorted(name for name in change.parameters if name not in own.used)
        if unused:
            raise NotFlyable(
                f"{unused[0]} does not change how logged setpoints are followed; parameters of control "
                "(MC_*, MPC_* of gains and limits) and of the body (SIH_*) do.",
                field="parameters",
            )
        self._stores = (own, RecordedParameters({**parameters, **change.parameters}))
        self._configure(CHANGED, own)

    def _configure(self, row: int, store: Parameters) -> None:
        try:
            self._bodies.configure(row, Airframe.from_parameters(store))
            self._cascade.configure(row, store)
        except ValueError as error:
            raise NotFlyable(f"{error}.", field="parameters") from error
        self._gyro.configure(
            row, store.finite_value("IMU_GYRO_CUTOFF"), store.finite_value("IMU_DGYRO_CUTOFF")
        )

    def fly(self, from_s: float) -> tuple[Track, Track]:
        """Flies from a time to the landing, or to the end of the logged flight; returns both tracks.

        Raises:
            NotFlyable: the vehicle is not armed and in the air then.
        """
        flight, start = self._flight, self._settle(from_s)
        self._configure(CHANGED, self._stores[CHANGED])
        self._begin(start)
        count = flight.landing_after(start) - start
        followed = flight.target_position_ned_m[start : start + count]
        for axis, moved_m in enumerate(self._moved_ned_m[CHANGED]):
            if moved_m != 0.0 and not np.isfinite(followed[:, axis]).any():
                raise NotFlyable(
                    "In this part no position setpoint is followed on this axis: there is nothing to move.",
                    field="moved_ned_m",
                )
        tracks = tuple(
            Track(np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 4))) for _ in range(2)
        )
        state = self._bodies.state
        for n in range(count):
            for row, track in enumerate(tracks):
                track.position_ned_m[n] = state.position_ned_m[row]
                track.velocity_ned_m_s[n] = state.velocity_ned_m_s[row]
                track.q_ned_frd[n] = state.q_ned_frd[row]
            self._estimate_is_true()
            self._blow(start + n)
            self._control(start + n, self._moved_ned_m)
            self._bodies.step(self._cascade.motor_signal, self._health)
        return tracks[0], tracks[1]

    def moment(self, from_s: float) -> FlightMoment:
        """The logged moment, with the controllers' integrals. Raises NotFlyable as `fly`."""
        self._begin(self._settle(from_s))
        state, cascade = self._bodies.state, self._cascade
        return FlightMoment(
            position_ned_m=state.position_ned_m[AS_IT_WAS],
            velocity_ned_m_s=state.velocity_ned_m_s[AS_IT_WAS],
            q_ned_frd=state.q_ned_frd[AS_IT_WAS],
            rates_frd_rad_s=state.rates_frd_rad_s[AS_IT_WAS],
            rotor_thrust=state.rotor_thrust[AS_IT_WAS],
            velocity_integral=cascade.position.velocity_integral[AS_IT_WAS],
            rate_integral=cascade.rate.integral[AS_IT_WAS],
            hover_thrust=float(cascade.hover.value[AS_IT_WAS]),
        )

    def _settle(self, from_s: float) -> int:
        """The controllers see the flight before; returns the index of its first sample at or after a time."""
        flight, start = self._flight, self._flight.first_after(from_s)
        if start >= len(flight.t_s) or flight.landed[start] or flight.level[start] == ControlLevel.DISARMED:
            raise NotFlyable(f"The vehicle is not in the air at {from_s:.1f} s.")
        for n in range(start):
            self._see(n)
        return start

    def _see(self, n: int) -> None:
        """The controllers see sample `n`; the position controller's integral approaches the logged one."""
        flight, estimate = self._flight, self._estimate
        estimate.position_ned_m[:] = flight.position_ned_m[n]
        estimate.velocity_ned_m_s[:] = flight.velocity_ned_m_s[n]
        estimate.q_ned_frd[:] = flight.q_ned_frd[n]
        estimate.heading_rad[:] = yaw_of(estimate.q_ned_frd)
        gyro = np.tile(flight.rates_frd_rad_s[n], (2, 1))
        self._gyro.update(gyro, estimate.rates_frd_rad_s, estimate.angular_acceleration_frd_rad_s2)
        if np.isfinite(flight.hover_thrust[n]):
            self._cascade.hover.value[:] = flight.hover_thrust[n]
        self._control(n)
        commanded = flight.commanded_acceleration_ned_m_s2[n]
        commanded = np.where(np.isfinite(commanded), commanded, self._flown_acceleration(n))
        missing = commanded - self._cascade.target.acceleration_ned_m_s2
        share = STEP_S / SETTLE_S
        self._cascade.position.velocity_integral += share * np.nan_to_num(missing)

    def _flown_acceleration(self, n: int) -> Values:
        """(3,) what was commanded, by attitude and motors, where the log does not say it."""
        flight, hover = self._flight, self._cascade.hover.value[AS_IT_WAS]
        down = rotation_matrix(flight.q_ned_frd[n : n + 1])[0, :, 2]
        return np.array([0.0, 0.0, GRAVITY_M_S2]) - down * GRAVITY_M_S2 * flight.motors[n].mean() / hover

    def _begin(self, n: int) -> None:
        flight, state = self._flight, self._bodies.state
        state.position_ned_m[:] = flight.position_ned_m[n]
        state.velocity_ned_m_s[:] = flight.velocity_ned_m_s[n]
        state.q_ned_frd[:] = flight.q_ned_frd[n]
        state.rates_frd_rad_s[:] = flight.rates_frd_rad_s[n]
        state.rotor_thrust[:] = flight.motors[n]
        state.on_ground[:] = False
        self._bodies.matrix[:] = rotation_matrix(state.q_ned_frd)
        self._blow(n)
        if np.isfinite(flight.rate_integral[n]).all():
            self._cascade.rate.integral[:] = flight.rate_integral[n]

    def _blow(self, n: int) -> None:
        wind = self._bodies.wind_ned_m_s
        wind[:] = self._wind_ned_m_s[n]
        if self._changed_wind_ned_m_s is not None:
            wind[CHANGED] = self._changed_wind_ned_m_s

    def _estimate_is_true(self) -> None:
        state, estimate = self._bodies.state, self._estimate
        estimate.position_ned_m[:] = state.position_ned_m
        estimate.velocity_ned_m_s[:] = state.velocity_ned_m_s
        estimate.acceleration_ned_m_s2[:] = state.acceleration_ned_m_s2
        estimate.q_ned_frd[:] = state.q_ned_frd
        estimate.heading_rad[:] = yaw_of(state.q_ned_frd)
        self._gyro.update(
            state.rates_frd_rad_s, estimate.rates_frd_rad_s, estimate.angular_acceleration_frd_rad_s2
        )

    def _control(self, n: int, moved_ned_m: Values | float = 0.0) -> None:
        flight, setpoints = self._flight, self._setpoints
        setpoints.level[:] = flight.level[n]
        setpoints.armed[:] = flight.level[n] != ControlLevel.DISARMED
        setpoints.landed[:] = flight.landed[n]
        setpoints.in_air[:] = not flight.landed[n]
        setpoints.position_ned_m[:] = flight.target_position_ned_m[n] + moved_ned_m
        setpoints.velocity_ned_m_s[:] = flight.target_velocity_ned_m_s[n]
        setpoints.acceleration_ned_m_s2[:] = flight.target_acceleration_ned_m_s2[n]
        setpoints.yaw_ned_rad[:] = flight.target_yaw_ned_rad[n]
        setpoints.yaw_rate_ned_rad_s[:] = flight.target_yaw_rate_ned_rad_s[n]
        setpoints.q_ned_frd[:] = flight.target_q_ned_frd[n]
        setpoints.rates_frd_rad_s[:] = flight.target_rates_frd_rad_s[n]
        setpoints.thrust[:] = flight.thrust[n]
        setpoints.motors[:] = flight.motors[n]
        self._cascade.update(setpoints, self._estimate)
