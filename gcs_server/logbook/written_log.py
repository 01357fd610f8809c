"""Reads what `exports/mcap_file.py` has written: JSON messages, the log's facts and parameters."""

from __future__ import annotations

import json
import math
from array import array
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.exports.foxglove import LOG, PREFIX
from gcs_server.logbook.exports.mcap_file import METADATA, PARAMETERS
from gcs_server.logbook.log import (
    MAX_DURATION_S,
    MAX_MESSAGES,
    MAX_NAME,
    Column,
    Log,
    Message,
    Parameters,
    Topic,
    VehicleStates,
    clean_text,
    usable_name,
)
from gcs_server.logbook.states import heartbeat_states, ulog_states

MAX_COLUMNS = 2000
"""Values of a message."""
MAX_DEPTH = 8
_CODES = {"i": "q", "u": "Q", "b": "B", "f": "d"}
"""Type of `array` by NumPy's kind."""
_INFO = 6
"""MAV_SEVERITY_INFO."""


class JsonSamples:
    """The messages of a channel of JSON, as columns.

    Args:
        metadata: that of the channel.
        schema: name of its schema; None: it has none.
    """

    def __init__(self, metadata: Mapping[str, str], schema: str | None) -> None:
        self.id = metadata.get("id", "")[: 2 * MAX_NAME]
        self.units = _texts(metadata.get("units"))
        self.texts: list[tuple[int, str]] = []
        """Severity and text of each message of `foxglove.Log`."""
        self.schema = schema or ""
        self._types = _types(metadata.get("types"))
        self._columns: dict[str, array[Any]] = {}
        self._count = 0

    def add(self, data: bytes) -> bool:
        """Keeps a message; False: it is no JSON object."""
        try:
            values = msgspec.json.decode(data, type=dict[str, Any])
        except (msgspec.DecodeError, RecursionError):
            return False
        if self.schema == LOG:
            severity = values.get("severity")
            severity = severity if isinstance(severity, int) and 0 <= severity <= 7 else _INFO
            if len(self.texts) < 4 * MAX_MESSAGES:
                self.texts.append((severity, clean_text(str(values.get("message", "")))))
            return True
        flat: dict[str, Any] = {}
        _flatten(values, "", flat, 0)
        for name, value in flat.items():
            column = self._columns.get(name)
            if column is None:
                if len(self._columns) >= MAX_COLUMNS or not usable_name(name):
                    continue
                column = self._columns[name] = self._new(name)
            self._append(column, value)
        self._count += 1
        for name, column in self._columns.items():
            if len(column) < self._count:
                self._append(column, flat.get(name))
        return True

    def columns(self) -> dict[str, Column]:
        """The values by field."""
        columns: dict[str, Column] = {}
        for name, column in self._columns.items():
            values = np.frombuffer(column, np.dtype(column.typecode))
            with np.errstate(all="ignore"):
                columns[name] = values.astype(self._types.get(name, values.dtype), copy=False)
        return columns

    def _new(self, name: str) -> array[Any]:
        known = self._types.get(name)
        column = array("d" if known is None else _CODES[known.kind])
        for _ in range(self._count):
            self._append(column, None)
        return column

    @staticmethod
    def _append(column: array[Any], value: Any) -> None:
        try:
            column.append(value)
        except (TypeError, OverflowError):
            column.append(math.nan if column.typecode == "d" else 0)


def _flatten(value: Any, name: str, flat: dict[str, Any], depth: int) -> None:
    """Single numbers by name: `q[0]`, `esc[0].rpm`."""
    if len(flat) >= MAX_COLUMNS or depth > MAX_DEPTH:
        return
    if isinstance(value, dict):
        for key, each in value.items():  # pyright: ignore[reportUnknownVariableType]
            _flatten(each, f"{name}.{key}" if name else str(key), flat, depth + 1)  # pyright: ignore[reportUnknownArgumentType]
    elif isinstance(value, list):
        for i, each in enumerate(value):  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
            _flatten(each, f"{name}[{i}]", flat, depth + 1)
    elif value is None or isinstance(value, bool | int | float):
        flat[name] = value


def _texts(text: str | None) -> dict[str, str]:
    try:
        return msgspec.json.decode(text or "{}", type=dict[str, str])
    except msgspec.DecodeError:
        return {}


def _types(text: str | None) -> dict[str, np.dtype[Any]]:
    """The types of columns that the file says, of numbers only."""
    found: dict[str, np.dtype[Any]] = {}
    for name, code in _texts(text).items():
        if len(code) == 3 and code[0] in "<|=" and code[1] in _CODES and code[2] in "1248":
            try:
                found[name] = np.dtype(code)
            except TypeError:
                continue
    return found


class WrittenFacts:
    """The metadata of a file that this program has written."""

    def __init__(self) -> None:
        self._log: dict[str, str] | None = None
        self.parameters = Parameters()

    @property
    def is_written(self) -> bool:
        """Whether the file has them."""
        return self._log is not None

    def add(self, name: str, values: Mapping[str, str]) -> None:
        """Keeps what is known of a metadata record."""
        if name == METADATA:
            self._log = dict(values)
        elif name == PARAMETERS:
            for parameter, text in values.items():
                number = _number(text)
                if number is not None:
                    self.parameters.add(0.0, parameter, number)

    def text(self, name: str) -> str | None:
        """A text; None: there is none."""
        return clean_text((self._log or {}).get(name, "")) or None

    @property
    def start_unix_s(self) -> float | None:
        """Start of the log [s since 1970 UTC]; None: not known."""
        return _number(self.text("start_unix_s") or "")


def _number(text: str) -> float | int | None:
    try:
        number = json.loads(text) if len(text) < 40 else None
    except (ValueError, RecursionError):
        return None
    if not isinstance(number, int | float) or isinstance(number, bool):
        return None
    return number if abs(number) < 1e300 else None


def written_log(facts: WrittenFacts, channels: Sequence[tuple[JsonSamples, NDArray[np.int64]]]) -> Log:
    """The log of a file that this program has written, with its kind, topics and times."""
    start_ns = round((facts.start_unix_s or 0.0) * 1e6) * 1000
    topics: list[Topic] = []
    messages: list[Message] = []
    for samples, times_ns in channels:
        times_s = (times_ns - start_ns) / 1e9
        if samples.schema == LOG:
            pairs = zip(times_s.tolist(), samples.texts, strict=False)
            messages += [Message(t_s, severity, text) for t_s, (severity, text) in pairs]
            continue
        name, _, instance = samples.id.rpartition(":")
        usable = np.abs(times_s) <= MAX_DURATION_S
        columns = {each: values[usable] for each, values in samples.columns().items()}
        known = usable_name(name) and usable_name(instance) and columns and np.any(usable)
        if known and not samples.schema.startswith(PREFIX):
            units = {each: unit for each, unit in samples.units.items() if each in columns and len(unit) < 40}
            order = np.argsort(times_s[usable], kind="stable")
            columns = {each: values[order] for each, values in columns.items()}
            topics.append(Topic(name, instance, times_s[usable][order], columns, units))
    topics.sort(key=lambda topic: topic.id)
    duration_s = max([0.0, *(float(topic.times_s[-1]) for topic in topics)])
    is_tlog = facts.text("kind") == "tlog"
    system_id = facts.parameters.first.get("MAV_SYS_ID")
    own = "" if system_id is None else str(int(system_id))
    vehicles: list[VehicleStates] = (
        heartbeat_states(_senders(topics), duration_s) if is_tlog else [ulog_states(topics, own, duration_s)]
    )
    return Log(
        kind="tlog" if is_tlog else "ulog",
        start_unix_s=facts.start_unix_s,
        duration_s=duration_s,
        topics=topics,
        vehicles=vehicles,
        firmware=facts.text("firmware"),
        hardware=facts.text("hardware"),
        parameters=facts.parameters.first,
        messages=sorted(messages, key=lambda each: each.t_s),
    )


def _senders(topics: Sequence[Topic]) -> list[Topic]:
    """Topics whose instance is that of a telemetry log: `system.component`."""
    return [topic for topic in topics if all(part.isdecimal() for part in topic.instance.split("."))]
