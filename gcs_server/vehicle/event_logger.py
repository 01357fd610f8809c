"""Writes each STATUSTEXT, EVENT and state change of a vehicle to its event feed, once."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from gcs_server.clock import Clock
from gcs_server.vehicle.events import EventFeed
from gcs_server.vehicle.mode_cause import ModeCause
from gcs_server.vehicle.modes import ModeNames
from gcs_server.vehicle.px4_events import LEVEL_PROTOCOL, VehicleEvent
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.texts import LineRateLimiter, TextJoiner

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
            name, label = self._mode_names.name_and_label(after.custom_mode, after.autopilot)
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
