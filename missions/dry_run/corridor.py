"""Deviation of the flights of a Monte Carlo run from the nominal flight, along the nominal path.

Each flown position is compared with a part of the nominal path. The order of the positions on both paths
(`alignment.py`) determines this part, not the time: a flight that waits for a heading
or a condition, or flies a leg slower in the wind, does not deviate. The nearest position alone could
be on the wrong pass of a path that crosses or retraces itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.document import Band, Corridor
from missions.dry_run.track import Track

Array = NDArray[np.float64]
MAX_STATIONS = 400
SPACING_M = 0.5
"""Smallest distance between two stations along the path."""
POINTS_PER_STATION = 4
"""Number of path points from one station to the next; more than one, so that corners are measured well."""
SEARCHED_STATIONS = 3
"""Number of stations before and after the aligned station in which the nearest point is searched, because the
alignment compares whole stations."""
QUANTILES = (0.05, 0.5, 0.95)


def corridor(nominal: Track, flights: Sequence[Track]) -> Corridor:
    """The corridor of the flights around the nominal flight; its width is 0 without flights."""
    path = Stations.from_track(nominal, SPACING_M, MAX_STATIONS)
    deviations = [deviation(path, flight) for flight in flights]
    no_deviation = np.zeros((1, len(path.t_s)))
    across = np.array([each[0] for each in deviations]) if deviations else no_deviation
    above = np.array([each[1] for each in deviations]) if deviations else no_deviation
    return Corridor(path.t_s, path.position_ned_m, _band(across), _band(above))


def deviation(nominal: Stations, flight: Track) -> tuple[Array, Array]:
    """Largest horizontal distance and largest vertical distance (signed, up positive) of a flight from the
    nominal path [m].

    Args:
        nominal: the nominal flight.
        flight: the flight to compare.

    Returns:
        Both (S,), each the largest of all flown positions that are aligned with the station. NaN at stations
        after the end of the flight and in steps that the flight did not execute.
    """
    flight_stations = Stations.from_track(flight, nominal.spacing_m, 2 * MAX_STATIONS)
    across, above, below = (np.full(len(nominal.t_s), each) for each in (np.nan, -np.inf, np.inf))
    common, flight_common, open_end = _common_steps(nominal, flight_stations)
    if len(common) and len(flight_common):
        pairs = align(nominal.position_ned_m[common], flight_stations.position_ned_m[flight_common], open_end)
        station_index = np.repeat(common[pairs[0]], POINTS_PER_STATION)
        point_index = (
            POINTS_PER_STATION * flight_common[pairs[1]][:, None]
            + np.arange(POINTS_PER_STATION)
            - POINTS_PER_STATION // 2
        )
        fine_ned_m = flight_stations.fine_ned_m
        position = fine_ned_m[np.clip(point_index, 0, len(fine_ned_m) - 1)].reshape(-1, 3)
        offset_ned_m = _from_nearest(nominal.fine_ned_m, station_index, position)
        np.fmax.at(across, station_index, np.hypot(offset_ned_m[:, 0], offset_ned_m[:, 1]))
        np.maximum.at(above, station_index, -offset_ned_m[:, 2])
        np.minimum.at(below, station_index, -offset_ned_m[:, 2])
    vertical = np.where(above >= -below, above, below)
    return across, np.where(np.isnan(across), np.nan, vertical)


@dataclass(frozen=True, slots=True)
class Stations:
    """A flight sampled at even distances along its path; waiting times do not count."""

    spacing_m: float
    t_s: Array
    """(S,) time since the start."""
    position_ned_m: Array
    """(S, 3)."""
    fine_ned_m: Array
    """(POINTS_PER_STATION * (S - 1) + 1, 3) positions at a fraction of the spacing."""
    step_index: Indices
    """(S,) index of the step in `places`."""
    places: tuple[str, ...]
    """Names of the steps in the order in which they were executed; "": no step."""
    finished: bool
    """Whether the flight completed the plan."""

    @classmethod
    def from_track(cls, track: Track, spacing_m: float, max_count: int) -> Stations:
        """The stations of a flight, `spacing_m` apart, or farther apart so that there are at most
        `max_count`."""
        moved_m = np.linalg.norm(np.diff(track.position_ned_m, axis=0), axis=1)
        samples = np.arange(len(track.t_s))
        along_m = np.concatenate(([0.0], np.cumsum(moved_m))) + 1e-9 * samples
        count = min(max_count, max(2, 1 + math.ceil(along_m[-1] / spacing_m)))
        fine_m = np.linspace(0.0, along_m[-1], POINTS_PER_STATION * (count - 1) + 1)
        fine = np.stack([np.interp(fine_m, along_m, axis) for axis in track.position_ned_m.T], axis=1)
        at_m = fine_m[::POINTS_PER_STATION]
        begins = np.flatnonzero(np.diff(track.step, prepend=track.step[0] - 1))
        latest = np.searchsorted(along_m, at_m, side="right") - 1
        return cls(
            along_m[-1] / (count - 1),
            np.interp(at_m, along_m, track.t_s),
            fine[::POINTS_PER_STATION],
            fine,
            np.searchsorted(begins, latest, side="right") - 1,
            tuple(track.steps[index].place if index >= 0 else "" for index in track.step[begins].tolist()),
            track.finished,
        )


def _common_steps(nominal: Stations, flight_stations: Stations) -> tuple[Indices, Indices, OpenEnd | None]:
    """The steps that both flights executed: a branch can lead a flight through other steps.

    Returns:
        (P,) indices of the nominal stations and (Q,) of the flown stations in these steps; and the flight
        that continues although the other one ended within a step (None: neither).
    """
    matcher = SequenceMatcher(None, nominal.places, flight_stations.places, autojunk=False)
    blocks = [each for each in matcher.get_matching_blocks() if each.size]
    if not blocks:
        return np.arange(0), np.arange(0), None
    steps = [each.a + k for each in blocks for k in range(each.size)]
    flight_steps = [each.b + k for each in blocks for k in range(each.size)]
    nominal_ends = steps[-1] == len(nominal.places) - 1
    flight_ends = flight_steps[-1] == len(flight_stations.places) - 1
    open_end: OpenEnd | None = None
    if flight_ends and not (nominal_ends and flight_stations.finished):
        open_end = "nominal"
    elif nominal_ends and not (flight_ends and nominal.finished):
        open_end = "flown"
    return (
        np.flatnonzero(np.isin(nominal.step_index, steps)),
        np.flatnonzero(np.isin(flight_stations.step_index, flight_steps)),
        open_end,
    )


def _from_nearest(fine_ned_m: Array, station_index: Indices, position_ned_m: Array) -> Array:
    """(P, 3) positions relative to the nearest point of the nominal path near these stations (P,)."""
    around = POINTS_PER_STATION * station_index[:, None] + np.arange(
        -SEARCHED_STATIONS * POINTS_PER_STATION, SEARCHED_STATIONS * POINTS_PER_STATION + 1
    )
    path = fine_ned_m[np.clip(around, 0, len(fine_ned_m) - 1)]
    along = np.diff(path, axis=1)
    from_begin = position_ned_m[:, None] - path[:, :-1]
    length_squared = np.maximum(_dot(along, along), 1e-12)
    fraction = np.clip(_dot(from_begin, along) / length_squared, 0.0, 1.0)
    offset_ned_m = from_begin - fraction[:, :, None] * along
    return offset_ned_m[np.arange(len(station_index)), _dot(offset_ned_m, offset_ned_m).argmin(axis=1)]


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("psx,psx->ps", a, b)


def _band(values: Array) -> Band:
    """Quantiles of the values (F flights, S stations) over the flights; zero at stations without a flight."""
    is_flown = np.isfinite(values)
    has_flight = is_flown.any(axis=0)
    filled = np.where(has_flight, values, 0.0)
    p5, middle, p95 = np.nanquantile(filled, QUANTILES, axis=0)
    size = np.where(is_flown, np.abs(values), -1.0)
    greatest = np.take_along_axis(np.where(is_flown, values, 0.0), size.argmax(axis=0)[None], axis=0)[0]
    return Band(p5, middle, p95, greatest)


Indices = NDArray[np.int64]
OpenEnd = Literal["nominal", "flown"]


def align(nominal: Array, flown: Array, open_end: OpenEnd | None = None) -> tuple[Indices, Indices]:
    """Pairs of points of two paths with the least sum of squared distances.

    The first pair is the first points of both paths. From pair to pair, one index or both indices increase by
    one. So both paths are followed forwards only, each point has a partner, and two passes of a path that
    crosses or retraces itself have different partners.

    Args:
        nominal: (N, 3) points at even distances along the path.
        flown: (M, 3) points at about the same distances.
        open_end: the path whose last points may have no partner, because the other path ends before them;
            None: the last pair is the last points of both paths.

    Returns:
        (P,) indices in both paths.
    """
    sums = _least_sums(nominal, flown)
    i, j = len(nominal) - 1, len(flown) - 1
    if open_end == "nominal":
        i = int(sums[:, -1].argmin())
    elif open_end == "flown":
        j = int(sums[-1, 1:].argmin())
    return _pairs(sums, i, j)


def _least_sums(nominal: Array, flown: Array) -> Array:
    """(N, 1 + M) least sum of all pairs up to each pair; the first column is infinite.

    The pairs of a row begin at one column, reached from the previous row, and continue to the right. The sum
    of these pairs is a difference of two cumulative sums, so a running minimum finds the best first column
    for each pair.
    """
    products = nominal @ flown.T
    squares = (nominal**2).sum(axis=1)[:, None] + (flown**2).sum(axis=1) - 2.0 * products
    squares = np.maximum(squares, 0.0)
    row_sums = np.cumsum(squares, axis=1)
    row_sums_before = row_sums - squares
    sums = np.empty((len(nominal), len(flown) + 1))
    sums[:, 0], sums[0, 1:] = np.inf, row_sums[0]
    for row in range(1, len(nominal)):
        reached = np.minimum(sums[row - 1, 1:], sums[row - 1, :-1])
        reached -= row_sums_before[row]
        np.minimum.accumulate(reached, out=reached)
        np.add(reached, row_sums[row], out=sums[row, 1:])
    return sums


def _pairs(sums: Array, i: int, j: int) -> tuple[Indices, Indices]:
    """The pairs with the least sum, from the first one to (i, j)."""
    pairs = [(i, j)]
    while i > 0 or j > 0:
        if i == 0:
            j -= 1
        else:
            diagonal, from_previous_row, from_previous_column = sums[i - 1, j], sums[i - 1, j + 1], sums[i, j]
            i, j = (
                (i - 1, j - 1)
                if diagonal <= min(from_previous_row, from_previous_column)
                else ((i - 1, j) if from_previous_row <= from_previous_column else (i, j - 1))
            )
        pairs.append((i, j))
    index_pairs = np.array(pairs[::-1])
    return index_pairs[:, 0], index_pairs[:, 1]
