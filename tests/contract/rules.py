"""Differences caused by the recording, not by the vehicle: rules with a bound, each tested in
`test_rules.py`.

- *ends*: if the recording kept only the first and last messages, the same number of ours is compared.
- *earlier repeats*: PX4 repeats a command to itself after 1.0, 1.5 and 2.0 s. A repeat that arrives earlier
than its number allows belongs to a command from before the dialogue, and is removed on both sides.
- *swapped*: texts and events leave PX4 in two queues, and its modules run in parallel: two messages of one
kind may swap within 0.1 s.
- *sent often*: messages sent more than eight times in a dialogue are compared by their count, within a
tenth.
- *edge*: a text or event that ours sends in the last 0.3 s may belong to the time after the recording.
- *heights*: the heights in the text and event of a return agree within 2 m (GPS noise, drift of home).
- *hash*: the recorded vehicles had parameter values that no dialogue shows; `_HASH_CHECK` changes when PX4's
does and returns to the same value when PX4's does.
- *listing*: the order of a directory's entries is that of the recording machine's disk; a later part of a
listing has as many entries as PX4's.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Callable, Hashable
from typing import Any

from tests.contract.replay_vehicle import Received

FIRST_REPEAT_S, REPEAT_S, REPEAT_JITTER_S = 1.0, 0.51, 0.05
REPEATS = 3
SWAP_WITHIN_S = 0.1
OFTEN, OFTEN_WITHIN = 8, 0.1
EDGE_S = 0.3
HEIGHT_M = 2.0
RETURN_EVENT = "vrtl_return_at"
FTP_LIST = 3
_HEIGHTS = re.compile(r"(?<=^RTL: start return at )(\d+) m \((-?\d+) m")
_AUTOPILOT_TO_ALL = 0

Key = Callable[[Received], Hashable]
Row = tuple[str, str, Any, Any]


def ends(ours: list[Received], note: str | None) -> list[Received]:
    """The first and last of our messages, as many as the recording kept of PX4's according to its note."""
    kept = re.search(r"only the first (\d+) and last (\d+) messages are kept", note or "")
    if kept is None:
        return ours
    first, last = int(kept[1]), int(kept[2])
    return [*ours[:first], *ours[first:][-last:]]


def without_earlier_repeats(received: list[Received]) -> list[Received]:
    """Messages without repeats of commands that the autopilot sent itself before the dialogue began."""
    return [h for h in received if not _is_earlier_repeat(h)]


def _is_earlier_repeat(message: Received) -> bool:
    values = message.values
    if message.name != "COMMAND_LONG" or values.get("target_component", 0) != _AUTOPILOT_TO_ALL:
        return False
    repeat = values["confirmation"]
    if not 1 <= repeat <= REPEATS:
        return False
    return message.dt_s < FIRST_REPEAT_S + (repeat - 1) * REPEAT_S - REPEAT_JITTER_S


def without_edge(ours: list[Received], theirs: list[Received], end_s: float) -> list[Received]:
    """Messages without texts and events of the last moment that the recording does not contain."""
    return [
        h
        for h in ours
        if h.name not in ("STATUSTEXT", "EVENT") or h.dt_s < end_s - EDGE_S or _also(h, theirs)
    ]


def _also(message: Received, theirs: list[Received]) -> bool:
    field = "text" if message.name == "STATUSTEXT" else "id"
    return any(h.name == message.name and h.values[field] == message.values[field] for h in theirs)


def swapped(missing: list[Received], extra: list[Received], key: Key) -> list[tuple[Received, Received]]:
    """Pairs that only swapped; they are removed from both lists."""
    pairs: list[tuple[Received, Received]] = []
    for real in list(missing):
        own = next(
            (h for h in extra if key(h) == key(real) and abs(h.dt_s - real.dt_s) <= SWAP_WITHIN_S), None
        )
        if own is not None:
            pairs.append((real, own))
            missing.remove(real)
            extra.remove(own)
    return pairs


def sent_often(
    theirs: list[Received], ours: list[Received], key: Key
) -> tuple[list[Received], list[Received], list[tuple[Hashable, int, int]]]:
    """Both sides without messages that PX4 sent more than eight times; if our number differs: key, PX4,
    ours."""
    real, own = Counter(map(key, theirs)), Counter(map(key, ours))
    often = {each for each, count in real.items() if count > OFTEN}
    wrong = [
        (each, real[each], own[each])
        for each in sorted(often, key=str)
        if abs(real[each] - own[each]) > max(1, OFTEN_WITHIN * real[each])
    ]
    return [h for h in theirs if key(h) not in often], [h for h in ours if key(h) not in often], wrong


def without_heights(text: str) -> str:
    """A text without its measured heights."""
    return _HEIGHTS.sub("… m (… m", text)


def heights_in(text: str) -> list[float]:
    """The measured heights in a text [m]."""
    return [float(each) for found in _HEIGHTS.findall(text) for each in found]


def return_heights(arguments: list[int]) -> list[float]:
    """The heights [m] in the arguments of the event of a return."""
    return [float(each) for each in struct.unpack_from("<ii", bytes(arguments))]


def listing(payload: dict[str, Any], data_hex: str) -> list[str]:
    """A directory's entries in any order; for a part of it only their number."""
    entries = bytes.fromhex(data_hex).decode("utf-8", "replace").split("\0")
    return sorted(entries) if payload["offset"] == 0 else [str(len(entries))]


class Hashes:
    """The parameter hashes of a session: PX4's and ours change at the same time."""

    def __init__(self) -> None:
        self._ours: dict[int, int] = {}

    def without_hashes(self, rows: list[Row]) -> list[Row]:
        """Rows without those of `_HASH_CHECK` that change as PX4's did."""
        return [row for row in rows if not (row[1] == "[_HASH_CHECK].param_value" and self._fits(*row[2:]))]

    def _fits(self, real: int, own: int) -> bool:
        known = self._ours.setdefault(real, own) == own
        return known and list(self._ours.values()).count(own) == 1
