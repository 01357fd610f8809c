"""Runs tasks on logs in processes of their own, a few at a time."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from gcs_server.errors import InvalidRequest, LogUnusable
from gcs_server.logbook import tasks
from gcs_server.operations.fork_server import ForkServer
from gcs_server.operations.process import WorkerFailed
from gcs_server.operations.turns import TurnLimits, Turns

COMMAND = (sys.executable, "-m", "gcs_server.logbook.worker")
MAX_RESULT_BYTES = 32 * 1024 * 1024
READS = TurnLimits(running=2, running_without_control=1, per_client=4, total=16)
RERUNS = TurnLimits(running=1, running_without_control=1, per_client=2, total=8)
PLOTS = TurnLimits(running=2, running_without_control=2, per_client=8, total=32)
"""Plots have turns of their own, so that they do not wait for the reading of another log."""
EXPORTS = TurnLimits(running=3, running_without_control=2, per_client=2, total=12)
"""An export takes as long as its reader does."""
REMEDIES = {
    "topic": "Take a topic of the overview.",
    "format": "Take another format, or another part of the flight.",
    "rate_hz": "Take a lower rate, or a part of the flight.",
    "field": "Take a field of the overview.",
    "from_s": "Take another part of the flight.",
    "f": "Open another flight.",
    "other": "Take another flight.",
    "align": "Bring their times together by the best fit, or by an offset.",
    "offset_s": "Take another offset, or the best fit.",
    "moved_ned_m": "Take a part in which positions are flown, or move nothing.",
    "parameters": "Change another parameter, or give it another value.",
    "flown_by": "Take a moment in one of these modes, or fly on with the logged setpoints.",
    "plan": "Name the plan that was flown, or fly on with the logged setpoints.",
    "item": "Change an item that the vehicle had still before it.",
    "step": "Change another value or step, which the vehicle had still before it.",
}
"""What to do, by the field of the request that was wrong."""


class LogWork:
    """The tasks of one server.

    Args:
        in_control: returns whether the client with a key controls a vehicle; its tasks come first.
    """

    def __init__(self, in_control: Callable[[str], bool] = lambda _: False) -> None:
        self._processes = ForkServer(COMMAND, MAX_RESULT_BYTES)
        self._reads = Turns(in_control, READS)
        self._plots = Turns(in_control, PLOTS)
        self._reruns = Turns(in_control, RERUNS)
        self._exports = Turns(in_control, EXPORTS)

    async def read(self, path: Path, folder: Path) -> bytes:
        """Reads a log into a folder of columns; returns its overview as JSON.

        Raises:
            LogUnusable: the file cannot be read; the text says why.
            ClientHasTooMany, ServerBusy: too many logs are being read or wait.
        """
        async with self._reads.turn():
            return await self._run("read", {"path": str(path), "folder": str(folder)})

    async def plot(
        self, folder: Path, fields: Sequence[str], from_s: float | None, to_s: float | None, points: int
    ) -> bytes:
        """Values of fields and expressions for a plot, as JSON.

        Raises:
            InvalidRequest: the log has no such field, or an expression is invalid.
            LogUnusable: the columns cannot be read.
            ClientHasTooMany, ServerBusy: too many plots are being read or wait.
        """
        arguments = {
            "folder": str(folder),
            "fields": list(fields),
            "from_s": from_s,
            "to_s": to_s,
            "points": points,
        }
        async with self._plots.turn():
            return await self._run("plot", arguments)

    async def spectrum(self, folder: Path, field: str, from_s: float | None, to_s: float | None) -> bytes:
        """The spectrum and spectrogram of a field or expression, as JSON. Raises as `plot`."""
        arguments = {"folder": str(folder), "field": field, "from_s": from_s, "to_s": to_s}
        async with self._plots.turn():
            return await self._run("spectrum", arguments)

    async def loops(self, folder: Path, from_s: float | None, to_s: float | None) -> bytes:
        """How the rate and attitude loops follow their setpoints (`loops.Loops`), as JSON.

        Raises:
            LogUnusable: the columns cannot be read.
            ClientHasTooMany, ServerBusy: too many plots are being read or wait.
        """
        async with self._plots.turn():
            return await self._run("loops", {"folder": str(folder), "from_s": from_s, "to_s": to_s})

    async def rerun(
        self,
        folder: Path,
        from_s: float,
        to_s: float,
        change: Mapping[str, Any],
        plan: Mapping[str, str] | None,
    ) -> bytes:
        """Flies a part of a log again in simulation (`tasks.rerun`); the result as JSON.

        Raises:
            InvalidRequest: this part cannot be flown, or the change has no effect on it.
            LogUnusable: the columns cannot be read.
            ClientHasTooMany, ServerBusy: too many parts are being flown or wait.
        """
        arguments = {
            "folder": str(folder),
            "from_s": from_s,
            "to_s": to_s,
            "change": dict(change),
            "plan": None if plan is None else dict(plan),
        }
        async with self._reruns.turn():
            return await self._run("rerun", arguments)

    async def findings(self, folder: Path) -> bytes:
        """What a log means, as JSON.

        Raises:
            LogUnusable: the columns cannot be read.
            ClientHasTooMany, ServerBusy: too many plots are being read or wait.
        """
        async with self._plots.turn():
            return await self._run("findings", {"folder": str(folder)})

    async def identify(self, folder: Path, from_s: float, to_s: float, mass_kg: float | None) -> bytes:
        """The model of the aircraft that flew in a log, as JSON. Raises as `rerun`."""
        arguments = {"folder": str(folder), "from_s": from_s, "to_s": to_s, "mass_kg": mass_kg}
        async with self._reruns.turn():
            return await self._run("identify", arguments)

    async def beside(
        self, folders: Sequence[Path], parts: Sequence[Mapping[str, Any]], align: str, offset_s: float
    ) -> bytes:
        """Two flights over each other (`two_flights.compare`), as JSON.

        Raises:
            InvalidRequest: they cannot be compared like this.
            LogUnusable: the columns cannot be read.
            ClientHasTooMany, ServerBusy: too many plots are being read or wait.
        """
        arguments = {
            "folders": [str(folder) for folder in folders],
            "parts": [dict(part) for part in parts],
            "align": align,
            "offset_s": offset_s,
        }
        async with self._plots.turn():
            return await self._run("beside", arguments)

    async def table(
        self, folder: Path, topic: str, from_row: int | None, at_s: float | None, count: int
    ) -> bytes:
        """Rows of a topic, as JSON.

        Raises:
            InvalidRequest: the log has no such topic.
            LogUnusable: the columns cannot be read.
            ClientHasTooMany, ServerBusy: too many plots are being read or wait.
        """
        arguments = {
            "folder": str(folder),
            "topic": topic,
            "from_row": from_row,
            "at_s": at_s,
            "count": count,
        }
        async with self._plots.turn():
            return await self._run("table", arguments)

    async def export(self, folder: Path, name: str, request: Mapping[str, Any]) -> AsyncGenerator[bytes]:
        """The pieces of a log's export (`exports.export.Request`). The first is empty: what it raises is
        known before anything is written. Closing it ends the process.

        Raises:
            InvalidRequest: the log has not what is asked for.
            LogUnusable: the columns cannot be read, or (later) a limit was exceeded.
            ClientHasTooMany, ServerBusy: too many exports are being written or wait.
        """
        message = msgspec.msgpack.encode(
            ("export", {"folder": str(folder), "name": name, "request": dict(request)})
        )
        async with self._exports.turn(), contextlib.aclosing(self._processes.stream(message)) as pieces:
            try:
                yield _body(tasks.answer_from_bytes(await anext(pieces)))
                async for piece in pieces:
                    yield piece
            except (WorkerFailed, msgspec.DecodeError, StopAsyncIteration) as error:
                raise _too_much() from error

    def close(self) -> None:
        """Ends the fork server."""
        self._processes.close()

    async def _run(self, task: str, arguments: dict[str, Any]) -> bytes:
        request = msgspec.msgpack.encode((task, arguments))
        try:
            answer = tasks.answer_from_bytes(await self._processes.run(request))
        except (WorkerFailed, msgspec.DecodeError, MemoryError) as error:
            raise _too_much() from error
        return _body(answer)


def _too_much() -> LogUnusable:
    return LogUnusable(
        "Reading the log took more memory or time than allowed, or failed.",
        remedy="Other logs are not affected. Log fewer topics, or shorter flights.",
    )


def _body(answer: tuple[tasks.Fault | None, bytes]) -> bytes:
    """The body of an answer without a fault. Raises InvalidRequest, LogUnusable."""
    fault, body = answer
    if fault is None:
        return body
    kind, text = fault
    if kind == "log":
        raise LogUnusable(text, remedy="Other logs are not affected.")
    raise InvalidRequest(kind, text, remedy=REMEDIES[kind])
