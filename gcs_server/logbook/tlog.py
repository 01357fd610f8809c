"""Reads a telemetry log (tlog): the fields of each message of each sender, into the values of `log.py`."""

from __future__ import annotations

import struct
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gcs_server.logbook.log import (
    MAX_MESSAGES,
    MAX_TOPICS,
    Column,
    Log,
    Message,
    Parameters,
    Topic,
    UnreadableLog,
    clean_text,
    limit_fields,
)
from gcs_server.logbook.states import heartbeat_states
from gcs_server.logbook.units import mavlink_unit
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, FrameParser
from gcs_server.mavlink.definitions import instance_in
from gcs_server.mavlink.tables import LAYOUTS
from gcs_server.replay.records import Batch, Cursor, open_log, read_batch
from gcs_server.vehicle.identity import read_version

_NUMPY_TYPES = {
    "int8_t": "i1",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "char": "S1",
    "uint8_t_mavlink_version": "u1",
}
MAX_DAMAGED_FRACTION = 0.5


@dataclass(slots=True)
class _Buffer:
    """The payloads of one message of one sender."""

    msg_id: int
    size: int
    times_us: array[int] = field(default_factory=lambda: array("q"))
    payloads: bytearray = field(default_factory=bytearray)


class _Reader:
    def __init__(self) -> None:
        self.buffers: dict[tuple[int, int, int, int], _Buffer] = {}
        """By message, system, component and the message's own instance (-1: it has none)."""
        self.begin_us: int | None = None
        self.end_us = 0
        self.left_out = 0
        self.parameters = Parameters()
        self.messages: list[Message] = []
        self.version: int | None = None
        self.uids: dict[str, str] = {}
        """Hexadecimal uid of each system that has sent one."""
        self._text_id: tuple[int, int] | None = None

    def add(self, time_us: int, frame: Frame) -> None:
        if self.begin_us is None:
            self.begin_us = time_us
        self.end_us = max(self.end_us, time_us)
        layout = LAYOUTS.get(frame.msg_id)
        if layout is None:
            return
        size = layout.unpacker.size
        payload = frame.payload[:size].ljust(size, b"\0")
        instance = instance_in(layout, payload)
        key = (frame.msg_id, frame.system_id, frame.component_id, -1 if instance is None else instance)
        buffer = self.buffers.get(key)
        if buffer is None:
            if len(self.buffers) >= 2 * MAX_TOPICS:
                self.left_out += 1
                return
            buffer = self.buffers[key] = _Buffer(frame.msg_id, size)
        buffer.times_us.append(time_us)
        buffer.payloads += payload
        t_s = (time_us - self.begin_us) / 1e6
        if frame.msg_id == d.MAVLINK_MSG_ID_STATUSTEXT:
            self._add_text(t_s, frame.system_id, payload)
        elif frame.msg_id == d.MAVLINK_MSG_ID_PARAM_VALUE:
            self._add_parameter(t_s, payload)
        elif frame.msg_id == d.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            values = dict(zip(layout.fields, layout.unpacker.unpack(payload), strict=False))
            self.version = self.version or int(values["flight_sw_version"]) or None
            if (version := read_version(payload)).unique and version.uid is not None:
                self.uids[str(frame.system_id)] = version.uid

    def _add_text(self, t_s: float, system_id: int, payload: bytes) -> None:
        severity, text = payload[0], payload[1:51]
        number, part = int.from_bytes(payload[51:53], "little"), payload[53]
        words = text.split(b"\0", 1)[0].decode("utf-8", "replace")
        if number and part and self._text_id == (system_id, number) and self.messages:
            last = self.messages[-1]
            self.messages[-1] = Message(last.t_s, last.severity, clean_text(last.text + words))
        elif cleaned := clean_text(words):
            if len(self.messages) >= 4 * MAX_MESSAGES:
                return
            self.messages.append(Message(t_s, min(7, severity), cleaned))
        self._text_id = (system_id, number) if number else None

    def _add_parameter(self, t_s: float, payload: bytes) -> None:
        """PX4 sends a whole number as the bytes of a float."""
        name = payload[8:24].split(b"\0", 1)[0].decode("ascii", "replace")
        code = {1: "B", 2: "b", 3: "H", 4: "h", 5: "I", 6: "i"}.get(payload[24], "f")
        if name != "_HASH_CHECK":  # a checksum of the list
            self.parameters.add(t_s, name, struct.unpack_from(f"<{code}", payload)[0])


def read_tlog(path: Path) -> Log:
    """Reads a log.

    Raises:
        UnreadableLog: the file has no MAVLink messages of this dialect.
        OSError: the file cannot be read.
    """
    reader, parser = _Reader(), FrameParser()
    skipped = records = 0
    batch = Batch([], Cursor(), at_end=False, bytes_skipped=0)
    with open_log(path) as file:
        while not batch.at_end:
            batch = read_batch(file, batch.after)
            skipped += batch.bytes_skipped
            records += len(batch.records)
            for record in batch.records:
                for frame in parser.feed(record.raw, 0.0):
                    reader.add(record.time_us, frame)
    size = batch.after.offset
    if not size:
        raise UnreadableLog("The file is empty.")
    if not records or skipped > MAX_DAMAGED_FRACTION * size:
        raise UnreadableLog("This is not a telemetry log (.tlog): most of it is no MAVLink.")
    if not reader.buffers or reader.begin_us is None:
        raise UnreadableLog("No message of the telemetry log is known here.")
    return _log(reader, parser, skipped)


def _log(reader: _Reader, parser: FrameParser, skipped: int) -> Log:
    assert reader.begin_us is not None
    problems: list[str] = []
    if skipped or parser.crc_errors or parser.bytes_skipped:
        problems.append(
            f"{skipped + parser.bytes_skipped:,} bytes of the log are damaged and left out "
            f"({parser.crc_errors:,} messages have a wrong checksum)."
        )
    if parser.frames_unknown:
        problems.append(f"{parser.frames_unknown:,} messages are of kinds that are not known here.")
    topics = [_topic(key, buffer, reader.begin_us) for key, buffer in reader.buffers.items()]
    topics = [topic for topic in topics if topic.columns]
    topics.sort(key=lambda topic: (topic.name, [int(part) for part in topic.instance.split(".")]))
    if reader.left_out:
        problems.append(f"{reader.left_out:,} messages are of too many kinds and senders, and are left out.")
    topics = limit_fields(topics, problems)
    duration_s = (reader.end_us - reader.begin_us) / 1e6
    vehicles = heartbeat_states(topics, duration_s)
    for vehicle in vehicles:
        vehicle.uid = reader.uids.get(vehicle.id)
    if len(vehicles) > 1 and reader.parameters.first:
        problems.append("The log has several vehicles; its parameters are those of all of them together.")
    version = reader.version
    firmware = None if version is None else "v" + ".".join(str(version >> n & 255) for n in (24, 16, 8))
    return Log(
        kind="tlog",
        start_unix_s=reader.begin_us / 1e6,
        duration_s=duration_s,
        topics=topics,
        vehicles=vehicles,
        firmware=firmware,
        parameters=reader.parameters.first,
        parameter_changes=reader.parameters.changes,
        messages=reader.messages,
        problems=problems,
    )


def _topic(key: tuple[int, int, int, int], buffer: _Buffer, begin_us: int) -> Topic:
    msg_id, system_id, component_id, instance = key
    cls: Any = LAYOUTS[msg_id].message_class
    types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
    row = np.dtype(
        [
            (name, _NUMPY_TYPES[types[name]], (lengths[name],) if lengths[name] else ())
            for name in cls.ordered_fieldnames
        ]
    )
    rows = np.frombuffer(buffer.payloads, row)
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    for name in cls.fieldnames:
        if types[name] == "char":
            continue  # texts are not plotted
        values = rows[name]
        unit = cls.fieldunits_by_name.get(name)
        length = lengths[name]
        named = {f"{name}[{i}]": values[:, i] for i in range(length)} if length else {name: values}
        columns |= named
        if unit:
            units.update(dict.fromkeys(named, mavlink_unit(unit)))

    times_s = (np.frombuffer(buffer.times_us, np.int64) - begin_us) / 1e6
    sender = f"{system_id}.{component_id}" + (f".{instance}" if instance >= 0 else "")
    return Topic(cls.msgname, sender, times_s, columns, units)
