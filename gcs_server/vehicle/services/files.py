"""The vehicle's files as a person sees them: lists, writes, removes (reads: `logbook/file_downloads.py`).

Nothing is written while the vehicle is armed, nor devices. A file is written beside the old one, read back by
its checksum, and only then takes its place: what ends early leaves the old file as it was.
"""

from __future__ import annotations

import asyncio
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from gcs_server.errors import Disconnected, GcsError, InvalidRequest, Refused
from gcs_server.vehicle.px4.file_dangers import FileDanger, danger_of
from gcs_server.vehicle.services import ftp_codec as codec
from gcs_server.vehicle.services.ftp_codec import DirectoryEntry, FtpError, FtpFailed, Opcode
from gcs_server.vehicle.services.port import VehiclePort
from missions.values import hidden_character

MAX_PATH_BYTES = 200
MAX_WRITTEN_PATH_BYTES = 110
"""Twice in one packet, to rename."""
MAX_WRITTEN_BYTES = 700_000
PART = ".part"
"""End of the name beside the old file."""
CHECK_BYTES_S = 100_000
"""A checksum is awaited as long as reading takes at this rate."""
TIDY_S = 5.0


@dataclass(frozen=True, slots=True)
class FileEntry:
    """One entry of a folder on the vehicle."""

    name: str
    """Name in the folder."""
    path: str
    """Path on the vehicle."""
    size_bytes: int | None
    """Size [bytes]; null: a folder."""
    danger: FileDanger | None
    """What hangs on it; null: nothing that is known."""


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder on the vehicle."""

    path: str
    """Path on the vehicle, without a slash at its end."""
    danger: FileDanger | None
    """What hangs on files written here; null: nothing that is known."""
    entries: tuple[FileEntry, ...]
    """Folders first, by name."""


class VehicleFiles:
    """The files of one vehicle."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle

    async def list(self, path: str) -> Folder:
        """Lists a folder.

        Raises:
            InvalidRequest: not a path.
            FtpFailed, NoReply, Disconnected: see `FtpService.list`.
        """
        path = checked(path, "path")
        entries = [
            FileEntry(each.name, joined(path, each.name), each.bytes, danger_of(joined(path, each.name)))
            for each in await self._vehicle.ftp.list(path or "/")
            if each.name and "/" not in each.name
        ]
        entries.sort(key=lambda each: (each.size_bytes is not None, each.name.lower(), each.name))
        return Folder(path, danger_of(joined(path, "a")), tuple(entries))

    async def entry(self, path: str) -> DirectoryEntry | None:
        """What is at a path; None: nothing. Raises the errors of `list`."""
        parent, _, name = path.rpartition("/")
        entries = await self._vehicle.ftp.list(parent or "/")
        same = [each for each in entries if each.name == name]
        return same[0] if same else None

    async def put(self, path: str, content: bytes, progress: Callable[[int, int], None]) -> None:
        """Writes a file in place of an earlier one, if there is one.

        Args:
            path: path on the vehicle.
            content: at most MAX_WRITTEN_BYTES.
            progress: called with (written, total) bytes.

        Raises:
            InvalidRequest: not a path, or the content is too large.
            Refused: the vehicle is armed, or there is a folder.
            FtpFailed, NoReply, Disconnected: see `FtpService.write`; the earlier file is as it was, unless
                the error says otherwise.
        """
        path = self.writable(path)
        if len(content) > MAX_WRITTEN_BYTES:
            raise InvalidRequest(
                "content_base64",
                f"The file has {len(content):,} bytes; at most {MAX_WRITTEN_BYTES:,} are written.",
                remedy="Write it to the memory card in a reader.",
            )
        self.require_disarmed()
        existing = await self.entry(path)
        if existing is not None and existing.bytes is None:
            raise Refused(f"{path} is a folder.", remedy="Choose another name.")
        part = path + PART

        def report(written: int, total: int) -> None:
            self.require_disarmed()
            progress(written, total)

        keep_part = False
        try:
            await self._vehicle.ftp.write(part, content, report)
            await self._compare(part, content)
            if not await self._renamed(part, path, content, exists=existing is not None):
                keep_part = True
                await self._replace(part, path)
        except Disconnected:
            raise
        except BaseException:
            if not keep_part:
                await self._tidy(part, path)
            raise

    async def remove(self, path: str) -> None:
        """Removes a file, or an empty folder.

        Raises:
            InvalidRequest: not a path, or there is nothing.
            Refused: the vehicle is armed, or it is a device.
            FtpFailed, NoReply, Disconnected: the vehicle refused, does not answer, or was lost.
        """
        path = self.writable(path)
        self.require_disarmed()
        existing = await self.entry(path)
        if existing is None:
            raise InvalidRequest("path", f"There is no {path} on the vehicle.", remedy="List the folder.")
        opcode = Opcode.REMOVE_DIRECTORY if existing.bytes is None else Opcode.REMOVE_FILE
        self.require_disarmed()
        try:
            await self._vehicle.ftp.change(codec.request(opcode, 0, path=path), path, "Removing")
        except FtpFailed as error:
            if error.ftp_error != FtpError.FILE_NOT_FOUND:  # the reply to the first request was lost
                raise

    async def make_folder(self, path: str) -> None:
        """Makes a folder.

        Raises:
            InvalidRequest: not a path, or it exists.
            Refused: the vehicle is armed, or it is a device.
            FtpFailed, NoReply, Disconnected: the vehicle refused, does not answer, or was lost.
        """
        path = self.writable(path)
        self.require_disarmed()
        if await self.entry(path) is not None:
            raise InvalidRequest("path", f"{path} already exists.", remedy="Choose another name.")
        self.require_disarmed()
        try:
            request = codec.request(Opcode.CREATE_DIRECTORY, 0, path=path)
            await self._vehicle.ftp.change(request, path, "Making the folder")
        except FtpFailed as error:
            if error.ftp_error != FtpError.FILE_EXISTS:  # the reply to the first request was lost
                raise

    def writable(self, path: str) -> str:
        """The path, if it may be changed; raises InvalidRequest or Refused."""
        path = checked(path, "path", MAX_WRITTEN_PATH_BYTES)
        if not path:
            raise InvalidRequest("path", "The path names no file.", remedy="Add a name.")
        refuse_device(path)
        return path

    def require_disarmed(self) -> None:
        """Raises Refused if the vehicle is armed, or its links carry no files."""
        vehicle = self._vehicle
        vehicle.require("files")
        if vehicle.flight_state.armed:
            raise Refused(
                f"Vehicle {vehicle.id} is armed; its files are neither read nor changed now.",
                remedy="Land and disarm, then try again.",
            )

    async def _compare(self, part: str, content: bytes) -> None:
        """Compares what was written with the vehicle's checksum, or by reading it where it computes none."""
        ftp = self._vehicle.ftp
        try:
            same = await ftp.crc32(part, wait_s=len(content) / CHECK_BYTES_S) == mavlink_crc32(content)
        except FtpFailed as error:
            if error.ftp_error != FtpError.UNKNOWN_COMMAND:
                raise
            same = await ftp.read(part, max_bytes=MAX_WRITTEN_BYTES) == content
        if not same:
            raise FtpFailed(
                f"What the vehicle has stored as {part} differs from what was sent.",
                path=part,
                remedy="Try again; its memory card may be damaged.",
            )

    async def _renamed(self, part: str, path: str, content: bytes, *, exists: bool) -> bool:
        """Gives the checked file its name; False: the file system does not replace the old one."""
        self.require_disarmed()
        try:
            await self._vehicle.ftp.change(codec.rename_request(part, path), path, "Renaming")
        except FtpFailed as error:
            if error.ftp_error == FtpError.FILE_NOT_FOUND:  # the reply to the first request was lost
                await self._compare(path, content)
                return True
            if not exists or error.ftp_error == FtpError.FILE_PROTECTED:
                raise
            return False
        return True

    async def _replace(self, part: str, path: str) -> None:
        """Removes the old file, then gives the checked one its name."""
        ftp = self._vehicle.ftp
        self.require_disarmed()
        try:
            with suppress(FtpFailed):  # if it is still there, renaming fails
                await ftp.change(codec.request(Opcode.REMOVE_FILE, 0, path=path), path, "Removing")
            await ftp.change(codec.rename_request(part, path), path, "Renaming")
        except GcsError as error:
            raise FtpFailed(
                f"The new content is on the vehicle as {part}, and {path} may be gone: {error}",
                path=path,
                remedy="Write the file again before the vehicle is restarted.",
            ) from error

    async def _tidy(self, part: str, path: str) -> None:
        """Removes what was written beside the old file."""
        with suppress(GcsError, TimeoutError):
            async with asyncio.timeout(TIDY_S):
                request = codec.request(Opcode.REMOVE_FILE, 0, path=part)
                await self._vehicle.ftp.change(request, path, "Removing")


def checked(path: str, field: str, max_bytes: int = MAX_PATH_BYTES) -> str:
    """A path on a vehicle, without slashes at its end and without double ones.

    Raises:
        InvalidRequest: it is too long, has hidden characters, or `.` or `..` in it, so that what hangs on it
            could not be told.
    """
    parts = [part for part in path.split("/") if part]
    fault = None
    if len(path.encode("utf-8", "replace")) > max_bytes:
        fault = f"is longer than {max_bytes} bytes"
    elif hidden_character(path) is not None or "\\" in path or "\t" in path:
        fault = "has a character that a path may not have"
    elif any(part in (".", "..") for part in parts):
        fault = "has . or .. in it"
    if fault is not None:
        raise InvalidRequest(field, f"The path {fault}.", remedy="Give the path as the list shows it.")
    return ("/" if path.startswith("/") else "") + "/".join(parts) if parts else ""


def refuse_device(path: str) -> None:
    """Raises Refused for devices, which may answer never, or act."""
    if danger_of(path) == "device":
        raise Refused(
            f"{path} is no file but a device or a view of the running system.",
            remedy="Use the vehicle's console.",
        )


def joined(folder: str, name: str) -> str:
    """Path of an entry of a folder; the root of a vehicle in simulation is its working folder."""
    return f"{folder}/{name}" if folder else f"/{name}"


def mavlink_crc32(content: bytes) -> int:
    """MAVLink's checksum: start value and final XOR are zero."""
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF
