"""Random variation of the conditions from flight to flight, reproducible by seed and flight number."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from missions.dry_run.setup import Conditions
from missions.errors import PlanError

MAX_FLIGHTS = 200
MAX_VEHICLES = 400
"""Maximum number of vehicles of all flights together, for a mission with roles."""
MAX_SIGMA = 3.0
"""Random deviations are limited to this many standard deviations, so that no unrealistic wind occurs."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Standard deviations of normal distributions around the mean conditions; 0: no variation."""

    wind_m_s: float = 1.5
    """Steady wind, on each horizontal axis."""
    gusts: float = 0.3
    """Gusts, as a fraction of the mean gusts."""
    mass: float = 0.03
    """Mass, as a fraction of the mean mass."""
    battery: float = 0.05
    """Battery capacity, as a fraction of the mean capacity."""
    sensor_noise: float = 0.2
    """Sensor noise, as a fraction of the mean noise."""

    def __post_init__(self) -> None:
        """Checks the bounds of each value.

        Raises:
            PlanError: a value is out of bounds; the error names the value and its bounds.
        """
        for each in fields(self):
            value, maximum = getattr(self, each.name), 10.0 if each.name == "wind_m_s" else 0.5
            if not 0.0 <= value <= maximum:
                reason = f"{value:g} is not between 0 and {maximum:g}"
                raise PlanError(f"spread, {each.name}", reason, "Give a value between these.")

    def draw(self, mean: Conditions, seed: int, flight: int, vehicle: int = 0) -> Conditions:
        """The conditions of one flight; equal seeds and numbers give equal conditions.

        Args:
            mean: mean conditions.
            seed: seed of the variation.
            flight: number of the flight. All vehicles of a flight have the same wind and gusts.
            vehicle: number of the vehicle in the flight. Each has its own mass, battery and sensor noise.
        """
        z = _normal([seed, flight, 1])
        if vehicle:
            z[3:] = _normal([seed, flight, 1, vehicle])[3:]
        north, east, down = mean.wind_ned_m_s
        return Conditions(
            wind_ned_m_s=(north + self.wind_m_s * z[0], east + self.wind_m_s * z[1], down),
            gusts_m_s=max(0.0, mean.gusts_m_s * (1.0 + self.gusts * z[2])),
            mass_scale=max(0.3, mean.mass_scale * (1.0 + self.mass * z[3])),
            battery_scale=max(0.05, mean.battery_scale * (1.0 + self.battery * z[4])),
            sensor_noise=max(0.0, mean.sensor_noise * (1.0 + self.sensor_noise * z[5])),
        )


def _normal(seed: list[int]) -> list[float]:
    z = np.random.default_rng(seed).standard_normal(6)
    return np.clip(z, -MAX_SIGMA, MAX_SIGMA).tolist()


@dataclass(frozen=True, slots=True)
class Chance:
    """How often an outcome happened, and the upper limit of its probability."""

    count: int
    share: float
    upper: float
    """Upper limit of the probability, with 97.5 % confidence (Wilson's interval)."""

    @classmethod
    def from_counts(cls, count: int, flights: int) -> Chance:
        """The chance of an outcome that happened in `count` of `flights` flights."""
        z, p = 1.959964, count / flights
        centre = p + z * z / (2 * flights)
        half = z * math.sqrt(p * (1 - p) / flights + z * z / (4 * flights * flights))
        return cls(count, p, min(1.0, (centre + half) / (1 + z * z / flights)))


@dataclass(frozen=True, slots=True)
class Quantiles:
    """Quantiles of one value over many flights."""

    p5: float
    p50: float
    p95: float
    least: float
    greatest: float

    @classmethod
    def from_values(cls, values: list[float]) -> Quantiles | None:
        """The quantiles of a list; None for an empty list."""
        if not values:
            return None
        p5, p50, p95 = np.quantile(values, (0.05, 0.5, 0.95)).tolist()
        return cls(p5, p50, p95, min(values), max(values))
