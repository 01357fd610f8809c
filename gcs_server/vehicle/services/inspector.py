"""What arrives of one vehicle, message by message: rates, ages, fields as they come, and loss.

Nothing is counted while nobody looks: the first look starts it, and it ends `IDLE_S` after the last. Of a
message whose fields are plotted the frames are kept, so that a plot has each of them, at any rate.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from gcs_server.errors import InvalidRequest
from gcs_server.mavlink.codec import Frame
from gcs_server.mavlink.definitions import Value, definition, values_of
from gcs_server.mavlink.tables import NAMES
from gcs_server.vehicle.endpoint import Endpoint
from gcs_server.vehicle.services.port import VehiclePort

IDLE_S: Final = 10.0
"""Without a look for this time counting ends [s]."""
CHECK_S: Final = 2.0
WINDOW_S: Final = 10.0
"""A rate is the average of this time [s]."""
MAX_TIMES: Final = 400
"""Arrivals from which the rate is computed; of a faster message those of a shorter time."""
MAX_MESSAGES: Final = 500
"""Kinds of messages of all components together; others are counted in `left_out`."""
MAX_FOLLOWED: Final = 8
"""Messages of which the frames are kept; the one that was not read for the longest time is dropped."""
MAX_FRAMES: Final = 4000
"""Frames that are kept of each, the newest."""


@dataclass(frozen=True, slots=True)
class ReceivedMessage:
    """A kind of message of one component."""

    id: int
    """Number of the message."""
    name: str | None
    """Name of the message; null: not in the server's dialect."""
    component: int
    """Component that sends it."""
    count: int
    """Messages since counting began."""
    rate_hz: float | None
    """Rate, average of the last 10 s [Hz]; null: one message."""
    age_s: float
    """Age of the newest [s]."""
    size_bytes: int
    """Size of the newest, without the zeros at its end that MAVLink 2 leaves out [bytes]."""
    fields: dict[str, Value] | None
    """Fields of the newest, as they came; a number that is not finite is null. Null: not in the dialect."""


@dataclass(frozen=True, slots=True)
class ReceivedLoss:
    """Messages of one component on one link."""

    component: int
    """The component."""
    link: str
    """The link."""
    received: int
    """Messages since counting began."""
    lost: int
    """Missing numbers between them: lost on the way, or sent to others."""


@dataclass(frozen=True, slots=True)
class Received:
    """What arrived of one vehicle."""

    since_s: float
    """Time since counting began [s]."""
    messages: tuple[ReceivedMessage, ...]
    """By component and name."""
    loss: tuple[ReceivedLoss, ...]
    """By component and link."""
    left_out: int
    """Messages of further kinds, which are not shown."""


@dataclass(frozen=True, slots=True)
class FieldSeries:
    """The values of fields of one message."""

    now_s: float
    """Time of the answer, on the clock of `times_s` [s]."""
    times_s: list[float]
    """Arrivals, on the server's monotonic clock [s]."""
    values: dict[str, list[float | None]]
    """By field, `name` or `name[index]`; null: not finite."""


@dataclass(slots=True)
class _Kind:
    newest: Frame
    count: int = 0
    times_s: deque[float] = field(default_factory=lambda: deque[float](maxlen=MAX_TIMES))


@dataclass(slots=True)
class _Sender:
    next_seq: int
    received: int = 0
    lost: int = 0


@dataclass(slots=True)
class _Followed:
    read_s: float
    frames: deque[Frame] = field(default_factory=lambda: deque[Frame](maxlen=MAX_FRAMES))


class MessageInspector:
    """The messages of one vehicle."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._looked_s = float("-inf")
        self._since_s: float | None = None
        self._kinds: dict[tuple[int, int], _Kind] = {}
        self._senders: dict[tuple[int, str, str], _Sender] = {}
        self._followed: dict[tuple[int, int], _Followed] = {}
        self._left_out = 0

    def received(self) -> Received:
        """What has arrived since the first look."""
        now_s = self._look()
        messages = [self._view(key, kind, now_s) for key, kind in self._kinds.items()]
        messages.sort(key=lambda each: (each.component, each.name or f"~{each.id:08}"))
        loss: dict[tuple[int, str], list[int]] = {}
        for (component, link, _), sender in self._senders.items():
            counts = loss.setdefault((component, link), [0, 0])
            counts[0] += sender.received
            counts[1] += sender.lost
        return Received(
            now_s - (now_s if self._since_s is None else self._since_s),
            tuple(messages),
            tuple(ReceivedLoss(*key, *counts) for key, counts in sorted(loss.items())),
            self._left_out,
        )

    def series(self, message: str, component: int, fields: list[str], after_s: float) -> FieldSeries:
        """The values of fields of a message that arrived after a time; the first call begins to keep them.

        Args:
            message: name of the message.
            component: component that sends it.
            fields: `name`, or `name[index]` of an array.
            after_s: time of the last value that the caller has, on the server's monotonic clock; 0: all.

        Raises:
            InvalidRequest: the dialect has no such message, or the message no such field.
        """
        described = definition(message)
        lengths = {each.name: each.length for each in described.fields if each.type != "char"}
        for name in fields:
            _require_number(name, lengths)
        now_s = self._look()
        key = (component, described.id)
        if key not in self._followed:
            if len(self._followed) >= MAX_FOLLOWED:
                del self._followed[min(self._followed, key=lambda each: self._followed[each].read_s)]
            self._followed[key] = _Followed(now_s)
            if (kind := self._kinds.get(key)) is not None:
                self._followed[key].frames.append(kind.newest)
        followed = self._followed[key]
        followed.read_s = now_s
        frames = [frame for frame in followed.frames if frame.received_monotonic_s > after_s]
        rows = [values_of(frame) for frame in frames]
        values = {name: [_number(row, name) for row in rows] for name in fields}
        return FieldSeries(now_s, [frame.received_monotonic_s for frame in frames], values)

    def take(self, frame: Frame, endpoint: Endpoint) -> None:
        """Counts a frame; called only while somebody looks."""
        now_s = frame.received_monotonic_s
        key = (frame.component_id, frame.msg_id)
        kind = self._kinds.get(key)
        if kind is None:
            if len(self._kinds) >= MAX_MESSAGES:
                self._left_out += 1
                return
            kind = self._kinds[key] = _Kind(frame)
        kind.newest = frame
        kind.count += 1
        kind.times_s.append(now_s)
        sender_key = (frame.component_id, endpoint.connection.name, endpoint.peer.name)
        sender = self._senders.get(sender_key)
        if sender is None:
            if len(self._senders) >= MAX_MESSAGES:
                return
            sender = self._senders[sender_key] = _Sender(frame.seq)
        gap = (frame.seq - sender.next_seq) & 0xFF
        if gap < 128:  # else an older frame that arrived late
            sender.lost += gap
            sender.next_seq = (frame.seq + 1) & 0xFF
        sender.received += 1
        if (followed := self._followed.get(key)) is not None:
            followed.frames.append(frame)

    def _look(self) -> float:
        """Begins or continues to count; returns the time."""
        now_s = self._looked_s = self._vehicle.clock.monotonic_s()
        if self._since_s is None:
            self._since_s = now_s
            self._vehicle.inspect = self.take
            self._vehicle.in_background("inspector", self._until_idle())
        return now_s

    async def _until_idle(self) -> None:
        clock = self._vehicle.clock
        try:
            while clock.monotonic_s() - self._looked_s < IDLE_S:
                await clock.sleep(CHECK_S)
        finally:
            self._vehicle.inspect = None
            self._since_s = None
            self._left_out = 0
            for table in (self._kinds, self._senders, self._followed):
                table.clear()

    def _view(self, key: tuple[int, int], kind: _Kind, now_s: float) -> ReceivedMessage:
        component, msg_id = key
        frame, times_s = kind.newest, kind.times_s
        while times_s and now_s - times_s[0] > WINDOW_S:
            times_s.popleft()
        known = frame.known and msg_id in NAMES
        return ReceivedMessage(
            msg_id,
            NAMES[msg_id] if known else None,
            component,
            kind.count,
            _rate_hz(times_s, now_s),
            max(0.0, now_s - frame.received_monotonic_s),
            len(frame.payload),
            values_of(frame) if known else None,
        )


def _rate_hz(times_s: deque[float], now_s: float) -> float | None:
    """Rate of arrivals; of a message that has stopped it falls with its age."""
    if len(times_s) < 2:
        return None
    span_s = times_s[-1] - times_s[0]
    mean_s = span_s / (len(times_s) - 1)
    if now_s - times_s[-1] > 2 * mean_s:
        span_s = now_s - times_s[0]
    return (len(times_s) - 1) / span_s if span_s > 0 else None


def _require_number(name: str, lengths: Mapping[str, int]) -> None:
    """Checks the name of a number: a field, or an element of an array.

    Raises:
        InvalidRequest: there is no such number.
    """
    base, _, rest = name.partition("[")
    index = int(rest[:-1]) if rest.endswith("]") and rest[:-1].isdecimal() and len(rest) < 6 else None
    length = lengths.get(base)
    if length is None or (index is None or index >= length if length else rest != ""):
        raise InvalidRequest(
            "field",
            f"The message has no number {name[:60]!r}.",
            remedy="Name a field, of an array `name[0]`.",
        )


def _number(row: Mapping[str, Value], name: str) -> float | None:
    """Value of a field or an element."""
    base, _, rest = name.partition("[")
    value = row[base]
    if isinstance(value, list):
        value = value[int(rest[:-1])]
    assert not isinstance(value, str)
    return value
