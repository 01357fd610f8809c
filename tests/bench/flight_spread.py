"""Differences between repeated simulated flights with sensor noise, compared with those of a real PX4.

Most flights of the real PX4 were repeated once (`spread.json`), which gives one difference. The number of
simulated flights can be chosen, so they also show how much such a difference varies.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from . import flight_recordings, flight_replay
from .flight_comparison import GRID_S, MANOEUVRES, XYZ, Track, grid_of, response_of, rms, size_of
from .flight_recordings import FloatArray, Recording

REPEATS = 4
_VELOCITY = ("vx", "vy", "vz")


@dataclass(frozen=True, slots=True)
class Repeats:
    """Differences between simulated flights of one stimulus, one per pair (rise times: one per flight)."""

    positions_m: tuple[float, ...]
    velocities_m_s: tuple[float, ...]
    errors: tuple[float, ...]
    """RMS over the controlled axes, in the unit of the manoeuvre."""
    rises_s: tuple[float, ...]


def measure(selected: Sequence[str], flights: int = REPEATS) -> dict[str, Repeats]:
    """Flies each flight `flights` times, each time with another seed of the noise."""
    recordings = [flight_recordings.load(name) for name in selected]
    flown = [flight_replay.fly(recordings, noise=True, seed=seed) for seed in range(flights)]
    return {each.name: _repeats(each, [Track(flight[each.name]) for flight in flown]) for each in recordings}


def _repeats(recording: Recording, tracks: list[Track]) -> Repeats:
    manoeuvre = MANOEUVRES[recording.name]
    quantity = manoeuvre.quantity
    real = Track(recording)
    whole_s = np.arange(0.0, min(float(track.t_s[-1]) for track in (real, *tracks)), GRID_S)
    grid = grid_of(manoeuvre, real, *tracks)
    pairs = list(itertools.combinations(tracks, 2))
    return Repeats(
        tuple(rms(a, whole_s, b, whole_s, XYZ, from_zero=False) for a, b in pairs),
        tuple(rms(a, whole_s, b, whole_s, _VELOCITY, from_zero=False) for a, b in pairs),
        tuple(
            quantity.scale * rms(a, grid, b, grid, manoeuvre.axes, from_zero=quantity.from_zero)
            for a, b in pairs
        ),
        tuple(_rises_s(manoeuvre.rising, real, tracks, grid)),
    )


def _rises_s(axis: str | None, real: Track, tracks: list[Track], grid: FloatArray) -> Iterator[float]:
    if axis is not None:
        size = size_of(real.at(axis, grid))
        for track in tracks:
            yield response_of(grid, track.at(axis, grid), size).rise_s


def table() -> Iterator[str]:
    """Rows of Markdown."""
    if not flight_recordings.FLIGHTS.is_dir():
        yield "The recordings (../shared/px4/flights) are not beside this checkout."
        return
    names = flight_recordings.names()
    measured = measure(names)
    yield "| flight | position RMS m | velocity RMS m/s | rise differs by s |"
    yield "|---|---|---|---|"
    ratios: list[tuple[float, float]] = []
    for name in names:
        repeats, spread = measured[name], flight_recordings.load(name).spread
        simulated = (float(np.median(repeats.positions_m)), float(np.median(repeats.velocities_m_s)))
        rise_differences_s = [abs(a - b) for a, b in itertools.combinations(repeats.rises_s, 2)]
        rise_difference_s = float(np.median(rise_differences_s)) if rise_differences_s else math.nan
        cells = (
            sim_and_real(simulated[0], spread.position_m),
            sim_and_real(simulated[1], spread.velocity_m_s),
            sim_and_real(rise_difference_s, spread.rise_s),
        )
        yield f"| {name} | {' | '.join(cells)} |"
        ratios.append((simulated[0] / spread.position_m, simulated[1] / spread.velocity_m_s))
    position, velocity = np.nanmedian(np.array(ratios), axis=0)
    yield ""
    yield (
        f"Medians of the pairs among {REPEATS} simulated flights with sensor noise / PX4's single pair. "
        f"In the median flight the simulated difference is {position:.2f} of PX4's in position, "
        f"{velocity:.2f} in velocity."
    )


def sim_and_real(sim: float, real: float, digits: int = 2) -> str:
    """Text of a cell: the simulated vehicle's value and PX4's."""
    return " / ".join("–" if math.isnan(value) else f"{value:.{digits}f}" for value in (sim, real))
