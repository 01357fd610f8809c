"""What a finding is, and how its functions read a log: values of one vehicle, only finite ones, with the
times in the air."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.log import Log, Span, Times, Topic, VehicleStates
from gcs_server.logbook.logged_flights import own_topics

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_VALUE = 1e9
"""A larger value is none of a vehicle's: it is left out, so that sums of damaged values stay finite."""
MAX_OF_A_KIND = 20
"""Findings of one kind in one flight."""
JOIN_S = 2.0
"""Spans with shorter gaps are one."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a log shows; times are seconds since the log's start."""

    severity: Literal["warning", "caution"]
    """warning: it endangered the flight; caution: look at it before the next one."""
    begin_s: float
    end_s: float
    text: str
    """What happened."""
    limit: str
    """What would be normal, and who says so."""
    remedy: str
    """What to do."""
    panes: list[list[str]] = field(default_factory=list[list[str]])
    """Fields and expressions that show it, of each pane of plots."""


class NotJudged(Exception):
    """A log lacks what a kind of finding needs; the text says what."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of finding: a row of the table."""

    name: str
    """Name in the API."""
    title: str
    find: Callable[[Flight], list[Finding]]
    """Raises NotJudged."""


@dataclass(frozen=True, slots=True)
class Signal:
    """Finite values of a field."""

    field: str
    """As in a plot: `vehicle_attitude:0/q[0]`."""
    times_s: Times
    values: Values

    def at(self, times_s: Times) -> Values:
        """The newest value at each time; the first before it. The signal has at least one value."""
        indices = np.searchsorted(self.times_s, times_s, "right") - 1
        return self.values[np.clip(indices, 0, None)]

    def between(self, begin_s: float, end_s: float) -> Signal:
        """The part of a time."""
        part = (self.times_s >= begin_s) & (self.times_s <= end_s)
        return Signal(self.field, self.times_s[part], self.values[part])


class Flight:
    """One vehicle of a log.

    Args:
        log: the log.
        states: the vehicle; of a telemetry log only its own messages are read.
    """

    def __init__(self, log: Log, states: VehicleStates) -> None:
        self.log, self.states = log, states
        self.is_tlog = log.kind == "tlog"
        self._topics: dict[str, list[Topic]] = {}
        own = log.topics if self.is_tlog else own_topics(log, states.id)
        for topic in own:
            if not self.is_tlog or topic.instance.split(".", 1)[0] == states.id:
                self._topics.setdefault(topic.name, []).append(topic)
        self.air = self._air()
        """Times in the air; where landing is not logged, times armed."""

    def _air(self) -> list[Span]:
        armed = self.states.armed
        try:
            landed = self.signal("vehicle_land_detected/landed", "EXTENDED_SYS_STATE/landed_state")
        except NotJudged:
            return armed
        on_ground = landed.values == 1  # MAV_LANDED_STATE_ON_GROUND, and true of PX4's own topic
        air = spans(landed.times_s, ~on_ground, self.log.duration_s, join_s=0.0)
        return [
            Span(max(a.begin_s, b.begin_s), min(a.end_s, b.end_s), "")
            for a in air
            for b in armed
            if min(a.end_s, b.end_s) > max(a.begin_s, b.begin_s)
        ][:MAX_OF_A_KIND]

    def topic(self, *names: str) -> Topic:
        """The first topic of these names that this kind of log has. Raises NotJudged."""
        return self.topics(*names)[0]

    def topics(self, *names: str) -> list[Topic]:
        """All instances of the first of these names that the log has. Raises NotJudged."""
        wanted = [name for name in names if name.isupper() == self.is_tlog]
        if not wanted:
            raise NotJudged("A telemetry log does not have what this needs; the vehicle's own log has.")
        for name in wanted:
            if name in self._topics:
                return self._topics[name]
        raise self.not_logged(wanted[0])

    def has(self, name: str) -> bool:
        """Whether the log has a topic."""
        return name in self._topics

    def signal(self, *fields: str) -> Signal:
        """The first of these fields, `topic/field`, that the log has with values. Raises NotJudged."""
        wanted = [each for each in fields if each.split("/")[0].isupper() == self.is_tlog]
        for each in wanted:
            name, _, column = each.partition("/")
            for topic in self._topics.get(name, []):
                if column in topic.columns:
                    signal = signal_of(topic, column)
                    if len(signal.values):
                        return signal
        if not wanted:
            raise NotJudged("A telemetry log does not have what this needs; the vehicle's own log has.")
        raise self.not_logged(wanted[0].split("/")[0])

    def not_logged(self, name: str) -> NotJudged:
        """That a topic or message is missing."""
        text = f"The message {name} is not logged." if self.is_tlog else f"The topic {name} is not logged."
        return NotJudged(text)

    def optional(self, *fields: str) -> Signal | None:
        """As `signal`; None: not logged."""
        try:
            return self.signal(*fields)
        except NotJudged:
            return None

    def parameter(self, name: str, default: float) -> float:
        """A parameter's first value; `default`: the log does not have it."""
        return float(self.log.parameters.get(name, default))

    def in_air(self, times_s: Times, margin_s: float = 0.0) -> Mask:
        """Which times are in the air, and `margin_s` after take-off and before landing."""
        return inside(times_s, self.air, margin_s)

    def armed(self, times_s: Times) -> Mask:
        """At which times the vehicle is armed."""
        return inside(times_s, self.states.armed, 0.0)

    def mode_at(self, t_s: float) -> str | None:
        """The mode at a time; None: not known."""
        return next((s.name for s in reversed(self.states.modes) if s.begin_s <= t_s), None)


def signal_of(topic: Topic, column: str) -> Signal:
    """The finite values of a topic's field."""
    raw = np.asarray(topic.columns[column])
    if raw.dtype.kind not in "fiub":
        return Signal(f"{topic.id}/{column}", topic.times_s[:0], np.empty(0))
    with np.errstate(all="ignore"):
        values = raw.astype(np.float64)
        usable = np.abs(values) <= MAX_VALUE
    return Signal(f"{topic.id}/{column}", topic.times_s[usable], values[usable])


def inside(times_s: Times, within: list[Span], margin_s: float) -> Mask:
    """Which times are in one of the spans, and not within `margin_s` of its ends."""
    mask = np.zeros(len(times_s), dtype=np.bool_)
    for span in within:
        first = np.searchsorted(times_s, span.begin_s + margin_s, "left")
        mask[first : np.searchsorted(times_s, span.end_s - margin_s, "right")] = True
    return mask


def spans(times_s: Times, mask: Mask, end_s: float, min_s: float = 0.0, join_s: float = JOIN_S) -> list[Span]:
    """The spans in which a mask is true; each sample holds until the next, the last one until `end_s`."""
    if not len(times_s):
        return []
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    ends_s = np.append(times_s, max(end_s, float(times_s[-1])))
    joined: list[Span] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        begin_s, until_s = float(times_s[begin]), float(ends_s[end])
        if joined and begin_s - joined[-1].end_s <= join_s:
            joined[-1] = Span(joined[-1].begin_s, until_s, "")
        else:
            joined.append(Span(begin_s, until_s, ""))
    return [span for span in joined if span.end_s - span.begin_s >= min_s]


def longest(found: list[Span]) -> Span:
    """The longest of at least one span."""
    return max(found, key=lambda span: span.end_s - span.begin_s)


def total_s(found: list[Span]) -> float:
    """The time of all spans."""
    return sum(span.end_s - span.begin_s for span in found)


def above(flight: Flight, signal: Signal, limit: float, min_s: float, margin_s: float = 1.0) -> list[Span]:
    """Where a signal is above a limit in the air for at least `min_s`."""
    mask = (signal.values > limit) & flight.in_air(signal.times_s, margin_s)
    return spans(signal.times_s, mask, float(signal.times_s[-1]), min_s)


def highest(signal: Signal, span: Span) -> float:
    """The highest value in a span that has one."""
    return float(np.max(signal.between(span.begin_s, span.end_s).values))
