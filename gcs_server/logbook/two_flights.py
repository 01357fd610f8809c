"""Two flights over each other: how far apart they were at the same times of both, and how they differ. Pure.

Their times are brought together by arming, by take-off, by the best fit of their tracks in time, or by a
given offset. Positions are the estimates of the vehicles (WGS84, altitude AMSL), as on the map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.exports.tracks import tracks
from gcs_server.logbook.findings.model import Flight, NotJudged, Signal
from gcs_server.logbook.findings.power import measured_current, measured_voltage
from gcs_server.logbook.log import Log, Span, VehicleStates
from gcs_server.logbook.logged_flights import path_length_m

Values = NDArray[np.float64]
Align = Literal["arming", "takeoff", "fit", "offset"]

STEP_S = 0.2
"""Time between two compared positions."""
MAX_GAP_S = 3.0
"""Nothing is said of a longer gap between two positions."""
MAX_STEPS = 100_000
"""Positions of a longer flight are further apart in time."""
MAX_POINTS = 3000
"""Points of the answer."""
MIN_SHARED = 0.5
"""Part of the shorter flight that both fly at the same time in a fit."""
NEARLY = 1.3
"""Another offset whose distance is only this much larger fits nearly as well."""
METRES_PER_DEG = 111_194.9
"""Of latitude, on a sphere of 6371 km: the error of a distance is below 0.5 %."""


class CannotCompare(ValueError):
    """These two flights cannot be compared like this; the text says why.

    Args:
        text: the reason, as a sentence.
        field: the field of the request that would have to be different.
    """

    def __init__(self, text: str, field: str) -> None:
        super().__init__(text)
        self.field = field


@dataclass(frozen=True, slots=True)
class Part:
    """One flight of one vehicle in a log."""

    vehicle: str
    """MAVLink system id; empty: not known, or any."""
    begin_s: float | None = None
    """Arming [s since the log's start]; None: the log's start."""
    end_s: float | None = None
    """Disarming; None: the log's end."""


@dataclass(frozen=True, slots=True)
class Totals:
    """What one flight came to."""

    duration_s: float
    """From arming to disarming."""
    distance_m: float
    """Length of the path over ground."""
    height_m: float
    """Greatest height above its first position."""
    energy_wh: float | None
    """Energy from the battery, voltage times current; null: not measured."""
    charge_mah: float | None
    """Charge from the battery; null: not measured."""
    battery_used_share: float | None
    """Used part of the battery by the vehicle's own estimate, 0 to 1; null: not reported."""


@dataclass(frozen=True, slots=True)
class TwoFlights:
    """A second flight beside a first one, at times of the first one's log."""

    align: Align
    """By what their times are brought together."""
    offset_s: float
    """What is added to times of the second log to get those of the first one."""
    first: Totals
    second: Totals
    shared_s: float
    """Time in which both have positions."""
    t_s: list[float]
    """Times in which both fly [s since the start of the first log]."""
    distance_m: list[float | None]
    """Distance between the two vehicles' positions; null: a gap of a log."""
    over_ground_m: list[float | None]
    """The same without heights."""
    above_m: list[float | None]
    """How much higher the second one is."""
    max_m: float
    """Largest distance."""
    max_s: float
    """When it was largest."""
    rms_m: float
    """Root of the mean square of the distances."""
    notes: list[str]
    """What limits the comparison, as sentences."""


@dataclass(frozen=True, slots=True)
class _Path:
    """Positions in equal steps: (N, 3) north, east, up [m] from a common place; NaN in gaps."""

    begin_s: float
    step_s: float
    points_m: Values


class _One:
    """One of the two flights."""

    def __init__(self, log: Log, part: Part, *, is_first: bool) -> None:
        self._is_first = is_first
        begin_s = 0.0 if part.begin_s is None else part.begin_s
        end_s = log.duration_s if part.end_s is None else part.end_s
        states = next((v for v in log.vehicles if not part.vehicle or v.id in ("", part.vehicle)), None)
        states = states or VehicleStates(part.vehicle)
        self.is_armed = any(span.end_s > begin_s and span.begin_s < end_s for span in states.armed)
        found = [each for each in tracks(log, begin_s, end_s) if each.vehicle in ("", states.id)]
        if not found:
            raise CannotCompare(
                f"The {'first' if is_first else 'second'} flight has no positions.",
                "f" if is_first else "other",
            )
        self.track, self.begin_s, self.end_s = found[0], begin_s, end_s
        self._log = log
        self._flight = Flight(log, replace(states, armed=[Span(begin_s, end_s, "")]))

    def moment_s(self, align: Align) -> float:
        """Arming or take-off. Raises CannotCompare."""
        if align == "arming":
            if not self.is_armed:
                raise CannotCompare(
                    f"In the {'first' if self._is_first else 'second'} log the vehicle was not armed.",
                    "align",
                )
            return self.begin_s
        try:
            self._flight.signal("vehicle_land_detected/landed", "EXTENDED_SYS_STATE/landed_state")
        except NotJudged as error:
            raise CannotCompare(
                f"The {'first' if self._is_first else 'second'} log does not say when the vehicle took off.",
                "align",
            ) from error
        if not self._flight.air or self._flight.air[0].begin_s >= self.end_s:
            raise CannotCompare(
                f"In the {'first' if self._is_first else 'second'} flight the vehicle did not take off.",
                "align",
            )
        return self._flight.air[0].begin_s

    def path(self, origin: tuple[float, float, float], step_s: float) -> _Path:
        """The positions in equal steps from a common place: latitude, longitude [deg], altitude [m]."""
        lat0, lon0, alt0 = origin
        times_s, track = self.track.times_s, self.track
        # A step on a common grid, so that both flights are compared at the same times.
        t_s = np.arange(np.ceil(times_s[0] / step_s), np.floor(times_s[-1] / step_s) + 1) * step_s
        east_deg = (track.lon_deg - lon0 + 180.0) % 360.0 - 180.0
        metres = (
            (track.lat_deg - lat0) * METRES_PER_DEG,
            east_deg * METRES_PER_DEG * np.cos(np.radians(lat0)),
            track.alt_amsl_m - alt0,
        )
        points = np.column_stack([np.interp(t_s, times_s, each) for each in metres])
        after = np.clip(np.searchsorted(times_s, t_s), 1, len(times_s) - 1)
        points[times_s[after] - times_s[after - 1] > MAX_GAP_S] = np.nan
        return _Path(float(t_s[0]) if len(t_s) else 0.0, step_s, points)

    def totals(self, path: _Path) -> Totals:
        """Duration, distance, height and what was taken from the battery."""
        known = path.points_m[np.isfinite(path.points_m).all(axis=1)]
        energy_wh, charge_mah = self._from_battery()
        return Totals(
            duration_s=round(self.end_s - self.begin_s, 2),
            distance_m=round(path_length_m(known[:, :2]), 1),
            height_m=round(float(np.max(known[:, 2]) - known[0, 2]), 2) if len(known) else 0.0,
            energy_wh=energy_wh,
            charge_mah=charge_mah,
            battery_used_share=self._used_share(),
        )

    def _part(self, signal: Signal) -> Signal:
        return signal.between(self.begin_s, self.end_s)

    def _from_battery(self) -> tuple[float | None, float | None]:
        """Energy [Wh] and charge [mAh]; None: the current is not measured."""
        try:
            current = self._part(measured_current(self._flight))
            voltage = measured_voltage(self._flight)
        except NotJudged:
            return None, None
        if len(current.values) < 2 or not np.any(current.values > 0.0):
            return None, None
        step_s = np.clip(np.diff(current.times_s), 0.0, MAX_GAP_S)
        amperes = np.maximum(current.values[:-1], 0.0)
        volts = voltage.at(current.times_s[:-1])
        return round(float(np.sum(volts * amperes * step_s)) / 3600, 3), round(
            float(np.sum(amperes * step_s)) / 3.6, 1
        )

    def _used_share(self) -> float | None:
        remaining = self._flight.optional("battery_status/remaining", "SYS_STATUS/battery_remaining")
        if remaining is None:
            return None
        values = self._part(remaining).values / (100.0 if self._flight.is_tlog else 1.0)
        values = values[values >= 0.0]
        return round(float(values[0] - values[-1]), 4) if len(values) > 1 else None


def compare(logs: Sequence[Log], parts: Sequence[Part], align: Align, offset_s: float = 0.0) -> TwoFlights:
    """Compares two flights.

    Args:
        logs: the first and the second log.
        parts: the flight in each.
        align: by what their times are brought together.
        offset_s: with `offset`, what is added to times of the second log.

    Raises:
        CannotCompare: one has no positions, or they do not overlap like this.
    """
    first, second = (
        _One(log, part, is_first=is_first)
        for log, part, is_first in zip(logs, parts, (True, False), strict=True)
    )
    length_s = max(one.track.times_s[-1] - one.track.times_s[0] for one in (first, second))
    step_s = max(STEP_S, float(length_s) / MAX_STEPS)
    origin = (float(first.track.lat_deg[0]), float(first.track.lon_deg[0]), float(first.track.alt_amsl_m[0]))
    paths = first.path(origin, step_s), second.path(origin, step_s)
    notes: list[str] = []
    if align == "fit":
        offset_s = _best_offset_s(*paths, notes)
    elif align != "offset":
        offset_s = first.moment_s(align) - second.moment_s(align)
    return _compared(first, second, paths, align, offset_s, notes)


def _compared(
    first: _One, second: _One, paths: tuple[_Path, _Path], align: Align, offset_s: float, notes: list[str]
) -> TwoFlights:
    a, b = paths
    t_s = a.begin_s + a.step_s * np.arange(len(a.points_m))
    other_s = b.begin_s + b.step_s * np.arange(len(b.points_m)) + offset_s
    inside = (t_s >= other_s[0] - 1e-9) & (t_s <= other_s[-1] + 1e-9) if len(other_s) else t_s < t_s
    if np.count_nonzero(inside) < 2:
        raise CannotCompare("With this offset the flights do not overlap in time.", "offset_s")
    t_s = t_s[inside]
    apart = (
        np.column_stack([np.interp(t_s, other_s, b.points_m[:, k]) for k in range(3)]) - a.points_m[inside]
    )
    distance_m = np.linalg.norm(apart, axis=1)
    known = np.isfinite(distance_m)
    if not known.any():
        raise CannotCompare("With this offset there is no time at which both have positions.", "offset_s")
    worst = int(np.nanargmax(distance_m))
    if first.track.topic.split(":")[0] != second.track.topic.split(":")[0]:
        notes.append(f"Positions are of {first.track.topic} and of {second.track.topic}.")
    every = -(-len(t_s) // MAX_POINTS)
    return TwoFlights(
        align=align,
        offset_s=round(offset_s, 3),
        first=first.totals(a),
        second=second.totals(b),
        shared_s=round(float(np.count_nonzero(known)) * a.step_s, 2),
        t_s=_listed(t_s[::every]),
        distance_m=_listed(distance_m[::every]),
        over_ground_m=_listed(np.hypot(apart[:, 0], apart[:, 1])[::every]),
        above_m=_listed(apart[::every, 2]),
        max_m=round(float(distance_m[worst]), 3),
        max_s=round(float(t_s[worst]), 3),
        rms_m=round(float(np.sqrt(np.mean(distance_m[known] ** 2))), 3),
        notes=notes,
    )


def _best_offset_s(a: _Path, b: _Path, notes: list[str]) -> float:
    """The offset with the least mean square distance, over all with enough time in common.

    By the sums of squares and one correlation (FFT), so that all offsets cost little more than one.
    """
    first, second = (_filled(each.points_m) for each in (a, b))
    counts, squares = len(first) + len(second) - 1, np.zeros(len(first) + len(second) - 1)
    size = 1 << (counts - 1).bit_length()
    for k in range(3):
        x, y = first[:, k], second[::-1, k]
        product = np.fft.irfft(np.fft.rfft(x, size) * np.fft.rfft(y, size), size)[:counts]
        squares += _overlap_sums(x**2, len(y)) + _overlap_sums(y**2, len(x)) - 2.0 * product
    # Index n: sample i of the first one is beside sample i - n + len(second) - 1 of the second one.
    shared = _overlap_sums(np.ones(len(first)), len(second))
    usable = shared >= max(2.0, MIN_SHARED * min(len(first), len(second)))
    cost = np.where(usable, np.maximum(squares, 0.0) / np.maximum(shared, 1.0), np.inf)
    best = int(np.argmin(cost))
    shift = best - (len(second) - 1) + _vertex(cost, best)
    near = max(1, round(3.0 / a.step_s))
    low = np.flatnonzero((cost[1:-1] <= cost[:-2]) & (cost[1:-1] <= cost[2:])) + 1
    rivals = low[np.abs(low - best) > near]
    if len(rivals) and np.sqrt(cost[rivals].min()) <= NEARLY * max(np.sqrt(cost[best]), 0.1):
        rival = int(rivals[np.argmin(cost[rivals])])
        rival_s = a.begin_s - b.begin_s + (rival - len(second) + 1) * a.step_s
        notes.append(f"An offset of {rival_s:.1f} s fits nearly as well: parts of the flight are alike.")
    return float(a.begin_s - b.begin_s + shift * a.step_s)


def _filled(points: Values) -> Values:
    """(N, 3) with gaps bridged, for a correlation. The path has at least one position."""
    known = np.isfinite(points).all(axis=1)
    if not known.any():
        return np.zeros_like(points)
    n = np.arange(len(points))
    return np.column_stack([np.interp(n, n[known], points[known, k]) for k in range(3)])


def _overlap_sums(values: Values, width: int) -> Values:
    """(N + width - 1,) sums of the values under a window that moves over them from their begin."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    n = np.arange(len(values) + width - 1)
    return total[np.minimum(n + 1, len(values))] - total[np.clip(n + 1 - width, 0, len(values))]


def _vertex(cost: Values, best: int) -> float:
    """Where between its neighbours a minimum is, by a parabola: -0.5 to 0.5 steps."""
    if not 0 < best < len(cost) - 1:
        return 0.0
    before, at, after = cost[best - 1 : best + 2]
    bend = before - 2.0 * at + after
    return float(0.5 * (before - after) / bend) if np.isfinite(bend) and bend > 0.0 else 0.0


def _listed(values: NDArray[np.floating[Any]]) -> list[Any]:
    """Rounded, with None in place of NaN."""
    return [value if np.isfinite(value) else None for value in np.round(values, 3).tolist()]
