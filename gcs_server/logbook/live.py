"""Numbers of messages of a vehicle as they arrive, for plots in flight: the same fields and expressions as
in a log. An answer is bounded, so that a client that asks seldom costs no more than one that asks often.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs_server.errors import InvalidRequest
from gcs_server.logbook.columns import UnknownField
from gcs_server.logbook.expressions import evaluate, is_expression, names_of
from gcs_server.logbook.log import Times
from gcs_server.logbook.series import Values, split
from gcs_server.logbook.units import mavlink_unit
from gcs_server.mavlink.definitions import layout_of
from gcs_server.vehicle.services.inspector import Followed, KeptFrame, MessageInspector

MAX_FRAMES: Final = 1500
"""Frames of which an answer has new values; the next answer has the others."""
CONTEXT: Final = 50
"""Frames before the new ones that an expression sees: for a derivative, and between samples of others."""


@dataclass(frozen=True, slots=True)
class LiveSeries:
    """New values of one field or expression."""

    field: str
    """As it was asked for."""
    unit: str | None
    """Null: not known."""
    gap: bool
    """Whether values before these are missing, because they were not kept until this request."""
    t_s: list[float]
    """Arrival of each, on the server's monotonic clock [s]."""
    values: list[float | None]
    """As many; null: not a number."""


@dataclass(frozen=True, slots=True)
class LiveValues:
    """What has arrived of fields and expressions."""

    now_s: float
    """Time of the answer, on the clock of the values [s]."""
    after: int
    """`after` of the next request."""
    more: bool
    """Whether more has arrived than an answer has: ask again now."""
    series: tuple[LiveSeries, ...]
    """In the order of the request."""


@dataclass(slots=True)
class _Topic:
    """A message of one sender: `ATTITUDE:1.1`, of one of several instances `BATTERY_STATUS:1.1.0`."""

    message: str
    instance: int | None
    followed: Followed
    frames: list[KeptFrame]
    """The frames that are read: the new ones, and some before them."""
    times_s: Times


def live_values(inspector: MessageInspector, system_id: int, fields: Sequence[str], after: int) -> LiveValues:
    """The values that arrived since an answer.

    Args:
        inspector: keeps the frames of the vehicle.
        system_id: the vehicle's.
        fields: `ATTITUDE:1.1/roll`, or an expression with such names in braces.
        after: from the last answer; 0: all that is kept.

    Raises:
        InvalidRequest: there is no such number, or an expression is invalid.
    """
    after = after if after <= inspector.kept_count else 0  # that of a server that has ended
    try:
        names = {field: names_of(field) if is_expression(field) else [field] for field in fields}
        topics: dict[str, _Topic] = {}
        for name in dict.fromkeys(name for each in names.values() for name in each):
            if (topic := split(name)[0]) not in topics:
                topics[topic] = _topic(inspector, system_id, topic)
        until, more = _read(list(topics.values()), inspector, after)
        series = tuple(_series(field, topics, split(names[field][0])[0], after) for field in fields)
    except UnknownField as error:
        text = str(error)
        raise InvalidRequest(
            "field",
            f"{text[:1].upper()}{text[1:]}.",
            remedy="Name a number such as ATTITUDE:1.1/roll, or an expression with such names in braces.",
        ) from None
    return LiveValues(inspector.now_s(), until, more, series)


def _topic(inspector: MessageInspector, system_id: int, name: str) -> _Topic:
    message, _, sender = name.partition(":")
    parts = sender.split(".")
    if len(parts) not in (2, 3) or not all(
        part.isascii() and part.isdigit() and len(part) < 4 for part in parts
    ):
        raise UnknownField(f"{name[:60]!r} is not of the form message:system.component")
    system, component, *own = (int(part) for part in parts)
    if system != system_id:
        raise UnknownField(f"the system of this vehicle is {system_id}, not {system}")
    return _Topic(message, own[0] if own else None, inspector.follow(message, component), [], np.empty(0))


def _read(topics: list[_Topic], inspector: MessageInspector, after: int) -> tuple[int, bool]:
    """Chooses the frames; returns the number of the last one, and whether there are more."""
    new = sorted(
        kept.number
        for followed in {id(topic.followed): topic.followed for topic in topics}.values()
        for kept in followed.frames
        if kept.number > after
    )
    more = len(new) > MAX_FRAMES
    until = new[MAX_FRAMES - 1] if more else inspector.kept_count
    for topic in topics:
        frames = [
            kept
            for kept in topic.followed.frames
            if kept.number <= until and (topic.instance is None or kept.instance == topic.instance)
        ]
        first = next((i for i, kept in enumerate(frames) if kept.number > after), len(frames))
        topic.frames = frames[max(0, first - CONTEXT) :]
        topic.times_s = np.array([kept.frame.received_monotonic_s for kept in topic.frames], np.float64)
    return until, more


def _series(field: str, topics: dict[str, _Topic], timed_by: str, after: int) -> LiveSeries:
    """The new values of a field or expression; `timed_by`: the topic whose times they have."""

    def read(name: str) -> tuple[Times, Values, str | None]:
        topic_id, number = split(name)
        topic = topics[topic_id]
        values, unit = _numbers(topic, number)
        return topic.times_s, values, unit

    times_s, values, unit = evaluate(field, read) if is_expression(field) else read(field)
    topic = topics[timed_by]
    new = np.array([kept.number > after for kept in topic.frames], np.bool_)
    shown = values[new]
    return LiveSeries(
        field,
        unit,
        0 < after < topic.followed.complete_after,
        np.round(times_s[new], 6).tolist(),
        [
            value if ok else None
            for value, ok in zip(shown.tolist(), np.isfinite(shown).tolist(), strict=True)
        ],
    )


@cache
def _numbers_of(message: str) -> dict[str, str | None]:
    """Units of the numbers of a message: `name`, or `name[index]` of an array."""
    kind: Any = layout_of(message).message_class
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    units: dict[str, str | None] = {}
    for name, type_name in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        if type_name == "char":
            continue
        unit = kind.fieldunits_by_name.get(name)
        names = [f"{name}[{i}]" for i in range(lengths[name])] if lengths[name] else [name]
        units |= dict.fromkeys(names, mavlink_unit(unit) if unit else None)
    return units


def _numbers(topic: _Topic, number: str) -> tuple[NDArray[np.float64], str | None]:
    units = _numbers_of(topic.message)
    if number not in units:
        raise UnknownField(f"{topic.message} has no number {number[:60]!r}")
    name, _, rest = number.partition("[")
    index = int(rest[:-1]) if rest else None
    rows: list[Any] = [kept.row()[name] for kept in topic.frames]
    values = rows if index is None else [row[index] if isinstance(row, list) else row for row in rows]
    return np.array([np.nan if value is None else value for value in values], np.float64), units[number]
