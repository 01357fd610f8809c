"""Samples the array topics of all vehicles that log.

A step costs one small copy per array. NumPy encodes the samples of BLOCK_MS and of all vehicles together, so
that logging takes about one per cent of the simulation's computing time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.simulation import Simulation
from vehicle_sim.topics.arrays import ArrayTopic, Period, Source, array_topics

BLOCK_MS = 400
"""Samples are collected for this time before they are written."""
GPS_BLOCK_SAMPLES = 4
"""Number of GPS samples that are collected before they are written."""


class LogWriter(Protocol):
    """The writer of one vehicle's log."""

    row: int

    def write(self, data: bytes) -> None:
        """Writes complete messages."""


@dataclass(frozen=True, slots=True)
class _SourceColumns:
    """A source of values, its columns in the buffer of a group, and the topic's fields for these columns."""

    names: tuple[str, ...]
    """Name of one array field for all columns, or the name of a field for each column."""
    source: Source
    first: int
    """Index of the first column."""
    width: int
    """Number of columns."""


class _Group:
    """Topics with the same period, which are sampled together."""

    def __init__(self, simulation: Simulation, period: Period, topics: Sequence[ArrayTopic]) -> None:
        self._simulation = simulation
        self._period = period
        self.due_us = 0
        """Time of the next sample."""
        self._sample_count = -1
        self._filled = 0
        self._topic_encodings: list[tuple[ArrayTopic, NDArray[Any], list[_SourceColumns]]] = []
        """Each topic, a record with its constant fields, and the columns of its other fields."""
        self._columns: list[_SourceColumns] = []
        width = 0
        for topic in topics:
            template = topic.layout.blank()
            lengths = {field.name: field.length for field in topic.layout.fields}
            topic_columns: list[_SourceColumns] = []
            for joined_names, source in topic.sources.items():
                if not callable(source):
                    template[joined_names] = source
                    continue
                names = tuple(joined_names.split())
                column = _SourceColumns(names, source, width, max(len(names), lengths[names[0]]))
                width += column.width
                topic_columns.append(column)
            self._columns += topic_columns
            self._topic_encodings.append((topic, template, topic_columns))
        self._capacity = max(1, BLOCK_MS // period) if isinstance(period, int) else GPS_BLOCK_SAMPLES
        self._values = np.zeros((self._capacity, simulation.count, width))
        self._times_us = np.zeros((self._capacity, 1), dtype=np.uint64)

    def sample(self, now_us: int) -> bool:
        """Takes a sample; returns whether the buffer is then full.

        A group with the period GPS_SAMPLES takes a sample only after a new GPS measurement.
        """
        period = self._period
        if isinstance(period, str):
            count = getattr(self._simulation.sensors, period)
            if count == self._sample_count:
                return False
            self._sample_count = count
        else:
            self.due_us = (now_us // (period * 1000) + 1) * period * 1000
        k = self._filled
        row, simulation = self._values[k], self._simulation
        for column in self._columns:
            values = column.source(simulation)
            if column.width == 1:
                row[:, column.first] = values
            else:
                row[:, column.first : column.first + column.width] = values
        self._times_us[k] = now_us
        self._filled = k + 1
        return self._filled == self._capacity

    def write(self, writers: Sequence[LogWriter]) -> None:
        """Writes the collected samples."""
        filled, self._filled = self._filled, 0
        if not filled:
            return
        rows = [writer.row for writer in writers]
        values = self._values[:filled]
        if len(rows) != values.shape[1]:
            values = values[:, rows]
        encoded_by_writer: list[list[bytes]] = [[] for _ in writers]
        for topic, template, columns in self._topic_encodings:
            records = np.empty((filled, len(rows)), dtype=topic.layout.dtype)
            records[:] = template
            records["timestamp"] = self._times_us[:filled]
            if topic.sampled:
                records["timestamp_sample"] = self._times_us[:filled]
            for column in columns:
                first, names = column.first, column.names
                if len(names) == 1 and column.width > 1:
                    records[names[0]] = values[:, :, first : first + column.width]
                    continue
                for k, name in enumerate(names):
                    records[name] = values[:, :, first + k]
            for m, encoded in enumerate(encoded_by_writer):
                encoded.append(records[:, m].tobytes())
        for writer, encoded in zip(writers, encoded_by_writer, strict=True):
            writer.write(b"".join(encoded))


class Recorder:
    """Samples all vehicles of one version of PX4 that use one logging profile."""

    def __init__(self, simulation: Simulation, profile: int, version: str) -> None:
        self.topics = tuple(topic for topic in array_topics(version) if topic.period(profile) is not None)
        by_period: dict[Period, list[ArrayTopic]] = {}
        for topic in self.topics:
            by_period.setdefault(topic.period(profile) or 0, []).append(topic)
        self._groups = [_Group(simulation, period, topics) for period, topics in by_period.items()]
        self._writers: list[LogWriter] = []

    def add(self, writer: LogWriter) -> None:
        """Starts logging for a vehicle."""
        self.flush()
        self._writers.append(writer)

    def remove_without_flush(self, writer: LogWriter) -> None:
        """Stops logging for a vehicle without writing; called after a write error."""
        self._writers = [each for each in self._writers if each is not writer]

    def flush(self) -> None:
        """Writes the collected samples, even if the buffer is not full."""
        for group in self._groups:
            group.write(tuple(self._writers))

    def step(self, now_us: int) -> None:
        """Called after each simulation step."""
        if not self._writers:
            return
        for group in self._groups:
            if now_us >= group.due_us and group.sample(now_us):
                group.write(tuple(self._writers))


class Recorders:
    """One recorder for each profile and version of PX4 in use."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._recorders: dict[tuple[int, str], Recorder] = {}
        self.steps: list[Callable[[int], None]] = []
        """`Recorder.step` of each recorder."""

    def for_profile(self, profile: int, version: str) -> Recorder:
        """The recorder of a profile (SDLOG_PROFILE) and version; created at the first call."""
        key = profile, version
        if key not in self._recorders:
            recorder = self._recorders[key] = Recorder(self._simulation, *key)
            self.steps.append(recorder.step)
        return self._recorders[key]
