"""Values that were found in a flight, with their uncertainty. Imports no simulator: the server reads them."""

from __future__ import annotations

from dataclasses import dataclass

MIN_EXCITED = 3.0
"""A value is used if it is at least this many standard errors away from zero."""


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
class VehicleModel:
    """What a flight says of its aircraft."""

    thrust_m_s2: Identified
    """Thrust of all motors at full signal, divided by the mass [m/s²]."""
    drag_per_s: Identified
    """Drag per speed, divided by the mass [1/s]."""
    drag_known: bool
    """Whether the flight says enough of the drag; otherwise the simulated quadrotor's is used."""
    turns_known: bool
    """Whether it says enough of the turning about roll, pitch and yaw; otherwise the simulated
    quadrotor's."""
    wind_ne_m_s: tuple[float, float] | None
    """Mean wind in the flight to the north and east; null: not known."""
    mass_kg: float | None
    """The known mass that was given; null: only ratios to the mass are known."""
    thrust_n: float | None
    """Thrust of all motors at full signal [N]; null: the mass is not known."""
    drag_n_per_m_s: float | None
    """Drag per speed [N/(m/s)]; null: mass or drag are not known."""
    parameters: dict[str, float]
    """The body for the simulation (SIH_*, MPC_THR_HOVER); with an unknown mass that of a vehicle of 1 kg,
    which moves alike."""
    notes: list[str]
    """What the flight does not say, as sentences."""
