"""The corridor of a dry run, and the check whether the vehicle is inside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3
from missions.runner.requests import Tell

TOLERANCE_M = 0.5
"""Tolerance for the error of the vehicle's position estimate."""
OUTSIDE_FOR_S = 1.0
MAX_PLACES = 2000


@dataclass(frozen=True, slots=True)
class Corridor:
    """Bounds along the path; all tuples have the same length."""

    position_ned_m: tuple[Vector3, ...]
    """Positions of the nominal flight, in the vehicle's local frame."""
    beside_m: tuple[float, ...]
    """Largest horizontal deviation of the flights at each position."""
    above_m: tuple[float, ...]
    below_m: tuple[float, ...]
    """Largest deviations upwards and downwards, positive."""

    def __post_init__(self) -> None:
        sizes = {len(self.position_ned_m), len(self.beside_m), len(self.above_m), len(self.below_m)}
        if len(sizes) != 1 or not 2 <= len(self.position_ned_m) <= MAX_PLACES:
            raise ValueError(f"a corridor has 2 to {MAX_PLACES} positions, each with its bounds")


class CorridorWatch:
    """Checks one flight against a corridor."""

    def __init__(self, corridor: Corridor) -> None:
        places = np.array(corridor.position_ned_m)
        self._begin, self._step = places[:-1], np.diff(places, axis=0)
        self._step_2: NDArray[np.float64] = np.maximum((self._step[:, :2] ** 2).sum(axis=1), 1e-9)
        bounds = np.array([corridor.beside_m, corridor.above_m, corridor.below_m]) + TOLERANCE_M
        self._bounds = np.maximum(bounds[:, :-1], bounds[:, 1:])
        self._outside_since_s: float | None = None
        self.outside_m = 0.0
        """Distance outside the corridor [m]; 0 inside."""
        self.left = False
        """Whether it has been outside for at least `OUTSIDE_FOR_S`."""

    def update(self, now_s: float, here: Vector3 | None) -> bool:
        """Updates with a position; True if `left` has changed."""
        if here is not None:
            self.outside_m = self._outside_m(here)
        if self.outside_m == 0.0:
            self._outside_since_s = None
        elif self._outside_since_s is None:
            self._outside_since_s = now_s
        since_s = self._outside_since_s
        before, self.left = self.left, since_s is not None and now_s - since_s >= OUTSIDE_FOR_S
        return self.left != before

    def told(self) -> Tell:
        """That it has left, or is back."""
        if self.left:
            text = f"The vehicle is {self.outside_m:.1f} m outside the corridor of the dry run."
            return Tell("corridor_left", text, warning=True)
        return Tell("corridor_back", "The vehicle is inside the corridor of the dry run again.")

    def _outside_m(self, here: Vector3) -> float:
        """Distance to the corridor [m]."""
        from_begin = np.array(here) - self._begin
        along = np.clip((from_begin[:, :2] * self._step[:, :2]).sum(axis=1) / self._step_2, 0.0, 1.0)
        off = from_begin - along[:, None] * self._step
        beside, above, below = self._bounds
        over_ground = np.maximum(np.hypot(off[:, 0], off[:, 1]) - beside, 0.0)
        vertical = np.maximum(np.maximum(-off[:, 2] - above, off[:, 2] - below), 0.0)
        return float(np.hypot(over_ground, vertical).min())
