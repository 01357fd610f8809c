"""Runs each task in a process of its own that starts in milliseconds; this module contains the code of both
sides.

A fork server is a process that has imported what tasks need and does nothing else: it never reads a request.
For each task it forks a process, which reads the request, writes the result and ends. Nothing of a task
remains for the next one, and the limits of memory and time are those of one task. Requests and results are
bytes; the server never creates objects from a result by itself.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import resource
import select
import signal
import socket
import struct
import subprocess
import threading
from collections.abc import AsyncGenerator, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gcs_server.operations.process import NICENESS, WorkerFailed

_LENGTH = struct.Struct("!Q")
_PID = struct.Struct("!i")
_CHUNK_BYTES = 1 << 18
CLOSE_TIMEOUT_S = 2.0
STATM = Path("/proc/self/statm")
"""Has the size of a process's address space [pages] in front."""
CHECK_INTERVAL_S = 0.02
"""Between two looks at the memory of a task's process [s]."""
MAX_CPU_TIME_S = 1200
"""Limit of CPU time of a task that has more to do than others (`extend_limits`) [s]."""
Send = Callable[[bytes], None]
"""Sends a piece of a stream; blocks while the server reads nothing."""
Stream = Callable[[Send], None]
"""Sends a result in pieces, so that neither side ever has it whole."""


@dataclass(frozen=True, slots=True)
class TaskLimits:
    """Limits of one task's process."""

    memory_bytes: int
    """Limit of address space. A process that has used seven eighths of it is ended."""
    cpu_time_s: int
    """Limit of CPU time [s]."""
    timeout_s: int
    """Limit of the total time [s], which is longer on a busy computer."""


class ForkServer:
    """The server's side: starts the fork server with the first task, and again if it has ended.

    Args:
        command: program and arguments; the number of a socket is added, which the program passes to
            `serve_tasks`.
        max_result_bytes: maximum size of a result.
    """

    def __init__(self, command: Sequence[str], max_result_bytes: int) -> None:
        self._command = command
        self._max_result_bytes = max_result_bytes
        self._process: subprocess.Popen[bytes] | None = None
        self._control: socket.socket | None = None

    async def run(self, request: bytes) -> bytes:
        """Runs one task; if the caller is cancelled, the task's process is killed.

        Raises:
            WorkerFailed: the process ended without a result, for example because it exceeded a limit, or the
                result is too large.
        """
        async with self._task(request) as reader:
            result = await self._result(reader)
        if not result:
            raise WorkerFailed("its process ended without a result.")
        return result

    async def stream(self, request: bytes) -> AsyncGenerator[bytes]:
        """Runs one task whose result is a stream, and gives its pieces; if it is closed, the task's process
        is killed. A task without a stream gives one piece.

        Raises:
            WorkerFailed: the process ended before the end of its stream, for example because it exceeded a
                limit.
        """
        async with self._task(request, stream=True) as reader:
            while (size := _LENGTH.unpack(await reader.readexactly(_LENGTH.size))[0]) > 0:
                if size > self._max_result_bytes:
                    raise WorkerFailed(f"a piece is larger than {self._max_result_bytes:,} bytes.")
                yield await reader.readexactly(size)

    @contextlib.asynccontextmanager
    async def _task(self, request: bytes, *, stream: bool = False) -> AsyncGenerator[asyncio.StreamReader]:
        """The connection to a task's process, which is killed unless the block is left without an error."""
        reader, writer = await asyncio.open_unix_connection(sock=self._new_task())
        pid: int | None = None
        try:
            with contextlib.suppress(ConnectionError):  # the process has ended; there is no result
                writer.write(_LENGTH.pack(len(request)) + bytes([stream]))
                writer.write(request)
                (pid,) = _PID.unpack(await reader.readexactly(_PID.size))
            yield reader
            pid = None
        except asyncio.IncompleteReadError as error:
            if pid is None:
                raise WorkerFailed("its process could not be started.") from error
            pid = None
            raise WorkerFailed("its process ended before its result was complete.") from error
        except ConnectionError as error:
            pid = None
            raise WorkerFailed("its process has ended.") from error
        finally:
            if pid is not None:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            writer.close()

    def close(self) -> None:
        """Ends the fork server; the processes of running tasks end when their callers do."""
        process, self._process = self._process, None
        if self._control is not None:
            self._control.close()
            self._control = None
        if process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(CLOSE_TIMEOUT_S)
            process.kill()
            process.wait()

    async def _result(self, reader: asyncio.StreamReader) -> bytes:
        pieces: list[bytes] = []
        size = 0
        while piece := await reader.read(_CHUNK_BYTES):
            pieces.append(piece)
            size += len(piece)
            if size > self._max_result_bytes:
                raise WorkerFailed(f"its result is larger than {self._max_result_bytes:,} bytes.")
        return b"".join(pieces)

    def _new_task(self) -> socket.socket:
        """A connection to the process of a new task."""
        ours, theirs = socket.socketpair()
        with theirs:
            try:
                self._send(theirs)
            except OSError as error:
                ours.close()
                raise WorkerFailed(f"no process can be started ({error}).") from error
        ours.setblocking(False)
        return ours

    def _send(self, connection: socket.socket) -> None:
        if self._process is None or self._control is None or self._process.poll() is not None:
            self._start()
        assert self._control is not None
        socket.send_fds(self._control, [b"t"], [connection.fileno()])

    def _start(self) -> None:
        self.close()
        self._control, theirs = socket.socketpair()
        self._control.setblocking(False)
        with theirs:
            command = [*self._command, str(theirs.fileno())]
            # One thread, so that a fork copies a process without threads.
            environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()], env=environment
            )


# --- in the fork server -------------------------------------------------------------------------------


def serve_tasks(control_fd: int, work: Callable[[bytes], bytes | Stream], limits: TaskLimits) -> None:
    """Forks a process for each task until the server closes the control socket.

    Args:
        control_fd: number of the socket, the program's last argument.
        work: computes the result of a request, in the process of the task.
        limits: limits of each task.
    """
    os.nice(NICENESS)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # ended processes leave nothing to wait for
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C ends the server, which ends this process
    with socket.socket(fileno=control_fd) as control:
        while True:
            message, fds, _, _ = socket.recv_fds(control, 1, 1)
            if not message:
                return
            if os.fork() == 0:
                control.close()
                _run_task(socket.socket(fileno=fds[0]), work, limits)
            os.close(fds[0])


def _run_task(connection: socket.socket, work: Callable[[bytes], bytes | Stream], limits: TaskLimits) -> None:
    """Executes the task in the forked process, and ends the process."""
    try:
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_AS, (limits.memory_bytes, limits.memory_bytes))
        resource.setrlimit(resource.RLIMIT_CPU, (limits.cpu_time_s, MAX_CPU_TIME_S))
        signal.alarm(limits.timeout_s)
        connection.sendall(_PID.pack(os.getpid()))
        with connection.makefile("rb") as file:
            (length,) = _LENGTH.unpack(file.read(_LENGTH.size))
            (is_stream,) = file.read(1)
            request = file.read(length)
        threading.Thread(target=_watch, args=(connection, limits.memory_bytes), daemon=True).start()
        _send_result(connection, work(request), in_pieces=bool(is_stream))
    finally:
        os._exit(0)


def extend_limits(*, cpu_time_s: int, timeout_s: int) -> None:
    """Gives the task of this process more time, counted from now.

    Args:
        cpu_time_s: limit of CPU time, at most `MAX_CPU_TIME_S`.
        timeout_s: limit of the total time.
    """
    signal.alarm(timeout_s)
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_time_s, MAX_CPU_TIME_S))


def _send_result(connection: socket.socket, result: bytes | Stream, *, in_pieces: bool) -> None:
    def send(piece: bytes) -> None:
        connection.sendall(_LENGTH.pack(len(piece)))
        connection.sendall(piece)

    if isinstance(result, bytes):
        if not in_pieces:
            connection.sendall(result)
            return
        send(result)
    else:
        result(send)
    connection.sendall(_LENGTH.pack(0))


def _watch(connection: socket.socket, memory_bytes: int) -> None:
    """Ends the process when the server closes the connection, or shortly before its memory is used up:
    Python 3.11 never returns from an exception for whose handling it cannot create an integer."""
    with contextlib.suppress(OSError):
        while not select.select([connection], [], [], CHECK_INTERVAL_S)[0]:
            if _address_space_bytes() > memory_bytes - memory_bytes // 8:
                break
    os._exit(1)


def _address_space_bytes() -> int:
    """The address space of this process, as Linux counts it for its limit."""
    return int(STATM.read_bytes().split()[0]) * resource.getpagesize()
