"""Work in a process of its own that reports progress and can be cancelled; both sides of it.

The process writes one JSON object a line: `{"text", "progress"}` as often as it likes, at last `{"result"}`
or `{"problem"}`. It is asked to end by SIGTERM and killed `END_WITHIN_S` later; it also ends when its
standard input does, so that it never outlives the server.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import resource
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any, cast

from gcs_server.errors import GcsError
from gcs_server.operations.operations import LARGEST_RESULT, Report

END_WITHIN_S = 2.0
LONGEST_LINE = 4 * LARGEST_RESULT
NICENESS = 10


class WorkerFailed(GcsError):
    """The process says what went wrong, or ended without a result."""

    code = "worker_failed"


async def run_process(
    command: Sequence[str], report: Report, *, request: bytes = b"", longest_line: int = LONGEST_LINE
) -> dict[str, object]:
    """Runs the command until it has written its result.

    Args:
        command: program and arguments.
        report: told what the process reports.
        request: what it works on, without a line feed; the process reads it by `read_request`.
        longest_line: of what it writes [bytes].

    Raises:
        WorkerFailed: it ended otherwise.
    """
    process = await asyncio.create_subprocess_exec(
        *command, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, limit=longest_line
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        if request:
            with contextlib.suppress(ConnectionError):  # it has ended: what it wrote says why
                process.stdin.write(request + b"\n")
                await process.stdin.drain()
        while line := await process.stdout.readline():
            said = _object(line)
            if "result" in said and isinstance(said["result"], dict):
                return cast(dict[str, object], said["result"])
            if "problem" in said:
                raise WorkerFailed(str(said["problem"])[:LONGEST_LINE])
            progress = said.get("progress")
            share = progress if isinstance(progress, int | float) and 0 <= progress <= 1 else None
            report(str(said.get("text", "")), share)
        code = await process.wait()
        raise WorkerFailed(f"The process of this operation ended without a result (exit status {code}).")
    except ValueError as error:
        raise WorkerFailed(f"The process of this operation wrote what cannot be read: {error}.") from error
    finally:
        await _end(process)


async def _end(process: asyncio.subprocess.Process) -> None:
    if process.returncode is not None:
        return
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        async with asyncio.timeout(END_WITHIN_S):
            await process.wait()
    except TimeoutError:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def _object(line: bytes) -> dict[str, Any]:
    said = json.loads(line)
    if not isinstance(said, dict):
        raise ValueError("a line is no object")
    return cast(dict[str, Any], said)


# --- in the process -----------------------------------------------------------------------------------


def read_request() -> bytes:
    """What `run_process` was given to send; called once, before `serve`."""
    return sys.stdin.buffer.readline().rstrip(b"\n")


def limit(*, memory_bytes: int, computing_s: int, within_s: int) -> None:
    """Bounds this process, and lets everything else go first; called before `read_request`.

    Args:
        memory_bytes: of address space.
        computing_s: processor time.
        within_s: wall time, on a busy machine.
    """
    os.nice(NICENESS)
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CPU, (computing_s, computing_s))
    signal.alarm(within_s)


def serve(work: Callable[[Report], dict[str, object]]) -> None:
    """Runs `work` in this process for `run_process` of another; what it raises becomes the problem."""
    threading.Thread(target=_end_with_the_server, daemon=True).start()
    try:
        _write({"result": work(lambda text, progress: _write({"text": text, "progress": progress}))})
    except Exception as error:
        _write({"problem": str(error) or type(error).__name__})


def _end_with_the_server() -> None:
    while sys.stdin.buffer.read(4096):
        pass
    os._exit(1)


def _write(said: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(said) + "\n")
    sys.stdout.flush()
