"""Download of onboard logs by LOG_* messages: listing, data in parts of 90 bytes, and deletion.

As in PX4, the time of a log is that of its end, an invalid request gets no reply, and a new request replaces
the previous request. A log keeps its number until a client requests a new listing. The oldest log has number
0; PX4 numbers them as its file system lists them.
"""

from __future__ import annotations

from dataclasses import dataclass

from vehicle_sim.logger.logger import FOLDER, Logger
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.storage.files import VehicleFiles

PART_BYTES = 90
ENTRIES_PER_STEP = 2
PARTS_PER_STEP = 20
"""With 250 steps per second, 5,000 parts or 450 kB per second."""
ALL_LOGS = 0xFFFF


@dataclass(frozen=True, slots=True)
class Log:
    """One log file."""

    path: str
    time_utc_s: int


@dataclass(slots=True)
class _Listing:
    """Log entries still to be sent."""

    next_number: int
    last_number: int
    log_count: int


@dataclass(slots=True)
class _Transfer:
    """Log data still to be sent."""

    log_number: int
    path: str
    offset: int
    end: int


class LogService:
    """Handles LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_ERASE and LOG_REQUEST_END."""

    def __init__(self, context: Context, files: VehicleFiles, logger: Logger) -> None:
        self._context, self._files, self._logger = context, files, logger
        self._logs: list[Log] | None = None
        self._listings: dict[str, _Listing] = {}
        self._transfers: dict[str, _Transfer] = {}
        self.handlers = {
            "LOG_REQUEST_LIST": self.request_list,
            "LOG_REQUEST_DATA": self.request_data,
            "LOG_ERASE": self.erase,
            "LOG_REQUEST_END": self.request_end,
        }

    @property
    def busy(self) -> bool:
        """Whether log entries or log data must still be sent."""
        return bool(self._listings or self._transfers)

    def request_list(self, link: Link, message: Message) -> None:
        """Sends the entries of the logs from `start` to `end`."""
        if not self._context.addresses_autopilot(message):
            return
        self._logs = self._find_logs()
        count = len(self._logs)
        last = count if message.end == ALL_LOGS else message.end
        self._transfers.pop(link.name, None)
        if message.start < count:
            self._listings[link.name] = _Listing(message.start, last, count)

    def request_data(self, link: Link, message: Message) -> None:
        """Sends part of a log."""
        if not self._context.addresses_autopilot(message):
            return
        if self._logs is None:
            self._logs = self._find_logs()
        number = message.values["id"]
        if number >= len(self._logs):
            return
        path = self._logs[number].path
        end = min(self._file_size(path), message.ofs + message.count)
        self._listings.pop(link.name, None)
        self._transfers.pop(link.name, None)
        if message.ofs < end:
            self._transfers[link.name] = _Transfer(number, path, message.ofs, end)

    def erase(self, link: Link, message: Message) -> None:
        """Deletes all log files, including the file of the running log, which continues but is lost."""
        if self._context.addresses_autopilot(message):
            self._listings.clear()
            self._transfers.clear()
            self._files.delete_tree(FOLDER)
            self._logs = None

    def request_end(self, link: Link, message: Message) -> None:
        """Ends the listing and the data transfer on a link."""
        if self._context.addresses_autopilot(message):
            self._listings.pop(link.name, None)
            self._transfers.pop(link.name, None)

    def step(self) -> None:
        """Continues the current listings and transfers."""
        for link in self._context.links:
            self._send_entries(link)
            self._send_data(link)
        open_links = {link.name for link in self._context.links}
        for by_link in (self._listings, self._transfers):
            for closed_link in by_link.keys() - open_links:
                del by_link[closed_link]

    def _find_logs(self) -> list[Log]:
        """All logs, the oldest first."""
        self._logger.flush()
        logs: list[Log] = []
        try:
            days = self._files.listing(FOLDER)
        except OSError:
            return logs
        for day, size in days:
            if size is not None:  # a file, not a directory
                continue
            for name, file_size in self._files.listing(f"{FOLDER}/{day}"):
                if file_size is not None and name.endswith(".ulg"):
                    path = f"{FOLDER}/{day}/{name}"
                    logs.append(Log(path, self._file_time_s(path)))
        return logs

    def _file_time_s(self, path: str) -> int:
        """Last change of a file (UTC), which PX4 reports as the time of a log."""
        try:
            return int(self._files.host_path(path).stat().st_mtime)
        except OSError:
            return 0

    def _file_size(self, path: str) -> int:
        try:
            return self._files.size(path)
        except OSError:
            return 0

    def _send_entries(self, link: Link) -> None:
        listing, logs = self._listings.get(link.name), self._logs or []
        if listing is None:
            return
        for _ in range(ENTRIES_PER_STEP):
            if listing.next_number > min(listing.last_number, len(logs) - 1):
                self._listings.pop(link.name, None)
                return
            log = logs[listing.next_number]
            link.send(
                "LOG_ENTRY", id=listing.next_number, num_logs=listing.log_count,
                last_log_num=listing.last_number, time_utc=log.time_utc_s, size=self._file_size(log.path),
            )  # fmt: skip
            listing.next_number += 1

    def _send_data(self, link: Link) -> None:
        transfer = self._transfers.get(link.name)
        if transfer is None:
            return
        byte_count = min(PARTS_PER_STEP * PART_BYTES, transfer.end - transfer.offset)
        try:
            data = self._files.read(transfer.path, transfer.offset, byte_count)
        except OSError:
            data = b""  # deleted during the transfer
        for start in range(0, len(data), PART_BYTES):
            part = data[start : start + PART_BYTES]
            link.send(
                "LOG_DATA", id=transfer.log_number, ofs=transfer.offset + start, count=len(part), data=part
            )  # fmt: skip
        transfer.offset += len(data)
        if len(data) < byte_count or transfer.offset >= transfer.end:
            del self._transfers[link.name]
