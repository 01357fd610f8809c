"""Tasks on logs, with plain values and bytes as input and output; each runs in a process of its own. The
server imports this module for `answer_from_bytes`, so what reads logs is imported only by the tasks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from gcs_server.logbook.names import ULOG, suffix_of

Fault = tuple[str, str]
"""What is wrong: `log` (the file) or a field of the request, and the text."""


def read(path: str, folder: str) -> bytes:
    """Reads a log into a folder of columns; returns the overview as JSON. Raises UnreadableLog, OSError."""
    from gcs_server.logbook import columns, overview
    from gcs_server.logbook.tlog import read_tlog
    from gcs_server.logbook.ulog import read_ulog

    reader = read_ulog if suffix_of(path) == ULOG else read_tlog
    log = reader(Path(path))
    encoded = overview.encode(log)
    columns.write(log, encoded, Path(folder))
    return encoded


def plot(folder: str, fields: list[str], from_s: float | None, to_s: float | None, points: int) -> bytes:
    """Values for a plot as JSON. Raises `columns.UnknownField`, OSError."""
    from gcs_server.logbook import columns, series

    found = series.series(columns.Columns(Path(folder)), fields, from_s, to_s, points)
    return msgspec.json.encode({"series": found})


def rerun(folder: str, from_s: float, to_s: float, change: dict[str, Any]) -> bytes:
    """Flies a part of a log again, as it was and with a change; the result as JSON.

    Raises `missions.what_if.flight.NotFlyable`, OSError.
    """
    from gcs_server.logbook import columns
    from gcs_server.logbook.flown import flown
    from missions.what_if import task

    overview = msgspec.json.decode((Path(folder) / columns.OVERVIEW).read_bytes())
    parameters = {each["name"]: each["value"] for each in overview["parameters"]}
    parameters |= {
        each["name"]: each["value"] for each in overview["parameter_changes"] if each["t_s"] <= from_s
    }
    flight = flown(columns.Columns(Path(folder)), parameters, from_s, to_s)
    return msgspec.json.encode(task.run(flight, from_s, task.change_from(change)))


def findings(folder: str) -> bytes:
    """What the log in a folder means, as JSON. Raises OSError."""
    from gcs_server.logbook import columns
    from gcs_server.logbook.findings import table

    return table.encode(columns.load(Path(folder)))


TASKS: dict[str, Callable[..., bytes]] = {"read": read, "plot": plot, "findings": findings, "rerun": rerun}


def answer_request(request: bytes) -> bytes:
    """Runs the task of a request (name and arguments as msgpack); the answer is (fault, body) as msgpack."""
    from gcs_server.logbook.columns import UnknownField
    from gcs_server.logbook.log import UnreadableLog
    from missions.what_if.flight import NotFlyable

    name, arguments = msgspec.msgpack.decode(request, type=tuple[str, dict[str, Any]])
    fault: Fault | None = None
    body = b""
    try:
        body = TASKS[name](**arguments)
    except UnreadableLog as error:
        fault = ("log", str(error))
    except UnknownField as error:
        fault = ("field", f"{str(error)[:1].upper()}{str(error)[1:]}.")
    except NotFlyable as error:
        fault = (error.field, str(error))
    except MemoryError:
        fault = ("log", "Reading it took more memory than allowed.")
    except OSError as error:
        fault = ("log", f"The server cannot read or write its files: {error.strerror or error}.")
    return msgspec.msgpack.encode((fault, body))


def answer_from_bytes(data: bytes) -> tuple[Fault | None, bytes]:
    """Reads the output of `answer_request`. Raises msgspec.DecodeError."""
    return msgspec.msgpack.decode(data, type=tuple[Fault | None, bytes])
