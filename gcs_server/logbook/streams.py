"""Logs that vehicles stream while they write them: each grows as a file of the flights, always a valid log,
and stays when its stream ends, for whatever reason."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.errors import Disconnected, GcsError, NoReply, Refused
from gcs_server.logbook.logbook import Logbook
from gcs_server.logbook.partial_logs import KEEP_FREE_BYTES
from gcs_server.operations.operations import ReportProgress
from gcs_server.vehicle.services.log_stream import LogStreamService
from gcs_server.vehicle.services.ulog_pieces import UlogPieces
from gcs_server.vehicle.vehicle import Vehicle

SAVE_PERIOD_S = 1.0
MAX_UNSAVED_BYTES = 16_000_000
"""With more in memory, because the disk is busy, the stream ends."""
MAX_BYTES = 512_000_000
"""A larger log could not be read."""
LOST_S = 120.0
"""A stream waits so long for a lost vehicle [s]; what it misses is a gap in the log."""
RETRY_S = 1.0


@dataclass(slots=True)
class _Stream:
    """One stream."""

    path: Path
    pieces: UlogPieces = field(default_factory=UlogPieces)
    unsaved: list[bytes] = field(default_factory=list[bytes])
    size: int = 0
    stops: bool = False
    """Whether a client wants it to end."""
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def write(self, data: bytes) -> None:
        """Takes complete messages."""
        self.unsaved.append(data)
        self.size += len(data)

    @property
    def lost_share(self) -> float:
        """Share of the pieces that were lost, 0 to 1."""
        return self.pieces.lost / max(1, self.pieces.lost + self.pieces.received)

    def save(self) -> None:
        """Writes what is new to the disk, if anything has arrived; blocks. Raises OSError."""
        if not self.size:
            return
        with self._lock:  # the last call waits for the one before
            unsaved, self.unsaved = self.unsaved, []
            with self.path.open("ab") as file:
                file.write(b"".join(unsaved))


class LogStreams:
    """The log streams of one server, one for each vehicle.

    Args:
        clock: the server's clock.
        logbook: gets the logs.
        vehicle: returns a vehicle by its id; raises UnknownVehicle.
    """

    def __init__(self, clock: Clock, logbook: Logbook, vehicle: Callable[[str], Vehicle]) -> None:
        self._clock, self._logbook, self._vehicle = clock, logbook, vehicle
        self._running: dict[str, _Stream] = {}

    def paths(self) -> frozenset[Path]:
        """The files that grow."""
        return frozenset(stream.path for stream in self._running.values())

    async def run(self, vehicle_id: str, report: ReportProgress) -> dict[str, object]:
        """Streams until a client stops it, or the vehicle ends it; the result of the operation.

        Raises:
            Refused: the vehicle streams already, its links carry no files, or the disk is full.
            Rejected: the vehicle cannot stream.
            NoReply, Disconnected: the vehicle did not answer, or was lost before its log began.
            UnknownVehicle: the vehicle was removed.
        """
        path = await asyncio.to_thread(self._new_path, vehicle_id)
        stream = self._running[vehicle_id] = _Stream(path)
        service = self._vehicle(vehicle_id).service(LogStreamService)
        try:
            try:
                await service.start(stream.pieces, stream.write)
                why = await self._receive(vehicle_id, stream, report)
                if why is None:
                    report("Stopping.", None)
                    with contextlib.suppress(NoReply, Disconnected):
                        await service.stop(stream.pieces, stream.write)
            except BaseException:  # also cancelled
                service.stop_soon()
                raise
            finally:
                await asyncio.shield(asyncio.to_thread(stream.save))
        except OSError as error:
            raise Refused(
                f"The server cannot write the log: {error.strerror or error}.",
                remedy="Make room on its disk, then try again.",
            ) from error
        finally:
            del self._running[vehicle_id]
        report("Stopped. The log is being read.", None)
        return await self._result(stream, why)

    async def stop(self, vehicle_id: str) -> bool:
        """Ends the stream. Returns whether this server ran it; otherwise the vehicle is told to stop the
        stream of whoever gets it.

        Raises:
            NoReply: the vehicle goes on sending.
            Disconnected: the vehicle was lost.
            UnknownVehicle: there is no such vehicle.
        """
        vehicle = self._vehicle(vehicle_id)
        if (stream := self._running.get(vehicle_id)) is not None:
            stream.stops = True
            return True
        vehicle.require("files")
        await vehicle.service(LogStreamService).stop()
        return False

    async def _receive(self, vehicle_id: str, stream: _Stream, report: ReportProgress) -> str | None:
        """Why the stream ended; None: a client wants it."""
        saver = _Saver(self._clock, stream, report)
        lost_s: float | None = None
        while True:
            service = self._vehicle(vehicle_id).service(LogStreamService)
            try:
                return await service.receive(stream.pieces, stream.write, saver.should_stop)
            except Disconnected:
                now_s = self._clock.monotonic_s()
                lost_s = now_s if lost_s is None or now_s - lost_s > LOST_S else lost_s
            while self._vehicle(vehicle_id).link_lost:
                if self._clock.monotonic_s() - lost_s > LOST_S:
                    return "The vehicle was lost."
                if saver.should_stop():
                    return "Stopped while the vehicle was lost."
                report("Waits for the vehicle to continue.", None)
                await self._clock.sleep(RETRY_S)
            lost_s = None

    async def _result(self, stream: _Stream, why: str | None) -> dict[str, object]:
        flight = await self._logbook.id_of(stream.path)
        with contextlib.suppress(GcsError):  # the list of flights then says why
            await self._logbook.overview(flight)
        return {
            "file": stream.path.name,
            "flight": flight,
            "size_bytes": stream.size,
            "lost_share": round(stream.lost_share, 4),
            "dropouts": stream.pieces.dropouts,
            "ended": why,
        }

    def _new_path(self, vehicle_id: str) -> Path:
        folder = self._logbook.library.logs
        folder.mkdir(parents=True, exist_ok=True)
        if shutil.disk_usage(folder).free < MAX_BYTES + KEEP_FREE_BYTES:
            raise Refused(
                "The server's disk has too little room for the log.", remedy="Delete flights first."
            )
        name = f"stream-{vehicle_id.replace('~', '-')}-{self._clock.unix_s():.0f}.ulg"
        return self._logbook.library.free_path(name)


class _Saver:
    """Saves a stream once a second, and says when it must end."""

    def __init__(self, clock: Clock, stream: _Stream, report: ReportProgress) -> None:
        self._clock, self._stream, self._report = clock, stream, report
        self._began_s = self._saved_s = clock.monotonic_s()
        self._saving: asyncio.Future[None] | None = None

    def should_stop(self) -> bool:
        """Whether a client wants the end, or the log is too large. Raises OSError: the disk fails."""
        stream, now_s = self._stream, self._clock.monotonic_s()
        if self._saving is not None and self._saving.done():
            self._saving.result()
            self._saving = None
        if now_s - self._saved_s >= SAVE_PERIOD_S:
            if self._saving is None:
                self._saving = asyncio.get_running_loop().run_in_executor(None, stream.save)
            elif sum(map(len, stream.unsaved)) > MAX_UNSAVED_BYTES:
                raise OSError("the disk is too slow")
            self._saved_s = now_s
            rate = stream.size / max(now_s - self._began_s, 0.1)
            self._report(
                f"{stream.size / 1e6:.1f} MB received, {rate / 1e3:.0f} kB/s, {stream.lost_share:.1%} lost.",
                None,
            )
        return stream.stops or stream.size >= MAX_BYTES
