"""Lists and downloads the vehicle's flight logs (MAVLink log protocol: LOG_REQUEST_LIST, LOG_REQUEST_DATA).

Missing entries and pieces are requested again. A download takes the link's whole capacity, so nothing is sent
while the vehicle is armed, and a download ends when it is armed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from gcs_server.errors import Disconnected, InvalidRequest, NoReply, Refused
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.mailbox import Reply, Waiter
from gcs_server.vehicle.services.ftp_pieces import PartialFile
from gcs_server.vehicle.services.port import VehiclePort

ALL_LOGS = 0xFFFF
MAX_LOGS = 1000
MAX_BYTES = 256_000_000
"""A larger log is not downloaded; the download is in memory until it is complete."""
PIECE_BYTES = 90
WINDOW_BYTES = 1000 * PIECE_BYTES
"""Requested at once, until nothing of it is missing. What arrived between two missing pieces is sent again,
because at a high loss a request for each piece would take minutes."""
SILENCE_S = 1.0
"""After this time without an answer, what is missing is requested again [s]."""
ATTEMPTS = 6
"""Requests without any new answer before the service gives up; at 20 % loss each way one in 20,000."""
ReportBytes = Callable[[int, int], None]
"""Called with the received bytes and the size of the log."""


@dataclass(frozen=True, slots=True)
class FlightLog:
    """A log on the vehicle."""

    number: int
    """Number by which the vehicle knows the log; changes when logs are added or deleted."""
    ended_unix_s: float | None
    """Its last change, normally its end [s since 1970 UTC]; null: the vehicle did not know the time."""
    size_bytes: int
    """Size [bytes]."""


class LogService:
    """The flight logs of one vehicle; one request at a time."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._lock = asyncio.Lock()

    async def list(self) -> tuple[FlightLog, ...]:
        """The logs on the vehicle, the oldest first. PX4 does not answer if it has none.

        Raises:
            Refused: the vehicle is armed, or its links carry no files.
            NoReply: some entries did not arrive.
            Disconnected: the vehicle was lost.
        """
        self._require_disarmed()
        async with self._lock:
            logs: dict[int, FlightLog] = {}
            count, silent = 0, 0
            with self._expect(d.MAVLINK_MSG_ID_LOG_ENTRY) as waiter:
                while silent < ATTEMPTS:
                    self._send(d.MAVLink_log_request_list_message, 0, ALL_LOGS)
                    known = len(logs)
                    while (entry := await _next(waiter)) is not None:
                        count = min(entry.num_logs, MAX_LOGS)
                        if entry.num_logs and entry.id < MAX_LOGS:
                            time_s = float(entry.time_utc) or None
                            logs[entry.id] = FlightLog(entry.id, time_s, entry.size)
                        if len(logs) >= count:
                            return tuple(sorted(logs.values(), key=_age))
                    silent = 0 if len(logs) > known else silent + 1
        if not logs:
            return ()
        raise self._no_reply(f"listed only {len(logs)} of its {count} logs")

    async def download(self, log: FlightLog, progress: ReportBytes) -> bytes:
        """The content of a log.

        Raises:
            InvalidRequest: the log is too large.
            Refused: the vehicle is or was armed, or its links carry no files.
            NoReply: the vehicle stopped answering.
            Disconnected: the vehicle was lost.
        """
        self._require_disarmed()
        if log.size_bytes > MAX_BYTES:
            text = (
                f"Log {log.number} has {log.size_bytes:,} bytes; more than {MAX_BYTES:,} are not downloaded."
            )
            raise InvalidRequest("number", text, remedy="Take it from the vehicle's memory card.")
        file = PartialFile(log.size_bytes)
        async with self._lock:
            try:
                await self._fill(log, file, progress)
            except Disconnected:
                raise
            except BaseException:
                self._send(d.MAVLink_log_request_end_message)
                raise
            self._send(d.MAVLink_log_request_end_message)
        return file.content

    async def _fill(self, log: FlightLog, file: PartialFile, progress: ReportBytes) -> None:
        silent = 0
        with self._expect(d.MAVLINK_MSG_ID_LOG_DATA) as waiter:
            while (part := file.missing_within(WINDOW_BYTES)) is not None:
                if silent == ATTEMPTS:
                    raise self._no_reply(f"sent {file.received:,} of {file.size:,} bytes of log {log.number}")
                self._require_disarmed()
                start, end = part
                self._send(d.MAVLink_log_request_data_message, log.number, start, end - start)
                received = file.received
                while (piece := await _next(waiter)) is not None:
                    if piece.id == log.number:
                        file.put(piece.ofs, bytes(piece.data[: piece.count]))
                        if piece.ofs + piece.count >= end:
                            break
                silent = 0 if file.received > received else silent + 1
                progress(file.received, file.size)

    def _require_disarmed(self) -> None:
        vehicle = self._vehicle
        vehicle.require("files")
        if vehicle.flight_state.armed:
            raise Refused(
                f"Vehicle {vehicle.id} is armed; a log would take its link's whole capacity.",
                remedy="Land and disarm, then try again.",
            )

    def _expect(self, msg_id: int):  # noqa: ANN202 the mailbox's context manager
        identity = self._vehicle.identity
        autopilot = (identity.system_id, identity.component_id)
        return self._vehicle.mailbox.expect(
            msg_id, matches=lambda message: (message.get_srcSystem(), message.get_srcComponent()) == autopilot
        )

    def _send(self, message: Callable[..., d.MAVLink_message], *fields: int) -> None:
        identity = self._vehicle.identity
        self._vehicle.send(message(identity.system_id, identity.component_id, *fields))

    def _no_reply(self, what: str) -> NoReply:
        return NoReply(
            f"Vehicle {self._vehicle.id} {what}, then no more.",
            deadline_s=ATTEMPTS * SILENCE_S,
            remedy="Check the link, then try again.",
        )


def _age(log: FlightLog) -> tuple[float, int]:
    """For sorting: PX4 numbers logs in the order in which its file system lists them."""
    return log.ended_unix_s or 0.0, log.number


async def _next(waiter: Waiter) -> Reply | None:
    """The next message; None after a silence."""
    try:
        async with asyncio.timeout(SILENCE_S):
            return await waiter.next()
    except TimeoutError:
        return None
