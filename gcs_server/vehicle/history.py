"""The last minutes of a vehicle, kept as the raw frames they came in: nothing is decoded until asked for.

What is kept are plain tuples of numbers and bytes, which Python's garbage collector stops to look at. As
objects, fifty vehicles' minutes would make each full collection halt the whole process, and with it the
offboard stream, the longer the more is kept.
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
    """Keeps, for each message, the frame that was newest at each `keep` call.

    Args:
        msg_ids: what to keep.
    """

    def __init__(self, msg_ids: Iterable[int]) -> None:
        self._msg_ids = frozenset(msg_ids)
        self._kept: dict[int, deque[_Kept]] = {}
        self._last: dict[int, Frame] = {}

    def keep(self, latest: dict[int, Frame], now_s: float) -> None:
        """Keeps what is new among the newest frames, and drops what is older than `HISTORY_S`.

        One older frame of each message stays: it is what held when the remembered time began. A message
        that has fallen silent keeps its past until it comes again.
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
        """(when kept [s], the newest frame of each key then), whenever one of them was new; oldest first."""
        newest: dict[int, Frame] = {}
        kept = heapq.merge(*(self._kept.get(key, ()) for key in dict.fromkeys(keys)))
        for kept_s, together in itertools.groupby(kept, key=lambda item: item[0]):
            for _, key, received_s, system_id, component_id, seq, raw in together:
                newest[key] = Frame(message_of(key), system_id, component_id, seq, raw, received_s)
            yield kept_s, tuple(map(newest.get, keys))
