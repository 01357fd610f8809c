"""Downloads of vehicles' logs to the server, one after another, because vehicles may share a link. A download
waits for a lost vehicle, and continues; what has arrived stays when it ends early."""

from __future__ import annotations

import asyncio
import contextlib
import errno
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.errors import Disconnected, GcsError, InvalidRequest, LogUnusable, NoReply, Refused
from gcs_server.logbook.logbook import Logbook
from gcs_server.logbook.partial_logs import PartialLog, PartialLogs
from gcs_server.operations.operations import ReportProgress
from gcs_server.vehicle.services.logs import MAX_BYTES, Download, FlightLog, LogService
from gcs_server.vehicle.vehicle import Vehicle

SAVE_PERIOD_S = 1.0
MAX_UNSAVED = 200_000
"""Pieces in memory; with more, while the disk is still busy with earlier ones, the download ends."""
LOST_S = 600.0
"""A download waits so long for a lost vehicle, or one that does not answer [s]."""
RETRY_S = 2.0
CHECK_BYTES_S = 500_000
"""A vehicle's checksum of a log is awaited as long as reading it takes at this rate."""


class LogDownloads:
    """The downloads of one server.

    Args:
        clock: the server's clock.
        logbook: gets the logs.
        vehicle: returns a vehicle by its id; raises UnknownVehicle.
    """

    def __init__(self, clock: Clock, logbook: Logbook, vehicle: Callable[[str], Vehicle]) -> None:
        self._clock, self._logbook, self._vehicle = clock, logbook, vehicle
        self._partial = PartialLogs(logbook.library.logs, clock)
        self._turn = asyncio.Lock()
        self._saver = ThreadPoolExecutor(1, "logs")
        """Writes in the order of the calls, also when a download was cancelled."""

    def received_bytes(self, vehicle_id: str, log: FlightLog) -> int:
        """Size of what has arrived of a log in an earlier download [bytes]; blocks."""
        return self._partial.received_bytes(_key(vehicle_id, log), log.size_bytes)

    def path_of(self, vehicle_id: str, log: FlightLog) -> Path | None:
        """The downloaded log; None: not downloaded. Blocks."""
        library, vehicle = self._logbook.library, vehicle_id.replace("~", "-")
        names = [f"vehicle-{_key(vehicle_id, log)}.ulg"]
        if log.ended_unix_s is not None:
            pattern = f"vehicle-{vehicle}-{log.ended_unix_s:.0f}-*-{log.size_bytes}.ulg"
            names += [path.name for path in library.logs.glob(pattern)]
        return next((path for name in names if (path := library.downloaded_path(name)) is not None), None)

    async def run(self, vehicle_id: str, number: int, report: ReportProgress) -> dict[str, object]:
        """Downloads a log, and reads it; the result of the operation.

        Raises:
            InvalidRequest: the vehicle has no such log, or it is too large.
            Refused: the vehicle is or was armed, its links carry no files, or the disk is full.
            Disconnected, NoReply: the vehicle did not come back.
            LogUnusable: what arrived differs from the vehicle's checksum.
            UnknownVehicle: the vehicle was removed.
        """
        log: FlightLog | None = None
        progress_s, received = self._clock.monotonic_s(), 0
        while True:
            if self._turn.locked():
                report("Waits for the download of another log.", None)
            async with self._turn:
                try:
                    log = await self._find(vehicle_id, number, log)
                    return await self._download(vehicle_id, log, report)
                except (Disconnected, NoReply) as error:
                    now_s = self._clock.monotonic_s()
                    if log is not None:
                        arrived = await asyncio.to_thread(self.received_bytes, vehicle_id, log)
                        if arrived > received:
                            received, progress_s = arrived, now_s
                    if now_s - progress_s > LOST_S:
                        raise
                    report(f"Waits for the vehicle to continue. {error}", None)
            await self._clock.sleep(RETRY_S)
            while self._vehicle(vehicle_id).link_lost and self._clock.monotonic_s() - progress_s <= LOST_S:
                await self._clock.sleep(RETRY_S)

    async def _find(self, vehicle_id: str, number: int, known: FlightLog | None) -> FlightLog:
        """The log, by its number at first, then also if its number has changed."""
        logs = await self._vehicle(vehicle_id).service(LogService).list()
        for log in logs:
            if known is None and log.number == number:
                return log
            if known is not None and _key(vehicle_id, log) == _key(vehicle_id, known):
                return log
        raise InvalidRequest("number", f"Vehicle {vehicle_id} has no log {number}.", remedy="List its logs.")

    async def _download(self, vehicle_id: str, log: FlightLog, report: ReportProgress) -> dict[str, object]:
        service = self._vehicle(vehicle_id).service(LogService)
        if log.size_bytes > MAX_BYTES:
            text = (
                f"Log {log.number} has {log.size_bytes:,} bytes; more than {MAX_BYTES:,} are not downloaded."
            )
            raise InvalidRequest("number", text, remedy="Take it from the vehicle's memory card.")
        path = await service.path_of(log, await service.list())
        key = _key(vehicle_id, log)
        partial = await asyncio.to_thread(self._partial.open, key, log.size_bytes)
        download = await self._read(service, log, path, partial, report)
        verified = False
        if path is not None:
            report("Received. The vehicle computes its checksum.", 1.0)
            verified = await self._verify(vehicle_id, path, partial)
        name = f"vehicle-{key}.ulg"
        file = await asyncio.to_thread(self._logbook.library.add_downloaded, name, partial.finish)
        flight = await self._logbook.id_of(file)
        report("Received. The log is being read.", 1.0)
        with contextlib.suppress(LogUnusable):  # the list of flights then says why
            await self._logbook.overview(flight)
        return {
            "file": file.name,
            "flight": flight,
            "size_bytes": log.size_bytes,
            "verified": "crc32" if verified else "size",
            "received_bytes": dict(download.received_bytes),
            "rates_bytes_s": {way: round(rate) for way, rate in download.rates_bytes_s.items()},
        }

    async def _read(
        self,
        service: LogService,
        log: FlightLog,
        path: str | None,
        partial: PartialLog,
        report: ReportProgress,
    ) -> Download:
        """Reads what is missing, and saves it while it arrives."""
        clock, file = self._clock, partial.file
        began_s, before = clock.monotonic_s(), file.received
        saving, saved_s = self._saver.submit(partial.saver()), began_s

        def progress(received: int, size: int) -> None:
            nonlocal saving, saved_s
            now_s = clock.monotonic_s()
            if saving.done():
                saving.result()
                if now_s - saved_s >= SAVE_PERIOD_S:
                    saving, saved_s = self._saver.submit(partial.saver()), now_s
            elif partial.unsaved_count > MAX_UNSAVED:
                raise OSError(errno.EIO, "the disk is too slow")
            rate = (received - before) / max(now_s - began_s, 0.1)
            text = f"{received / 1e6:.1f} of {size / 1e6:.1f} MB received, {rate / 1e3:.0f} kB/s."
            report(text, received / size if size else 1.0)

        try:
            try:
                return await service.download(log, path, file, progress)
            finally:  # also of a cancelled download
                await asyncio.wrap_future(self._saver.submit(partial.saver()))
        except OSError as error:
            raise Refused(
                f"The server cannot write the log: {error.strerror or error}.",
                remedy="Make room on its disk, then try again.",
            ) from error

    async def _verify(self, vehicle_id: str, path: str, partial: PartialLog) -> bool:
        """Compares the checksum; False: the vehicle computes none.

        Raises:
            LogUnusable: it differs; what arrived is deleted.
            Disconnected: the vehicle was lost.
        """
        wait_s = partial.file.size / CHECK_BYTES_S
        try:
            crc = await self._vehicle(vehicle_id).ftp.crc32(path, wait_s=wait_s)
        except Disconnected:
            raise
        except GcsError:
            return False
        if crc == await asyncio.to_thread(partial.crc32):
            return True
        await asyncio.to_thread(partial.discard)
        raise LogUnusable(
            f"What arrived of {path} differs from the vehicle's checksum; it was deleted.",
            remedy="Download it again.",
        )


def _key(vehicle_id: str, log: FlightLog) -> str:
    """Names a log by what does not change when others are added: end and size, or number and size."""
    vehicle = vehicle_id.replace("~", "-")
    number = log.number if log.ended_unix_s is None else 0
    return f"{vehicle}-{log.ended_unix_s or 0:.0f}-{number}-{log.size_bytes}"
