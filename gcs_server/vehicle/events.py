"""The event feed of a vehicle: status texts, EVENT messages, acknowledgements and mode changes, in order."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

log = logging.getLogger(__name__)

FEED_LENGTH = 1000


@dataclass(frozen=True, slots=True)
class Event:
    """One entry of an event feed; entries are never merged or replaced."""

    index: int
    """Number of the event in its feed, from 1."""
    kind: str
    """vehicle_added, vehicle_removed, status_text, event, mode_changed, armed, disarmed, command, progress,
    readiness, link, warning, group, …"""
    vehicle: str | None
    unix_s: float
    """Time of the event [s since 1970 UTC]."""
    severity: int
    """MAV_SEVERITY: 0 emergency … 6 info, 7 debug."""
    text: str
    data: Mapping[str, object] = field(default_factory=dict[str, object])


class EventFeed:
    """A list of limited length, newest event last; subscribers are called immediately, in the event loop."""

    def __init__(self, vehicle: str | None = None, length: int = FEED_LENGTH) -> None:
        self._vehicle = vehicle
        self._events: deque[Event] = deque(maxlen=length)
        self._subscribers: list[Callable[[Event], None]] = []
        self._next_index = 1

    def add(
        self,
        kind: str,
        unix_s: float,
        text: str,
        *,
        severity: int = 6,
        data: Mapping[str, object] | None = None,
        vehicle: str | None = None,
        stored: bool = True,
    ) -> Event:
        """Appends an event and calls the subscribers. `vehicle`: the event's vehicle, if it is not
        the feed's. If `stored` is false, only the current subscribers receive the event.
        """
        event = Event(self._next_index, kind, vehicle or self._vehicle, unix_s, severity, text, data or {})
        self._next_index += 1
        if stored:
            self._events.append(event)
        for callback in tuple(self._subscribers):
            try:
                callback(event)
            except Exception:  # a failing subscriber must not affect frames or other subscribers
                log.exception("a subscriber failed at event %r", kind)
        return event

    @property
    def last_index(self) -> int:
        """Index of the newest event; 0: no event yet."""
        return self._next_index - 1

    def since(self, index: int = 0, *, unix_s: float | None = None) -> list[Event]:
        """Events after `index` and not older than `unix_s` (None: of any age); oldest first."""
        return [e for e in self._events if e.index > index and (unix_s is None or e.unix_s >= unix_s)]

    def subscribe(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Calls `callback` for each new event; returns a function that unsubscribes."""
        self._subscribers.append(callback)
        return lambda: self._subscribers.remove(callback) if callback in self._subscribers else None
