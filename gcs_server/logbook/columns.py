"""Keeps the values of a log that has been read as columns in a file, so that a plot reads only what it shows.

A folder has `overview.json` (the answer to a client, complete once this file exists), `columns.json` (where
each column is) and `columns.bin`.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import msgspec
import numpy as np

from gcs_server.logbook.log import Column, Kind, Log, Message, Times, Topic, VehicleStates

OVERVIEW, INDEX, VALUES = "overview.json", "columns.json", "columns.bin"


class Place(msgspec.Struct, frozen=True):
    """Where one column is."""

    dtype: str
    offset: int
    unit: str | None = None


class TopicPlaces(msgspec.Struct, frozen=True):
    """Where the columns of a topic are."""

    samples: int
    times: Place
    fields: dict[str, Place]


class _Parameter(msgspec.Struct, frozen=True):
    name: str
    value: float | int
    t_s: float = 0.0


class _Dropout(msgspec.Struct, frozen=True):
    t_s: float
    duration_s: float


class _Overview(msgspec.Struct, frozen=True):
    """What `overview.py` writes, without the list of topics."""

    kind: Kind
    start_unix_s: float | None
    duration_s: float
    firmware: str | None
    hardware: str | None
    vehicles: list[VehicleStates]
    parameters: list[_Parameter]
    parameter_changes: list[_Parameter]
    messages: list[Message]
    dropouts: list[_Dropout]
    problems: list[str]


_overview_decoder = msgspec.json.Decoder(_Overview)
Index = dict[str, TopicPlaces]
_decoder = msgspec.json.Decoder(Index)


def write(log: Log, overview: bytes, folder: Path) -> None:
    """Writes a log's columns into a new folder, which appears complete or not at all.

    Raises:
        OSError: the disk is full, or the folder cannot be written.
    """
    part = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        index: Index = {}
        with (part / VALUES).open("wb") as file:

            def put(column: Column | Times, unit: str | None = None) -> Place:
                values = np.ascontiguousarray(column)
                place = Place(values.dtype.str, file.tell(), unit)
                values.tofile(file)
                return place

            for topic in log.topics:
                times = put(topic.times_s)
                fields = {name: put(values, topic.units.get(name)) for name, values in topic.columns.items()}
                index[topic.id] = TopicPlaces(len(topic.times_s), times, fields)
        (part / INDEX).write_bytes(msgspec.json.encode(index))
        (part / OVERVIEW).write_bytes(overview)
        shutil.rmtree(folder, ignore_errors=True)
        part.rename(folder)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


class UnknownField(ValueError):
    """A log has no such topic or field; the text says which."""


class Columns:
    """The columns in a folder. Raises OSError if the folder was removed."""

    def __init__(self, folder: Path) -> None:
        self._values = folder / VALUES
        self._index = _decoder.decode((folder / INDEX).read_bytes())

    def times(self, topic: str) -> Times:
        """The times of a topic's samples. Raises UnknownField."""
        places = self._places(topic)
        return self._read(places.times, places.samples).astype(np.float64, copy=False)

    def fields(self, topic: str) -> list[str]:
        """Names of a topic's fields. Raises UnknownField."""
        return list(self._places(topic).fields)

    def column(self, topic: str, field: str) -> tuple[Column, str | None]:
        """A field's values and unit. Raises UnknownField."""
        places = self._places(topic)
        place = places.fields.get(field)
        if place is None:
            raise UnknownField(f"{topic} has no field {field!r}")
        return self._read(place, places.samples), place.unit

    def _places(self, topic: str) -> TopicPlaces:
        places = self._index.get(topic)
        if places is None:
            raise UnknownField(f"the log has no topic {topic!r}")
        return places

    def _read(self, place: Place, samples: int) -> Column:
        return np.memmap(self._values, np.dtype(place.dtype), "r", place.offset, (samples,))


def load(folder: Path) -> Log:
    """The log in a folder: its values stay in the file until they are used. Raises OSError if the folder was
    removed."""
    overview = _overview_decoder.decode((folder / OVERVIEW).read_bytes())
    index = _decoder.decode((folder / INDEX).read_bytes())
    size = (folder / VALUES).stat().st_size
    values = np.memmap(folder / VALUES, np.uint8, "r") if size else np.empty(0, np.uint8)

    def column(place: Place, samples: int) -> Column:
        dtype = np.dtype(place.dtype)
        return values[place.offset : place.offset + samples * dtype.itemsize].view(dtype)

    topics: list[Topic] = []
    for each, places in index.items():
        name, _, instance = each.rpartition(":")
        columns = {field: column(place, places.samples) for field, place in places.fields.items()}
        units = {field: place.unit for field, place in places.fields.items() if place.unit is not None}
        times_s = column(places.times, places.samples).astype(np.float64, copy=False)
        topics.append(Topic(name, instance, times_s, columns, units))
    return Log(
        kind=overview.kind,
        start_unix_s=overview.start_unix_s,
        duration_s=overview.duration_s,
        topics=topics,
        vehicles=overview.vehicles,
        firmware=overview.firmware,
        hardware=overview.hardware,
        parameters={each.name: each.value for each in overview.parameters},
        parameter_changes=[(each.t_s, each.name, each.value) for each in overview.parameter_changes],
        messages=overview.messages,
        dropouts=[(each.t_s, each.duration_s) for each in overview.dropouts],
        problems=overview.problems,
    )
