"""How the rate and the attitude loops of a vehicle follow their setpoints, as its log tells it: frequency
response and step response of each axis. Pure.

Windows with a Hann window that overlap by half are taken where the vehicle is in the air, both signals have
no gap, and the setpoint moves enough. Over them, x being the setpoint and y what was measured:

- frequency response H = Sxy / Sxx, coherence |Sxy|² / (Sxx Syy) (Welch's averaged cross-spectra);
- step response: the running sum of the inverse transform of W H, where W is Wiener's weight of an estimate
  over n windows, c / (c + (1 - c) / n), c being the coherence without its bias of 1 / n. Frequencies of which
  the log says nothing are so left out, and the response without noise is as sharp as the log allows.

Means are taken away, so that trim does not count; the gain at zero is that of the lowest frequency. A
setpoint that is itself an answer to disturbances (hover in wind) biases H: therefore it has to move.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from gcs_server.logbook.autotune import AXES, Autotune, Axis, autotune
from gcs_server.logbook.expressions import FUNCTIONS
from gcs_server.logbook.findings.model import Flight, NotJudged
from gcs_server.logbook.log import Log, Times, VehicleStates
from gcs_server.logbook.spectra import GAP_STEPS

Values = NDArray[np.float64]
Complex = NDArray[np.complex128]
Spans = list[tuple[float, float]]
LoopName = Literal["rate", "attitude"]
GROUND_S = 1.0
"""So long after take-off and before landing nothing is taken: the ground carries the vehicle."""
MIN_WINDOWS = 4
"""Fewer windows say nothing: their coherence is high by chance."""
SURE_WINDOWS = 8
"""With fewer the values are uncertain."""
MAX_WINDOWS = 800
"""Of more windows, these are taken evenly."""
PARTS = 6
"""The spread is that of the responses of so many parts of the windows, if each has `MIN_WINDOWS`."""
USABLE, SURE = 0.5, 0.8
"""Coherence, weighted by the setpoint's power, below which there are no numbers, and below which they are
uncertain."""
SMOOTH_BINS = 5
_SMOOTH = np.full(SMOOTH_BINS, 1.0 / SMOOTH_BINS)
"""Coherence is averaged over so many frequencies for Wiener's weight."""
CHANCE = 0.05
"""A coherence that noise alone reaches with this probability counts for nothing."""
SHOWN_COHERENCE = 0.5
"""Least coherence of a frequency that counts for bandwidth and resonance."""
BANDWIDTH_DB = -3.0
MAX_STRIDE = 1.5
"""The gain crosses it between two frequencies of at most this ratio."""
SETTLED = 0.05
"""Settled: within this part of the final value."""
FINAL_PART = 0.3
"""The final value is the mean over this last part of the response."""
ACAUSAL_PART = 0.1
"""Part of the response's length that is summed up before zero: filters are symmetrical."""
SHARPNESS = 0.6
"""A rise time is an upper bound if a perfect loop would rise in this part of it by this log."""
MIN_RISE_SAMPLES = 2.5
MAX_POINTS = 200
"""Points of a response."""
MAX_SHOWN_HZ = 60.0


@dataclass(frozen=True, slots=True)
class Loop:
    """One kind of loop, and how it is judged."""

    name: LoopName
    window_s: float
    response_s: float
    """Length of the step response."""
    moves: tuple[float, float, float]
    """By how much the setpoint of roll, pitch and yaw moves at least in a window: [°/s] or [°]."""


RATE = Loop("rate", 4.0, 1.0, (20.0, 20.0, 15.0))
ATTITUDE = Loop("attitude", 10.0, 2.5, (5.0, 5.0, 10.0))


@dataclass(frozen=True, slots=True)
class StepResponse:
    """The answer to a step of the setpoint by one."""

    t_s: list[float]
    """Times since the step."""
    value: list[float]
    """The answer, as a part of the step."""
    lowest: list[float] | None
    """The lowest of the answers in parts of the flight; null: too few windows for parts."""
    highest: list[float] | None
    """The highest of them."""
    rise_s: float
    """From 10 to 90 % of the final value."""
    rise_range_s: list[float] | None
    """Least and largest rise time in the parts of the flight."""
    overshoot: float
    """By which part of the final value it goes beyond it; 0: it does not."""
    overshoot_range: list[float] | None
    """Least and largest overshoot in the parts of the flight."""
    settling_s: float | None
    """From when it stays within 5 % of the final value; null: not within the shown time."""
    final: float
    """Value at the end, as a part of the step: 1 is what was wanted."""


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """The answer to setpoints that swing."""

    frequencies_hz: list[float]
    gain_db: list[float]
    """20·log10 of the amplitude beside that of the setpoint."""
    phase_deg: list[float]
    """Phase beside that of the setpoint; negative: later."""
    coherence: list[float]
    """Which part of the motion the setpoint explains, 0 to 1; below 0.5 gain and phase mean nothing."""
    bandwidth_hz: float | None
    """Frequency up to which the gain is above -3 dB; null: the log does not say it."""
    phase_at_bandwidth_deg: float | None
    """Phase at the bandwidth."""
    peak_db: float
    """Highest gain up to the bandwidth; above 0: the loop resonates."""
    peak_hz: float
    """Its frequency."""


@dataclass(frozen=True, slots=True)
class LoopResponse:
    """How one loop of one axis follows its setpoint."""

    loop: LoopName
    axis: Axis
    setpoint: str
    """Field or expression of the setpoint, in deg/s or deg, as for a plot."""
    measured: str
    """The same of what was measured."""
    rate_hz: float | None
    """Samples a second that were compared; null: there are none."""
    flown_s: float
    """Time in the air in which both are logged."""
    excited_s: float
    """The part of it in which the setpoint moves enough."""
    windows: int
    """Number of windows in it."""
    coherence: float | None
    """Coherence, weighted by the power of the setpoint; null: too few windows."""
    step: StepResponse | None
    """Null: the log does not say enough; `notes` say why."""
    frequency: FrequencyResponse | None
    """Null: too few windows."""
    notes: list[str]
    """What the log does not say, and how sure the rest is, as sentences."""


@dataclass(frozen=True, slots=True)
class Loops:
    """The rate and attitude loops of a flight."""

    loops: list[LoopResponse]
    """Rates of roll, pitch, yaw, then attitudes."""
    autotune: Autotune | None
    """What PX4's autotune found in the whole flight; null: it did not run."""


@dataclass(frozen=True, slots=True)
class _Pair:
    """Setpoint and measurement of a loop, each with its own times, in deg/s or deg."""

    fields: tuple[str, str]
    times_s: tuple[Times, Times]
    values: tuple[Values, Values]


class _Silent(ValueError):
    """The log does not say this; the text says why."""


def loops(log: Log, from_s: float | None, to_s: float | None) -> Loops:
    """The responses of all loops of the log's first vehicle, in a window of time (None: to its end)."""
    states = next(iter(log.vehicles), VehicleStates(""))
    flight = Flight(log, states)
    window = (-np.inf if from_s is None else from_s, np.inf if to_s is None else to_s)
    return Loops(
        [
            _response(flight, loop, k, read, window)
            for loop, read in ((RATE, _rates), (ATTITUDE, _attitudes))
            for k in range(3)
        ],
        autotune(flight),
    )


def _rates(flight: Flight, k: int) -> _Pair:
    """Raises NotJudged."""
    wanted = flight.signal(f"vehicle_rates_setpoint/{AXES[k]}")
    actual = flight.signal(f"vehicle_angular_velocity/xyz[{k}]")
    fields = (f"degrees({{{wanted.field}}})", f"degrees({{{actual.field}}})")
    values = (np.degrees(wanted.values), np.degrees(actual.values))
    return _Pair(fields, (wanted.times_s, actual.times_s), values)


def _attitudes(flight: Flight, k: int) -> _Pair:
    """Raises NotJudged."""
    angle: Callable[..., Values] = FUNCTIONS[AXES[k]][2]
    fields: list[str] = []
    values: list[Values] = []
    times_s: list[Times] = []
    for name in ("vehicle_attitude_setpoint/q_d", "vehicle_attitude/q"):
        parts = [flight.signal(f"{name}[{n}]") for n in range(4)]
        fields.append(f"{AXES[k]}({', '.join(f'{{{each.field}}}' for each in parts)})")
        times_s.append(parts[0].times_s)
        turns = angle(*(each.at(parts[0].times_s) for each in parts))
        values.append(np.unwrap(turns, period=360.0) if AXES[k] == "yaw" else turns)
    return _Pair((fields[0], fields[1]), (times_s[0], times_s[1]), (values[0], values[1]))


def _response(
    flight: Flight,
    loop: Loop,
    k: int,
    read: Callable[[Flight, int], _Pair],
    window: tuple[float, float],
) -> LoopResponse:
    try:
        pair = read(flight, k)
    except NotJudged as reason:
        return LoopResponse(loop.name, AXES[k], "", "", None, 0.0, 0.0, 0, None, None, None, [str(reason)])
    air = [(span.begin_s + GROUND_S, span.end_s - GROUND_S) for span in flight.air]
    step_s, runs = _even_runs(pair, [air, [window]])
    flown_s = sum(len(x) for x, _ in runs) * step_s
    length = round(loop.window_s / step_s) if step_s > 0.0 else 0
    count, windows = _windows(runs, length, loop.moves[k]) if length >= 8 else (0, np.empty((0, 2, 0)))
    notes: list[str] = []
    step = frequency = coherence = None
    try:
        _require(windows, loop, k, flown_s, step_s)
        spectra = _Spectra.of(windows)
        coherence = spectra.weighted_coherence()
        frequency = _frequency(spectra, step_s, length, notes)
        if coherence < USABLE:
            raise _Silent(
                f"The vehicle follows this setpoint too little to say more (coherence {coherence:.2f}): "
                "disturbances or noise are stronger, or the log is too slow."
            )
        step = _step(windows, spectra, step_s, loop, notes)
        if coherence < SURE:
            notes.append(f"These values are uncertain: the coherence is only {coherence:.2f}.")
        elif count < SURE_WINDOWS:
            notes.append(f"These values are uncertain: the setpoint moves enough in only {count} windows.")
    except _Silent as reason:
        notes.append(str(reason))
    return LoopResponse(
        loop.name, AXES[k], *pair.fields,
        rate_hz=None if step_s == 0.0 else round(1.0 / step_s, 2),
        flown_s=round(flown_s, 1),
        excited_s=round(_covered_s(count, loop.window_s, flown_s), 1),
        windows=count,
        coherence=None if coherence is None else round(coherence, 3),
        step=step, frequency=frequency, notes=notes,
    )  # fmt: skip


def _covered_s(windows: int, window_s: float, flown_s: float) -> float:
    """Time that windows cover which overlap by half."""
    return min(flown_s, (windows + 1) * window_s / 2) if windows else 0.0


def _require(found: Values, loop: Loop, k: int, flown_s: float, step_s: float) -> None:
    """Raises _Silent: there are too few windows."""
    if flown_s < loop.window_s:
        raise _Silent(
            f"Less than {loop.window_s:.0f} s of this part are flown in the air with this setpoint."
        )
    if found.shape[2] == 0 and step_s > 0.0:
        raise _Silent(f"The log has only {1.0 / step_s:.1f} samples a second of it.")
    if len(found) < MIN_WINDOWS:
        unit = "°/s" if loop.name == "rate" else "°"
        raise _Silent(
            f"The setpoint hardly moves: by {loop.moves[k]:.0f}{unit} in only {len(found)} windows of "
            f"{loop.window_s:.0f} s, and {MIN_WINDOWS} are needed. Fly quick turns on this axis."
        )


def _even_runs(pair: _Pair, within: Iterable[Spans]) -> tuple[float, list[tuple[Values, Values]]]:
    """Both signals at the steps of the slower one, in each time in which both have no gap.

    Returns:
        the step [s], 0 without values; of each run setpoint and measurement, (N,) each.
    """
    kept = [_ascending(t_s, v) for t_s, v in zip(pair.times_s, pair.values, strict=True)]
    if min(len(t_s) for t_s, _ in kept) < 2:
        return 0.0, []
    steps = [float(np.median(np.diff(t_s))) for t_s, _ in kept]
    spans: Spans = [(-np.inf, np.inf)]
    for other in (*within, *(_unbroken(t_s, step) for (t_s, _), step in zip(kept, steps, strict=True))):
        spans = _common(spans, other)
    step_s = max(steps)
    runs: list[tuple[Values, Values]] = []
    for begin_s, end_s in spans:
        t_s = np.arange(begin_s, end_s, step_s)
        runs.append((np.interp(t_s, *kept[0]), np.interp(t_s, *kept[1])))
    return step_s, runs


def _common(some: Spans, others: Spans) -> Spans:
    """The times that are in both; each ascending."""
    found: Spans = []
    i = j = 0
    while i < len(some) and j < len(others):
        begin_s, end_s = max(some[i][0], others[j][0]), min(some[i][1], others[j][1])
        if end_s > begin_s:
            found.append((begin_s, end_s))
        if some[i][1] < others[j][1]:
            i += 1
        else:
            j += 1
    return found


def _ascending(times_s: Times, values: Values) -> tuple[Times, Values]:
    """Without repeated times."""
    later = np.concatenate(([True], np.diff(times_s) > 0)) if len(times_s) else np.zeros(0, np.bool_)
    return times_s[later], values[later]


def _unbroken(times_s: Times, step_s: float) -> Spans:
    """The times between two gaps."""
    cuts = np.flatnonzero(np.diff(times_s) > GAP_STEPS * step_s)
    begins, ends = np.append(0, cuts + 1), np.append(cuts, len(times_s) - 1)
    return [(float(times_s[a]), float(times_s[b])) for a, b in zip(begins, ends, strict=True) if b > a]


def _windows(runs: list[tuple[Values, Values]], length: int, least: float) -> tuple[int, Values]:
    """The windows, overlapping by half, in which the setpoint moves by `least`: their number, and at most
    `MAX_WINDOWS` of them, (n, 2, length)."""
    views = [
        [sliding_window_view(each, length)[:: length // 2] for each in run]
        for run in runs
        if len(run[0]) >= length
    ]
    places = [(view, int(n)) for view in views for n in np.flatnonzero(np.ptp(view[0], axis=1) >= least)]
    count = len(places)
    if count > MAX_WINDOWS:
        places = [places[n] for n in np.linspace(0, count - 1, MAX_WINDOWS).astype(np.int64)]
    found = [np.stack([signal[n] for signal in view]) for view, n in places]
    return count, np.stack(found) if found else np.empty((0, 2, length))


@dataclass(frozen=True, slots=True)
class _Spectra:
    """Sums over n windows, (F,) each."""

    n: int
    sxx: Values
    syy: Values
    sxy: Complex

    @classmethod
    def of(cls, windows: Values) -> _Spectra:
        """Of windows (n, 2, length)."""
        hann = np.hanning(windows.shape[2] + 1)[:-1]
        mean = (windows @ hann)[:, :, None] / hann.sum()
        x, y = np.moveaxis(np.fft.rfft((windows - mean) * hann), 1, 0)
        return cls(
            len(windows),
            np.sum(np.abs(x) ** 2, axis=0),
            np.sum(np.abs(y) ** 2, axis=0),
            np.sum(np.conj(x) * y, axis=0),
        )

    @property
    def response(self) -> Complex:
        """(F,) H; at zero the gain of the lowest frequency."""
        found = self.sxy / np.maximum(self.sxx, np.finfo(float).tiny)
        found[0] = np.abs(found[1])
        return found

    @property
    def coherence(self) -> Values:
        """(F,) 0 to 1."""
        return np.abs(self.sxy) ** 2 / np.maximum(self.sxx * self.syy, np.finfo(float).tiny)

    def weighted_coherence(self) -> float:
        """Coherence over all frequencies but zero, by the power of the setpoint."""
        return float(np.average(self.coherence[1:], weights=self.sxx[1:]))

    @property
    def weight(self) -> Values:
        """(F,) Wiener's weight of each frequency."""
        smooth = np.convolve(np.pad(self.coherence[1:], SMOOTH_BINS // 2, "edge"), _SMOOTH, "valid")
        true = np.clip((self.n * smooth - 1.0) / (self.n - 1.0), 0.0, 1.0)
        weight = true / np.maximum(true + (1.0 - true) / self.n, np.finfo(float).tiny)
        weight[smooth < 1.0 - CHANCE ** (1.0 / (self.n - 1.0))] = 0.0
        return np.concatenate((weight[:1], weight))


def _frequency(spectra: _Spectra, step_s: float, length: int, notes: list[str]) -> FrequencyResponse | None:
    hz = np.fft.rfftfreq(length, step_s)
    shown = slice(1, int(np.searchsorted(hz, min(MAX_SHOWN_HZ, 0.5 / step_s), "right")))
    hz, found, coherence = hz[shown], spectra.response[shown], spectra.coherence[shown]
    gain_db = 20.0 * np.log10(np.maximum(np.abs(found), 1e-6))
    phase_deg = np.degrees(np.unwrap(np.angle(found)))
    sure = np.flatnonzero(coherence >= SHOWN_COHERENCE)
    below = gain_db[sure] < BANDWIDTH_DB
    # A single frequency below it, with others above after it, is an error of the estimate.
    under = np.flatnonzero(below & np.append(below[1:], True))
    first = int(under[0]) if len(under) else len(sure)
    bandwidth_hz = phase = None
    if len(sure) == 0:
        notes.append("No frequency of the setpoint is strong enough to see an answer to it.")
        return None
    if first == 0:
        notes.append(f"Already at {hz[sure[0]]:.2f} Hz the gain is below −3 dB.")
    elif first < len(sure) and hz[sure[first]] < MAX_STRIDE * hz[sure[first - 1]]:
        near = sure[first - 1 : first + 1]
        part = float((gain_db[near[0]] - BANDWIDTH_DB) / (gain_db[near[0]] - gain_db[near[1]]))
        bandwidth_hz = round(float(hz[near[0]] + part * (hz[near[1]] - hz[near[0]])), 3)
        phase = round(float(phase_deg[near[0]] + part * (phase_deg[near[1]] - phase_deg[near[0]])), 1)
    else:
        notes.append(
            f"The log does not say the bandwidth: only that it is above {hz[sure[first - 1]]:.1f} Hz."
        )
    peak = sure[int(np.argmax(gain_db[sure[: max(first, 1)]]))]
    return FrequencyResponse(
        frequencies_hz=np.round(hz, 4).tolist(),
        gain_db=np.round(gain_db, 2).tolist(),
        phase_deg=np.round(phase_deg, 1).tolist(),
        coherence=np.round(coherence, 3).tolist(),
        bandwidth_hz=bandwidth_hz,
        phase_at_bandwidth_deg=phase,
        peak_db=round(float(gain_db[peak]), 2),
        peak_hz=round(float(hz[peak]), 3),
    )


@dataclass(frozen=True, slots=True)
class _Shape:
    """What a step response looks like."""

    rise_s: float
    overshoot: float
    settling_s: float | None
    final: float


def _step(windows: Values, spectra: _Spectra, step_s: float, loop: Loop, notes: list[str]) -> StepResponse:
    length = windows.shape[2]
    count = round(loop.response_s / step_s) + 1
    weight = spectra.weight
    answer = _running_sum(spectra.response * weight, length, count)
    shape = _shape(answer, step_s)
    if shape is None:
        raise _Silent("The vehicle does not follow a step of this setpoint.")
    parts = [
        _running_sum(_Spectra.of(each).response * weight, length, count)
        for each in np.array_split(windows, min(PARTS, len(windows) // MIN_WINDOWS))
    ]
    shapes = [each for each in (_shape(part, step_s) for part in parts) if each is not None]
    spread = len(parts) > 1 and len(shapes) == len(parts)
    perfect = _shape(_running_sum(weight.astype(np.complex128), length, count), step_s)
    if shape.rise_s < MIN_RISE_SAMPLES * step_s:
        rate_hz = 1.0 / step_s
        notes.append(f"{rate_hz:.0f} samples a second are too few to see how fast it rises: maybe faster.")
    elif perfect is not None and perfect.rise_s > SHARPNESS * shape.rise_s:
        notes.append(
            "The setpoint has too little quick movement to see how fast it rises: it may rise faster."
        )
    every = -(-count // MAX_POINTS)

    def shown(values: Values) -> list[float]:
        return np.round(values[::every], 4).tolist()

    return StepResponse(
        t_s=np.round(np.arange(count)[::every] * step_s, 4).tolist(),
        value=shown(answer),
        lowest=shown(np.min(parts, axis=0)) if spread else None,
        highest=shown(np.max(parts, axis=0)) if spread else None,
        rise_s=round(shape.rise_s, 4),
        rise_range_s=_range([each.rise_s for each in shapes]) if spread else None,
        overshoot=round(shape.overshoot, 4),
        overshoot_range=_range([each.overshoot for each in shapes]) if spread else None,
        settling_s=None if shape.settling_s is None else round(shape.settling_s, 3),
        final=round(shape.final, 4),
    )


def _range(values: list[float]) -> list[float]:
    return [round(min(values), 4), round(max(values), 4)]


def _running_sum(response: Complex, length: int, count: int) -> Values:
    """(count,) the step response of a frequency response (F,)."""
    impulse = np.fft.irfft(response, length)
    before = min(round(ACAUSAL_PART * count), length - count)
    return np.cumsum(np.concatenate((impulse[length - before :], impulse[:count])))[before:]


def _shape(answer: Values, step_s: float) -> _Shape | None:
    """None: it does not rise."""
    final = float(np.mean(answer[-max(1, round(FINAL_PART * len(answer))) :]))
    if final <= 0.1:
        return None
    part = answer / final
    ends = [_crossing(part, level) for level in (0.1, 0.9)]
    if ends[0] is None or ends[1] is None:
        return None
    outside = np.flatnonzero(np.abs(part - 1.0) > SETTLED)
    settled = int(outside[-1]) + 1 if len(outside) else 0
    return _Shape(
        rise_s=(ends[1] - ends[0]) * step_s,
        overshoot=max(0.0, float(np.max(part)) - 1.0),
        settling_s=settled * step_s if settled < len(part) else None,
        final=final,
    )


def _crossing(part: Values, level: float) -> float | None:
    """Index at which it first exceeds a level, between samples."""
    over = np.flatnonzero(part >= level)
    if not len(over):
        return None
    n = int(over[0])
    if n == 0:
        return 0.0
    return n - 1 + float((level - part[n - 1]) / (part[n] - part[n - 1]))
