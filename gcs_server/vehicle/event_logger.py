"""Writes each STATUSTEXT, EVENT and state change of a vehicle to its event feed, once."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from gcs_server.clock import Clock
from gcs_server.vehicle.events import EventFeed
from gcs_server.vehicle.mode_cause import ModeCause
from gcs_server.vehicle.px4.events import LEVEL_PROTOCOL, VehicleEvent
from gcs_server.vehicle.px4.modes import ModeNames
from gcs_server.vehicle.reducers import FlightState

_text = struct.Struct("<B50sHB")
WAIT_FOR_CHUNKS_S = 1.0
MAX_PENDING = 8
"""Maximum number of texts whose chunks are awaited. If there is one more, the oldest text is
published incomplete."""
MAX_CHUNKS = 20
"""Maximum number of chunks of 50 bytes in one text; further chunks are ignored."""
MAX_BURST_LINES, MAX_LINES_PER_S = 200.0, 20.0
"""Maximum number of lines of one vehicle in a burst, and average per second. PX4 sends about 60 lines when it
starts."""


@dataclass(slots=True)
class _Pending:
    severity: int
    began_s: float
    chunks: dict[int, bytes] = field(default_factory=dict[int, bytes])
    has_last_chunk: bool = False


class TextJoiner:
    """Joins chunks with the same id to one text; a lost chunk is shown as ‹…›."""

    def __init__(self) -> None:
        self._pending: dict[int, _Pending] = {}

    def feed(self, payload: bytes, now_s: float) -> list[tuple[int, str]]:
        """(severity, text) of the texts that are complete with this message."""
        severity, raw, text_id, chunk = _text.unpack(payload)
        is_last = b"\0" in raw
        part = raw.split(b"\0", 1)[0]
        if text_id == 0:
            return [*self.expire(now_s), (severity, _decode(part))]
        if chunk >= MAX_CHUNKS:
            return []
        texts: list[tuple[int, str]] = []
        pending = self._pending.get(text_id)
        if pending is not None and chunk in pending.chunks and pending.chunks[chunk] != part:
            texts.append(self._finish(text_id))  # the id was reused
            pending = None
        if pending is None:
            if len(self._pending) >= MAX_PENDING:
                texts.append(self._finish(next(iter(self._pending))))
            pending = self._pending[text_id] = _Pending(severity, now_s)
        pending.chunks[chunk] = part
        last = max(pending.chunks)
        pending.has_last_chunk = pending.has_last_chunk or is_last
        if pending.has_last_chunk and len(pending.chunks) == last + 1:
            texts.append(self._finish(text_id))
        return texts

    def expire(self, now_s: float) -> list[tuple[int, str]]:
        """Texts whose missing chunks have not arrived in time."""
        if not self._pending:
            return []
        expired = [i for i, p in self._pending.items() if now_s - p.began_s > WAIT_FOR_CHUNKS_S]
        return [self._finish(text_id) for text_id in expired]

    def _finish(self, text_id: int) -> tuple[int, str]:
        pending = self._pending.pop(text_id)
        parts = [
            _decode(pending.chunks[i]) if i in pending.chunks else "‹…›"
            for i in range(max(pending.chunks) + 1)
        ]
        if not pending.has_last_chunk:
            parts.append("‹…›")
        return pending.severity, "".join(parts)


class LineRateLimiter:
    """Limits the rate of a vehicle's lines (token bucket), and counts the dropped lines."""

    def __init__(self) -> None:
        self._tokens = MAX_BURST_LINES
        self._filled_s: float | None = None
        self._dropped = 0

    def allow(self, now_s: float) -> bool:
        """Whether one more line may be published; if not, counts it as dropped."""
        if self._filled_s is not None:
            self._tokens = min(MAX_BURST_LINES, self._tokens + (now_s - self._filled_s) * MAX_LINES_PER_S)
        self._filled_s = now_s
        if self._tokens < 1.0:
            self._dropped += 1
            return False
        self._tokens -= 1.0
        return True

    def take_dropped(self, now_s: float) -> int:
        """Number of lines dropped since the last call; 0 while the vehicle still sends too fast."""
        if not self._dropped or self._filled_s is None:
            return 0
        if self._tokens + (now_s - self._filled_s) * MAX_LINES_PER_S < MAX_LINES_PER_S / 2:
            return 0
        count, self._dropped = self._dropped, 0
        return count


def _decode(raw: bytes) -> str:
    return raw.decode("utf-8", errors="replace")


MAX_PAIR_DELAY_S = 0.3
"""Maximum time between a text that ends in a tab and its event [s]; PX4 sends both within a few
milliseconds."""
SAME_TEXT_S = 1.0
"""Maximum time between equal texts from two links that become one line [s]."""
REMEMBERED_SEQUENCES = 64
"""Number of events that are remembered to recognise repeats."""
MAX_LATE_PAIR_DELAY_S = 5.0
"""Maximum time between a text and its event if the event was lost and requested again [s]."""
WARNING, NOTICE = 4, 5
MAX_UNDESCRIBED = 20
"""Maximum number of events that wait for a description; further events are logged without a description."""


class EventLogger:
    """Writes one vehicle's event feed.

    In this class, a text is a STATUSTEXT, an event is an EVENT, and a line is an entry of the feed. A text
    that ends in a tab has the same content as an event: the pair becomes one line with the text. A text or
    event received on two links also becomes one line.
    """

    def __init__(self, feed: EventFeed, clock: Clock, mode_names: ModeNames | None = None) -> None:
        self._mode_names = mode_names or ModeNames()
        self._feed = feed
        self._clock = clock
        self._texts = TextJoiner()
        self._waiting_texts: deque[tuple[float, int, str]] = deque()
        """(arrival time [s], severity, text) of texts that wait for their event."""
        self._unpaired_events: deque[float] = deque(maxlen=8)
        """Times of events that were logged before their text arrived."""
        self._seen_events: deque[tuple[int, int]] = deque(maxlen=REMEMBERED_SEQUENCES)
        self._seen_texts: deque[tuple[float, object, str]] = deque(maxlen=16)
        self._unpaired_texts: deque[float] = deque(maxlen=8)
        """Times of texts that were logged before their event arrived."""
        self._undescribed: deque[tuple[float, VehicleEvent]] = deque()
        """(arrival time [s], event) of events without a description; a text or the vehicle's metadata may
        still describe them."""
        self._line_limiter = LineRateLimiter()
        self.describe_again: Callable[[VehicleEvent, float], VehicleEvent | None] = lambda event, _: event
        """(event, waiting time [s]) → the event with its description; None: the description may still
        arrive."""

    def text(self, payload: bytes, source: object) -> None:
        """Logs a STATUSTEXT received from `source` (an endpoint)."""
        now_s = self._clock.monotonic_s()
        for severity, text in self._texts.feed(payload, now_s):
            self._log_text(severity, text, source, now_s)

    def event(self, event: VehicleEvent, late: bool = False) -> None:
        """Logs an EVENT outside a health and arming report; `late`: the event was lost and requested
        again."""
        now_s = self._clock.monotonic_s()
        key = (event.sequence, event.id)
        if key in self._seen_events:
            return
        self._seen_events.append(key)
        if event.level >= LEVEL_PROTOCOL:
            return
        if late and self._unpaired_texts and now_s - self._unpaired_texts.popleft() < MAX_LATE_PAIR_DELAY_S:
            return  # the text of this event is already logged
        paired_text = self._take_waiting(now_s)
        if paired_text is None and not event.is_described and len(self._undescribed) < MAX_UNDESCRIBED:
            self._undescribed.append((now_s, event))
            return
        if paired_text is None:
            self._unpaired_events.append(now_s)
        self._line("event", event.level, paired_text or event.text, event)

    def flight_state(self, before: FlightState, after: FlightState, cause: ModeCause | None = None) -> None:
        """Publishes events for the changes between two states; `cause` is the cause of a mode change."""
        has_earlier_state = before.heartbeat_s > float("-inf")
        if has_earlier_state and after.armed != before.armed:
            self._line("armed" if after.armed else "disarmed", NOTICE, "Armed" if after.armed else "Disarmed")
        if has_earlier_state and after.custom_mode != before.custom_mode:
            name, label = self._mode_names.registered(after.mode_name)
            text, severity = f"Mode {label}", NOTICE
            data: dict[str, object] = {"mode": name}
            if cause is not None:
                data |= {"cause": cause.source, "by": cause.who}
                if cause.is_external or cause.source == "failsafe":
                    text, severity = f"{text}: {cause.text}", WARNING
            self._feed.add("mode_changed", self._clock.unix_s(), text, severity=severity, data=data)

    def tick(self) -> None:
        """Logs texts and events whose missing chunks, pair or description did not arrive in time; called a
        few times a second."""
        now_s = self._clock.monotonic_s()
        for severity, text in self._texts.expire(now_s):
            self._log_text(severity, text, None, now_s)
        while self._waiting_texts and now_s - self._waiting_texts[0][0] > MAX_PAIR_DELAY_S:
            waiting_since_s, severity, text = self._waiting_texts.popleft()
            self._unpaired_texts.append(now_s)
            self._line("status_text", severity, text, ago_s=now_s - waiting_since_s)
        if self._undescribed:
            self._log_undescribed(now_s)
        dropped = self._line_limiter.take_dropped(now_s)
        if dropped:
            text = f"The vehicle sends too many messages: {dropped:,} of them are not shown."
            self._feed.add("warning", self._clock.unix_s(), text, severity=WARNING)

    def _log_undescribed(self, now_s: float) -> None:
        waiting: deque[tuple[float, VehicleEvent]] = deque()
        for received_s, event in self._undescribed:
            waited_s = now_s - received_s
            described = self.describe_again(event, waited_s) if waited_s > MAX_PAIR_DELAY_S else None
            if described is None:
                waiting.append((received_s, event))
            else:
                self._line("event", described.level, described.text, described, ago_s=waited_s)
        self._undescribed = waiting

    def _log_text(self, severity: int, text: str, source: object, now_s: float) -> None:
        for earlier_s, earlier_source, earlier_text in self._seen_texts:
            if earlier_text == text and earlier_source is not source and now_s - earlier_s < SAME_TEXT_S:
                return
        self._seen_texts.append((now_s, source, text))
        if not text.endswith("\t"):
            self._line("status_text", severity, text)
            return
        if self._unpaired_events and now_s - self._unpaired_events.popleft() <= MAX_PAIR_DELAY_S:
            return  # the event of this text is already logged
        if self._undescribed and now_s - self._undescribed[-1][0] <= MAX_PAIR_DELAY_S:
            received_s, event = self._undescribed.pop()
            self._line("event", event.level, text.rstrip("\t"), event, ago_s=now_s - received_s)
            return
        self._waiting_texts.append((now_s, severity, text.rstrip("\t")))

    def _take_waiting(self, now_s: float) -> str | None:
        self.tick()
        return self._waiting_texts.popleft()[2] if self._waiting_texts else None

    def _line(
        self, kind: str, severity: int, text: str, event: VehicleEvent | None = None, *, ago_s: float = 0.0
    ) -> None:
        if not self._line_limiter.allow(self._clock.monotonic_s()):
            return
        data = {"id": event.id, "sequence": event.sequence} if event is not None else {}
        self._feed.add(kind, self._clock.unix_s() - ago_s, text, severity=min(severity, 7), data=data)
