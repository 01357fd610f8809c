"""The model of an aircraft and its wind, as a log tells it.

The body is that of PX4's SIH (`vehicle_sim.physics.rigid_body`): thrust and moments are proportional to the
lagged motor signals, drag to the airspeed. Divided by the mass, all is linear in what is unknown:

- along the body's x and y, specific force = -(drag / mass) * (velocity - wind);
- along z, the same and -(thrust / mass) * mean motor signal;
- angular acceleration = (moment / inertia) * signed sum of the motor signals, without the small rest.

The second is a ratio of means, the others are solved by least squares; the standard errors are those of a
regression whose residuals are correlated over `CORRELATION_S`. A log tells ratios to the mass only, never the
mass alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.what_if.flight import LoggedFlight, NotFlyable
from vehicle_sim.airframe import PITCH_SIGN, ROLL_SIGN, YAW_SIGN
from vehicle_sim.frames import rotation_matrix

Values = NDArray[np.float64]

CORRELATION_S = 0.2
"""Time between two independent residuals: accelerations are logged and filtered at 5 to 20 Hz."""
THRUST_BLOCK_S = 1.0
"""Thrust and motor signals are averaged over this time."""
MIN_FLIGHT_S = 5.0
"""Shorter flights say too little of the model."""
MIN_EXCITED = 3.0
"""A value is used if it is at least this many standard errors away from zero."""
BODY = ("SIH_MASS", "SIH_T_MAX", "SIH_KDV", "SIH_IXX", "SIH_IYY", "SIH_IZZ")
"""A log with these parameters is that of PX4's or our simulation, whose body they describe."""


@dataclass(frozen=True, slots=True)
class Identified:
    """A value and its standard error."""

    value: float
    error: float

    @property
    def known(self) -> bool:
        """Whether the flight says enough of it."""
        return abs(self.value) >= MIN_EXCITED * self.error


@dataclass(frozen=True, slots=True)
class Model:
    """What a flight says of its aircraft and wind."""

    thrust_m_s2: Identified
    """Thrust of all motors at full signal, divided by the mass."""
    drag_per_s: Identified
    """Drag per speed, divided by the mass."""
    wind_north_m_s: Identified
    wind_east_m_s: Identified
    roll_rad_s2: Identified
    """Angular acceleration of one motor on each side at full signal and the others at none, halved."""
    pitch_rad_s2: Identified
    yaw_rad_s2: Identified


def identify(
    flight: LoggedFlight, rotor_time_constant_s: float, known_drag_per_s: float | None = None
) -> Model:
    """Finds the model in the samples in the air.

    Args:
        rotor_time_constant_s: lag of thrust behind the motor signals.
        known_drag_per_s: None: the drag is found too, which needs a flight at different speeds.

    Raises:
        NotFlyable: the flight is too short.
    """
    step_s = float(flight.t_s[1] - flight.t_s[0]) if len(flight.t_s) > 1 else 0.0
    air = ~flight.landed & np.isfinite(flight.force_frd_m_s2).all(axis=1)
    if np.count_nonzero(air) * step_s < MIN_FLIGHT_S:
        raise NotFlyable(f"Less than {MIN_FLIGHT_S:.0f} s of this part are flown in the air.")
    rotors = _lagged(flight.motors, step_s / max(rotor_time_constant_s, step_s))[air]
    thin = max(1, round(CORRELATION_S / step_s))
    force = flight.force_frd_m_s2[air]
    matrix = rotation_matrix(flight.q_ned_frd[air])
    # Body x and y in the horizontal plane: (R^T (v - w)) for the first two rows of R^T.
    across = np.swapaxes(matrix, 1, 2)[:, :2, :]
    airless = np.einsum("nij,nj->ni", across, flight.velocity_ned_m_s[air])
    if known_drag_per_s is None:
        columns = np.concatenate((-airless[:, :, None], across[:, :, :2]), axis=2).reshape(-1, 3)
        drag, *pushed = _solve(columns, force[:, :2].reshape(-1), 2 * thin)
        scale = drag.value if drag.known and drag.value > 0.0 else None
    else:
        columns = across[:, :, :2].reshape(-1, 2)
        measured = (force[:, :2] + known_drag_per_s * airless).reshape(-1)
        drag, pushed = Identified(known_drag_per_s, 0.0), list(_solve(columns, measured, 2 * thin))
        scale = known_drag_per_s if known_drag_per_s > 0.0 else None
    # Without drag nothing of the wind is felt.
    wind = [Identified(p.value / scale, p.error / scale) if scale else Identified(0.0, 0.0) for p in pushed]
    air_ned_m_s = flight.velocity_ned_m_s[air] - np.array([wind[0].value, wind[1].value, 0.0])
    dragged = (scale or 0.0) * np.einsum("nij,ni->nj", matrix, air_ned_m_s)[:, 2]
    thrust = _ratio(-force[:, 2] - dragged, rotors.mean(axis=1), round(THRUST_BLOCK_S / step_s))
    turned = flight.angular_acceleration_frd_rad_s2[air]
    turns = [
        _solve(0.25 * (rotors @ sign)[:, None], turned[:, k], thin)[0]
        for k, sign in enumerate((ROLL_SIGN, PITCH_SIGN, YAW_SIGN))
    ]
    return Model(thrust, drag, *wind, *turns)


def body_parameters(model: Model, own: Mapping[str, float]) -> dict[str, float]:
    """SIH_* of a vehicle of 1 kg that accelerates as the model says; what the flight does not say keeps the
    value in `own`, scaled to this mass.

    Raises:
        NotFlyable: not even the thrust is known.
    """
    if not model.thrust_m_s2.known or model.thrust_m_s2.value <= 0.0:
        raise NotFlyable("The flight does not say how strong the motors are.")
    mass = own["SIH_MASS"]
    thrust_n = model.thrust_m_s2.value / 4.0
    values = {"SIH_MASS": 1.0, "SIH_T_MAX": thrust_n, "SIH_Q_MAX": own["SIH_Q_MAX"] / mass}
    values["SIH_KDV"] = model.drag_per_s.value if model.drag_per_s.known else own["SIH_KDV"] / mass
    values["SIH_KDW"] = own["SIH_KDW"] / mass
    moments = (own["SIH_L_ROLL"] * thrust_n, own["SIH_L_PITCH"] * thrust_n, values["SIH_Q_MAX"])
    turns = (model.roll_rad_s2, model.pitch_rad_s2, model.yaw_rad_s2)
    for name, moment, turn in zip(("SIH_IXX", "SIH_IYY", "SIH_IZZ"), moments, turns, strict=True):
        usable = turn.known and turn.value > 0.0
        values[name] = 4.0 * moment / turn.value if usable else own[name] / mass
    return values | {"SIH_IXY": 0.0, "SIH_IXZ": 0.0, "SIH_IYZ": 0.0}


def _lagged(signals: Values, gain: float) -> Values:
    """Thrust of the rotors behind their signals, as the simulated rotors lag."""
    thrust = np.empty_like(signals)
    now = signals[0].copy()
    for n, signal in enumerate(signals):
        now += gain * (signal - now)
        thrust[n] = now
    return thrust


def _ratio(numerator: Values, denominator: Values, block: int) -> Identified:
    """Ratio of two means, with the standard error that the ratios of blocks show. Motor signals are logged at
    10 Hz: a regression on what lies between two samples would find too little."""
    count = len(numerator) // block
    means = [each[: count * block].reshape(count, block).mean(axis=1) for each in (numerator, denominator)]
    total = float(means[1].sum())
    if count < 2 or total <= 0.0:
        return Identified(0.0, np.inf)
    value = float(means[0].sum()) / total
    residuals = means[0] - value * means[1]
    return Identified(value, float(np.sqrt(residuals @ residuals * count / (count - 1)) / total))


def _solve(columns: Values, measured: Values, thin: int) -> tuple[Identified, ...]:
    """Least squares, with standard errors for one independent residual in `thin`."""
    solution, *_ = np.linalg.lstsq(columns, measured, rcond=None)
    residual = measured - columns @ solution
    free = max(1.0, len(measured) / thin - columns.shape[1])
    variance = float(residual @ residual) / len(measured)
    covariance = np.linalg.pinv(columns.T @ columns) * len(measured) * variance / free
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return tuple(Identified(float(v), float(e)) for v, e in zip(solution, errors, strict=True))
