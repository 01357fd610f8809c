"""Proof of gains: one manoeuvre flown many times in simulation, in varied wind, mass, thrust and inertia,
with the present and with the proposed values.

Each pair of runs has the same conditions, gusts and gyroscope noise, so that what differs is the gains. The
manoeuvre (`PHASES`) has doublets of roll and pitch, a turn, a step of the position, a climb, and hover at the
end. Bodies, rotors and controllers are those of the simulated PX4 (`vehicle_sim`); the estimate is the truth
but for the gyroscopes' noise, and errors of the estimator, modes and failsafes are not flown.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from missions.what_if.flight import NotFlyable
from missions.what_if.proof_document import (
    RUNS,
    SWING_HZ,
    Failure,
    Limits,
    Proof,
    ProofConditions,
    ProofPair,
    ProofRun,
    ProofSpread,
)
from missions.what_if.rerun import RecordedParameters
from vehicle_sim.airframe import Airframe
from vehicle_sim.control.cascade import Cascade
from vehicle_sim.control.setpoints import ControlLevel, Setpoints
from vehicle_sim.estimator.estimator import blank_estimate
from vehicle_sim.estimator.gyro_filter import GyroFilter
from vehicle_sim.frames import rotation_matrix, yaw_of
from vehicle_sim.noise import NoisePurpose, WhiteNoise
from vehicle_sim.parameters import Parameters
from vehicle_sim.physics.rigid_body import RigidBodies
from vehicle_sim.physics.wind import Wind
from vehicle_sim.sensors.suite import GYRO_NOISE_ARMED_RAD_S
from vehicle_sim.simulation import STEP_S

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]
Report = Callable[[str, float | None], None]

HEIGHT_M = 30.0
"""The manoeuvre begins so high: a vehicle that loses control needs some seconds to the ground."""
TILT_RAD = math.radians(20.0)
YAW_RAD = math.radians(60.0)
REPORT_STEPS = 250
MAX_SIGMA = 2.5
"""Deviations are limited to so many standard deviations."""


@dataclass(frozen=True, slots=True)
class Phase:
    """A part of the manoeuvre, from a time on; position and yaw from where it began."""

    from_s: float
    roll_rad: float | None = None
    """With `pitch_rad` an attitude setpoint with the last thrust; None: a trajectory setpoint."""
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    position_ned_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


PHASES = (
    Phase(0.0),
    Phase(5.0, roll_rad=TILT_RAD),
    Phase(5.4, roll_rad=-TILT_RAD),
    Phase(5.8),
    Phase(8.0, roll_rad=0.0, pitch_rad=TILT_RAD),
    Phase(8.4, roll_rad=0.0, pitch_rad=-TILT_RAD),
    Phase(8.8),
    Phase(11.0, yaw_rad=YAW_RAD),
    Phase(14.0, yaw_rad=YAW_RAD, position_ned_m=(3.0, 3.0, 0.0)),
    Phase(18.0, yaw_rad=YAW_RAD, position_ned_m=(3.0, 3.0, -2.0)),
)
JUDGED_FROM_S = 4.0
"""Until then it settles in the wind."""
QUIET_FROM_S, END_S = 22.0, 25.0
"""In the hover at the end oscillation and errors of position and altitude are judged."""


LIMITS = Limits()


def draw(spread: ProofSpread, seed: int, number: int) -> ProofConditions:
    """The conditions of a run; equal seeds and numbers give equal conditions."""
    generator = np.random.default_rng([seed, number, 7])
    z = np.clip(generator.standard_normal(8), -MAX_SIGMA, MAX_SIGMA).tolist()
    return ProofConditions(
        wind_ne_m_s=(spread.wind_m_s * z[0], spread.wind_m_s * z[1]),
        gusts_m_s=spread.gusts_m_s * float(generator.uniform()),
        mass=1.0 + spread.mass * z[2],
        thrust=1.0 + spread.thrust * z[3],
        inertia=(1.0 + spread.inertia * z[4], 1.0 + spread.inertia * z[5], 1.0 + spread.inertia * z[6]),
        lag=1.0 + spread.lag * z[7],
    )


def prove(
    vehicle: Mapping[str, float],
    proposed: Mapping[str, float],
    *,
    runs: int = RUNS,
    seed: int = 0,
    spread: ProofSpread | None = None,
    assumed: Sequence[str] = (),
    report: Report | None = None,
) -> Proof:
    """Flies the manoeuvre `runs` times with the vehicle's values and with the proposed ones.

    Args:
        vehicle: parameters of the vehicle, with its body (SIH_*); what is missing has PX4's default.
        proposed: values that are to be written.
        runs: number of conditions.
        seed: seed of conditions, gusts and noise.
        spread: how conditions vary.
        assumed: sentences that are passed on.
        report: called with a sentence and the completed part; an exception from it ends the proof.

    Raises:
        NotFlyable: a proposed value is not used by the controllers, or describes no valid aircraft.
    """
    spread = spread or ProofSpread()
    conditions = [draw(spread, seed, number) for number in range(1, runs + 1)]
    flight = _Flight(vehicle, proposed, conditions, seed)
    judged = flight.fly(report or (lambda _text, _part: None))
    present, changed = judged[:runs], judged[runs:]
    excess = [max(_shares(each).values()) for each in changed]
    own = RecordedParameters(vehicle)
    return Proof(
        passed=not any(each.failures for each in changed),
        parameters=dict(proposed),
        present={name: own.finite_value(name) for name in proposed},
        runs=runs,
        seed=seed,
        stable=sum(not each.failures for each in changed),
        stable_at_present=sum(not each.failures for each in present),
        worst=1 + max(range(runs), key=lambda n: (len(changed[n].failures), excess[n])),
        limits=LIMITS,
        spread=spread,
        pairs=[
            ProofPair(n + 1, conditions[n], present[n], changed[n]) for n in range(runs)
        ],
        assumed=list(assumed),
    )  # fmt: skip


def _shares(run: ProofRun) -> dict[Failure, float]:
    """Each value as a part of its limit."""
    return {
        "oscillates": run.swing_deg_s / LIMITS.swing_deg_s,
        "tracking": run.tilt_error_deg / LIMITS.tilt_error_deg,
        "saturated": run.saturated_share / LIMITS.saturated_share,
        "altitude": run.altitude_m / LIMITS.altitude_m,
        "position": run.position_m / LIMITS.position_m,
    }


class _Flight:
    """All runs at once: R with the present, then R with the proposed values; N = 2 R."""

    def __init__(
        self,
        vehicle: Mapping[str, float],
        proposed: Mapping[str, float],
        conditions: Sequence[ProofConditions],
        seed: int,
    ) -> None:
        runs = len(conditions)
        count = 2 * runs
        self._runs = runs
        self._bodies = RigidBodies(count, STEP_S)
        self._cascade = Cascade(count, STEP_S)
        self._gyro = GyroFilter(count, STEP_S)
        self._estimate = blank_estimate(count)
        self._setpoints = Setpoints.idle(count)
        self._health = np.ones((count, 4))
        numbers = [n + 1 for n in range(runs)]
        self._noise = WhiteNoise(seed, numbers, NoisePurpose.IMU, 3)
        self._wind = Wind(STEP_S, seed=seed, vehicles=numbers)
        for n, each in enumerate(conditions):
            self._wind.steady_ned_m_s[n, :2] = each.wind_ne_m_s
            self._wind.set_gusts(each.gusts_m_s, n)
            body = _body(RecordedParameters(vehicle), each)
            for row, changes in ((n, {}), (runs + n, dict(proposed))):
                self._configure(row, {**vehicle, **body, **changes}, changes)
        start = np.array([0.0, 0.0, -HEIGHT_M])
        for row in range(count):
            self._bodies.place(row, start, 0.0)
        # In hover: rotors turn at the hover thrust of each.
        self._bodies.state.rotor_thrust[:] = self._cascade.hover.value[:, None]
        self._bodies.state.on_ground[:] = False
        self._setpoints.armed[:] = self._setpoints.in_air[:] = True

    def _configure(self, row: int, values: Mapping[str, float], changes: Mapping[str, float]) -> None:
        store = RecordedParameters(values)
        try:
            self._bodies.configure(row, Airframe.from_parameters(store))
            store.used.clear()
            self._cascade.configure(row, store)
        except ValueError as error:
            raise NotFlyable(f"{error}.", field="parameters") from error
        cutoffs = [store.finite_value(name) for name in ("IMU_GYRO_CUTOFF", "IMU_DGYRO_CUTOFF")]
        self._gyro.configure(row, cutoffs[0], cutoffs[1])
        unused = sorted(name for name in changes if name not in store.used)
        if unused:
            raise NotFlyable(
                f"{unused[0]} is no gain or limit of the simulated controllers: nothing can be proved of it.",
                field="parameters",
            )

    def fly(self, report: Report) -> list[ProofRun]:
        """Flies all runs; the N results."""
        steps, state, judge = round(END_S / STEP_S), self._bodies.state, _Judge(2 * self._runs)
        sigma = np.array(GYRO_NOISE_ARMED_RAD_S)
        phase = -1
        for n in range(steps):
            t_s = n * STEP_S
            while phase + 1 < len(PHASES) and PHASES[phase + 1].from_s <= t_s + 1e-9:
                phase += 1
                self._command(PHASES[phase])
            if n % REPORT_STEPS == 0:
                report(f"{t_s:.0f} of {END_S:.0f} s of {2 * self._runs} flights are simulated.", n / steps)
            self._bodies.wind_ned_m_s[:] = np.tile(self._wind.step(), (2, 1))
            noise = np.tile(self._noise.sample() * sigma, (2, 1))
            self._estimate_with(noise)
            self._cascade.update(self._setpoints, self._estimate)
            self._bodies.step(self._cascade.motor_signal, self._health)
            judge.see(t_s, PHASES[phase], state.position_ned_m, state.q_ned_frd, state.rates_frd_rad_s,
                      self._bodies.matrix, self._cascade, state.on_ground)  # fmt: skip
        return judge.results()

    def _command(self, phase: Phase) -> None:
        setpoints = self._setpoints
        north, east, down = phase.position_ned_m
        if phase.roll_rad is None:
            setpoints.level[:] = ControlLevel.TRAJECTORY
            setpoints.position_ned_m[:] = (north, east, down - HEIGHT_M)
            setpoints.yaw_ned_rad[:] = phase.yaw_rad
            return
        setpoints.level[:] = ControlLevel.ATTITUDE
        setpoints.thrust[:] = self._cascade.hover.value
        setpoints.q_ned_frd[:] = _tilted(phase.roll_rad, phase.pitch_rad)
        setpoints.yaw_rate_ned_rad_s[:] = np.nan

    def _estimate_with(self, noise: Values) -> None:
        state, estimate = self._bodies.state, self._estimate
        estimate.position_ned_m[:] = state.position_ned_m
        estimate.velocity_ned_m_s[:] = state.velocity_ned_m_s
        estimate.acceleration_ned_m_s2[:] = state.acceleration_ned_m_s2
        estimate.q_ned_frd[:] = state.q_ned_frd
        estimate.heading_rad[:] = yaw_of(state.q_ned_frd)
        self._gyro.update(
            state.rates_frd_rad_s + noise, estimate.rates_frd_rad_s, estimate.angular_acceleration_frd_rad_s2
        )


def _body(own: Parameters, conditions: ProofConditions) -> dict[str, float]:
    """SIH_* of a run. Inertia grows with the mass."""
    values = {
        "SIH_MASS": own.finite_value("SIH_MASS") * conditions.mass,
        "SIH_T_MAX": own.finite_value("SIH_T_MAX") * conditions.thrust,
        "SIH_Q_MAX": own.finite_value("SIH_Q_MAX") * conditions.thrust,
        "SIH_T_TAU": own.finite_value("SIH_T_TAU") * conditions.lag,
    }
    for name, factor in zip(("SIH_IXX", "SIH_IYY", "SIH_IZZ"), conditions.inertia, strict=True):
        values[name] = own.finite_value(name) * factor * conditions.mass
    return values


def _tilted(roll_rad: float, pitch_rad: float) -> tuple[float, float, float, float]:
    """Quaternion of a roll or a pitch."""
    return (
        math.cos(roll_rad / 2) * math.cos(pitch_rad / 2), math.sin(roll_rad / 2) * math.cos(pitch_rad / 2),
        math.cos(roll_rad / 2) * math.sin(pitch_rad / 2), -math.sin(roll_rad / 2) * math.sin(pitch_rad / 2),
    )  # fmt: skip


class _Judge:
    """Measures N runs while they are flown."""

    def __init__(self, count: int) -> None:
        self._tilt_error = np.zeros(count)
        self._swing = np.zeros((count, 3))
        self._slow = np.zeros((count, 3))
        self._saturated = np.zeros(count)
        self._altitude, self._position = np.zeros(count), np.zeros(count)
        self._crashed = np.zeros(count, dtype=np.bool_)
        self._judged = self._quiet = 0

    def see(
        self, t_s: float, phase: Phase, position: Values, q: Values, rates: Values, matrix: Values,
        cascade: Cascade, on_ground: Flags,
    ) -> None:  # fmt: skip
        """Sees one step."""
        tilt_limit = math.cos(math.radians(LIMITS.tilt_deg))
        self._crashed |= on_ground | ~(matrix[:, 2, 2] > tilt_limit) | ~np.isfinite(rates).all(axis=1)
        self._slow += (STEP_S * 2.0 * math.pi * SWING_HZ) * (rates - self._slow)
        if t_s < JUDGED_FROM_S:
            return
        self._judged += 1
        wanted = rotation_matrix(cascade.target.q_ned_frd)[:, :, 2]
        cosine = np.einsum("ni,ni->n", wanted, matrix[:, :, 2])
        self._tilt_error += np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2
        signal = cascade.motor_signal
        self._saturated += ((signal <= 0.001) | (signal >= 0.999)).any(axis=1)
        if t_s < QUIET_FROM_S:
            return
        self._quiet += 1
        self._swing += (rates - self._slow) ** 2
        north, east, down = phase.position_ned_m
        np.maximum(self._altitude, np.abs(position[:, 2] - down + HEIGHT_M), out=self._altitude)
        off_m = np.hypot(position[:, 0] - north, position[:, 1] - east)
        np.maximum(self._position, off_m, out=self._position)

    def results(self) -> list[ProofRun]:
        """What each run came to."""
        tilt_deg = np.degrees(np.sqrt(self._tilt_error / self._judged))
        swing_deg_s = np.degrees(np.sqrt(self._swing / self._quiet)).max(axis=1)
        found: list[ProofRun] = []
        for n in range(len(tilt_deg)):
            values = (
                tilt_deg[n], swing_deg_s[n], self._saturated[n] / self._judged, self._altitude[n],
                self._position[n],
            )  # fmt: skip
            rounded = [round(float(value), 4) if math.isfinite(value) else MAX_VALUE for value in values]
            run = ProofRun([], *[min(value, MAX_VALUE) for value in rounded])
            over: list[Failure] = [name for name, share in _shares(run).items() if share > 1.0]
            found.append(replace(run, failures=["crashed"] if self._crashed[n] else over))
        return found


MAX_VALUE = 1e6
"""Values of a run that was lost are at most this: JSON has no infinity."""
