"""What arrives of one vehicle, message by message: rates, ages, fields as they come, and loss.

Nothing is counted while nobody looks: the first look starts it, and it ends `IDLE_S` after the last. Of a
message whose fields are plotted the frames are kept, so that a plot has each of them, at any rate.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from gcs_server.mavlink.codec import Frame
from gcs_server.mavlink.definitions import Value, instance_of, layout_of, values_of
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
MAX_FOLLOWED: Final = 64
"""Messages of which the frames are kept, more than a PX4 sends; the one that was not read for the longest
time is dropped."""
MAX_FRAMES: Final = 500
"""Frames that are kept of each, the newest: 10 s at 50 Hz, and a plot asks several times a second."""
MAX_INSTANCES: Final = 16
"""Instances of a message, such as batteries, that are told apart."""


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
    instance: int | None
    """What the newest is of, such as the number of its battery; null: the message has no such field."""
    instances: tuple[int, ...]
    """All that were seen, ascending."""


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

    system: int
    """MAVLink system id of the vehicle."""
    since_s: float
    """Time since counting began [s]."""
    messages: tuple[ReceivedMessage, ...]
    """By component and name."""
    loss: tuple[ReceivedLoss, ...]
    """By component and link."""
    left_out: int
    """Messages of further kinds, which are not shown."""


@dataclass(slots=True)
class KeptFrame:
    """A frame of a message whose numbers are plotted."""

    number: int
    """Counts all frames that are kept of the vehicle, from 1."""
    frame: Frame
    instance: int | None
    """What it is of, such as the number of a battery; None: the message has no such field."""
    _row: dict[str, Value] | None = None

    def row(self) -> dict[str, Value]:
        """Its fields, decoded when they are first read."""
        if self._row is None:
            self._row = values_of(self.frame)
        return self._row


@dataclass(slots=True)
class Followed:
    """The newest frames of one message of one component."""

    read_s: float
    complete_after: int
    """All frames with a larger number are here."""
    frames: deque[KeptFrame] = field(default_factory=lambda: deque[KeptFrame](maxlen=MAX_FRAMES))

    def keep(self, kept: KeptFrame) -> None:
        """Adds a frame, in place of the oldest if there are too many."""
        if len(self.frames) == MAX_FRAMES:
            self.complete_after = self.frames[0].number
        self.frames.append(kept)


@dataclass(slots=True)
class _Kind:
    newest: Frame
    count: int = 0
    times_s: deque[float] = field(default_factory=lambda: deque[float](maxlen=MAX_TIMES))
    instances: set[int] = field(default_factory=set[int])


@dataclass(slots=True)
class _Sender:
    next_seq: int
    received: int = 0
    lost: int = 0


class MessageInspector:
    """The messages of one vehicle."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._looked_s = float("-inf")
        self._since_s: float | None = None
        self._kinds: dict[tuple[int, int], _Kind] = {}
        self._senders: dict[tuple[int, str, str], _Sender] = {}
        self._followed: dict[tuple[int, int], Followed] = {}
        self.kept_count = 0
        """Number of the newest frame that is kept."""
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
            self._vehicle.identity.system_id,
            now_s - (now_s if self._since_s is None else self._since_s),
            tuple(messages),
            tuple(ReceivedLoss(*key, *counts) for key, counts in sorted(loss.items())),
            self._left_out,
        )

    def follow(self, message: str, component: int) -> Followed:
        """The newest frames of a message; the first call begins to keep them.

        Raises:
            InvalidRequest: the dialect has no such message.
        """
        now_s = self._look()
        key = (component, layout_of(message).msg_id)
        followed = self._followed.get(key)
        if followed is None:
            if len(self._followed) >= MAX_FOLLOWED:
                del self._followed[min(self._followed, key=lambda each: self._followed[each].read_s)]
            followed = self._followed[key] = Followed(now_s, self.kept_count + 1)
            if (kind := self._kinds.get(key)) is not None and kind.newest.known:
                self._keep(followed, kind.newest)
        followed.read_s = now_s
        return followed

    def now_s(self) -> float:
        """The time, on the clock of the frames [s]."""
        return self._vehicle.clock.monotonic_s()

    def _keep(self, followed: Followed, frame: Frame) -> None:
        self.kept_count += 1
        followed.keep(KeptFrame(self.kept_count, frame, instance_of(frame)))

    def take(self, frame: Frame, endpoint: Endpoint) -> None:
        """Counts a frame; called only while somebody looks."""
        if endpoint.over_ros2:
            return
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
        if len(kind.instances) < MAX_INSTANCES and (instance := instance_of(frame)) is not None:
            kind.instances.add(instance)
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
        if frame.known and (followed := self._followed.get(key)) is not None:
            self._keep(followed, frame)

    def _look(self) -> float:
        """Begins or continues to count; returns the time."""
        now_s = self._looked_s = self._vehicle.clock.monotonic_s()
        if self._since_s is None:
            self._since_s = now_s
            self._vehicle.taps += (self.take,)
            self._vehicle.in_background("inspector", self._until_idle())
        return now_s

    async def _until_idle(self) -> None:
        clock = self._vehicle.clock
        try:
            while clock.monotonic_s() - self._looked_s < IDLE_S:
                await clock.sleep(CHECK_S)
        finally:
            self._vehicle.taps = tuple(tap for tap in self._vehicle.taps if tap != self.take)
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
            instance_of(frame),
            tuple(sorted(kind.instances)),
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
