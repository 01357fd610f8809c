"""The queue of packets that wait on a link. The most urgent packet is sent first, and every packet expires.
No I/O, no clock."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs_server.links.base import Peer

CLASSES = 5
"""Number of priority classes; class 0 is the most urgent. `mavlink/priority.py` defines the classes."""
MOST_URGENT, LEAST_URGENT = 0, CLASSES - 1
MAX_PASSED_OVER = 4
"""After this many packets of more urgent classes, a packet of a waiting class is sent next. Class 0 is always
sent first."""
LEAST_URGENT_LIMIT_BYTES = 64_000
"""Limit of the waiting packets of the least urgent class; further packets are dropped."""
CLASS_LIMIT = 512
"""Maximum number of packets in each class between the first and the last; packets of class 0 are never
dropped."""


def _ignore(_data: bytes) -> None:
    return


@dataclass(slots=True, eq=False)
class Packet:
    """A packet to send; its bytes are completed at the time of sending.

    Args:
        peer: the receiver.
        size_bytes: maximum size of the completed packet.
        finish: returns the bytes to send, with sequence number and signature. It is called again if they
            could not be sent.
        on_sent: called with the bytes once they are sent; the sequence number is then used up.
        priority: priority class of the packet.
        expires_s: time on the link's clock after which the packet is not sent.
        key: the packet replaces a waiting packet with the same peer and key; None: it replaces none.
        group: the packet removes waiting packets of the same peer and group, except more urgent ones and
            class 0.
    """

    peer: Peer
    size_bytes: int
    finish: Callable[[], bytes]
    on_sent: Callable[[bytes], None] = _ignore
    priority: int = LEAST_URGENT
    expires_s: float = math.inf
    key: Hashable = None
    group: Hashable = None


@dataclass(slots=True)
class SendCounts:
    """Counters of a link's packets by outcome; changed only with the lock held."""

    frames_sent: int = 0
    bytes_sent: int = 0
    frames_expired: int = 0
    frames_replaced: int = 0
    frames_dropped: int = 0
    bytes_dropped: int = 0
    lock: threading.Lock = field(default_factory=threading.Lock, repr=False)
    """Shared by all senders of the link, so that frames are numbered in the order in which they are sent."""


class SendQueue:
    """Waiting packets by priority class. Class 0 is always sent first, then the most urgent of the other
    classes. After `MAX_PASSED_OVER` packets of more urgent classes, a packet of a waiting class is sent next,
    so that no packet waits forever.
    """

    def __init__(self, counts: SendCounts) -> None:
        self._counts = counts
        self._waiting: list[OrderedDict[Hashable, Packet]] = [OrderedDict() for _ in range(CLASSES)]
        self._passed_over = [0] * CLASSES
        self._least_urgent_bytes = 0

    def __len__(self) -> int:
        return sum(map(len, self._waiting))

    def __bool__(self) -> bool:
        return any(self._waiting)

    def put(self, packet: Packet, now_s: float) -> bool:
        """Queues a packet; False if it was dropped because the queue is full."""
        if packet.group is not None:
            self._remove_group(packet)
        queue_key = (packet.peer.name, packet.key) if packet.key is not None else packet
        waiting = self._waiting[packet.priority]
        older = waiting.get(queue_key)
        if older is not None:
            self._counts.frames_replaced += 1
            if packet.priority == LEAST_URGENT:
                self._least_urgent_bytes += packet.size_bytes - older.size_bytes
            # the new packet takes the position of the old one, so that vehicles take turns
            waiting[queue_key] = packet
            return True
        if self._is_full(packet):
            self.purge(now_s)
            if self._is_full(packet):
                self._counts.frames_dropped += 1
                self._counts.bytes_dropped += packet.size_bytes
                return False
        waiting[queue_key] = packet
        if packet.priority == LEAST_URGENT:
            self._least_urgent_bytes += packet.size_bytes
        return True

    def take(self, now_s: float) -> Packet | None:
        """Takes the next packet to send; None if no packet waits."""
        while (chosen := self._choose()) is not None:
            _, packet = self._waiting[chosen].popitem(last=False)
            if chosen == LEAST_URGENT:
                self._least_urgent_bytes -= packet.size_bytes
            if packet.expires_s < now_s:
                self._counts.frames_expired += 1
                continue
            self._passed_over[chosen] = 0
            if chosen != MOST_URGENT:
                for other in range(chosen + 1, CLASSES):
                    self._passed_over[other] += bool(self._waiting[other])
            return packet
        return None

    def put_back(self, packet: Packet) -> None:
        """Puts a packet that could not be sent back to the front of its class."""
        queue_key = (packet.peer.name, packet.key) if packet.key is not None else packet
        waiting = self._waiting[packet.priority]
        waiting[queue_key] = packet
        waiting.move_to_end(queue_key, last=False)
        if packet.priority == LEAST_URGENT:
            self._least_urgent_bytes += packet.size_bytes

    def purge(self, now_s: float) -> None:
        """Removes expired packets."""
        for priority, waiting in enumerate(self._waiting):
            for queue_key in [key for key, packet in waiting.items() if packet.expires_s < now_s]:
                packet = waiting.pop(queue_key)
                self._counts.frames_expired += 1
                if priority == LEAST_URGENT:
                    self._least_urgent_bytes -= packet.size_bytes

    def clear(self) -> None:
        """Drops all packets."""
        for waiting in self._waiting:
            self._counts.frames_dropped += len(waiting)
            self._counts.bytes_dropped += sum(packet.size_bytes for packet in waiting.values())
            waiting.clear()
        self._least_urgent_bytes = 0

    def _choose(self) -> int | None:
        waiting = [priority for priority in range(CLASSES) if self._waiting[priority]]
        if not waiting or waiting[0] == MOST_URGENT:
            return waiting[0] if waiting else None
        overdue = (priority for priority in waiting if self._passed_over[priority] >= MAX_PASSED_OVER)
        return next(overdue, waiting[0])

    def _is_full(self, packet: Packet) -> bool:
        if packet.priority == MOST_URGENT:
            return False
        waiting = self._waiting[packet.priority]
        if packet.priority == LEAST_URGENT:
            return bool(waiting) and self._least_urgent_bytes + packet.size_bytes > LEAST_URGENT_LIMIT_BYTES
        return len(waiting) >= CLASS_LIMIT

    def _remove_group(self, packet: Packet) -> None:
        for priority in range(max(packet.priority, MOST_URGENT + 1), CLASSES):
            waiting = self._waiting[priority]
            for queue_key, other in list(waiting.items()):
                if other.group == packet.group and other.peer.name == packet.peer.name:
                    del waiting[queue_key]
                    self._counts.frames_replaced += 1
