"""Deviation of the flights of a Monte Carlo run from the nominal flight, along the nominal path.

Each point of the nominal path is compared with the nearest point of a flight within a few seconds of the same
time in the same step. Position alone would pick the wrong pass of a path that crosses itself; time alone
would count the delay in a head wind as a deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.track import Track

Array = NDArray[np.float64]
MAX_STATIONS = 400
WINDOW_S = 3.0
"""Time that is searched before and after the same time in the step [s]."""
QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True, slots=True)
class Band:
    """Quantiles of one deviation at each station (S,) [m]."""

    p5: Array
    p50: Array
    p95: Array
    greatest: Array
    """The deviation with the largest magnitude, signed."""


@dataclass(frozen=True, slots=True)
class Corridor:
    """Deviations along the nominal path."""

    t_s: Array
    """(S,) time of the nominal flight since its start."""
    position_ned_m: Array
    """(S, 3) position of the nominal flight."""
    horizontal: Band
    """Horizontal distance."""
    vertical: Band
    """Positive: above the nominal path."""

    @property
    def width_m(self) -> float:
        """The largest horizontal deviation."""
        return float(self.horizontal.greatest.max(initial=0.0))

    def document(self) -> dict[str, object]:
        """As JSON values."""

        def band(each: Band) -> dict[str, list[float]]:
            names = ("p5", "p50", "p95", "greatest")
            return {name: np.round(getattr(each, name), 2).tolist() for name in names}

        return {
            "t_s": np.round(self.t_s, 2).tolist(),
            "position_ned_m": np.round(self.position_ned_m, 2).tolist(),
            "horizontal_m": band(self.horizontal),
            "vertical_m": band(self.vertical),
        }


def corridor(nominal: Track, flights: Sequence[Track]) -> Corridor:
    """The corridor of the flights around the nominal flight; its width is 0 without flights."""
    count = min(MAX_STATIONS, len(nominal.t_s))
    at = np.unique(np.linspace(0, len(nominal.t_s) - 1, count).round().astype(int))
    t_s, position = nominal.t_s[at], nominal.position_ned_m[at]
    deviations = [deviation(nominal, flight, t_s, position) for flight in flights]
    none = np.zeros((1, len(at)))
    across = np.array([each[0] for each in deviations]) if deviations else none
    above = np.array([each[1] for each in deviations]) if deviations else none
    return Corridor(t_s, position, _band(across), _band(above))


def deviation(nominal: Track, flight: Track, t_s: Array, position_ned_m: Array) -> tuple[Array, Array]:
    """Horizontal distance and height of a flight relative to points of the nominal flight (S,) [m].

    Args:
        nominal: the nominal flight.
        flight: the flight to compare.
        t_s: (S,) times of the nominal flight.
        position_ned_m: (S, 3) nominal positions at these times.

    Returns:
        NaN for times after the flight's end.
    """
    own_s, other_s = _matching_times(nominal, flight)
    same_moment_s = np.interp(t_s, own_s, other_s)
    step_s = float(np.median(np.diff(flight.t_s))) if len(flight.t_s) > 1 else 1.0
    half = max(1, round(WINDOW_S / step_s))
    middle = np.searchsorted(flight.t_s, same_moment_s)
    index = np.clip(middle[:, None] + np.arange(-half, half + 1), 0, len(flight.t_s) - 1)
    path = flight.position_ned_m[index]
    a, along = path[:, :-1], np.diff(path, axis=1)
    length_2 = np.maximum((along**2).sum(axis=2), 1e-12)
    to = position_ned_m[:, None, :] - a
    fraction = np.clip((to * along).sum(axis=2) / length_2, 0.0, 1.0)
    deviations = a + fraction[:, :, None] * along - position_ned_m[:, None, :]
    nearest = (deviations**2).sum(axis=2).argmin(axis=1)
    offset = deviations[np.arange(len(deviations)), nearest]
    late = t_s > own_s[-1] + 1e-9
    across, above = np.hypot(offset[:, 0], offset[:, 1]), -offset[:, 2]
    across[late] = above[late] = np.nan
    return across, above


def _matching_times(nominal: Track, flight: Track) -> tuple[Array, Array]:
    """Times of both flights at which the same steps began."""
    own, other = _starts(nominal), _starts(flight)
    own_s, other_s = [], []
    for (own_place, at_s), (other_place, other_at_s) in zip(own, other, strict=False):
        if own_place != other_place:
            break
        own_s.append(at_s)
        other_s.append(other_at_s)
    if len(own_s) == len(own) == len(other):
        own_s.append(float(nominal.t_s[-1]))
        other_s.append(float(flight.t_s[-1]))
    elif len(own_s) < 2:
        length_s = min(float(nominal.t_s[-1]), float(flight.t_s[-1]))
        return np.array([0.0, length_s]), np.array([0.0, length_s])
    return np.array(own_s), np.array(other_s)


def _starts(track: Track) -> list[tuple[str, float]]:
    changes = [0, *(np.flatnonzero(np.diff(track.step)) + 1).tolist()]
    return [
        (track.steps[int(track.step[at])].place if track.step[at] >= 0 else "", float(track.t_s[at]))
        for at in changes
    ]


def _band(values: Array) -> Band:
    """Quantiles over the flights (F, S); zero where there is no flight."""
    known = np.isfinite(values)
    some = known.any(axis=0)
    filled = np.where(some, values, 0.0)
    low, middle, high = np.nanquantile(filled, QUANTILES, axis=0)
    size = np.where(known, np.abs(values), -1.0)
    greatest = np.take_along_axis(np.where(known, values, 0.0), size.argmax(axis=0)[None], axis=0)[0]
    return Band(low, middle, high, greatest)
