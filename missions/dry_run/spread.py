"""How conditions vary from flight to flight: stated distributions, drawn by seed and number of the flight."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from missions.dry_run.setup import Conditions
from missions.errors import PlanError

WITHIN_SIGMA = 3.0
"""Draws beyond are cut: nobody plans for a wind that never blows."""


@dataclass(frozen=True, slots=True)
class Spread:
    """One sigma of each normal distribution about the stated conditions; 0: as stated."""

    wind_m_s: float = 1.5
    """Of the steady wind, on each horizontal axis."""
    gusts: float = 0.3
    """Of the gusts, as a part of the stated gusts."""
    mass: float = 0.03
    """Of the mass, as a part of it."""
    battery: float = 0.05
    """Of the battery's capacity, as a part of it."""
    sensor_noise: float = 0.2
    """Of the sensors' noise, as a part of it."""

    def __post_init__(self) -> None:
        """Refuses what is no sigma.

        Raises:
            PlanError: names the value and its bounds.
        """
        for each in fields(self):
            value, most = getattr(self, each.name), 10.0 if each.name == "wind_m_s" else 0.5
            if not 0.0 <= value <= most:
                reason = f"{value:g} is not between 0 and {most:g}"
                raise PlanError(f"spread, {each.name}", reason, "Give a value between these.")

    def draw(self, stated: Conditions, seed: int, flight: int) -> Conditions:
        """The conditions of one flight: the same for the same seed and number."""
        random = np.random.default_rng([seed, flight, 1])
        z = np.clip(random.standard_normal(6), -WITHIN_SIGMA, WITHIN_SIGMA).tolist()
        north, east, down = stated.wind_ned_m_s
        return Conditions(
            wind_ned_m_s=(north + self.wind_m_s * z[0], east + self.wind_m_s * z[1], down),
            gusts_m_s=max(0.0, stated.gusts_m_s * (1.0 + self.gusts * z[2])),
            mass_scale=max(0.3, stated.mass_scale * (1.0 + self.mass * z[3])),
            battery_scale=max(0.05, stated.battery_scale * (1.0 + self.battery * z[4])),
            sensor_noise=max(0.0, stated.sensor_noise * (1.0 + self.sensor_noise * z[5])),
        )


@dataclass(frozen=True, slots=True)
class Chance:
    """How often something happened, and what that says of the next flight."""

    count: int
    share: float
    upper: float
    """At most so likely, with 97.5 % confidence (Wilson's interval)."""

    @classmethod
    def of(cls, count: int, flights: int) -> Chance:
        """Of so many flights."""
        z, p = 1.959964, count / flights
        middle = p + z * z / (2 * flights)
        half = z * math.sqrt(p * (1 - p) / flights + z * z / (4 * flights * flights))
        return cls(count, p, min(1.0, (middle + half) / (1 + z * z / flights)))


@dataclass(frozen=True, slots=True)
class Quantiles:
    """Of many flights."""

    p5: float
    p50: float
    p95: float
    least: float
    greatest: float

    @classmethod
    def of(cls, values: list[float]) -> Quantiles | None:
        """None: there are none."""
        if not values:
            return None
        p5, p50, p95 = np.quantile(values, (0.05, 0.5, 0.95)).tolist()
        return cls(p5, p50, p95, min(values), max(values))
