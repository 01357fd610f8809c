"""Runs tasks on plans outside the event loop: small tasks in a thread, large or untrusted plans and files in
a process."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from gcs_server.errors import InvalidRequest, Refused
from gcs_server.operations.process import WorkerFailed, run_process
from gcs_server.plans import tasks

MAX_PROCESSES = 2
"""Maximum number of processes; a small computer has two cores, and one is needed for the vehicles."""
MAX_PENDING = 16
"""Maximum number of running and waiting tasks."""
MAX_RESULT_BYTES = 32 * 1024 * 1024
ELEVATION_SUFFIXES = (".tif", ".tiff", ".hgt")
MAX_ELEVATION_FILES = 200
COMMAND = (sys.executable, "-m", "gcs_server.plans.worker")


class PlanWork:
    """The tasks of one server."""

    def __init__(self, elevation_folder: Path) -> None:
        """
        Args:
            elevation_folder: folder of the operator's elevation files; need not exist.
        """
        self.elevation_folder = elevation_folder
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="plan work")
        self._process_slots = asyncio.Semaphore(MAX_PROCESSES)
        self._pending = 0

    async def run(
        self, task: str, arguments: Mapping[str, Any], *, small: bool, field: str = "plan"
    ) -> dict[str, Any]:
        """Runs one task; if the caller is cancelled, the task's process ends.

        Args:
            task: one of `tasks.TASKS`.
            arguments: arguments of the task.
            small: whether the task takes only milliseconds for any content, so that it can run in a thread.
            field: the field that an error names if the error concerns no single field of the document.

        Raises:
            InvalidRequest: the plan or file cannot be used; the error contains the part, the reason and the
                fix.
            Refused: the task takes too much memory or time, or too many tasks are waiting.
        """
        if self._pending >= MAX_PENDING:
            raise Refused(
                f"{MAX_PENDING} other tasks on plans are still waiting.",
                remedy="Try again in a moment.",
            )
        if task in tasks.WITH_ELEVATION:
            elevation_paths = await self.elevation_paths()
            arguments = {**arguments, "elevation": elevation_paths}
            small = small and not elevation_paths
        self._pending += 1
        try:
            if small:
                loop = asyncio.get_running_loop()
                result = await loop.run_in_executor(self._thread, tasks.run, task, arguments)
            else:
                result = await self._in_process(task, arguments)
        finally:
            self._pending -= 1
        fault = result.get("fault")
        if fault is not None:
            text = f"{fault['place']}: {fault['reason']}."
            raise InvalidRequest(fault["field"] or field, text, remedy=fault["fix"])
        return result

    async def elevation_paths(self) -> list[str]:
        """Paths of the operator's elevation files."""
        return await asyncio.to_thread(elevation_files, self.elevation_folder)

    def close(self) -> None:
        """Waits for the thread."""
        self._thread.shutdown()

    async def _in_process(self, task: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        request = json.dumps({"task": task, "arguments": arguments}).encode()
        try:
            async with self._process_slots:
                return await run_process(
                    COMMAND, lambda _text, _fraction: None, request=request, max_line_bytes=MAX_RESULT_BYTES
                )
        except WorkerFailed as error:
            raise Refused(
                f"The task {task!r} took more memory or time than allowed, or failed: {error}",
                remedy="Make the plan, file or area smaller.",
            ) from error


def elevation_files(folder: Path) -> list[str]:
    """Paths of the files in a folder with the name of an elevation file, sorted by name."""
    if not folder.is_dir():
        return []
    files = (
        each for each in folder.iterdir() if each.suffix.lower() in ELEVATION_SUFFIXES and each.is_file()
    )
    return sorted(map(str, files))[:MAX_ELEVATION_FILES]
