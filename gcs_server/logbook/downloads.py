"""Downloads of vehicles' logs to the server, one after another, because vehicles may share a link. A download
waits for a lost vehicle, and continues; what has arrived stays when it ends early."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.errors import InvalidRequest, LogUnusable
from gcs_server.logbook.logbook import Logbook
from gcs_server.logbook.partial_logs import PartialLogs
from gcs_server.logbook.transfers import Transfers
from gcs_server.operations.operations import ReportProgress
from gcs_server.vehicle.services.logs import MAX_BYTES, FlightLog, LogService
from gcs_server.vehicle.vehicle import Vehicle


class LogDownloads:
    """The downloads of one server.

    Args:
        clock: the server's clock.
        logbook: gets the logs.
        vehicle: returns a vehicle by its id; raises UnknownVehicle.
    """

    def __init__(self, clock: Clock, logbook: Logbook, vehicle: Callable[[str], Vehicle]) -> None:
        self._logbook, self._vehicle = logbook, vehicle
        self._partial = PartialLogs(logbook.library.logs, clock)
        self.transfers = Transfers(clock, vehicle)

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

        async def attempt() -> dict[str, object]:
            nonlocal log
            log = await self._find(vehicle_id, number, log)
            return await self._download(vehicle_id, log, report)

        def arrived() -> int:
            return 0 if log is None else self.received_bytes(vehicle_id, log)

        return await self.transfers.until_done(vehicle_id, attempt, arrived, report)

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
        download = await self.transfers.receive(
            partial, report, lambda progress: service.download(log, path, partial.file, progress)
        )
        verified = False
        if path is not None:
            report("Received. The vehicle computes its checksum.", 1.0)
            verified = await self.transfers.verified(vehicle_id, path, partial)
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


def _key(vehicle_id: str, log: FlightLog) -> str:
    """Names a log by what does not change when others are added: end and size, or number and size."""
    vehicle = vehicle_id.replace("~", "-")
    number = log.number if log.ended_unix_s is None else 0
    return f"{vehicle}-{log.ended_unix_s or 0:.0f}-{number}-{log.size_bytes}"
