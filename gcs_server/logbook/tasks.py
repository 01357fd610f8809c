"""Tasks on logs, with plain values and bytes as input and output; each runs in a process of its own. The
server imports this module for `answer_from_bytes`, so what reads logs is imported only by the tasks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from gcs_server.logbook.names import kind_of
from gcs_server.operations.fork_server import Send, Stream, extend_limits

EXPORT_CPU_S, EXPORT_TIMEOUT_S = 900, 3600
"""Limits of an export: a ULog of 100 MB needs a minute for MCAP, and all are as slow as their readers [s]."""
Fault = tuple[str, str]
"""What is wrong: `log` (the file) or a field of the request, and the text."""


def read(path: str, folder: str) -> bytes:
    """Reads a log into a folder of columns; returns the overview as JSON. Raises UnreadableLog, OSError."""
    from gcs_server.logbook import columns, overview
    from gcs_server.logbook.mcap_log import read_mcap
    from gcs_server.logbook.tlog import read_tlog
    from gcs_server.logbook.ulog import read_ulog

    readers = {"ulog": read_ulog, "tlog": read_tlog, "mcap": read_mcap}
    log = readers[kind_of(path)](Path(path))
    encoded = overview.encode(log)
    columns.write(log, encoded, Path(folder))
    return encoded


def plot(folder: str, fields: list[str], from_s: float | None, to_s: float | None, points: int) -> bytes:
    """Values for a plot as JSON. Raises `columns.UnknownField`, OSError."""
    from gcs_server.logbook import columns, series

    found = series.series(columns.Columns(Path(folder)), fields, from_s, to_s, points)
    return msgspec.json.encode({"series": found})


def spectrum(folder: str, field: str, from_s: float | None, to_s: float | None) -> bytes:
    """The spectrum and spectrogram of a value as JSON. Raises `columns.UnknownField`, OSError."""
    from gcs_server.logbook import columns, spectra

    return msgspec.json.encode(spectra.spectrum(columns.Columns(Path(folder)), field, from_s, to_s))


def loops(folder: str, from_s: float | None, to_s: float | None) -> bytes:
    """How the rate and attitude loops follow their setpoints, as JSON. Raises OSError."""
    from gcs_server.logbook import columns
    from gcs_server.logbook import loops as responses

    return msgspec.json.encode(responses.loops(columns.load(Path(folder)), from_s, to_s))


def rerun(
    folder: str, from_s: float, to_s: float, change: dict[str, Any], plan: dict[str, str] | None = None
) -> bytes:
    """Flies a part of a log again, as it was and with a change; the result as JSON.

    Args:
        folder: the folder of its columns.
        from_s, to_s: the part [s since the log's start].
        change: what is different, and `flown_by`: `setpoints` (the default) or `autopilot`.
        plan: `kind` and `text` (JSON) of the flown plan, for `autopilot`; None: not known.

    Raises `missions.what_if.flight.NotFlyable`, OSError.
    """
    from gcs_server.logbook import columns
    from gcs_server.logbook.flown import OFFBOARD, autopilot_at, flown, stream_at
    from missions.what_if import task

    overview = msgspec.json.decode((Path(folder) / columns.OVERVIEW).read_bytes())
    parameters = {each["name"]: each["value"] for each in overview["parameters"]}
    parameters |= {
        each["name"]: each["value"] for each in overview["parameter_changes"] if each["t_s"] <= from_s
    }
    log = columns.Columns(Path(folder))
    if change.get("flown_by") != "autopilot":
        flight = flown(log, parameters, from_s, to_s)
        return msgspec.json.encode(task.run(flight, from_s, task.change_from(change)))
    logged = autopilot_at(log, overview["firmware"], from_s, to_s)
    stream = stream_at(log, from_s) if logged.nav_state == OFFBOARD else None
    flight = flown(log, parameters, from_s, to_s)
    result = task.run_autopilot(flight, logged, plan, from_s, to_s - from_s, change, stream)
    return msgspec.json.encode(result)


def findings(folder: str) -> bytes:
    """What the log in a folder means, as JSON. Raises OSError."""
    from gcs_server.logbook import columns
    from gcs_server.logbook.findings import table

    return table.encode(columns.load(Path(folder)))


def identify(folder: str, from_s: float, to_s: float, mass_kg: float | None) -> bytes:
    """The model of the aircraft that flew in a log, as JSON (`missions.what_if.vehicle_model.VehicleModel`).

    Raises `missions.what_if.flight.NotFlyable`, OSError.
    """
    from gcs_server.logbook import columns
    from gcs_server.logbook.flown import flown
    from missions.what_if.flight import LEAD_S
    from missions.what_if.vehicle_model import vehicle_model

    overview = msgspec.json.decode((Path(folder) / columns.OVERVIEW).read_bytes())
    parameters = {each["name"]: each["value"] for each in overview["parameters"]}
    flight = flown(columns.Columns(Path(folder)), parameters, from_s + LEAD_S, to_s)
    return msgspec.json.encode(vehicle_model(flight, mass_kg))


def beside(folders: list[str], parts: list[dict[str, Any]], align: str, offset_s: float) -> bytes:
    """Two flights over each other as JSON: the folder of each, and what `two_flights.Part` has of it.

    Raises `two_flights.CannotCompare`, OSError.
    """
    from gcs_server.logbook import columns, two_flights

    logs = [columns.load(Path(folder)) for folder in folders]
    chosen = [msgspec.convert(part, two_flights.Part) for part in parts]
    how = msgspec.convert(align, two_flights.Align)
    return msgspec.json.encode(two_flights.compare(logs, chosen, how, offset_s))


def table(folder: str, topic: str, from_row: int | None, at_s: float | None, count: int) -> bytes:
    """Rows of a topic as JSON. Raises `exports.sink.BadExport`, OSError."""
    from gcs_server.logbook import columns
    from gcs_server.logbook.exports import rows

    return msgspec.json.encode(rows.page(columns.Columns(Path(folder)), topic, from_row, at_s, count))


def export(folder: str, name: str, request: dict[str, Any]) -> Stream:
    """Writes a log, or a part of it, for other programs.

    Args:
        folder: the folder of its columns.
        name: the log's name, for the file's title.
        request: `format`, `topics`, `fields`, `rate_hz`, `from_s`, `to_s`.

    Raises `exports.sink.BadExport`, `columns.UnknownField`, OSError.
    """
    from gcs_server.logbook.exports import export as exports

    write = exports.prepared(Path(folder), name, exports.Request(**request))

    def stream(send: Send) -> None:
        extend_limits(cpu_time_s=EXPORT_CPU_S, timeout_s=EXPORT_TIMEOUT_S)
        write(send)

    return stream


TASKS: dict[str, Callable[..., bytes | Stream]] = {
    "read": read,
    "plot": plot,
    "spectrum": spectrum,
    "loops": loops,
    "findings": findings,
    "rerun": rerun,
    "identify": identify,
    "beside": beside,
    "table": table,
    "export": export,
}


def answer_request(request: bytes) -> bytes | Stream:
    """Runs the task of a request (name and arguments as msgpack); the answer is (fault, body) as msgpack.
    That of a task whose body is a stream is the stream's first piece."""
    from gcs_server.logbook.columns import UnknownField
    from gcs_server.logbook.exports.sink import BadExport
    from gcs_server.logbook.log import UnreadableLog
    from gcs_server.logbook.two_flights import CannotCompare
    from missions.what_if.flight import NotFlyable

    name, arguments = msgspec.msgpack.decode(request, type=tuple[str, dict[str, Any]])
    fault: Fault | None = None
    body: bytes | Stream = b""
    try:
        body = TASKS[name](**arguments)
    except UnreadableLog as error:
        fault = ("log", str(error))
    except UnknownField as error:
        fault = ("field", f"{str(error)[:1].upper()}{str(error)[1:]}.")
    except (NotFlyable, BadExport, CannotCompare) as error:
        fault = (error.field, str(error))
    except MemoryError:
        fault = ("log", "Reading it took more memory than allowed.")
    except OSError as error:
        fault = ("log", f"The server cannot read or write its files: {error.strerror or error}.")
    if isinstance(body, bytes):
        return msgspec.msgpack.encode((fault, body))

    def stream(send: Send) -> None:
        send(msgspec.msgpack.encode((None, b"")))
        body(send)

    return stream


def answer_from_bytes(data: bytes) -> tuple[Fault | None, bytes]:
    """Reads the output of `answer_request`. Raises msgspec.DecodeError."""
    return msgspec.msgpack.decode(data, type=tuple[Fault | None, bytes])
