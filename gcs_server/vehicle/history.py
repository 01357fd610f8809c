"""Stores the last minutes of a vehicle as raw frames, which are decoded only on request.

Frames are stored as tuples of numbers and bytes, which Python's garbage collector does not track. With
objects, the history of fifty vehicles would make each full collection stall the process.
"""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Iterable, Iterator

from gcs_server.mavlink.codec import Frame, known_frame
from gcs_server.vehicle.instances import ID_MASK

HISTORY_S = 300.0
PURGE_EVERY_S = 10.0
"""Period at which old frames are dropped [s]; looking for them at each call would cost as much as storing."""

_StoredFrame = tuple[float, int, float, bytes]
"""(stored_s, key, received_s, raw); keys: `instances.py`."""


class History:
    """Stores the newest frame of each message at each call of `store`.

    Args:
        msg_ids: the messages to store.
    """

    def __init__(self, msg_ids: Iterable[int]) -> None:
        self._msg_ids = frozenset(msg_ids)
        self._stored: dict[int, deque[_StoredFrame]] = {}
        self._next_purge_s = float("-inf")

    def store(self, latest: dict[int, Frame], now_s: float) -> None:
        """Stores new frames, and every `PURGE_EVERY_S` drops frames older than `HISTORY_S`.

        One older frame of each message stays stored, because it is the newest at the start of the history.
        """
        stored = self._stored
        for key, frame in latest.items():
            frames = stored.get(key)
            if frames is None:
                if key & ID_MASK not in self._msg_ids:
                    continue
                frames = stored[key] = deque()
            elif frames[-1][3] is frame.raw:
                continue
            frames.append((now_s, key, frame.received_monotonic_s, frame.raw))
        if now_s >= self._next_purge_s:
            self._next_purge_s = now_s + PURGE_EVERY_S
            self._purge(now_s - HISTORY_S)

    def _purge(self, before_s: float) -> None:
        for frames in self._stored.values():
            while len(frames) > 1 and frames[1][0] < before_s:
                frames.popleft()

    def frames(self, keys: tuple[int, ...]) -> Iterator[tuple[float, tuple[Frame | None, ...]]]:
        """(time [s], newest frame of each key at that time) for each time with a new frame; oldest first."""
        newest: dict[int, Frame] = {}
        stored = heapq.merge(*(self._stored.get(key, ()) for key in dict.fromkeys(keys)))
        for stored_s, simultaneous in itertools.groupby(stored, key=lambda item: item[0]):
            for _, key, received_s, raw in simultaneous:
                newest[key] = known_frame(raw, received_s)
            yield stored_s, tuple(map(newest.get, keys))
