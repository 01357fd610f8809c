"""Creates an index in a separate process (`python -m gcs_server.replay.index_process FILE`).

Reading a long recording takes seconds, which must not stall the server. The process has limits of memory and
computing time, so that no recording can exhaust the server. Its output is one line of JSON, then the arrays
as bytes, because parsing millions of numbers from text would stall all threads of the server.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from array import array
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from gcs_server.replay.index import Checkpoint, Index, UnreadableRecording, explain, make_index
from gcs_server.replay.records import Cursor, open_log

NICENESS = 10
MEMORY_BYTES = 1_000_000_000
COMPUTING_S = 900
"""Processor time [s], enough for a recording of about ten gigabytes."""

_limit_exceeded = "Reading the recording took more memory or time than allowed."


class IndexProcess:
    """Creates an index in a separate process. Call `run` in a worker thread, `stop` in any thread."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = False

    def run(self) -> Index:
        """Runs the process and returns the index.

        Raises:
            UnreadableRecording: the file cannot be read; the text contains the reason.
        """
        command = [sys.executable, "-m", "gcs_server.replay.index_process", str(self.path)]
        with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as process:
            self._process = process
            if self._stopped:
                process.kill()
            output, _ = process.communicate()
        if self._stopped:
            raise UnreadableRecording("Reading the recording was interrupted.")
        if process.returncode or not output:
            raise UnreadableRecording(_limit_exceeded)
        return from_bytes(output)

    def stop(self) -> None:
        """Stops the process, because its result is no longer needed."""
        self._stopped = True
        if self._process is not None:
            self._process.kill()


def to_bytes(index: Index) -> bytes:
    """An index as one line of JSON, then its arrays."""
    arrays = [index.changes, index.texts, *(c.newest for c in index.checkpoints)]
    header = {
        "begin_us": index.begin_us,
        "end_us": index.end_us,
        "records": index.records,
        "bytes_skipped": index.bytes_skipped,
        "size_bytes": index.size_bytes,
        "systems": index.systems,
        "first_heartbeats": index.first_heartbeats,
        "left_out": index.left_out,
        "cursors": [(c.cursor.offset, c.cursor.time_us, c.cursor.shift_us) for c in index.checkpoints],
        "lengths": [len(numbers) for numbers in arrays],
    }
    return b"".join((json.dumps(header).encode(), b"\n", *(numbers.tobytes() for numbers in arrays)))


def from_bytes(data: bytes) -> Index:
    """Reads the output of `to_bytes`.

    Raises:
        UnreadableRecording: the process reported a problem of the file.
    """
    line, _, rest = data.partition(b"\n")
    header = json.loads(line)
    if "problem" in header:
        raise UnreadableRecording(header["problem"])
    changes, texts, *newest = _arrays(header["lengths"], rest)
    return Index(
        begin_us=header["begin_us"],
        end_us=header["end_us"],
        records=header["records"],
        bytes_skipped=header["bytes_skipped"],
        size_bytes=header["size_bytes"],
        systems=tuple(header["systems"]),
        checkpoints=tuple(
            Checkpoint(Cursor(offset, time_us, shift_us), numbers)
            for (offset, time_us, shift_us), numbers in zip(header["cursors"], newest, strict=True)
        ),
        changes=changes,
        texts=texts,
        first_heartbeats=tuple((time_us, offset) for time_us, offset in header["first_heartbeats"]),
        left_out=header["left_out"],
    )


def _arrays(lengths: list[int], data: bytes) -> Iterable[array[int]]:
    start = 0
    for length in lengths:
        numbers: array[int] = array("q")
        numbers.frombytes(data[start : start + length * numbers.itemsize])
        start += length * numbers.itemsize
        yield numbers


def _output(path: Path) -> bytes:
    problem: dict[str, Any]
    try:
        with open_log(path) as file:
            return to_bytes(make_index(file))
    except UnreadableRecording as error:
        problem = {"problem": str(error)}
    except OSError as error:
        problem = {"problem": explain(path, error)}
    except MemoryError:
        problem = {"problem": _limit_exceeded}
    return json.dumps(problem).encode()


def main(arguments: list[str]) -> None:
    """Prints the index of the given file, or its problem."""
    os.nice(NICENESS)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (COMPUTING_S, COMPUTING_S))
    sys.stdout.buffer.write(_output(Path(arguments[0])))


if __name__ == "__main__":
    main(sys.argv[1:])
