"""The model of an aircraft that is kept for its dry runs."""

from __future__ import annotations

from missions.what_if.flight import LoggedFlight, NotFlyable
from missions.what_if.identified import VehicleModel
from missions.what_if.model import body_parameters, identify
from vehicle_sim.frames import GRAVITY_M_S2
from vehicle_sim.parameters import Parameters

MAX_THRUST_ERROR = 0.1
"""Largest standard error of a thrust that is kept, as a part of it."""
HOVER_THRUST = (0.1, 0.8)
"""PX4's range of MPC_THR_HOVER."""


def vehicle_model(flight: LoggedFlight, mass_kg: float | None) -> VehicleModel:
    """Finds the model of the aircraft in a whole flight.

    Args:
        flight: the flight; parameters of a simulated body (SIH_*) in its log are not used.
        mass_kg: known take-off mass; None: not known.

    Raises:
        NotFlyable: the flight says too little of the thrust.
    """
    own = {name: float(value) for name, value in Parameters().items()}
    found = identify(flight, own["SIH_T_TAU"])
    thrust, drag = found.thrust_m_s2, found.drag_per_s
    if not thrust.known or thrust.value <= 0.0 or thrust.error > MAX_THRUST_ERROR * thrust.value:
        raise NotFlyable("The flight does not say well enough how strong the motors are.", field="flight")
    drag_known = drag.known and drag.value > 0.0
    turns = (found.roll_rad_s2, found.pitch_rad_s2, found.yaw_rad_s2)
    turns_known = all(each.known and each.value > 0.0 for each in turns)
    body = body_parameters(found, own)
    mass = 1.0 if mass_kg is None else mass_kg
    # All of a body but its arms is in proportion to its mass.
    scaled = {name: value * mass for name, value in body.items()}
    hover = GRAVITY_M_S2 / thrust.value
    scaled["MPC_THR_HOVER"] = min(max(hover, HOVER_THRUST[0]), HOVER_THRUST[1])
    notes: list[str] = []
    if mass_kg is None:
        notes.append("A log tells ratios to the mass, never the mass alone; the flight is the same by them.")
    if not drag_known:
        notes.append("The flight does not say enough of the drag: fly at different speeds.")
    if not turns_known:
        notes.append("The flight does not say enough of the turning: log the motors at a higher rate.")
    wind = (found.wind_north_m_s.value, found.wind_east_m_s.value) if drag_known else None
    return VehicleModel(
        thrust_m_s2=thrust,
        drag_per_s=drag,
        drag_known=drag_known,
        turns_known=turns_known,
        wind_ne_m_s=wind,
        mass_kg=mass_kg,
        thrust_n=None if mass_kg is None else thrust.value * mass_kg,
        drag_n_per_m_s=None if mass_kg is None or not drag_known else drag.value * mass_kg,
        parameters=scaled,
        notes=notes,
    )
