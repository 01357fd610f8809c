"""The corridor of a dry run, and the check that the vehicle is inside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3
from missions.runner.requests import Notify

TOLERANCE_M = 0.5
"""Tolerance for the error of the vehicle's position estimate."""
OUTSIDE_FOR_S = 1.0
"""The vehicle has left the corridor when it was outside for this long [s]."""
MAX_POSITIONS = 2000
"""Maximum number of positions of one corridor."""


@dataclass(frozen=True, slots=True)
class Corridor:
    """Bounds along the path; all tuples have the same length."""

    position_ned_m: tuple[Vector3, ...]
    """Positions of the nominal flight, in the vehicle's local frame."""
    beside_m: tuple[float, ...]
    """Largest horizontal deviation of the dry run's flights at each position."""
    above_m: tuple[float, ...]
    """Largest deviation upwards."""
    below_m: tuple[float, ...]
    """Largest deviation downwards, positive."""

    def __post_init__(self) -> None:
        sizes = {len(self.position_ned_m), len(self.beside_m), len(self.above_m), len(self.below_m)}
        if len(sizes) != 1 or not 2 <= len(self.position_ned_m) <= MAX_POSITIONS:
            raise ValueError(f"a corridor needs 2 to {MAX_POSITIONS} positions, each with its bounds")


class CorridorWatch:
    """Checks one flight against a corridor."""

    def __init__(self, corridor: Corridor) -> None:
        positions = np.array(corridor.position_ned_m)
        self._starts_ned_m, self._legs_ned_m = positions[:-1], np.diff(positions, axis=0)
        self._leg_length_squared_m2: NDArray[np.float64] = np.maximum(
            (self._legs_ned_m[:, :2] ** 2).sum(axis=1), 1e-9
        )
        bounds = np.array([corridor.beside_m, corridor.above_m, corridor.below_m]) + TOLERANCE_M
        self._bounds = np.maximum(bounds[:, :-1], bounds[:, 1:])
        self._outside_since_s: float | None = None
        self.outside_m = 0.0
        """Distance outside the corridor [m]; 0 inside."""
        self.has_left = False
        """Whether the vehicle has been outside for at least `OUTSIDE_FOR_S`."""

    def update(self, now_s: float, position_ned_m: Vector3 | None) -> bool:
        """Updates the state with the vehicle's position; returns whether `has_left` has changed."""
        if position_ned_m is not None:
            self.outside_m = self._outside_m(position_ned_m)
        if self.outside_m == 0.0:
            self._outside_since_s = None
        elif self._outside_since_s is None:
            self._outside_since_s = now_s
        since_s = self._outside_since_s
        had_left, self.has_left = self.has_left, since_s is not None and now_s - since_s >= OUTSIDE_FOR_S
        return self.has_left != had_left

    def notification(self) -> Notify:
        """The message that the vehicle has left the corridor, or is back inside."""
        if self.has_left:
            text = f"The vehicle is {self.outside_m:.1f} m outside the corridor of the dry run."
            return Notify("corridor_left", text, warning=True)
        return Notify("corridor_back", "The vehicle is inside the corridor of the dry run again.")

    def _outside_m(self, position_ned_m: Vector3) -> float:
        """Distance to the corridor [m]."""
        from_start_ned_m = np.array(position_ned_m) - self._starts_ned_m
        fraction = np.clip(
            (from_start_ned_m[:, :2] * self._legs_ned_m[:, :2]).sum(axis=1) / self._leg_length_squared_m2,
            0.0,
            1.0,
        )
        offset_ned_m = from_start_ned_m - fraction[:, None] * self._legs_ned_m
        beside, above, below = self._bounds
        horizontal = np.maximum(np.hypot(offset_ned_m[:, 0], offset_ned_m[:, 1]) - beside, 0.0)
        vertical = np.maximum(np.maximum(-offset_ned_m[:, 2] - above, offset_ned_m[:, 2] - below), 0.0)
        return float(np.hypot(horizontal, vertical).min())
