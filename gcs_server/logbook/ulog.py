"""Reads a ULog (docs.px4.io, "ULog File Format") with pyulog, into the values of `log.py`."""

from __future__ import annotations

import contextlib
import os
import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from pyulog import ULog
from pyulog.exceptions import ULogException, ULogIncompatibleFlagException

from gcs_server.logbook.log import (
    MAX_DURATION_S,
    MAX_MESSAGES,
    MAX_SPANS,
    Log,
    Message,
    Parameters,
    Topic,
    UnreadableLog,
    clean_text,
    limit_fields,
    usable_name,
)
from gcs_server.logbook.states import ulog_states
from gcs_server.logbook.units import ulog_unit

MAGIC = ULog.HEADER_BYTES
_GPS_TOPICS = ("vehicle_gps_position", "sensor_gps")
_UTC_US = (1e15, 1e16)
"""Range of plausible times of a GPS receiver [us since 1970], 2001 to 2286."""
_DAMAGE = (
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    OverflowError,
    RecursionError,
    UnicodeError,
    struct.error,
)
"""What pyulog raises besides its own errors on a damaged file."""


class _DefinitionsFile:
    """The file while pyulog reads where the log defines its topics.

    To step over a damaged message, pyulog goes back there by the message's size, also if the file had fewer
    bytes: before the start, or again and again to one place. Here it goes back by what it has read.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._missing = 0
        self.tell = file.tell

    def read(self, size: int) -> bytes:
        data = self._file.read(size)
        self._missing = size - len(data)
        return data

    def seek(self, target: int, whence: int = 0) -> int:
        return self._file.seek(target + self._missing if whence == 1 else target, whence)


class _Reader(ULog):
    def _read_file_definitions(self) -> None:
        file = self._file_handle
        self._file_handle = _DefinitionsFile(file)
        try:
            super()._read_file_definitions()
        finally:
            self._file_handle = file


def read_ulog(path: Path) -> Log:
    """Reads a log.

    Raises:
        UnreadableLog: the file is not a ULog, or has no data.
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise UnreadableLog("This is not a ULog: its first bytes are different.")
        file.seek(0)
        try:
            # pyulog prints what is wrong, once for each of 65,536 ids at most.
            with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stdout(nowhere):
                ulog = _Reader(file)
        except _DAMAGE as error:
            raise UnreadableLog(
                f"The ULog is damaged where it defines its topics ({_reason(error)})."
            ) from error
        except (ULogException, ULogIncompatibleFlagException) as error:
            raise UnreadableLog(f"pyulog cannot read the log: {clean_text(str(error))}.") from error
    return _log(ulog)


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {clean_text(str(error))}"


def _log(ulog: ULog) -> Log:
    start_us = ulog.start_timestamp
    problems: list[str] = []
    topics: list[Topic] = []
    damaged = 0
    for data in ulog.data_list:
        if not usable_name(data.name):
            continue
        topic, dropped = _topic(data, start_us)
        damaged += dropped
        if topic is not None:
            topics.append(topic)
    if ulog.file_corruption:
        problems.append("Parts of the log are damaged and left out.")
    if damaged:
        problems.append(f"{damaged:,} samples have no usable time and are left out.")
    topics = limit_fields(_distinct(topics), problems)
    if not topics:
        raise UnreadableLog("The ULog has no data: it ends before the first sample of a topic.")
    parameters = _parameters(ulog, start_us)
    info = ulog.msg_info_dict
    system_id = parameters.first.get("MAV_SYS_ID")
    duration_s = max(0.0, *(float(topic.times_s[-1]) for topic in topics))
    vehicle = ulog_states(topics, "" if system_id is None else str(int(system_id)), duration_s)
    vehicle.uid = _text(info.get("sys_uuid"))
    return Log(
        kind="ulog",
        start_unix_s=_start_unix_s(topics),
        duration_s=duration_s,
        topics=topics,
        vehicles=[vehicle],
        firmware=_firmware(ulog),
        hardware=_text(info.get("ver_hw")),
        parameters=parameters.first,
        parameter_changes=parameters.changes,
        messages=_messages(ulog, start_us),
        dropouts=[
            (_since(start_us, each.timestamp), each.duration / 1e3) for each in ulog.dropouts[:MAX_SPANS]
        ],
        problems=problems,
        start_boot_s=start_us / 1e6,
    )


def _topic(data: Any, start_us: int) -> tuple[Topic | None, int]:
    """A topic, and how many of its samples have no usable time; None: it has no samples with a time."""
    stamps = data.data.get("timestamp")
    if stamps is None:
        return None, 0
    stamps = np.asarray(stamps).astype(np.float64)
    times_s = (stamps - float(start_us)) / 1e6
    known = stamps > 0  # PX4 logs one sample without a time of a topic that was never published
    usable = known & (times_s <= MAX_DURATION_S)
    dropped = int(np.count_nonzero(known & ~usable))
    columns = {n: values for n, values in data.data.items() if usable_name(n) and n != "timestamp"}
    if not np.all(usable):
        times_s = times_s[usable]
        columns = {name: values[usable] for name, values in columns.items()}
    if not len(times_s) or not columns:
        return None, dropped
    if np.any(np.diff(times_s) < 0):
        order = np.argsort(times_s, kind="stable")
        times_s = times_s[order]
        columns = {name: values[order] for name, values in columns.items()}
    units = {name: unit for name in columns if (unit := ulog_unit(data.name, name)) is not None}
    return Topic(data.name, str(data.multi_id), times_s, columns, units), dropped


def _distinct(topics: list[Topic]) -> list[Topic]:
    """Of topics with the same id, which only a damaged log has, the one with the most samples."""
    best: dict[str, Topic] = {}
    for topic in topics:
        known = best.get(topic.id)
        if known is None or len(known.times_s) < len(topic.times_s):
            best[topic.id] = topic
    return list(best.values())


def _start_unix_s(topics: list[Topic]) -> float | None:
    """Start of the log by the GPS receiver's time."""
    for topic in topics:
        utc_us = topic.columns.get("time_utc_usec")
        if topic.name not in _GPS_TOPICS or utc_us is None:
            continue
        utc_us = np.asarray(utc_us).astype(np.float64)
        known = (utc_us > _UTC_US[0]) & (utc_us < _UTC_US[1])
        if np.any(known):
            return float(np.median(utc_us[known] / 1e6 - topic.times_s[known]))
    return None


def _parameters(ulog: ULog, start_us: int) -> Parameters:
    parameters = Parameters()
    for name, value in ulog.initial_parameters.items():
        if isinstance(value, int | float):
            parameters.add(0.0, name, value)
    for time_us, name, value in ulog.changed_parameters:
        if isinstance(value, int | float):
            parameters.add(_since(start_us, time_us), name, value)
    return parameters


def _messages(ulog: ULog, start_us: int) -> list[Message]:
    logged = [*ulog.logged_messages, *(m for each in ulog.logged_messages_tagged.values() for m in each)]
    messages = [
        Message(_since(start_us, each.timestamp), min(7, max(0, each.log_level - ord("0"))), text)
        for each in logged[: 4 * MAX_MESSAGES]
        if (text := clean_text(each.message)) and each.timestamp / 1e6 <= start_us / 1e6 + MAX_DURATION_S
    ]
    return sorted(messages, key=lambda each: each.t_s)


def _firmware(ulog: ULog) -> str | None:
    name = _text(ulog.msg_info_dict.get("sys_name"))
    release, commit = ulog.msg_info_dict.get("ver_sw_release"), _text(ulog.msg_info_dict.get("ver_sw"))
    version = None
    if isinstance(release, int):
        version = f"v{release >> 24 & 255}.{release >> 16 & 255}.{release >> 8 & 255}"
        if release & 255 < 255:
            version += f" ({(commit or 'development')[:10]})"
    parts = [part for part in (name, version) if part]
    return " ".join(parts) or None


def _text(value: object) -> str | None:
    return clean_text(value) or None if isinstance(value, str) else None


def _since(start_us: int, time_us: int) -> float:
    return (time_us - start_us) / 1e6
