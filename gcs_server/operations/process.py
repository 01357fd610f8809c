"""Runs work in a separate process, with progress and cancellation; this module contains the code of both
sides.

The process writes one short JSON object per line: any number of `{"text", "progress"}`, then `{"result"}` or
`{"problem"}`. After the line of a result with `body_bytes`, that number of bytes follows, which the server
does not read itself. The process is ended with SIGTERM, and killed `END_TIMEOUT_S` later. It also ends when
its standard input closes, so that it never outlives the server.
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
from gcs_server.operations.operations import MAX_RESULT_LENGTH, ReportProgress

END_TIMEOUT_S = 2.0
MAX_LINE_LENGTH = 4 * MAX_RESULT_LENGTH
Result = tuple[dict[str, object], bytes]
"""A few values, and a body of any size."""
NICENESS = 10


class WorkerFailed(GcsError):
    """The process reported a problem, or ended without a result."""

    code = "worker_failed"


async def run_process(
    command: Sequence[str],
    report: ReportProgress,
    *,
    request: bytes = b"",
    max_body_bytes: int = 0,
) -> Result:
    """Runs a command and returns the result that it writes.

    Args:
        command: program and arguments.
        report: receives the progress of the process.
        request: input of the process, without a line feed; the process reads it with `read_request`.
        max_body_bytes: maximum size of the result's body.

    Raises:
        WorkerFailed: the process reported a problem or ended without a result.
    """
    process = await asyncio.create_subprocess_exec(
        *command, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, limit=MAX_LINE_LENGTH
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        if request:
            # ConnectionError: the process has ended; its output contains the reason
            with contextlib.suppress(ConnectionError):
                process.stdin.write(request + b"\n")
                await process.stdin.drain()
        while line := await process.stdout.readline():
            value = _parse_object(line)
            if "result" in value and isinstance(value["result"], dict):
                size = value.get("body_bytes", 0)
                if type(size) is not int or not 0 <= size <= max_body_bytes:
                    raise ValueError(f"a result of more than {max_body_bytes:,} bytes")
                return cast(dict[str, object], value["result"]), await process.stdout.readexactly(size)
            if "problem" in value:
                raise WorkerFailed(str(value["problem"])[:MAX_LINE_LENGTH])
            progress = value.get("progress")
            fraction = progress if isinstance(progress, int | float) and 0 <= progress <= 1 else None
            report(str(value.get("text", "")), fraction)
        exit_status = await process.wait()
        raise WorkerFailed(
            f"The process of this operation ended without a result (exit status {exit_status})."
        )
    except (ValueError, EOFError) as error:
        raise WorkerFailed(
            f"The process of this operation wrote output that cannot be read: {error}."
        ) from error
    finally:
        await _end(process)


async def _end(process: asyncio.subprocess.Process) -> None:
    if process.returncode is not None:
        return
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        async with asyncio.timeout(END_TIMEOUT_S):
            await process.wait()
    except TimeoutError:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def _parse_object(line: bytes) -> dict[str, Any]:
    value = json.loads(line)
    if not isinstance(value, dict):
        raise ValueError("a line is not an object")
    return cast(dict[str, Any], value)


# --- in the process -----------------------------------------------------------------------------------


def read_request() -> bytes:
    """Reads the request of `run_process`; call once, before `serve`."""
    return sys.stdin.buffer.readline().rstrip(b"\n")


def limit_process(*, memory_bytes: int, cpu_time_s: int, timeout_s: int) -> None:
    """Limits this process and lowers its priority; call before `read_request`.

    Args:
        memory_bytes: limit of address space.
        cpu_time_s: limit of CPU time.
        timeout_s: limit of the total time, which is longer on a busy computer.
    """
    os.nice(NICENESS)
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_time_s, cpu_time_s))
    signal.alarm(timeout_s)


def serve(work: Callable[[ReportProgress], Result]) -> None:
    """Runs `work` in this process and writes the output for `run_process`; an exception is reported as the
    problem."""
    threading.Thread(target=_exit_with_server, daemon=True).start()
    try:
        values, body = work(lambda text, progress: _write({"text": text, "progress": progress}))
        _write({"result": values, "body_bytes": len(body)})
        sys.stdout.buffer.write(body)
        sys.stdout.buffer.flush()
    except Exception as error:
        _write({"problem": str(error) or type(error).__name__})


def _exit_with_server() -> None:
    """Waits until the server closes the standard input, then ends the process."""
    while sys.stdin.buffer.read(4096):
        pass
    os._exit(1)


def _write(value: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(value) + "\n")
    sys.stdout.flush()
