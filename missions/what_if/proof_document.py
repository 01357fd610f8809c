"""What a proof of gains answers (`proof.py`); without the simulation, which takes long to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Failure = Literal["crashed", "oscillates", "tracking", "saturated", "altitude", "position"]
RUNS = 100
SWING_HZ = 1.0
"""Slower motion is no oscillation: it answers the wind."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Beyond these a run is not stable."""

    tilt_error_deg: float = 12.0
    """Root of the mean square of the angle between the wanted and the flown axis of thrust."""
    swing_deg_s: float = 12.0
    """Root of the mean square of the body rates above 1 Hz in the hover at the end."""
    saturated_share: float = 0.15
    """Part of the time in which a motor is at a limit."""
    altitude_m: float = 1.0
    """Error of the altitude in the hover at the end."""
    position_m: float = 4.0
    """Horizontal error of the position in the hover at the end."""
    tilt_deg: float = 80.0
    """A larger tilt is a loss of control, as a touch of the ground is."""


@dataclass(frozen=True, slots=True)
class ProofSpread:
    """Standard deviations of the conditions."""

    wind_m_s: float = 2.5
    """Steady wind, on each horizontal axis."""
    gusts_m_s: float = 1.5
    """Gusts: the standard deviation of a run is drawn evenly from 0 to this."""
    mass: float = 0.05
    """Mass, as a part of it; inertia grows with it."""
    thrust: float = 0.07
    """Thrust at full signal, as a part of it: batteries and propellers."""
    inertia: float = 0.15
    """Inertia of each axis, as a part of it, besides that of the mass."""
    lag: float = 0.15
    """Time constant of the motors, as a part of it."""


@dataclass(frozen=True, slots=True)
class ProofConditions:
    """Conditions of one run."""

    wind_ne_m_s: tuple[float, float]
    gusts_m_s: float
    mass: float
    """Factor on the mass."""
    thrust: float
    """Factor on the thrust at full signal."""
    inertia: tuple[float, float, float]
    """Factors on the inertia of roll, pitch and yaw."""
    lag: float
    """Factor on the time constant of the motors."""


@dataclass(frozen=True, slots=True)
class ProofRun:
    """What one run with some gains came to."""

    failures: list[Failure]
    """Which limits were exceeded; empty: stable."""
    tilt_error_deg: float
    swing_deg_s: float
    saturated_share: float
    altitude_m: float
    position_m: float


@dataclass(frozen=True, slots=True)
class ProofPair:
    """Two runs in the same conditions."""

    number: int
    """From 1."""
    conditions: ProofConditions
    present: ProofRun
    proposed: ProofRun


@dataclass(frozen=True, slots=True)
class Proof:
    """A hundred runs with the present and with the proposed gains."""

    passed: bool
    """Whether every run with the proposed gains is stable."""
    parameters: dict[str, float]
    """The proposed values, of which this is the proof."""
    present: dict[str, float]
    """The values that they would replace."""
    runs: int
    seed: int
    stable: int
    """Number of stable runs with the proposed gains."""
    stable_at_present: int
    """Number of stable runs with the present gains."""
    worst: int
    """Number of the run with the proposed gains that comes nearest to a limit, or goes beyond most."""
    limits: Limits
    spread: ProofSpread
    pairs: list[ProofPair]
    assumed: list[str]
    """What was assumed of the vehicle, as sentences."""
