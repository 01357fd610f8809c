"""Records the frames of links in a thread, so that a slow or full disk never delays messages.

A record is an 8-byte big-endian time (microseconds since 1970) and the raw frame, as other ground
stations write it. Writes are unbuffered, so a killed server loses at most the frames since the last flush.
"""

from __future__ import annotations

import errno
import logging
import os
import re
import shutil
import struct
import threading
from datetime import UTC, datetime
from pathlib import Path

from gcs_server.faults import FaultLog
from gcs_server.links.base import Recording

log = logging.getLogger(__name__)

FLUSH_INTERVAL_S = 0.25
BACKLOG_LIMIT_RECORDS = 150_000
"""Maximum number of records of a link that wait for a stalled disk (15 MB: half a minute of fifty vehicles).
Above it, the recording stops.
"""
TRY_AGAIN_FLUSHES = 40
"""Number of flushes after which a stopped recording is tried again."""

_time = struct.Struct(">Q")


def stamp(time_us: int) -> bytes:
    """The time of a record [us since 1970], encoded for `TlogChannel.append`."""
    return _time.pack(time_us)


class TlogChannel:
    """The recording of one link; `append` may be called from any thread and never waits for the disk."""

    def __init__(self, link: str) -> None:
        self.link = link
        self.problem = ""
        """Why recording has stopped; empty while recording works."""
        self.path: Path | None = None
        self.closing = False
        self._waiting: list[bytes] = []
        """Waiting records. Any thread appends, and only the recorder's thread removes; both are single
        operations of a list, so no lock is needed."""
        self._file: int | None = None
        self._began_unix_s: float | None = None
        self._size = 0
        self._flushes_until_retry = 0

    def append(self, encoded_time: bytes, raw: bytes) -> None:
        """Adds a received or sent frame, with its time encoded by `stamp`."""
        if not self.problem and len(self._waiting) < BACKLOG_LIMIT_RECORDS:
            self._waiting.append(encoded_time + raw)

    def take(self) -> bytes:
        """Takes all waiting records; only for the recorder's thread."""
        waiting = self._waiting
        count = len(waiting)
        records = b"".join(waiting[:count])
        del waiting[:count]
        return records

    @property
    def backlog_records(self) -> int:
        """Number of waiting records."""
        return len(self._waiting)

    def write(self, directory: Path, data: bytes, time_us: int, max_bytes: int) -> None:
        """Writes records; called by the recorder's thread. On OSError, an incomplete record is removed."""
        if self._file is not None and self._size and self._size + len(data) > max_bytes:
            self.end()
        if self._file is None:
            self._begin(directory, time_us)
        assert self._file is not None
        written = 0
        try:
            while written < len(data):
                written += os.write(self._file, data[written:])
        except OSError:
            if written:
                os.ftruncate(self._file, self._size)
            raise
        self._size += written

    def _begin(self, directory: Path, time_us: int) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        begin_text = datetime.fromtimestamp(time_us / 1e6, UTC).strftime("%Y%m%d-%H%M%S")
        safe = re.sub(r"[^A-Za-z0-9._-]+", "_", self.link)
        for number in range(1000):
            path = directory / f"{begin_text}-{safe}{f'_{number:03}' if number else ''}.tlog"
            try:
                self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
            except FileExistsError:
                continue
            self.path, self._size, self._began_unix_s = path, 0, time_us / 1e6
            return
        raise FileExistsError(errno.EEXIST, f"too many recordings named {begin_text}-{safe}")

    def info(self) -> Recording:
        """The recording's state for `GET /links`; may be called from any thread."""
        name = None if self.path is None else self.path.name
        return Recording(name, self._size, self._began_unix_s, self.problem or None)

    def end(self) -> None:
        """Closes the file; the next write starts a new file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def stop(self, problem: str) -> None:
        """Stops recording until `should_retry` returns true."""
        self.problem = problem
        self._flushes_until_retry = TRY_AGAIN_FLUSHES
        self.take()
        self.end()

    def should_retry(self) -> bool:
        """Counts the flushes since recording stopped; returns whether to try again."""
        self._flushes_until_retry -= 1
        return self._flushes_until_retry <= 0


class TlogRecorder:
    """The thread that writes all channels.

    Args:
        directory: folder of the files; created if missing.
        max_bytes: size at which the next file begins.
        keep_free_bytes: recording stops while the disk has less free space.
    """

    def __init__(self, directory: Path, *, max_bytes: int, keep_free_bytes: int) -> None:
        self._directory = directory
        self._max_bytes = max_bytes
        self._keep_free_bytes = keep_free_bytes
        self._channels: list[TlogChannel] = []
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._faults = FaultLog("recordings")

    def start(self) -> None:
        """Starts writing every `FLUSH_INTERVAL_S`."""
        self._thread = threading.Thread(target=self._run, name="tlog", daemon=True)
        self._thread.start()

    def channel(self, link: str) -> TlogChannel:
        """A recording for a link; its file is created with the first frame."""
        channel = TlogChannel(link)
        with self._lock:
            self._channels.append(channel)
        return channel

    def problems(self) -> list[tuple[str, str]]:
        """(link, reason) of all stopped recordings."""
        return [(c.link, c.problem) for c in tuple(self._channels) if c.problem]

    def close(self) -> None:
        """Writes the rest and closes all files."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
            self._thread = None
        self.flush()
        for channel in self._channels:
            channel.end()

    def flush(self) -> None:
        """Writes waiting records now; normally called by the thread."""
        with self._lock:
            channels = tuple(self._channels)
        disk_problem = self._disk_problem()
        for channel in channels:
            if channel.problem:
                if not disk_problem and channel.should_retry():
                    log.info("recording of %s continues", channel.link)
                    channel.problem = ""
                continue
            if disk_problem and channel.backlog_records:
                self._stop_channel(channel, disk_problem)
                continue
            self._write(channel)
            if channel.closing and not channel.backlog_records:
                channel.end()
                with self._lock:
                    self._channels.remove(channel)

    def _write(self, channel: TlogChannel) -> None:
        if channel.backlog_records >= BACKLOG_LIMIT_RECORDS:
            self._stop_channel(channel, "The disk is too slow: too many frames wait to be written.")
            return
        data = channel.take()
        if not data:
            return
        try:
            channel.write(self._directory, data, _time.unpack_from(data)[0], self._max_bytes)
        except OSError as error:
            problem = f"The recording in {self._directory} cannot be written: {error.strerror or error}."
            self._stop_channel(channel, problem)

    def _disk_problem(self) -> str:
        folder = self._directory
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
        try:
            free = shutil.disk_usage(folder).free
        except OSError:
            return ""  # the next write reports the problem
        if free >= self._keep_free_bytes:
            return ""
        return (
            f"Only {free // 1_000_000} MB are free on the disk of the recordings ({self._directory}); "
            f"{self._keep_free_bytes // 1_000_000} MB are kept free. Free some space; recording then "
            f"continues."
        )

    def _stop_channel(self, channel: TlogChannel, why: str) -> None:
        log.warning("recording of %s stopped: %s", channel.link, why)
        channel.stop(why)

    def _run(self) -> None:
        while not self._stop.wait(FLUSH_INTERVAL_S):
            try:
                self.flush()
            except Exception as error:  # the thread continues, because one fault must not end all recordings
                self._faults.add(error, "writing")
