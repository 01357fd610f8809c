"""The model of an aircraft and its wind, as a log tells it.

The body is that of PX4's SIH (`vehicle_sim.physics.rigid_body`): thrust and moments are proportional to the
lagged motor signals, drag to the airspeed. Divided by the mass, all is linear in what is unknown:

- along the body's x and y, specific force = -(drag / mass) * (velocity - wind);
- along z, the same and -(thrust / mass) * mean motor signal;
- angular acceleration = (moment / inertia) * signed sum of the motor signals, without the small rest.

All are solved by least squares; the standard errors are those of a regression whose residuals are correlated
over `FORCE_CORRELATION_S`, of the angular acceleration over `CORRELATION_S`. A log tells ratios to the mass
only, never the mass alone: with a known mass the rest follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.what_if.flight import LoggedFlight, NotFlyable
from missions.what_if.identified import Identified
from missions.what_if.wind import specific_force
from vehicle_sim.airframe import PITCH_SIGN, ROLL_SIGN, YAW_SIGN
from vehicle_sim.frames import rotation_matrix

Values = NDArray[np.float64]

CORRELATION_S = 0.2
"""Time between two independent residuals: accelerations are logged and filtered at 5 to 20 Hz."""
FORCE_CORRELATION_S = 1.0
"""The same of the forces, whose errors are also those of the logged attitude and motor signals."""
BLOCK_S = 0.4
"""Forces and motor signals are averaged over this time."""
STEADY_S = 10.0
"""Wind is taken as steady for this time."""
CLEAR_M = 0.5
"""So high above the ground it carries nothing of the vehicle."""
MIN_FLIGHT_S = 5.0
"""Shorter flights say too little of the model."""
BODY = ("SIH_MASS", "SIH_T_MAX", "SIH_KDV", "SIH_IXX", "SIH_IYY", "SIH_IZZ")
"""A log with these parameters is that of PX4's or our simulation, whose body they describe."""


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
    air = clear_of_ground(flight)
    if np.count_nonzero(air) * step_s < MIN_FLIGHT_S:
        raise NotFlyable(f"Less than {MIN_FLIGHT_S:.0f} s of this part are flown in the air.")
    rotors = _lagged(flight.motors, step_s / max(rotor_time_constant_s, step_s))[air]
    thrust, drag, wind = _forces(flight, air, rotors.mean(axis=1), step_s, known_drag_per_s)
    thin = max(1, round(CORRELATION_S / step_s))
    turned = flight.angular_acceleration_frd_rad_s2[air]
    turns = [
        _solve(0.25 * (rotors @ sign)[:, None], turned[:, k], thin)[0]
        for k, sign in enumerate((ROLL_SIGN, PITCH_SIGN, YAW_SIGN))
    ]
    return Model(thrust, drag, *wind, *turns)


def clear_of_ground(flight: LoggedFlight) -> NDArray[np.bool_]:
    """(N,) in the air, and well above where it stood before and stands afterwards: the ground carries a
    vehicle that spools up, or whose landing is not yet recognised."""
    landed, down_m = flight.landed, flight.position_ned_m[:, 2]
    clear = ~landed
    if landed.any() and clear.any():
        n, on_ground = np.arange(len(landed)), np.flatnonzero(landed)
        at = np.searchsorted(on_ground, n)
        for neighbour in (np.maximum(at - 1, 0), np.minimum(at, len(on_ground) - 1)):
            clear &= down_m < down_m[on_ground[neighbour]] - CLEAR_M
    return clear


def _forces(
    flight: LoggedFlight,
    air: NDArray[np.bool_],
    rotors: Values,
    step_s: float,
    known_drag_per_s: float | None,
) -> tuple[Identified, Identified, list[Identified]]:
    """Thrust, drag, and the wind to the north and east.

    Rows are means over `BLOCK_S` of the three axes, as motor signals are logged at 10 Hz; the unknowns are
    thrust, drag, and drag times wind of each `STEADY_S`, as wind is not the same all the time.
    """
    block = max(1, round(BLOCK_S / step_s))
    count = max(1, len(rotors) // block)
    used = slice(0, count * block)

    def means(values: Values) -> Values:
        return values[used].reshape(count, -1, *values.shape[1:]).mean(axis=1)

    matrix = rotation_matrix(flight.q_ned_frd[air])
    airless = means(np.einsum("nji,nj->ni", matrix, flight.velocity_ned_m_s[air]))
    across = means(np.swapaxes(matrix, 1, 2)[:, :, :2])
    force = means(specific_force(flight)[air])
    pushed = np.zeros_like(force)
    pushed[:, 2] = -means(rotors)
    steady = (np.arange(count) * BLOCK_S // STEADY_S).astype(int)
    parts = steady[-1] + 1
    winds = np.zeros((count, 3, parts, 2))
    winds[np.arange(count), :, steady] = across
    columns = [pushed[:, :, None]] + ([-airless[:, :, None]] if known_drag_per_s is None else [])
    table = np.concatenate((*columns, winds.reshape(count, 3, -1)), axis=2).reshape(3 * count, -1)
    measured = force + (known_drag_per_s or 0.0) * airless
    found = _solve(table, measured.reshape(-1), 3 * max(1, round(FORCE_CORRELATION_S / BLOCK_S)))
    drag = Identified(known_drag_per_s, 0.0) if known_drag_per_s is not None else found[1]
    blown = found[len(columns) :]
    scale = (
        drag.value if drag.known and drag.value > 0.0 else None
    )  # without drag nothing of the wind is felt
    wind = [_mean([blown[k] for k in range(axis, 2 * parts, 2)], steady, scale) for axis in (0, 1)]
    return found[0], drag, wind


def _mean(parts: Sequence[Identified], steady: NDArray[np.int64], scale: float | None) -> Identified:
    """The mean wind over all parts, each as long as it is."""
    if scale is None:
        return Identified(0.0, 0.0)
    share = np.bincount(steady) / len(steady)
    value = float(share @ [each.value for each in parts])
    error = float(np.sqrt(share**2 @ [each.error**2 for each in parts]))
    return Identified(value / scale, error / scale)


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
        # Unknown: it turns as fast as the simulated quadrotor by the same signals.
        own_moment = own["SIH_Q_MAX"] if name == "SIH_IZZ" else own["SIH_T_MAX"] * moment / thrust_n
        values[name] = 4.0 * moment / turn.value if usable else own[name] * moment / own_moment
    return values | {"SIH_IXY": 0.0, "SIH_IXZ": 0.0, "SIH_IYZ": 0.0}


def _lagged(signals: Values, gain: float) -> Values:
    """Thrust of the rotors behind their signals, as the simulated rotors lag."""
    thrust = np.empty_like(signals)
    now = signals[0].copy()
    for n, signal in enumerate(signals):
        now += gain * (signal - now)
        thrust[n] = now
    return thrust


def _solve(columns: Values, measured: Values, thin: int) -> tuple[Identified, ...]:
    """Least squares, with standard errors for one independent residual in `thin`."""
    solution, *_ = np.linalg.lstsq(columns, measured, rcond=None)
    residual = measured - columns @ solution
    free = max(1.0, len(measured) / thin - columns.shape[1])
    variance = float(residual @ residual) / len(measured)
    covariance = np.linalg.pinv(columns.T @ columns) * len(measured) * variance / free
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return tuple(Identified(float(v), float(e)) for v, e in zip(solution, errors, strict=True))
