"""Puts one vehicle's EVENT messages in order, drops repeats and finds missing events to request again. No
I/O. This is the events interface of the MAVLink guide, with 16-bit sequence numbers that wrap. The server
requests missing events with REQUEST_EVENT; if the vehicle no longer has an event, it sends
RESPONSE_EVENT_ERROR. CURRENT_EVENT_SEQUENCE contains the newest sequence number.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

Item = TypeVar("Item")

MAX_GAP = 64
"""A larger gap means that the vehicle restarted or the link was lost, so that the events are no longer
available."""
REQUEST_PERIOD_S = 0.25
MAX_REQUESTS = 12
RESET_FLAG = 1
"""MAV_EVENT_CURRENT_SEQUENCE_FLAGS_RESET."""


@dataclass(slots=True)
class EventStream(Generic[Item]):
    """Takes events as they arrive and returns them in order."""

    expected: int | None = None
    """Sequence number of the next event; None before the first event."""
    lost: int = 0
    """Number of events that were never received; a gap above `MAX_GAP` counts as one."""
    _buffered: dict[int, Item] = field(default_factory=dict[int, Item])
    _newest: int = 0
    """Newest sequence number known."""
    _requests: int = 0
    """Number of requests for the first gap."""
    _next_request_s: float = float("-inf")

    def take(self, sequence: int, item: Item) -> list[Item]:
        """Takes an event; returns the events that are now in order. Empty for a repeat, or if an earlier
        event is missing."""
        if self.expected is None:
            self.expected, self._newest = sequence, (sequence - 1) & 0xFFFF
        difference = _difference(sequence, self.expected)
        if difference > MAX_GAP:
            self._jump(sequence)
        elif difference < 0:
            if difference < -MAX_GAP:
                self._jump(sequence)  # the vehicle has restarted
            else:
                return []
        self._buffered[sequence] = item
        self._update_newest(sequence)
        return self._in_order()

    def current(self, sequence: int, flags: int) -> None:
        """Applies CURRENT_EVENT_SEQUENCE, the number of the vehicle's newest event."""
        if self.expected is None or flags & RESET_FLAG:
            self.reset()
            self.expected, self._newest = (sequence + 1) & 0xFFFF, sequence
            return
        difference = _difference(sequence, self.expected)
        if abs(difference) > MAX_GAP:
            self._jump((sequence + 1) & 0xFFFF)
        elif difference >= 0:
            self._update_newest(sequence)

    def skip_unavailable(self, sequence: int, oldest: int) -> list[Item]:
        """Applies RESPONSE_EVENT_ERROR: the vehicle does not have this event; its oldest event is `oldest`.
        Returns the events that are now in order. An event that does not exist yet is not skipped."""
        if self.expected is None or self.missing is None or sequence != self.expected:
            return []
        return self._skip_to(oldest if 0 < _difference(oldest, self.expected) <= MAX_GAP else sequence + 1)

    def is_missing(self, sequence: int) -> bool:
        """Whether this event is missing, although later events were received or are known to exist."""
        return (
            self.expected is not None
            and sequence not in self._buffered
            and _difference(sequence, self.expected) >= 0 >= _difference(sequence, self._newest)
        )

    def next_request(self, now_s: float) -> tuple[int, int] | None:
        """(first, last) sequence number to request now; None: no event is missing, the last request is
        recent, or all `MAX_REQUESTS` requests were sent."""
        missing = self.missing
        if missing is None or now_s < self._next_request_s or self._requests >= MAX_REQUESTS:
            return None
        self._requests += 1
        self._next_request_s = now_s + REQUEST_PERIOD_S
        return missing

    def give_up(self, now_s: float) -> list[Item]:
        """Skips a gap after all requests for it have failed; returns the events that are now in order."""
        missing = self.missing
        if missing is None or self._requests < MAX_REQUESTS or now_s < self._next_request_s:
            return []
        return self._skip_to(missing[1] + 1)

    def reset(self) -> None:
        """Resets, because the vehicle restarted or is another vehicle."""
        self.expected = None
        self._buffered.clear()
        self._requests = 0

    @property
    def missing(self) -> tuple[int, int] | None:
        """(first, last) sequence number of the first gap; None: no gap."""
        if self.expected is None or self.expected in self._buffered:
            return None
        if self._buffered:
            first_buffered = min(self._buffered, key=lambda s: _difference(s, self.expected or 0))
            return self.expected, (first_buffered - 1) & 0xFFFF
        return (self.expected, self._newest) if _difference(self._newest, self.expected) >= 0 else None

    def _update_newest(self, sequence: int) -> None:
        if _difference(sequence, self._newest) > 0:
            self._newest = sequence

    def _jump(self, sequence: int) -> None:
        if self.expected is not None:
            self.lost += 1
        self.reset()
        self.expected = sequence
        self._newest = (sequence - 1) & 0xFFFF

    def _skip_to(self, sequence: int) -> list[Item]:
        assert self.expected is not None
        sequence &= 0xFFFF
        self.lost += max(1, _difference(sequence, self.expected))
        for passed in [s for s in self._buffered if _difference(s, sequence) < 0]:
            del self._buffered[passed]
        self.expected = sequence
        self._update_newest((sequence - 1) & 0xFFFF)
        self._requests = 0
        return self._in_order()

    def _in_order(self) -> list[Item]:
        ready: list[Item] = []
        while self.expected is not None and self.expected in self._buffered:
            ready.append(self._buffered.pop(self.expected))
            self.expected = (self.expected + 1) & 0xFFFF
            self._requests = 0
        return ready


def _difference(sequence: int, reference: int) -> int:
    """`sequence` - `reference` with wrap-around: -32768 to 32767."""
    return ((sequence - reference + 0x8000) & 0xFFFF) - 0x8000
