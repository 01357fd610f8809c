"""Flies one command many times in simulation, from a vehicle's present state: all flights at once.

Bodies, rotors and controllers are those of the simulated PX4 (`vehicle_sim`), as are the trajectories of its
modes. The estimate is the truth with a slowly changing error of the size that the vehicle's own estimator
states, and the gyroscopes' noise. Failsafes, the geofence's action, collision prevention and other commands
are not flown.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from missions.errors import PlanError
from missions.what_if.futures.commands import FlightState, ModeCommand, StreamedSetpoint
from missions.what_if.futures.modes import ModeFlights
from missions.what_if.futures.start import Deviations, Start
from missions.what_if.futures.streamed import write_setpoint
from vehicle_sim.airframe import Airframe
from vehicle_sim.control.cascade import Cascade
from vehicle_sim.control.setpoints import ControlLevel, Setpoints
from vehicle_sim.estimator.estimator import blank_estimate
from vehicle_sim.estimator.gyro_filter import GyroFilter
from vehicle_sim.frames import GRAVITY_M_S2, rotation_matrix, yaw_of
from vehicle_sim.noise import NoisePurpose, WhiteNoise
from vehicle_sim.parameters import Parameters
from vehicle_sim.physics.battery import Batteries
from vehicle_sim.physics.rigid_body import RigidBodies
from vehicle_sim.physics.wind import Wind
from vehicle_sim.px4_version import VERSIONS
from vehicle_sim.sensors.suite import GYRO_NOISE_ARMED_RAD_S
from vehicle_sim.simulation import STEP_S

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]

TICK_STEPS = 5
TICK_S = TICK_STEPS * STEP_S
"""Flight modes, streams, wind and errors of the estimate change at this interval."""
SAMPLE_TICKS = 5
"""A sample is kept every so many ticks: 10 Hz."""
POSITION_ERROR_S, VELOCITY_ERROR_S = 8.0, 4.0
"""Correlation times of the errors of the estimate."""
EXCESS_HORIZONTAL, EXCESS_VERTICAL = 1.5, 2.2
"""The errors of the estimate are so many times as large as the estimator states them: in manoeuvres of the
simulated PX4 they are."""
PARKED_M_S = 0.5
"""Until the command arrives, a slower vehicle keeps its position, and a faster one its velocity."""
LOST_TILT_RAD = math.radians(80.0)
HOVER_THRUST = (0.1, 0.9)
"""Limits of the hover thrust."""


@dataclass(frozen=True, slots=True)
class Tracks:
    """What N flights did; M samples, the first at the begin."""

    t_s: Values
    """(M,)."""
    position_ned_m: Values
    """(M, N, 3) true positions."""
    estimated_ned_m: Values
    """(M, N, 3) positions as the vehicle estimates them."""
    on_ground: Flags
    """(N,) at the end."""
    touched_ground: Flags
    """(N,) at any time."""
    lost_control: Flags
    """(N,) tilted by more than 80° at any time."""
    battery_share: Values
    """(N,) charge at the end."""


class Flight:
    """N flights.

    Args:
        start: the vehicle's state.
        store: its parameters (`simulated_parameters`).
        command: what is flown.
        deviations: of the flights.
        velocity_error_m_s: one sigma of the velocity estimate on each axis.
        seed: seed of noise and gusts.

    Raises:
        PlanError: the parameters describe no valid aircraft.
    """

    def __init__(
        self,
        start: Start,
        store: Parameters,
        command: ModeCommand | StreamedSetpoint,
        deviations: Deviations,
        velocity_error_m_s: float,
        seed: int,
    ) -> None:
        count = len(deviations.mass)
        self._start, self._store, self._deviations = start, store, deviations
        self._stream: StreamedSetpoint | None = None
        self._modes: ModeFlights | None = None
        self._bodies, self._cascade = RigidBodies(count, STEP_S), Cascade(count, STEP_S)
        self._gyro, self._batteries = GyroFilter(count, STEP_S), Batteries(count, TICK_S)
        self._estimate, self._setpoints = blank_estimate(count), Setpoints.idle(count)
        self._health, self._begun = np.ones((count, 4)), np.zeros(count, dtype=np.bool_)
        numbers = list(range(1, count + 1))
        self._noise = WhiteNoise(seed, numbers, NoisePurpose.IMU, 3)
        self._wind = Wind(TICK_S, seed=seed, vehicles=numbers)
        self._wind.steady_ned_m_s[:, :2] = deviations.wind_ne_m_s
        for row, gusts_m_s in enumerate(deviations.gusts_m_s.tolist()):
            self._wind.set_gusts(gusts_m_s, row)
        self._errors = _EstimateErrors(start, velocity_error_m_s, count, seed)
        airframe = self._configure()
        if isinstance(command, ModeCommand):
            self._modes = ModeFlights(
                command, start, store, deviations.keeps_speed, self._estimate, self._setpoints
            )
        else:
            self._stream = command
        self._place(airframe)

    def _configure(self) -> Airframe:
        d, store = self._deviations, self._store
        try:
            airframe = Airframe.from_parameters(store)
            for row in range(len(d.mass)):
                mass = float(d.mass[row])
                inertia = airframe.inertia_kg_m2 * mass * np.diag(d.inertia[row])
                own = replace(
                    airframe, mass_kg=airframe.mass_kg * mass, inertia_kg_m2=inertia,
                    rotor_thrust_max_n=airframe.rotor_thrust_max_n * float(d.thrust[row]),
                    rotor_torque_max_nm=airframe.rotor_torque_max_nm * float(d.thrust[row]),
                    rotor_time_constant_s=airframe.rotor_time_constant_s * float(d.lag[row]),
                )  # fmt: skip
                self._bodies.configure(row, own)
                self._cascade.configure(row, store)
                self._batteries.configure(row, store)
                self._gyro.configure(
                    row, store.finite_value("IMU_GYRO_CUTOFF"), store.finite_value("IMU_DGYRO_CUTOFF")
                )
        except ValueError as error:
            raise PlanError("parameters", str(error), "Correct the parameters of the vehicle.") from error
        if self._start.battery_share is not None:
            for row in range(len(d.mass)):
                self._batteries.set_remaining(row, self._start.battery_share)
        return airframe

    def _place(self, airframe: Airframe) -> None:
        """Gives bodies and controllers the present state, in which the controllers have settled."""
        start, d, state = self._start, self._deviations, self._bodies.state
        self._bodies.ground_down_m[:] = max(start.ground_down_m, start.position_ned_m[2])
        state.position_ned_m[:] = np.array(start.position_ned_m) - self._errors.position_m
        state.velocity_ned_m_s[:] = np.array(start.velocity_ned_m_s) - self._errors.velocity_m_s
        state.q_ned_frd[:] = start.q_ned_frd
        state.rates_frd_rad_s[:] = start.rates_frd_rad_s
        state.on_ground[:] = False
        self._bodies.matrix[:] = rotation_matrix(state.q_ned_frd)
        weight_share = (
            airframe.mass_kg * d.mass * GRAVITY_M_S2 / (4.0 * airframe.rotor_thrust_max_n * d.thrust)
        )
        hover = np.clip(weight_share, *HOVER_THRUST)
        tilt = np.maximum(self._bodies.matrix[:, 2, 2], 0.5)
        state.rotor_thrust[:] = np.minimum(weight_share / tilt, 1.0)[:, None]
        self._setpoints.armed[:] = self._setpoints.in_air[:] = True
        self._setpoints.level[:] = ControlLevel.TRAJECTORY
        self._hold_until_begin()
        self._estimate_now()
        for _ in range(2):  # at the first run of the outer loops they clear the integral
            self._cascade.update(self._setpoints, self._estimate)
        cascade, drag_per_s = self._cascade, airframe.drag_n_per_m_s / (airframe.mass_kg * d.mass)
        if self._uses_hover_estimate:
            cascade.hover.value[:] = hover
        velocity = np.array(start.velocity_ned_m_s)
        integral = np.empty((len(hover), 3))
        integral[:, :2] = drag_per_s[:, None] * (d.settled[:, None] * velocity[:2] - d.wind_ne_m_s)
        integral[:, 2] = GRAVITY_M_S2 * (1.0 - weight_share / cascade.hover.value)
        integral += d.unsettled_m_s2
        for row in range(len(hover)):
            cascade.position.place(row, velocity, integral[row])

    @property
    def _uses_hover_estimate(self) -> bool:
        return self._store.get("MPC_USE_HTE") != 0

    def _hold_until_begin(self) -> None:
        """Until the command arrives, the vehicle does what it does now."""
        start, setpoints = self._start, self._setpoints
        if math.hypot(*start.velocity_ned_m_s) < PARKED_M_S:
            setpoints.position_ned_m[:] = start.position_ned_m
        else:
            setpoints.velocity_ned_m_s[:] = start.velocity_ned_m_s
        setpoints.yaw_ned_rad[:] = float(yaw_of(np.array([start.q_ned_frd]))[0])

    def fly(self, horizon_s: float, cancelled: Callable[[], None] | None = None) -> Tracks:
        """Flies all flights.

        Args:
            horizon_s: how long.
            cancelled: called ten times a simulated second; an exception from it ends the flights.
        """
        ticks, state, count = round(horizon_s / TICK_S), self._bodies.state, len(self._begun)
        samples = ticks // SAMPLE_TICKS + 1
        true, estimated = np.empty((samples, count, 3)), np.empty((samples, count, 3))
        touched, lost = np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
        sigma, level_enough = np.array(GYRO_NOISE_ARMED_RAD_S), math.cos(LOST_TILT_RAD)
        for tick in range(ticks + 1):
            if tick % SAMPLE_TICKS == 0:
                if cancelled is not None:
                    cancelled()
                true[tick // SAMPLE_TICKS] = state.position_ned_m
                estimated[tick // SAMPLE_TICKS] = state.position_ned_m + self._errors.position_m
            if tick == ticks:
                break
            self._errors.step()
            self._bodies.wind_ned_m_s[:] = self._wind.step()
            self._command(tick * TICK_S)
            for _ in range(TICK_STEPS):
                self._estimate_now(self._noise.sample() * sigma)
                self._cascade.update(self._setpoints, self._estimate)
                self._bodies.step(self._cascade.motor_signal, self._health)
            self._batteries.step(self._setpoints.armed, self._cascade.motor_signal)
            touched |= state.on_ground
            lost |= ~(self._bodies.matrix[:, 2, 2] > level_enough)
        times = SAMPLE_TICKS * TICK_S * np.arange(samples, dtype=np.float64)
        on_ground, charge = state.on_ground.copy(), self._end_charge()
        return Tracks(times, true, estimated, on_ground, touched, lost, charge)

    def _end_charge(self) -> Values:
        """Charge at the end: a smaller battery has used more of it."""
        start = self._start.battery_share
        charge = self._batteries.state.remaining
        return charge if start is None else np.clip(start - (start - charge) / self._deviations.battery, 0, 1)

    def _command(self, t_s: float) -> None:
        """Writes the setpoints of a tick."""
        arrived = (self._deviations.delay_s <= t_s + 1e-9) & ~self._begun
        if self._modes is not None:
            if arrived.any():
                self._modes.begin(arrived)
            self._begun |= arrived
            self._modes.fly(self._begun)
            return
        assert self._stream is not None
        self._begun |= arrived
        if self._begun.any():
            estimate = self._estimate
            first = FlightState(
                t_s,
                tuple(estimate.position_ned_m[0].tolist()),
                tuple(estimate.velocity_ned_m_s[0].tolist()),
                float(estimate.heading_rad[0]),
                tuple(estimate.q_ned_frd[0].tolist()),
            )
            write_setpoint(self._setpoints, self._begun, self._stream(first))

    def _estimate_now(self, gyro_noise: Values | float = 0.0) -> None:
        state, estimate = self._bodies.state, self._estimate
        np.add(state.position_ned_m, self._errors.position_m, out=estimate.position_ned_m)
        np.add(state.velocity_ned_m_s, self._errors.velocity_m_s, out=estimate.velocity_ned_m_s)
        estimate.acceleration_ned_m_s2[:] = state.acceleration_ned_m_s2
        estimate.q_ned_frd[:] = state.q_ned_frd
        estimate.heading_rad[:] = yaw_of(state.q_ned_frd)
        self._gyro.update(
            state.rates_frd_rad_s + gyro_noise,
            estimate.rates_frd_rad_s,
            estimate.angular_acceleration_frd_rad_s2,
        )


class _EstimateErrors:
    """Estimated minus true position and velocity of N flights; the first flight has none."""

    def __init__(self, start: Start, velocity_error_m_s: float, count: int, seed: int) -> None:
        horizontal_m = EXCESS_HORIZONTAL * start.position_error_m / math.sqrt(2.0)
        vertical_m = EXCESS_VERTICAL * start.height_error_m
        sigma = [horizontal_m, horizontal_m, vertical_m, *(velocity_error_m_s,) * 3]
        self._sigma = np.tile(sigma, (count, 1))
        self._sigma[0] = 0.0
        correlation_s = np.array([POSITION_ERROR_S] * 3 + [VELOCITY_ERROR_S] * 3)
        self._decay = np.exp(-TICK_S / correlation_s)
        self._generator = np.random.default_rng([seed, 11])
        self._values = self._sigma * self._generator.standard_normal((count, 6))
        self._split()

    def _split(self) -> None:
        self.position_m, self.velocity_m_s = self._values[:, :3].copy(), self._values[:, 3:].copy()

    def step(self) -> None:
        """Advances by one tick."""
        noise = self._sigma * self._generator.standard_normal(self._values.shape)
        self._values = self._decay * self._values + np.sqrt(1.0 - self._decay**2) * noise
        self._split()


def simulated_parameters(start: Start) -> Parameters:
    """The parameters of a vehicle as its release of PX4 has them."""
    version = VERSIONS[start.px4]
    known = Parameters(px4=version)
    return Parameters({name: value for name, value in start.parameters.items() if name in known}, px4=version)
