"""The last minutes of a vehicle as raw frames, decoded only on request.

Frames are stored as tuples of numbers and bytes, which Python's garbage collector does not track. With
objects, the history of fifty vehicles would make each full collection stall the process.
"""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Iterable, Iterator

from gcs_server.mavlink.codec import Frame
from gcs_server.vehicle.instances import message_of

HISTORY_S = 300.0

_Kept = tuple[float, int, float, int, int, int, bytes]
"""(kept_s, key, received_s, system, component, sequence number, raw); keys: `instances.py`."""


class History:
    """Stores the newest frame of each message at each `keep` call.

    Args:
        msg_ids: the messages to store.
    """

    def __init__(self, msg_ids: Iterable[int]) -> None:
        self._msg_ids = frozenset(msg_ids)
        self._kept: dict[int, deque[_Kept]] = {}
        self._last: dict[int, Frame] = {}

    def keep(self, latest: dict[int, Frame], now_s: float) -> None:
        """Stores new frames, and drops frames older than `HISTORY_S`.

        One older frame of each message is kept, because it was valid at the start of the stored time. A
        message that is no longer received keeps its history until it is sent again.
        """
        before_s, kept, last = now_s - HISTORY_S, self._kept, self._last
        for key, frame in latest.items():
            if frame is last.get(key) or message_of(key) not in self._msg_ids:
                continue
            last[key] = frame
            past = kept.setdefault(key, deque())
            past.append(
                (
                    now_s,
                    key,
                    frame.received_monotonic_s,
                    frame.system_id,
                    frame.component_id,
                    frame.seq,
                    frame.raw,
                )
            )
            while len(past) > 1 and past[1][0] < before_s:
                past.popleft()

    def frames(self, keys: tuple[int, ...]) -> Iterator[tuple[float, tuple[Frame | None, ...]]]:
        """(time [s], newest frame of each key at that time) for each time with a new frame; oldest first."""
        newest: dict[int, Frame] = {}
        kept = heapq.merge(*(self._kept.get(key, ()) for key in dict.fromkeys(keys)))
        for kept_s, together in itertools.groupby(kept, key=lambda item: item[0]):
            for _, key, received_s, system_id, component_id, seq, raw in together:
                newest[key] = Frame(message_of(key), system_id, component_id, seq, raw, received_s)
            yield kept_s, tuple(map(newest.get, keys))
