"""Downloads of any file of a vehicle to the server, from where a browser takes it. What has arrived of one
stays when its download ends early, and the next one continues there."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import re
from collections.abc import Callable
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.errors import InvalidRequest
from gcs_server.logbook.partial_logs import PartialLogs
from gcs_server.logbook.transfers import Transfers
from gcs_server.operations.operations import ReportProgress
from gcs_server.vehicle.services.files import VehicleFiles, checked, refuse_device
from gcs_server.vehicle.services.ftp_codec import FtpFailed
from gcs_server.vehicle.services.ftp_pieces import PartialFile
from gcs_server.vehicle.vehicle import Vehicle

MAX_BYTES = 512_000_000
MAX_KEPT, MAX_KEPT_BYTES = 100, 1_000_000_000
"""Downloaded files that the server keeps, the newest; the vehicle still has all of them."""
ID = re.compile(r"[0-9a-f]{16}")
_UNSAFE = re.compile(r"[^\w.-]+", re.ASCII)
MAX_NAME = 120


class FileDownloads:
    """The downloads of one server.

    Args:
        clock: the server's clock.
        folder: folder for the files; made when needed.
        transfers: the downloads of the server, of logs too.
        vehicle: returns a vehicle by its id; raises UnknownVehicle.
    """

    def __init__(
        self, clock: Clock, folder: Path, transfers: Transfers, vehicle: Callable[[str], Vehicle]
    ) -> None:
        self._folder, self._transfers, self._vehicle = folder, transfers, vehicle
        self._partial = PartialLogs(folder, clock)

    def path_of(self, vehicle_id: str, file: str) -> tuple[Path, str] | None:
        """(path, name) of a downloaded file; None: there is none. Blocks.

        Args:
            vehicle_id: the vehicle.
            file: `file` of the download's result.
        """
        if ID.fullmatch(file) is None:
            return None
        prefix = f"{_plain(vehicle_id)}-{file}-"
        found = [path for path in _files(self._folder) if path.name.startswith(prefix)]
        return (found[0], found[0].name.removeprefix(prefix)) if found else None

    async def run(self, vehicle_id: str, path: str, report: ReportProgress) -> dict[str, object]:
        """Downloads a file; the result of the operation.

        Raises:
            InvalidRequest: not a path, no such file, or it is too large.
            Refused: its links carry no files, it is a device, or the disk is full.
            FtpFailed: the vehicle refused, or the file changed meanwhile.
            Disconnected, NoReply: the vehicle did not come back.
            LogUnusable: what arrived differs from the vehicle's checksum.
            UnknownVehicle: the vehicle was removed.
        """
        path = checked(path, "path")
        refuse_device(path)
        size: int | None = None

        async def attempt() -> dict[str, object]:
            nonlocal size
            size = await self._size(vehicle_id, path)
            return await self._download(vehicle_id, path, size, report)

        def arrived() -> int:
            return 0 if size is None else self._partial.received_bytes(_key(vehicle_id, path, size), size)

        return await self._transfers.until_done(vehicle_id, attempt, arrived, report)

    async def _size(self, vehicle_id: str, path: str) -> int:
        files = self._vehicle(vehicle_id).service(VehicleFiles)
        files.require_disarmed()
        entry = await files.entry(path)
        if entry is None or entry.bytes is None:
            text = f"{path} is a folder." if entry is not None else f"There is no file {path} on the vehicle."
            raise InvalidRequest("path", text, remedy="List the folder, then give a file in it.")
        if entry.bytes > MAX_BYTES:
            text = f"{path} has {entry.bytes:,} bytes; more than {MAX_BYTES:,} are not downloaded."
            raise InvalidRequest("path", text, remedy="Take it from the vehicle's memory card.")
        return entry.bytes

    async def _download(
        self, vehicle_id: str, path: str, size: int, report: ReportProgress
    ) -> dict[str, object]:
        vehicle = self._vehicle(vehicle_id)
        files = vehicle.service(VehicleFiles)
        partial = await asyncio.to_thread(self._partial.open, _key(vehicle_id, path, size), size)

        def same_file(opened: int) -> PartialFile:
            if opened != size:
                raise FtpFailed(f"{path} has {opened:,} bytes instead of {size:,}.", path=path)
            return partial.file

        async def read(progress: Callable[[int, int], None]) -> None:
            def report_disarmed(received: int, total: int) -> None:
                files.require_disarmed()
                progress(received, total)

            files.require_disarmed()
            await vehicle.ftp.read_parts(path, same_file, report_disarmed)

        await self._transfers.receive(vehicle_id, partial, report, read)
        report("Received. The vehicle computes its checksum.", 1.0)
        verified = await self._transfers.verified(vehicle_id, path, partial)
        file, name = _id(vehicle_id, path), _safe(path)

        def keep() -> None:
            if (old := self.path_of(vehicle_id, file)) is not None:
                old[0].unlink(missing_ok=True)
            partial.finish(self._folder / f"{_plain(vehicle_id)}-{file}-{name}")
            self._drop_old()

        await asyncio.to_thread(keep)
        return {"file": file, "name": name, "size_bytes": size, "verified": "crc32" if verified else "size"}

    def _drop_old(self) -> None:
        newest_first = sorted(_files(self._folder), key=lambda path: path.stat().st_mtime, reverse=True)
        kept_bytes = 0
        for n, path in enumerate(newest_first):
            kept_bytes += path.stat().st_size
            if n > 0 and (n >= MAX_KEPT or kept_bytes > MAX_KEPT_BYTES):
                with contextlib.suppress(OSError):
                    path.unlink()


def _files(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*") if not path.name.startswith(".")]


def _plain(vehicle_id: str) -> str:
    return vehicle_id.replace("~", "-")


def _id(vehicle_id: str, path: str) -> str:
    return hashlib.sha256(f"{vehicle_id} {path}".encode()).hexdigest()[:16]


def _key(vehicle_id: str, path: str, size: int) -> str:
    return f"{_plain(vehicle_id)}-{_id(vehicle_id, path)}-{size}"


def _safe(path: str) -> str:
    """The file's name in letters that every file system has."""
    return _UNSAFE.sub("-", path.rpartition("/")[2])[-MAX_NAME:].lstrip(".-") or "file"
