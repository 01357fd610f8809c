"""Lists, downloads and erases the vehicle's flight logs.

The list is that of MAVLink's log protocol (LOG_REQUEST_LIST). A log is read by FTP, if its file is found
there by its size, or by LOG_REQUEST_DATA; a large one by each of them for some seconds, then by the faster.
FTP carries 239 bytes in a message and LOG_DATA 90, so that FTP is normally faster; only it has a checksum.
What has arrived by either is kept, and only what is missing is requested.

A download takes the link's whole capacity, so nothing is sent while the vehicle is armed, and a download ends
when it is armed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Literal

from gcs_server.errors import Disconnected, NoReply, Refused
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.mailbox import Reply, Waiter
from gcs_server.vehicle.services.ftp_codec import FtpFailed
from gcs_server.vehicle.services.ftp_pieces import PartialFile
from gcs_server.vehicle.services.port import VehiclePort

ALL_LOGS = 0xFFFF
MAX_LOGS = 1000
MAX_BYTES = 512_000_000
"""A larger log is not downloaded; it could not be read either."""
PIECE_BYTES = 90
WINDOW_BYTES = 1000 * PIECE_BYTES
"""Requested at once, until nothing of it is missing. What arrived between two missing pieces is sent again,
because at a high loss a request for each piece would take minutes."""
MAX_ENTRIES, MAX_PIECES = 2 * MAX_LOGS, 4 * WINDOW_BYTES // PIECE_BYTES
"""Answers to one request that are looked at; a vehicle that sends more of them sends what was not asked
for."""
REQUEST_S = 60.0
"""Time for the answers to one request; 1.5 kB a second are enough [s]."""
SILENCE_S = 1.0
"""After this time without an answer, what is missing is requested again [s]."""
ATTEMPTS = 6
"""Requests without any new answer before the service gives up; at 20 % loss each way one in 20,000."""
TRIAL_S = 3.0
"""Time for which a large log is read in each way, to find the faster [s]."""
TRIAL_BYTES = 1_000_000
"""A log of which less is missing is read by FTP without a trial."""
FOLDERS: Final = ("/fs/microsd/log", "/log")
"""PX4's folder of logs on hardware, and in simulation."""
MAX_DAYS = 200
"""Folders of days that are looked through for a log, the newest first."""

Way = Literal["FTP", "LOG_DATA"]
ReportBytes = Callable[[int, int], None]
"""Called with the received bytes and the size of the log; an error that it raises ends the download."""


@dataclass(frozen=True, slots=True)
class FlightLog:
    """A log on the vehicle."""

    number: int
    """Number by which the vehicle knows the log; changes when logs are added or deleted."""
    ended_unix_s: float | None
    """Its last change, normally its end [s since 1970 UTC]; null: the vehicle did not know the time."""
    size_bytes: int
    """Size [bytes]."""


@dataclass(slots=True)
class Download:
    """How a log was read."""

    received_bytes: dict[Way, int] = field(default_factory=dict["Way", int])
    """What arrived in each way [bytes]."""
    rates_bytes_s: dict[Way, float] = field(default_factory=dict["Way", float])
    """The newest rate of each way [bytes/s]."""


class _TrialOver(Exception):
    """Ends the trial of a way."""


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
        self.require_disarmed()
        async with self._lock:
            logs: dict[int, FlightLog] = {}
            count, silent = 0, 0
            with self._expect(d.MAVLINK_MSG_ID_LOG_ENTRY) as waiter:
                while silent < ATTEMPTS:
                    self._send(d.MAVLink_log_request_list_message, 0, ALL_LOGS)
                    known = len(logs)
                    for _ in range(MAX_ENTRIES):
                        if (entry := await _next(waiter)) is None:
                            break
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

    async def path_of(self, log: FlightLog, logs: tuple[FlightLog, ...]) -> str | None:
        """Path of a log for FTP; None: it is not found. The log protocol has no names, so the file is that of
        the same size, if no other log has it; a log that is being written has another size.

        Raises:
            NoReply, Disconnected, Refused: see `list`.
        """
        if sum(each.size_bytes == log.size_bytes for each in logs) != 1:
            return None
        ftp = self._vehicle.ftp
        for folder in FOLDERS:
            try:
                days = [entry.name for entry in await ftp.list(folder) if entry.bytes is None]
                for day in sorted(days, reverse=True)[:MAX_DAYS]:
                    self.require_disarmed()
                    for entry in await ftp.list(f"{folder}/{day}"):
                        if entry.bytes == log.size_bytes and entry.name.endswith(".ulg"):
                            return f"{folder}/{day}/{entry.name}"
            except FtpFailed:
                continue
        return None

    async def download(
        self, log: FlightLog, path: str | None, file: PartialFile, progress: ReportBytes
    ) -> Download:
        """Reads what is missing of a log.

        Args:
            log: the log.
            path: its path for FTP; None: it is read by LOG_REQUEST_DATA.
            file: what has arrived; of the log's size.
            progress: called with the progress.

        Raises:
            Refused: the vehicle is or was armed, or its links carry no files.
            NoReply: the vehicle stopped answering.
            Disconnected: the vehicle was lost.
        """
        done = Download()
        ways: list[Way] = ["LOG_DATA"] if path is None else ["FTP", "LOG_DATA"]
        if file.size - file.received < TRIAL_BYTES:
            done.rates_bytes_s = dict.fromkeys(ways, 0.0)
        while not file.complete:
            self.require_disarmed()
            tried = [way for way in ways if way in done.rates_bytes_s]
            on_trial = len(ways) > 1 and len(tried) < len(ways)
            way = (
                ways[len(tried)]
                if on_trial
                else max(ways, key=lambda each: done.rates_bytes_s.get(each, 0.0))
            )
            try:
                await self._read(way, log, path or "", file, progress, done, on_trial)
            except (FtpFailed, NoReply):
                ways.remove(way)
                if not ways:
                    raise
        return done

    async def _read(
        self,
        way: Way,
        log: FlightLog,
        path: str,
        file: PartialFile,
        progress: ReportBytes,
        done: Download,
        on_trial: bool,
    ) -> None:
        """Reads a log in one way, for the time of a trial or to the end; notes the rate."""
        clock = self._vehicle.clock
        began_s, before = clock.monotonic_s(), file.received

        def report(received: int, size: int) -> None:
            self.require_disarmed()
            progress(received, size)
            if on_trial and clock.monotonic_s() - began_s >= TRIAL_S:
                raise _TrialOver

        def same_file(size: int) -> PartialFile:
            if size != file.size:
                raise FtpFailed(f"{path} has {size:,} bytes instead of {file.size:,}.", path=path)
            return file

        try:
            if way == "FTP":
                await self._vehicle.ftp.read_parts(path, same_file, report)
            else:
                await self._read_data(log, file, report)
        except _TrialOver:
            pass
        finally:
            received = file.received - before
            done.received_bytes[way] = done.received_bytes.get(way, 0) + received
            done.rates_bytes_s[way] = received / max(clock.monotonic_s() - began_s, 1e-3)

    async def erase(self) -> None:
        """Erases all logs, and waits until the vehicle lists none.

        Raises:
            Refused: the vehicle is armed, or its links carry no files.
            NoReply: the vehicle still lists logs.
            Disconnected: the vehicle was lost.
        """
        for _ in range(ATTEMPTS):
            self.require_disarmed()
            async with self._lock:
                self._send(d.MAVLink_log_erase_message)
            if not await self.list():
                return
        raise NoReply(
            f"Vehicle {self._vehicle.id} was told to erase its logs {ATTEMPTS} times, and still lists some.",
            deadline_s=ATTEMPTS * ATTEMPTS * SILENCE_S,
            remedy="A log that is being written may remain; list them again.",
        )

    async def _read_data(self, log: FlightLog, file: PartialFile, progress: ReportBytes) -> None:
        async with self._lock:
            try:
                await self._fill(log, file, progress)
            except Disconnected:
                raise
            except BaseException:
                self._send(d.MAVLink_log_request_end_message)
                raise
            self._send(d.MAVLink_log_request_end_message)

    async def _fill(self, log: FlightLog, file: PartialFile, progress: ReportBytes) -> None:
        silent = 0
        with self._expect(d.MAVLINK_MSG_ID_LOG_DATA) as waiter:
            while (part := file.missing_within(WINDOW_BYTES)) is not None:
                if silent == ATTEMPTS:
                    raise self._no_reply(f"sent {file.received:,} of {file.size:,} bytes of log {log.number}")
                self.require_disarmed()
                start, end = part
                self._send(d.MAVLink_log_request_data_message, log.number, start, end - start)
                received, end_s = file.received, self._vehicle.clock.monotonic_s() + REQUEST_S
                for _ in range(MAX_PIECES):
                    if (piece := await _next(waiter)) is None:
                        break
                    if piece.id == log.number:
                        if file.put(piece.ofs, bytes(piece.data[: piece.count])):
                            progress(file.received, file.size)
                        if piece.ofs + piece.count >= end:
                            break
                    if self._vehicle.clock.monotonic_s() > end_s:
                        break
                silent = 0 if file.received > received else silent + 1

    def require_disarmed(self) -> None:
        """Raises Refused if the vehicle is armed, or its links carry no files."""
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
    """The next message; None after a silence. Other tasks run between messages that have arrived already."""
    await asyncio.sleep(0)
    try:
        async with asyncio.timeout(SILENCE_S):
            return await waiter.next()
    except TimeoutError:
        return None
