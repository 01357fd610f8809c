"""Download of onboard logs by LOG_* messages: listing, data in parts of 90 bytes, and deletion.

As in PX4, log numbers start at the oldest log, an invalid request gets no reply, and a new request replaces
the previous one. The numbers are those of the last listing until a new listing is requested.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

from vehicle_sim.logger.logger import FOLDER, Logger
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.storage.files import VehicleFiles

PART_BYTES = 90
ENTRIES_PER_STEP = 2
PARTS_PER_STEP = 20
"""5,000 parts per second, 450 kB/s."""
ALL = 0xFFFF


@dataclass(frozen=True, slots=True)
class Log:
    """One log file."""

    path: str
    time_utc_s: int


@dataclass(slots=True)
class _Listing:
    """Log entries still to be sent."""

    next: int
    last: int
    count: int


@dataclass(slots=True)
class _Transfer:
    """Log data still to be sent."""

    log: int
    path: str
    offset: int
    end: int


class LogService:
    """LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_ERASE, LOG_REQUEST_END."""

    def __init__(self, context: Context, files: VehicleFiles, logger: Logger) -> None:
        self._context, self._files, self._logger = context, files, logger
        self._logs: list[Log] | None = None
        self._listings: dict[str, _Listing] = {}
        self._transfers: dict[str, _Transfer] = {}
        self.handlers = {
            "LOG_REQUEST_LIST": self.request_list,
            "LOG_REQUEST_DATA": self.request_data,
            "LOG_ERASE": self.erase,
            "LOG_REQUEST_END": self.end,
        }

    @property
    def busy(self) -> bool:
        """Whether anything is left to send."""
        return bool(self._listings or self._transfers)

    def request_list(self, link: Link, message: Message) -> None:
        """Sends the entries of the logs from `start` to `end`."""
        if not self._context.is_for_me(message):
            return
        self._logs = self._find()
        count = len(self._logs)
        last = count if message.end == ALL else message.end
        self._transfers.pop(link.name, None)
        if message.start < count:
            self._listings[link.name] = _Listing(message.start, last, count)

    def request_data(self, link: Link, message: Message) -> None:
        """Sends part of a log."""
        if not self._context.is_for_me(message):
            return
        if self._logs is None:
            self._logs = self._find()
        number = message.values["id"]
        if number >= len(self._logs):
            return
        path = self._logs[number].path
        end = min(self._size(path), message.ofs + message.count)
        self._listings.pop(link.name, None)
        self._transfers.pop(link.name, None)
        if message.ofs < end:
            self._transfers[link.name] = _Transfer(number, path, message.ofs, end)

    def erase(self, link: Link, message: Message) -> None:
        """Deletes every log; a log that is being written continues, and is deleted when it ends."""
        if self._context.is_for_me(message):
            self._listings.clear()
            self._transfers.clear()
            self._files.delete_tree(FOLDER)
            self._logs = None

    def end(self, link: Link, message: Message) -> None:
        """Stops the transfer."""
        if self._context.is_for_me(message):
            self._listings.pop(link.name, None)
            self._transfers.pop(link.name, None)

    def step(self) -> None:
        """Continues the current transfer."""
        for link in self._context.links:
            self._list(link)
            self._send(link)
        names = {link.name for link in self._context.links}
        for waiting in (self._listings, self._transfers):
            for gone in waiting.keys() - names:
                del waiting[gone]

    def _find(self) -> list[Log]:
        """All logs, the oldest first."""
        self._logger.flush()
        logs: list[Log] = []
        try:
            days = self._files.listing(FOLDER)
        except OSError:
            return logs
        for day, size in days:
            if size is not None:
                continue
            for name, bytes_ in self._files.listing(f"{FOLDER}/{day}"):
                if bytes_ is not None and name.endswith(".ulg"):
                    logs.append(Log(f"{FOLDER}/{day}/{name}", _time_of(day, name)))
        return logs

    def _size(self, path: str) -> int:
        try:
            return self._files.size(path)
        except OSError:
            return 0

    def _list(self, link: Link) -> None:
        listing, logs = self._listings.get(link.name), self._logs or []
        if listing is None:
            return
        for _ in range(ENTRIES_PER_STEP):
            if listing.next > min(listing.last, len(logs) - 1):
                self._listings.pop(link.name, None)
                return
            log = logs[listing.next]
            link.send(
                "LOG_ENTRY", id=listing.next, num_logs=listing.count, last_log_num=listing.last,
                time_utc=log.time_utc_s, size=self._size(log.path),
            )  # fmt: skip
            listing.next += 1

    def _send(self, link: Link) -> None:
        transfer = self._transfers.get(link.name)
        if transfer is None:
            return
        wanted = min(PARTS_PER_STEP * PART_BYTES, transfer.end - transfer.offset)
        try:
            data = self._files.read(transfer.path, transfer.offset, wanted)
        except OSError:
            data = b""  # deleted during the transfer
        for at in range(0, len(data), PART_BYTES):
            part = data[at : at + PART_BYTES]
            link.send("LOG_DATA", id=transfer.log, ofs=transfer.offset + at, count=len(part), data=part)
        transfer.offset += len(data)
        if len(data) < wanted or transfer.offset >= transfer.end:
            del self._transfers[link.name]


def _time_of(day: str, name: str) -> int:
    """Start time of a log, from its path; 0 if the path has none."""
    try:
        when = datetime.strptime(f"{day}/{name[:8]}", "%Y-%m-%d/%H_%M_%S")
    except ValueError:
        return 0
    return int(when.replace(tzinfo=UTC).timestamp())
