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

HISTORY_S = 300.0

_Kept = tuple[float, int, float, int, int, int, bytes]
"""(kept_s, msg_id, received_s, system, component, sequence number, raw)."""


class History:
    """Of each message the frames that were newest at one of the `keep` calls.

    Args:
        msg_ids: what to keep.
    """

    def __init__(self, msg_ids: Iterable[int]) -> None:
        self._kept: dict[int, deque[_Kept]] = {msg_id: deque() for msg_id in msg_ids}
        self._last: dict[int, Frame] = {}

    def keep(self, latest: dict[int, Frame], now_s: float) -> None:
        """Keeps what is new among the newest frames, and drops what is older than `HISTORY_S`.

        One older frame of each message stays: it is what held when the remembered time began. A message
        that has fallen silent keeps its past until it comes again.
        """
        before_s, kept, last = now_s - HISTORY_S, self._kept, self._last
        for msg_id, frame in latest.items():
            if frame is last.get(msg_id) or msg_id not in kept:
                continue
            last[msg_id] = frame
            past = kept[msg_id]
            past.append(
                (
                    now_s,
                    msg_id,
                    frame.received_monotonic_s,
                    frame.system_id,
                    frame.component_id,
                    frame.seq,
                    frame.raw,
                )
            )
            while len(past) > 1 and past[1][0] < before_s:
                past.popleft()

    def frames(self, msg_ids: tuple[int, ...]) -> Iterator[tuple[float, tuple[Frame | None, ...]]]:
        """(when kept [s], the newest frame of each id then), whenever one of them was new; oldest first."""
        newest: dict[int, Frame] = {}
        kept = heapq.merge(*(self._kept[msg_id] for msg_id in dict.fromkeys(msg_ids)))
        for kept_s, together in itertools.groupby(kept, key=lambda item: item[0]):
            for _, msg_id, received_s, system_id, component_id, seq, raw in together:
                newest[msg_id] = Frame(msg_id, system_id, component_id, seq, raw, received_s)
            yield kept_s, tuple(newest.get(msg_id) for msg_id in msg_ids)
