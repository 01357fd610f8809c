"""Runs tasks on plans outside the event loop: tasks on small documents in a thread, all others in processes
of their own. Documents arrive as bytes, and most results are passed on as bytes, so that the loop never
parses or writes a document.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from gcs_server.errors import InvalidRequest, Refused
from gcs_server.operations.fork_server import ForkServer
from gcs_server.operations.process import WorkerFailed
from gcs_server.operations.turns import TurnLimits, Turns
from gcs_server.plans import tasks
from gcs_server.plans.tasks import Answer, ReadDocument
from gcs_server.vehicle.services.mission_dialogue import Part
from gcs_server.vehicle.services.mission_on_vehicle import Items
from missions.documents import PlanKind
from missions.formats.mavlink_items import WireItem

T = TypeVar("T")
SMALL_BYTES = 8_192
"""Size up to which a document can be read in a thread, in a few milliseconds."""
MAX_RESULT_BYTES = 32 * 1024 * 1024
ELEVATION_SUFFIXES = (".tif", ".tiff", ".hgt")
MAX_ELEVATION_FILES = 200
COMMAND = (sys.executable, "-m", "gcs_server.plans.worker")


class PlanWork:
    """The tasks of one server.

    Args:
        elevation_folder: folder of the operator's elevation files; need not exist.
        in_control: returns whether the client with a key controls a vehicle; its tasks come first.
    """

    def __init__(self, elevation_folder: Path, in_control: Callable[[str], bool] = lambda _: False) -> None:
        self.elevation_folder = elevation_folder
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="plan work")
        self._processes = ForkServer(COMMAND, MAX_RESULT_BYTES)
        self._thread_turns = Turns(in_control, TurnLimits(running=1, running_without_control=1))
        self._process_turns = Turns(in_control, TurnLimits())

    async def run(
        self,
        task: str,
        arguments: Mapping[str, Any],
        *,
        small: bool,
        field: str = "plan",
        subject: str = "",
    ) -> Answer:
        """Runs one task; if the caller is cancelled, the task's process ends.

        Args:
            task: one of `tasks.TASKS`.
            arguments: arguments of the task.
            small: whether the task takes only milliseconds for any content, so that it can run in a thread.
            field: the field that an error names if the error concerns no single field of the document.
            subject: begin of the error's text, for a document that is not in the request.

        Raises:
            InvalidRequest: the plan or file cannot be used; the error contains the part, the reason and the
                fix.
            ClientHasTooMany: too many tasks of the calling client (`turns.CALLER`) are running or waiting.
            ServerBusy: too many tasks are waiting.
            Refused: the task takes too much memory or time.
        """
        if task in tasks.WITH_ELEVATION:
            elevation_paths = await self.elevation_paths()
            arguments = {**arguments, "elevation": elevation_paths}
            small = small and not elevation_paths
        async with (self._thread_turns if small else self._process_turns).turn():
            if small:
                loop = asyncio.get_running_loop()
                answer = await loop.run_in_executor(self._thread, tasks.run, task, arguments)
            else:
                answer = await self._in_process(task, arguments)
        fault = answer.fault
        if fault is not None:
            text = f"{subject}{fault['place']}: {fault['reason']}."
            raise InvalidRequest(fault["field"] or field, text, remedy=fault["fix"])
        return answer

    async def in_thread(self, work: Callable[[], T]) -> T:
        """Runs Python code on values of this server, such as the items on a vehicle, in the thread.

        Raises:
            ClientHasTooMany, ServerBusy: see `run`.
        """
        async with self._thread_turns.turn():
            return await asyncio.get_running_loop().run_in_executor(self._thread, work)

    async def elevation_paths(self) -> list[str]:
        """Paths of the operator's elevation files."""
        return await asyncio.to_thread(elevation_files, self.elevation_folder)

    def close(self) -> None:
        """Waits for the thread, and ends the fork server."""
        self._thread.shutdown()
        self._processes.close()

    async def _in_process(self, task: str, arguments: Mapping[str, Any]) -> Answer:
        request = msgspec.msgpack.encode({"task": task, "arguments": arguments})
        try:
            return tasks.answer_from_bytes(await self._processes.run(request))
        except (WorkerFailed, msgspec.DecodeError, MemoryError) as error:
            raise Refused(
                f"The task {task!r} took more memory or time than allowed, or failed: {error}",
                remedy="Make the plan, file or area smaller.",
            ) from error


@dataclass(frozen=True, slots=True)
class UnreadDocument:
    """A document as JSON text. It may be anything: it has not been read."""

    text: bytes
    kind: PlanKind | None = None
    """The kind that the document must have; None: any."""

    @property
    def small(self) -> bool:
        """Whether the document is read in milliseconds. The items of a pattern may have to be made."""
        return len(self.text) <= SMALL_BYTES and b'"pattern"' not in self.text

    async def read(self, work: PlanWork, name: str | None = None, *, field: str = "plan") -> ReadDocument:
        """Reads the document.

        Args:
            work: reads the document.
            name: name that an offboard mission gets; None: its own.
            field: the field of the request, for errors.

        Raises:
            InvalidRequest: the document cannot be used.
            Refused: reading it takes too much memory or time, or too many tasks are waiting.
        """
        arguments = {"plan": self.text, "name": name, "kind": self.kind}
        answer = await work.run("read", arguments, small=self.small, field=field)
        return ReadDocument.from_answer(answer)

    async def items(self, work: PlanWork, subject: str = "") -> tuple[Items, Sequence[int]]:
        """The MAVLink items of a waypoint plan, and the index in the plan's `items` of each mission item.

        Args:
            work: reads the document.
            subject: begin of an error's text, for a plan that is not in the request.

        Raises:
            InvalidRequest: the plan cannot be used, or the MAVLink mission protocol cannot represent it.
            Refused: this takes too much memory or time, or too many tasks are waiting.
        """
        answer = await work.run("items", {"plan": self.text}, small=self.small, subject=subject)
        items = await asyncio.to_thread(_items_decoder.decode, answer.body)  # may be thousands
        return items, answer.values["rows"]


_items_decoder = msgspec.msgpack.Decoder(dict[Part, tuple[WireItem, ...]])


def elevation_files(folder: Path) -> list[str]:
    """Paths of the files in a folder with the name of an elevation file, sorted by name."""
    if not folder.is_dir():
        return []
    files = (
        each for each in folder.iterdir() if each.suffix.lower() in ELEVATION_SUFFIXES and each.is_file()
    )
    return sorted(map(str, files))[:MAX_ELEVATION_FILES]
