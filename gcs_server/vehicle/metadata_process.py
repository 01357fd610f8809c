"""Reads a metadata file in a separate process (`python -m gcs_server.vehicle.metadata_process KIND CRC`).

The file comes from a vehicle and is untrusted. The process has limits of memory, computing time and total
time; if it exceeds a limit, it ends and the server reports this. It reads the file from standard input, and
writes the encoded document (`metadata_files.encode_document`) to standard output.
"""

from __future__ import annotations

import asyncio
import os
import resource
import subprocess
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from gcs_server.vehicle import metadata_files
from gcs_server.vehicle.metadata_limits import Document

NICENESS = 10
MEMORY_BYTES = 256_000_000
COMPUTING_S = 5
TIMEOUT_S = 20.0
"""Time limit for one document; long enough for a busy machine."""
MAX_BUFFERED_BYTES = 24_000_000
"""Maximum total size of the encoded documents of all vehicles; ten different firmwares need 8 MB."""
LIMIT_EXCEEDED = "reading it took more memory or time than allowed"


class DocumentReader:
    """Reads files one after the other, each in a separate process."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="vehicle metadata")
        self._documents: weakref.WeakSet[Document[Any, Any]] = weakref.WeakSet()

    async def read(self, kind: int, packed: bytes, crc: int) -> Document[Any, Any]:
        """Reads a file; waits for its turn and for the process.

        Raises:
            metadata_files.Damaged: see `metadata_files.unpacked`.
            ValueError: the file cannot be used; the text is the reason.
        """
        job = _Job(kind, packed, crc)
        try:
            document = await asyncio.get_running_loop().run_in_executor(self._thread, job.run)
        except asyncio.CancelledError:
            job.stop()
            raise
        if sum(each.size_bytes for each in self._documents) + document.size_bytes > MAX_BUFFERED_BYTES:
            raise ValueError("the metadata of all vehicles exceeds the server's limit")
        self._documents.add(document)
        return document


class _Job:
    def __init__(self, kind: int, packed: bytes, crc: int) -> None:
        self._kind, self._packed, self._crc = kind, packed, crc
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = False

    def run(self) -> Document[Any, Any]:
        """Runs the process, in the reader's thread; raises the errors of `DocumentReader.read`."""
        if self._stopped:
            raise ValueError(LIMIT_EXCEEDED)
        return metadata_files.decode_document(self._kind, self._output())

    def stop(self) -> None:
        """Stops the process, because its result is not needed any more."""
        self._stopped = True
        if self._process is not None:
            self._process.kill()

    def _output(self) -> bytes:
        command = [sys.executable, "-m", __name__, str(self._kind), str(self._crc)]
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as process:
            self._process = process
            if self._stopped:
                process.kill()
            try:
                output, _ = process.communicate(self._packed, timeout=TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                output = b""
        if process.returncode or not output:
            raise ValueError(LIMIT_EXCEEDED)
        return output


def main(arguments: list[str]) -> None:
    """`KIND CRC`: the file's COMP_METADATA_TYPE, and its checksum."""
    os.nice(NICENESS)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (COMPUTING_S, COMPUTING_S))
    packed = sys.stdin.buffer.read(metadata_files.MAX_PACKED_BYTES + 1)
    sys.stdout.buffer.write(metadata_files.encode_document(int(arguments[0]), packed, int(arguments[1])))


if __name__ == "__main__":
    main(sys.argv[1:])
