"""Rules for differences that the recording caused, not the vehicle. Each rule has a bound, which
`test_rules.py` tests.

- *first and last*: if the recording kept only the first and last messages, as many first and last messages of
the simulator are compared.
- *earlier repeats*: PX4 repeats a command to itself after 1.0, 1.5 and 2.0 s. A repeat that arrives too early
for its confirmation number repeats a command from before the dialogue. It is omitted from the
recorded and the simulated messages.
- *swapped*: two messages may change places within 0.1 s, because PX4 sends texts and events from two queues
and runs its modules in parallel.
- *frequent*: messages that PX4 sent more than eight times in a dialogue are compared by their number, within
10 %.
- *last moment*: a text or event that the simulator sends in the last 0.3 s may belong to the time after the
recording.
- *altitudes*: the altitudes in the text and event of a return agree within 2 m (GPS noise, drift of home).
- *hash*: the recorded vehicles had parameter values that no dialogue shows. The `_HASH_CHECK` of the
simulator must change or return to an earlier value whenever the `_HASH_CHECK` of PX4 does.
- *directory*: PX4 lists entries in the order of the recording machine's disk. The first part must have the
same entries; a later part must have the same number of entries.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Callable, Hashable
from typing import Any

from tests.contract.replay_vehicle import Received

FIRST_REPEAT_S, REPEAT_S, REPEAT_JITTER_S = 1.0, 0.51, 0.05
MAX_REPEATS = 3
SWAP_WITHIN_S = 0.1
FREQUENT_COUNT, FREQUENT_TOLERANCE = 8, 0.1
LAST_MOMENT_S = 0.3
ALTITUDE_TOLERANCE_M = 2.0
RETURN_EVENT = "vrtl_return_at"
FTP_LIST = 3
_ALTITUDES = re.compile(r"(?<=^RTL: start return at )(\d+) m \((-?\d+) m")
_ALL_COMPONENTS = 0

MessageKey = Callable[[Received], Hashable]
Row = tuple[str, str, Any, Any]


def first_and_last(simulated: list[Received], note: str | None) -> list[Received]:
    """The first and last messages of the simulator, as many as the note of the recording states."""
    kept = re.search(r"only the first (\d+) and last (\d+) messages are kept", note or "")
    if kept is None:
        return simulated
    first, last = int(kept[1]), int(kept[2])
    return [*simulated[:first], *simulated[first:][-last:]]


def without_earlier_repeats(received: list[Received]) -> list[Received]:
    """Messages without the repeats of commands that the autopilot sent to itself before the dialogue."""
    return [m for m in received if not _is_earlier_repeat(m)]


def _is_earlier_repeat(message: Received) -> bool:
    values = message.values
    if message.name != "COMMAND_LONG" or values.get("target_component", 0) != _ALL_COMPONENTS:
        return False
    repeat = values["confirmation"]
    if not 1 <= repeat <= MAX_REPEATS:
        return False
    return message.dt_s < FIRST_REPEAT_S + (repeat - 1) * REPEAT_S - REPEAT_JITTER_S


def without_last_moment(simulated: list[Received], recorded: list[Received], end_s: float) -> list[Received]:
    """The simulator's messages without texts and events of the last moment that are not in the recording."""
    return [
        m
        for m in simulated
        if m.name not in ("STATUSTEXT", "EVENT") or m.dt_s < end_s - LAST_MOMENT_S or _is_in(m, recorded)
    ]


def _is_in(message: Received, recorded: list[Received]) -> bool:
    field = "text" if message.name == "STATUSTEXT" else "id"
    return any(m.name == message.name and m.values[field] == message.values[field] for m in recorded)


def swapped_pairs(
    missing: list[Received], extra: list[Received], key: MessageKey
) -> list[tuple[Received, Received]]:
    """Pairs of messages that only changed places; the function removes them from both lists."""
    pairs: list[tuple[Received, Received]] = []
    for real in list(missing):
        sim = next(
            (m for m in extra if key(m) == key(real) and abs(m.dt_s - real.dt_s) <= SWAP_WITHIN_S), None
        )
        if sim is not None:
            pairs.append((real, sim))
            missing.remove(real)
            extra.remove(sim)
    return pairs


def compare_frequent(
    recorded: list[Received], simulated: list[Received], key: MessageKey
) -> tuple[list[Received], list[Received], list[tuple[Hashable, int, int]]]:
    """Compares the numbers of the messages that PX4 sent more than eight times.

    Returns:
        The other recorded and simulated messages; key and both numbers where the numbers differ.
    """
    real, sim = Counter(map(key, recorded)), Counter(map(key, simulated))
    frequent_keys = {each for each, count in real.items() if count > FREQUENT_COUNT}
    different_counts = [
        (each, real[each], sim[each])
        for each in sorted(frequent_keys, key=str)
        if abs(real[each] - sim[each]) > max(1, FREQUENT_TOLERANCE * real[each])
    ]
    return (
        [m for m in recorded if key(m) not in frequent_keys],
        [m for m in simulated if key(m) not in frequent_keys],
        different_counts,
    )


def without_altitudes(text: str) -> str:
    """A text without its measured altitudes."""
    return _ALTITUDES.sub("… m (… m", text)


def altitudes_in(text: str) -> list[float]:
    """The measured altitudes in a text: AMSL and above the destination [m]."""
    return [float(each) for found in _ALTITUDES.findall(text) for each in found]


def return_altitudes(arguments: list[int]) -> list[float]:
    """The altitudes in the arguments of a return's event: AMSL and above the destination [m]."""
    return [float(each) for each in struct.unpack_from("<ii", bytes(arguments))]


def listed_entries(payload: dict[str, Any], data_hex: str) -> list[str]:
    """The entries of a directory, sorted; for a later part of the directory only their number.

    The size of a parameter file depends on what was set before the recording.
    """
    entries = bytes.fromhex(data_hex).decode("utf-8", "replace").split("\0")
    entries = [re.sub(r"(\.bson)\t\d+", r"\1", entry) for entry in entries]
    return sorted(entries) if payload["offset"] == 0 else [str(len(entries))]


class ParameterHashes:
    """The parameter hashes of a session; those of PX4 and of the simulator must change at the same time."""

    def __init__(self) -> None:
        self._simulated_by_recorded: dict[int, int] = {}

    def without_hashes(self, rows: list[Row]) -> list[Row]:
        """Rows without those of `_HASH_CHECK` in which the simulator's hash changed when PX4's did."""
        return [row for row in rows if not (row[1] == "[_HASH_CHECK].param_value" and self._match(*row[2:]))]

    def _match(self, real: int, sim: int) -> bool:
        unchanged = self._simulated_by_recorded.setdefault(real, sim) == sim
        return unchanged and list(self._simulated_by_recorded.values()).count(sim) == 1
