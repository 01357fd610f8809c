"""Metadata of a vehicle's parameters, events and outputs, read from the vehicle by FTP on request.

COMPONENT_METADATA names a general document and its checksum; the general document names the other documents.
Fetched files are cached by vehicle and checksum, so the next time only one message is requested. The server
never opens internet addresses in these documents. The files are untrusted: their size is limited, and a
separate process reads them (`metadata_process.py`).
"""

from __future__ import annotations

import asyncio
import functools
import re
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from gcs_server.errors import GcsError, NoReply
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.mailbox import Reply
from gcs_server.storage.cache import Cache
from gcs_server.vehicle import metadata_files
from gcs_server.vehicle.actuator_document import Output
from gcs_server.vehicle.event_definitions import Definitions
from gcs_server.vehicle.metadata_files import ACTUATORS, EVENTS, PARAMETERS, Damaged, FileEntry
from gcs_server.vehicle.metadata_limits import Document
from gcs_server.vehicle.metadata_process import DocumentReader
from gcs_server.vehicle.param_metadata import MetadataByName
from gcs_server.vehicle.services.ftp import FtpService
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import is_our_ack

NAMES = {PARAMETERS: "parameters", EVENTS: "events", ACTUATORS: "outputs"}
MAX_REQUESTS, REQUEST_PERIOD_S = 6, 0.5
MAX_FETCHES = 2
_uri = re.compile(r"mftp://(?:\[?;comp=(\d{1,3})\]?)?/?(.{1,200})")

RunInThread = Callable[[Callable[[], Any]], Awaitable[Any]]
"""Runs a function without blocking the event loop."""
ReadDocument = Callable[[int, bytes, int], Awaitable[Document[Any, Any]]]
"""(kind, packed file, its checksum) → document; raises Damaged or ValueError."""

Result = TypeVar("Result")

_reader = DocumentReader()
"""One reader for the whole server, which reads the files of all vehicles one after the other."""


class MetadataMissing(GcsError):
    """The vehicle has no metadata of this kind, or the metadata is unreadable."""

    code = "metadata_missing"


class MetadataService:
    """Metadata of one vehicle.

    Args:
        vehicle: the vehicle.
        ftp: reads the vehicle's files.
        cache: stores documents; None: no cache.
        run_in_thread: `asyncio.to_thread`, except in tests.
        read: reads a file in a separate process, except in tests.
    """

    def __init__(
        self,
        vehicle: VehiclePort,
        ftp: FtpService,
        cache: Cache | None = None,
        run_in_thread: RunInThread = asyncio.to_thread,
        read: ReadDocument = _reader.read,
    ) -> None:
        self._vehicle = vehicle
        self._ftp = ftp
        self.cache = cache
        self.run_in_thread = run_in_thread
        self.read = read
        self._lock = asyncio.Lock()
        self._parsed: dict[int, tuple[int, Document[Any, Any]]] = {}
        """By kind: (checksum, document)."""

    def set_cache(self, cache: Cache) -> None:
        """Sets the cache."""
        self.cache = cache

    async def parameters(self) -> MetadataByName:
        """Metadata of all parameters of the firmware, by name.

        Raises:
            MetadataMissing, FtpFailed, NoReply: the metadata is not available.
        """
        return await self._load(PARAMETERS)

    async def events(self) -> Definitions:
        """Metadata of all events of the firmware; raises the errors of `parameters`."""
        return await self._load(EVENTS)

    async def outputs(self) -> Document[str, Output]:
        """The vehicle's outputs by the parameter of their function; raises the errors of `parameters`."""
        return await self._load(ACTUATORS)

    async def _load(self, kind: int) -> Document[Any, Any]:
        self._vehicle.require("files")
        async with self._lock:
            general = await self._read_general()
            entry = next((e for e in general if e.kind == kind), None)
            if entry is None:
                raise MetadataMissing(
                    f"Vehicle {self._vehicle.id} provides no metadata of its {NAMES[kind]}."
                )
            parsed = self._parsed.get(kind)
            if parsed is not None and parsed[0] == entry.crc and entry.crc:
                return parsed[1]
            document = await self._document(entry, NAMES[kind], functools.partial(self.read, kind))
            self._parsed[kind] = (entry.crc, document)
            return document

    async def _read_general(self) -> list[FileEntry]:
        message = await self._request_announcement()
        entry = FileEntry(0, _decode_text(message.uri), int(message.file_crc))

        async def read(packed: bytes, crc: int) -> list[FileEntry]:
            return await self.run_in_thread(functools.partial(metadata_files.read_general, packed, crc))

        max_bytes = metadata_files.MAX_GENERAL_PACKED_BYTES
        return await self._document(entry, "general", read, max_bytes)

    async def _request_announcement(self) -> Reply:
        """Requests COMPONENT_METADATA."""
        vehicle, identity = self._vehicle, self._vehicle.identity
        ids = (d.MAVLINK_MSG_ID_COMPONENT_METADATA, d.MAVLINK_MSG_ID_COMMAND_ACK)
        request = d.MAVLink_command_long_message(
            identity.system_id,
            identity.component_id,
            d.MAV_CMD_REQUEST_MESSAGE,
            0,
            float(ids[0]),
            *(0.0,) * 6,
        )
        refusals = 0
        with vehicle.mailbox.expect(*ids) as waiter:
            for _ in range(MAX_REQUESTS):
                vehicle.send(request)
                try:
                    async with asyncio.timeout(REQUEST_PERIOD_S):
                        while True:
                            message = await waiter.next()
                            if message.get_msgId() == ids[0]:
                                if message.get_srcComponent() == identity.component_id:
                                    return message
                            elif is_our_ack(message, vehicle, d.MAV_CMD_REQUEST_MESSAGE) and (
                                message.result not in (d.MAV_RESULT_ACCEPTED, d.MAV_RESULT_IN_PROGRESS)
                            ):
                                refusals += (
                                    1  # the refusal may answer another request, so the server requests again
                                )
                                break
                except TimeoutError:
                    continue
                if refusals > 1:
                    raise MetadataMissing(
                        f"Vehicle {vehicle.id} provides no component metadata.",
                        remedy="Its firmware may be too old; parameters can be set without ranges and units.",
                    )
        raise NoReply(
            f"Vehicle {vehicle.id} did not report where its metadata is.",
            deadline_s=MAX_REQUESTS * REQUEST_PERIOD_S,
        )

    async def _document(
        self,
        entry: FileEntry,
        kind_name: str,
        read: Callable[[bytes, int], Awaitable[Result]],
        max_bytes: int = metadata_files.MAX_PACKED_BYTES,
    ) -> Result:
        """Reads a document from the cache, or fetches and caches it."""
        name, cache = self._cache_name(entry.crc), self.cache if entry.crc else None
        cached: bytes | None = None
        if cache is not None:
            cached = await self.run_in_thread(functools.partial(cache.read, name))
        for attempt in range(MAX_FETCHES + 1):
            packed = cached if cached is not None else await self._fetch(entry.uri, max_bytes)
            try:
                result = await read(packed, entry.crc)
            except Damaged as error:
                if cached is None and attempt >= MAX_FETCHES - 1:
                    raise self._unusable(kind_name, error, "Try again on a better link.") from error
                cached = None
                continue
            except (ValueError, RecursionError) as error:
                raise self._unusable(kind_name, error) from error
            if cache is not None and cached is None:
                await self.run_in_thread(functools.partial(cache.write, name, packed))
            return result
        raise AssertionError("the loop returns or raises")

    async def _fetch(self, uri: str, max_bytes: int) -> bytes:
        match = _uri.fullmatch(uri)
        component = self._vehicle.identity.component_id
        if match is None or match[1] not in (None, str(component)):
            raise MetadataMissing(
                f"Vehicle {self._vehicle.id} stores its metadata at {uri!r}, not in its own files.",
                remedy="The server does not open internet addresses.",
            )
        return await self._ftp.read(match[2], max_bytes=max_bytes)

    def _unusable(self, kind_name: str, error: Exception, remedy: str | None = None) -> MetadataMissing:
        return MetadataMissing(
            f"The metadata ({kind_name}) of vehicle {self._vehicle.id} cannot be used: {error}.",
            remedy=remedy,
        )

    def _cache_name(self, crc: int) -> str:
        """Name of the cached file. It includes the vehicle, because another vehicle could forge a
        checksum."""
        identity = self._vehicle.identity
        uid = "".join(c for c in identity.uid or "none" if c.isascii() and c.isalnum())[:40]
        return f"metadata-{uid}-{identity.system_id}-{crc:08x}"


def _decode_text(value: str | bytes) -> str:
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return text.rstrip("\0")
