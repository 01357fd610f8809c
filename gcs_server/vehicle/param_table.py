"""All known parameters of a vehicle. No I/O."""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass

from gcs_server.mavlink import dialect as d

HASH_NAME = "_HASH_CHECK"
NO_INDEX = 65535
MAX_PARAMETERS = 5_000
"""Maximum number of parameters; a vehicle with PX4 v1.16 has 929 of the firmware's 1,821."""
CACHE_VERSION = 1
_value = struct.Struct("<4sHH16sB")
_float = struct.Struct("<f")
_name = re.compile(r"[A-Za-z0-9_.-]{1,16}")
_integers = {
    d.MAV_PARAM_TYPE_UINT8: "<B", d.MAV_PARAM_TYPE_INT8: "<b", d.MAV_PARAM_TYPE_UINT16: "<H",
    d.MAV_PARAM_TYPE_INT16: "<h", d.MAV_PARAM_TYPE_UINT32: "<I", d.MAV_PARAM_TYPE_INT32: "<i",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Param:
    """A parameter as the vehicle reports it."""

    name: str
    value: int | float
    is_integer: bool


@dataclass(frozen=True, slots=True)
class ParamReport:
    """One PARAM_VALUE."""

    param: Param
    index: int
    """Index in the vehicle's list; 65535: no index."""
    count: int
    """Length of the list."""


def read_report(payload: bytes) -> ParamReport | None:
    """Decodes a full PARAM_VALUE payload with PX4's bytewise encoding; None for types with more than 32
    bits."""
    bits, count, index, raw_name, kind = _value.unpack_from(payload)
    name = raw_name.split(b"\0", 1)[0].decode("ascii", "replace")
    if kind == d.MAV_PARAM_TYPE_REAL32:
        return ParamReport(Param(name, _float.unpack(bits)[0], False), index, count)
    number_format = _integers.get(kind)
    if number_format is None:
        return None
    return ParamReport(Param(name, struct.unpack_from(number_format, bits)[0], True), index, count)


def checksum_of(param: Param) -> int | None:
    """The vehicle's checksum from `_HASH_CHECK`; None if the value is not a number."""
    return int(param.value) & 0xFFFFFFFF if math.isfinite(param.value) else None


class ParamTable:
    """Values by name, and their indexes in the vehicle's list.

    The table has at most `MAX_PARAMETERS` names. For an entry with an invalid name, only the index is marked
    as received.
    """

    def __init__(self) -> None:
        self._values: dict[str, Param] = {}
        self._received: set[int] = set()
        self.count: int | None = None
        """Length of the vehicle's list; None if unknown."""
        self.hash: int | None = None
        """The vehicle's checksum over names and values."""
        self.omitted_count = 0
        """Number of entries with an invalid name, or beyond the limit."""

    def __len__(self) -> int:
        return len(self._values)

    def get(self, name: str) -> Param | None:
        """A parameter; None if not received."""
        return self._values.get(name)

    def get_each(self, names: Iterable[str]) -> tuple[Param | None, ...]:
        """The parameters with these names; None for each that was not received."""
        return tuple(map(self._values.get, names))

    def all(self) -> list[Param]:
        """All parameters, sorted by name."""
        return [self._values[name] for name in sorted(self._values)]

    @property
    def received_count(self) -> int:
        """Number of received indexes."""
        return len(self._received)

    @property
    def complete(self) -> bool:
        """Whether the whole list was received."""
        return self.count is not None and len(self._received) >= self.count

    def missing(self, max_count: int) -> list[int]:
        """The first missing indexes."""
        missing_indexes: list[int] = []
        for index in range(self.count or 0):
            if index not in self._received:
                missing_indexes.append(index)
                if len(missing_indexes) == max_count:
                    break
        return missing_indexes

    def put(self, report: ParamReport) -> bool:
        """Stores a value. Returns False if the length of the list has changed, because then the indexes are
        different."""
        name = report.param.name
        if name == HASH_NAME:
            self.hash = checksum_of(report.param)
            return True
        is_new = report.index not in self._received
        length_changed = self.count is not None and report.count != self.count and report.index != NO_INDEX
        if report.index != NO_INDEX:
            self.count = report.count
            if report.index < report.count:
                self._received.add(report.index)
        has_room = name in self._values or len(self._values) < MAX_PARAMETERS
        if has_room and _name.fullmatch(name):
            self._values[name] = report.param
        elif is_new and report.index < report.count:
            self.omitted_count += 1
        return not length_changed

    def dump(self) -> bytes:
        """Content for the cache."""
        values = [(p.name, p.value, p.is_integer) for p in self._values.values()]
        content = {"version": CACHE_VERSION, "hash": self.hash, "count": self.count, "values": values}
        return json.dumps(content).encode()

    @classmethod
    def load(cls, content: bytes, expected_hash: int, count: int) -> ParamTable | None:
        """The table from the cache; None if it does not match the vehicle's state or is damaged."""
        try:
            cached = json.loads(content)
            if not isinstance(cached, dict):
                return None
            if (cached["version"], cached["hash"], cached["count"]) != (CACHE_VERSION, expected_hash, count):
                return None
            table = cls()
            for name, value, is_integer in cached["values"]:
                typed_value = int(value) if is_integer else float(value)
                table._values[str(name)] = Param(str(name), typed_value, bool(is_integer))
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            return None
        if len(table) != count or not all(_name.fullmatch(name) for name in table._values):
            return None
        table.count, table.hash = count, expected_hash
        table._received = set(range(count))
        return table
