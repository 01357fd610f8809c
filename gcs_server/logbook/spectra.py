"""Which frequencies a value of a log has, and when: Welch's power spectral density, and the spectrogram of
the same segments.

Each segment has a Hann window, overlaps the next by half and loses its mean. The density is one-sided: its
sum times the resolution is the variance. A log's samples are not evenly spaced: gaps separate runs, no
segment reaches over one, and within a run values are interpolated at the mean rate, which weakens the highest
frequencies; `irregular` says how many steps that concerns.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from gcs_server.logbook.columns import Columns, UnknownField
from gcs_server.logbook.log import Times
from gcs_server.logbook.series import Values, values_of

MIN_SEGMENT, MAX_SEGMENT = 32, 1024
"""Samples of a segment, a power of two."""
SEGMENTS = 16
"""Segments over which a spectrum is averaged, if there are as many values."""
MAX_COLUMNS = 300
"""Columns of a spectrogram; neighbours are averaged."""
MAX_SAMPLES = 8_000_000
AT_ONCE = 256
"""Segments that are transformed at once."""
GAP_STEPS = 2.5
"""A step this many times the usual one is a gap."""
IRREGULAR_PART = 0.2
"""A step that differs by more from the usual one is irregular."""


def spectrum(columns: Columns, field: str, from_s: float | None, to_s: float | None) -> dict[str, Any]:
    """The spectrum of a field or expression in a window of time, as plain values.

    Raises:
        UnknownField: the log has no such field, or too few values of it here.
    """
    times_s, values, unit = values_of(columns, field, from_s, to_s)
    finite = np.isfinite(values)
    times_s, values = times_s[finite][:MAX_SAMPLES], values[finite][:MAX_SAMPLES]
    ascending = np.concatenate(([True], np.diff(times_s) > 0)) if len(times_s) else finite[:0]
    times_s, values = times_s[ascending], values[ascending]
    if len(times_s) < MIN_SEGMENT:
        raise UnknownField(
            f"{field} has {len(times_s)} values in this time, and a spectrum needs {MIN_SEGMENT}"
        )
    steps_s = np.diff(times_s)
    step_s = float(np.median(steps_s))
    cuts = np.flatnonzero(steps_s > GAP_STEPS * step_s) + 1
    runs = list(zip(np.split(times_s, cuts), np.split(values, cuts), strict=True))
    length = _segment_length(len(values), max(len(times) for times, _ in runs))
    if length is None:
        raise UnknownField(
            f"{field} has so many gaps in this time that no {MIN_SEGMENT} values follow each other"
        )
    inside = steps_s[steps_s <= GAP_STEPS * step_s]
    even_s = float(np.mean(inside))
    segments = [part for run in runs for part in _segments(*run, even_s, length)]
    middles_s = np.concatenate([middles for middles, _ in segments])
    densities = np.concatenate([density for _, density in segments])
    shown_s, rows = _columns(middles_s, densities)
    return {
        "field": field,
        "unit": None if unit is None else f"({unit})²/Hz",
        "rate_hz": 1 / even_s,
        "segment_s": length * even_s,
        "segments": len(middles_s),
        "gaps": len(cuts),
        "irregular": float(np.mean(np.abs(steps_s - step_s) > IRREGULAR_PART * step_s)),
        "frequencies_hz": np.round(np.fft.rfftfreq(length, even_s), 6).tolist(),
        "density": densities.mean(axis=0).tolist(),
        "t_s": np.round(shown_s, 6).tolist(),
        "decibels": np.round(10 * np.log10(np.maximum(rows, 1e-30))).astype(int).tolist(),
    }


def _segment_length(count: int, longest: int) -> int | None:
    """The largest power of two with which enough segments fit; None: a run has not even the smallest."""
    if longest < MIN_SEGMENT:
        return None
    wanted = min(longest, max(MIN_SEGMENT, 2 * count // SEGMENTS), MAX_SEGMENT)
    return 1 << (wanted.bit_length() - 1)


def _segments(
    times_s: Times, values: Values, step_s: float, length: int
) -> Iterator[tuple[Times, NDArray[np.float32]]]:
    """Middles and densities of the segments of a run without gaps."""
    even_s = np.arange(times_s[0], times_s[-1] + step_s / 2, step_s)
    if len(even_s) < length:
        return
    even = np.interp(even_s, times_s, values)
    window = np.hanning(length + 1)[:-1]
    scale = 2 * step_s / np.sum(window * window)
    parts = sliding_window_view(even, length)[:: length // 2]
    middles_s = even_s[: len(parts) * (length // 2) : length // 2] + length * step_s / 2
    for first in range(0, len(parts), AT_ONCE):
        some = parts[first : first + AT_ONCE]
        power = np.abs(np.fft.rfft((some - some.mean(axis=1, keepdims=True)) * window)) ** 2 * scale
        power[:, [0, -1]] /= 2  # zero and half the rate have no other side
        yield middles_s[first : first + AT_ONCE], power.astype(np.float32)


def _columns(middles_s: Times, densities: NDArray[np.float32]) -> tuple[Times, Values]:
    """At most `MAX_COLUMNS` columns: means of neighbours."""
    count = -(-len(middles_s) // MAX_COLUMNS)
    firsts = np.arange(0, len(middles_s), count)
    sizes = np.diff(np.append(firsts, len(middles_s)))
    return (
        np.add.reduceat(middles_s, firsts) / sizes,
        np.add.reduceat(densities, firsts, axis=0) / sizes[:, None].astype(np.float32),
    )
