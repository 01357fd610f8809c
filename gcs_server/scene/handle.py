"""One run of the process of the 3D view (`worker.py`): starts it, writes to it, reads from it, ends it.

Only `start`, `wait` and `end` wait for the process, without blocking the event loop.
"""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from gcs_server.scene.messages import SceneError, Started, ViserAddress
from gcs_server.streamer.process.message_pipe import MessagePipe, PipeFull

START_TIMEOUT_S = 60.0
END_TIMEOUT_S = 3.0
MAX_WAITING_BYTES = 8_000_000
"""Maximum number of bytes that the process has not read; with more bytes it counts as failed."""
REMEDY = "Flying is not affected; try again in a few seconds."


class SceneWorker:
    """One run of the process. Belongs to the running event loop.

    Args:
        on_message: called with each message of the process after its start.
    """

    def __init__(self, on_message: Callable[[object], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._on_message = on_message
        server_socket, self._worker_socket = socket.socketpair()
        self._pipe = MessagePipe(server_socket, MAX_WAITING_BYTES)
        self._process: subprocess.Popen[bytes] | None = None
        self._address: asyncio.Future[ViserAddress] = self._loop.create_future()
        self._ended: asyncio.Future[None] = self._loop.create_future()
        self._closed = False
        self._has_writer = False

    @property
    def pid(self) -> int | None:
        """Process id; None while there is no process."""
        return None if self._process is None else self._process.pid

    async def start(self) -> ViserAddress:
        """Starts the process; returns the address of viser. Raises SceneError."""
        try:
            self._process = await asyncio.to_thread(_start, self._worker_socket)
        except OSError as error:
            raise SceneError(f"The 3D view could not be started: {error}.", remedy=REMEDY) from error
        finally:
            self._worker_socket.close()  # so that the end of the process closes the socket pair
        self._loop.add_reader(self._pipe.fileno(), self._read)
        futures = (self._address, self._ended)
        await asyncio.wait(futures, timeout=START_TIMEOUT_S, return_when=asyncio.FIRST_COMPLETED)
        if self._ended.done():
            self._ended.result()
        if not self._address.done():
            raise SceneError("The process of the 3D view did not start.", remedy=REMEDY)
        return self._address.result()

    async def wait(self) -> None:
        """Waits for the end of the process. Raises SceneError."""
        await asyncio.shield(self._ended)

    def post(self, message: object) -> None:
        """Sends without waiting; a process that does not read counts as failed."""
        if self._closed:
            return
        try:
            self._pipe.send(message)
        except (PipeFull, EOFError):
            self._fail("The process of the 3D view reads nothing.")
            return
        if self._pipe.has_unsent_data and not self._has_writer:
            self._has_writer = True
            self._loop.add_writer(self._pipe.fileno(), self._flush)

    async def end(self) -> None:
        """Closes the socket, so that the process ends by itself; kills a process that does not."""
        if not self._closed:
            self._closed = True
            self._loop.remove_reader(self._pipe.fileno())
            self._loop.remove_writer(self._pipe.fileno())
            self._pipe.close()
        if not self._ended.cancel() and not self._ended.cancelled():
            self._ended.exception()  # retrieved, so that asyncio does not log it again
        if self._process is not None:
            await asyncio.to_thread(_wait_or_kill, self._process)
        if self._address.done():  # a killed process has not removed its folder
            folder = Path(self._address.result().socket_path).parent
            await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)

    def _read(self) -> None:
        try:
            messages = self._pipe.receive()
        except EOFError:
            self._fail("The process of the 3D view has ended.")
            return
        for message in messages:
            if isinstance(message, Started):
                self._address.set_result(message.address)
            else:
                self._on_message(message)

    def _flush(self) -> None:
        with contextlib.suppress(EOFError):  # `_read` reports the end of the process
            self._pipe.flush()
            if self._pipe.has_unsent_data:
                return
        self._has_writer = False
        self._loop.remove_writer(self._pipe.fileno())

    def _fail(self, text: str) -> None:
        self._loop.remove_reader(self._pipe.fileno())
        if not self._ended.done():
            self._ended.set_exception(SceneError(text, remedy=REMEDY))


def _start(worker_socket: socket.socket) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "gcs_server.scene.worker", str(worker_socket.fileno())],
        stdin=subprocess.DEVNULL,
        pass_fds=[worker_socket.fileno()],
        start_new_session=True,  # so that Ctrl-C ends only the server
    )


def _wait_or_kill(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(END_TIMEOUT_S)
        return
    process.kill()
    process.wait()
