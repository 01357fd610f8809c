"""Writes one open file, several requests at a time. A request that is repeated late is executed again, which
changes nothing: it has its offset."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator

from gcs_server.clock import Clock
from gcs_server.vehicle.services import ftp_codec as codec
from gcs_server.vehicle.services.ftp_codec import FtpFailed, Opcode, Packet
from gcs_server.vehicle.services.ftp_pieces import PartialFile
from gcs_server.vehicle.services.ftp_window import RequestWindow, Session

EXTRA_REPLIES, REPLIES_PER_PIECE = 256, 16
YIELD_AFTER_REPLIES = 32


class Upload:
    """The content of one open, empty file.

    Args:
        client: the client that has opened the file.
        vehicle_id: the vehicle, for the texts of errors.
        clock: the vehicle's clock.
        path: path on the vehicle.
        session: number of the session.
        content: what is written.
        progress: called with (written, total) bytes; what it raises ends the upload.
    """

    def __init__(
        self,
        client: Session,
        vehicle_id: str,
        clock: Clock,
        path: str,
        session: int,
        content: bytes,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self._path, self._session, self._content, self._progress = path, session, content, progress
        self._written = PartialFile(len(content))
        """What the vehicle has acknowledged."""
        self._replies_left = EXTRA_REPLIES + REPLIES_PER_PIECE * (len(content) // codec.DATA_BYTES)
        silent = f"Vehicle {vehicle_id} did not answer: writing {path}."
        self._window = RequestWindow(client, clock, silent)

    async def run(self) -> None:
        """Writes the file.

        Raises:
            FtpFailed: the vehicle refused, wrote less than it was given, or answers endlessly.
            NoReply: the vehicle stopped answering.
            Disconnected: the vehicle was lost.
        """

        def missing() -> Iterator[Packet]:
            for start, end in self._written.missing_pieces(codec.DATA_BYTES, self._written.size):
                data = self._content[start:end]
                yield Packet(0, Opcode.WRITE_FILE, self._session, len(data), offset=start, data=data)

        await self._window.run(Opcode.WRITE_FILE, missing, self._take, self._count_reply)

    def _take(self, reply: Packet, request: Packet) -> None:
        if reply.opcode == Opcode.NAK:
            raise codec.refusal(reply, self._path, "Writing")
        written = int.from_bytes(reply.data[:4], "little")
        if len(reply.data) < 4 or written != request.size:
            raise FtpFailed(
                f"Writing {self._path}: the vehicle wrote only {written} of {request.size} bytes.",
                path=self._path,
                remedy="Its memory card may be full.",
            )
        self._written.put(request.offset, request.data)
        if self._progress is not None:
            self._progress(self._written.received, self._written.size)

    async def _count_reply(self) -> None:
        self._replies_left -= 1
        if self._replies_left < 0:
            raise FtpFailed(
                f"Writing {self._path}: the vehicle sends too many replies, so the server gave up.",
                path=self._path,
            )
        if self._replies_left % YIELD_AFTER_REPLIES == 0:
            await asyncio.sleep(0)
