"""Downloads of vehicles' logs to the server, one after another, because vehicles may share a link. A download
waits for a lost vehicle and for one that flies, and continues; what has arrived stays when it ends early."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.errors import InvalidRequest, LogUnusable, Refused
from gcs_server.logbook.logbook import Logbook
from gcs_server.logbook.partial_logs import PartialLogs
from gcs_server.logbook.transfers import Transfers
from gcs_server.operations.operations import ReportProgress
from gcs_server.vehicle.services.logs import MAX_BYTES, FlightLog, LogService
from gcs_server.vehicle.vehicle import Vehicle

Choose = Callable[[], Awaitable[FlightLog]]
CLOSES_S, MAX_CLOSING = 4.0, 6
"""A log is closed when two lists, so long apart, are the same [s]; one that still grows is then downloaded as
far as it was."""
NEAR_S = 60.0
"""The log of a flight ends so near to it [s]; if none does, the vehicle's clock is wrong, or it has none."""


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
        self.transfers = Transfers(clock, vehicle)
        self.on_downloaded: Callable[[str, FlightLog, Sequence[FlightLog]], object] | None = None
        """Called with the vehicle's id, the log that is on the server now, and all logs of the vehicle."""

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
            Refused: its links carry no files, or the disk is full.
            Disconnected, NoReply: the vehicle did not come back.
            LogUnusable: what arrived differs from the vehicle's checksum.
            UnknownVehicle: the vehicle was removed.
        """
        return await self._run(vehicle_id, partial(self._numbered, vehicle_id, number), report)

    async def run_landed(
        self, vehicle_id: str, ended_unix_s: float, report: ReportProgress
    ) -> dict[str, object]:
        """Downloads the log of a flight, and reads it; the result of the operation.

        Args:
            vehicle_id: the vehicle.
            ended_unix_s: end of the flight [s since 1970 UTC].
            report: reports progress.

        Raises:
            Refused: the vehicle has no such log, its links carry no files, or the disk is full.
            InvalidRequest, Disconnected, NoReply, LogUnusable, UnknownVehicle: see `run`.
        """

        async def choose() -> FlightLog:
            report("Waits until the vehicle has closed its log.", None)
            return await self._of_flight(vehicle_id, ended_unix_s)

        return await self._run(vehicle_id, choose, report)

    async def _run(self, vehicle_id: str, choose: Choose, report: ReportProgress) -> dict[str, object]:
        log: FlightLog | None = None

        async def attempt() -> dict[str, object]:
            nonlocal log
            log = await choose() if log is None else await self._again(vehicle_id, log)
            return await self._download(vehicle_id, log, report)

        def arrived() -> int:
            return 0 if log is None else self.received_bytes(vehicle_id, log)

        return await self.transfers.until_done(vehicle_id, attempt, arrived, report)

    async def _numbered(self, vehicle_id: str, number: int) -> FlightLog:
        for log in await self._vehicle(vehicle_id).service(LogService).list():
            if log.number == number:
                return log
        raise InvalidRequest("number", f"Vehicle {vehicle_id} has no log {number}.", remedy="List its logs.")

    async def _again(self, vehicle_id: str, known: FlightLog) -> FlightLog:
        """A log that was listed before; its number may have changed."""
        for log in await self._vehicle(vehicle_id).service(LogService).list():
            if _key(vehicle_id, log) == _key(vehicle_id, known):
                return log
        raise InvalidRequest(
            "number",
            f"Vehicle {vehicle_id} no longer has this log, or it has grown.",
            remedy="List its logs.",
        )

    async def _of_flight(self, vehicle_id: str, ended_unix_s: float) -> FlightLog:
        service = self._vehicle(vehicle_id).service(LogService)
        logs = await service.list()
        for _ in range(MAX_CLOSING):
            await self._clock.sleep(CLOSES_S)
            before, logs = logs, await service.list()
            if logs == before:
                break
        if not logs:
            raise Refused(
                f"Vehicle {vehicle_id} has no log.",
                remedy="It logs flights on its memory card, unless SDLOG_MODE is -1.",
            )
        log = log_of(logs, ended_unix_s)
        if await asyncio.to_thread(self.path_of, vehicle_id, log) is not None:
            raise Refused(
                f"The newest log of vehicle {vehicle_id} is already on the server.",
                remedy="If it is not of this flight, the vehicle did not log it: see SDLOG_MODE.",
            )
        return log

    async def _download(self, vehicle_id: str, log: FlightLog, report: ReportProgress) -> dict[str, object]:
        service = self._vehicle(vehicle_id).service(LogService)
        if log.size_bytes > MAX_BYTES:
            text = (
                f"Log {log.number} has {log.size_bytes:,} bytes; more than {MAX_BYTES:,} are not downloaded."
            )
            raise InvalidRequest("number", text, remedy="Take it from the vehicle's memory card.")
        logs = await service.list()
        path = await service.path_of(log, logs)
        key = _key(vehicle_id, log)
        partial = await asyncio.to_thread(self._partial.open, key, log.size_bytes)
        download = await self.transfers.receive(
            vehicle_id,
            partial,
            report,
            lambda progress: service.download(log, path, partial.file, progress),
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
        if self.on_downloaded is not None:
            self.on_downloaded(vehicle_id, log, logs)
        return {
            "file": file.name,
            "flight": flight,
            "size_bytes": log.size_bytes,
            "verified": "crc32" if verified else "size",
            "received_bytes": dict(download.received_bytes),
            "rates_bytes_s": {way: round(rate) for way, rate in download.rates_bytes_s.items()},
        }


def log_of(logs: Sequence[FlightLog], ended_unix_s: float) -> FlightLog:
    """The log of a flight that ended then: the nearest, or the newest; `logs` is not empty."""
    away_s = {log: abs(log.ended_unix_s - ended_unix_s) for log in logs if log.ended_unix_s is not None}
    nearest = min(away_s, key=lambda log: away_s[log], default=logs[-1])
    return nearest if away_s.get(nearest, NEAR_S) < NEAR_S else logs[-1]


def _key(vehicle_id: str, log: FlightLog) -> str:
    """Names a log by what does not change when others are added: end and size, or number and size."""
    vehicle = vehicle_id.replace("~", "-")
    number = log.number if log.ended_unix_s is None else 0
    return f"{vehicle}-{log.ended_unix_s or 0:.0f}-{number}-{log.size_bytes}"
