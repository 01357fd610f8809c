"""The vehicle's own description of its parameters and events, fetched by FTP only when asked for.

COMPONENT_METADATA names a general document and its checksum, and that one names the others. What was fetched
once is kept by its checksum: a vehicle of the same firmware is asked for one message and no file. Addresses
on the internet that these documents name are never followed.
"""

from __future__ import annotations

import asyncio
import functools
import json
import lzma
import re
import zlib
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from gcs_server.errors import GcsError, NoReply
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.mailbox import Reply
from gcs_server.storage.cache import Cache
from gcs_server.vehicle import event_definitions, param_facts
from gcs_server.vehicle.event_definitions import Definitions
from gcs_server.vehicle.param_facts import Facts
from gcs_server.vehicle.services.ftp import FtpService
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import is_our_ack

PARAMETERS, EVENTS = 1, 4
"""COMP_METADATA_TYPE."""
NAMES = {PARAMETERS: "parameters", EVENTS: "events"}
ASK_TIMES, ASK_EVERY_S = 6, 0.5
MOST_BYTES = 32_000_000
"""A document that unpacks to more is not what it claims to be."""
FETCH_TIMES = 2
_uri = re.compile(r"mftp://(?:\[?;comp=(\d+)\]?)?/?(.+)")

Result = TypeVar("Result")
Aside = Callable[[Callable[[], Any]], Awaitable[Any]]
"""Runs a function where it does not hold up the event loop."""


class MetadataMissing(GcsError):
    """The vehicle has no description of this kind, or it is not readable."""

    code = "metadata_missing"


class MetadataService:
    """One vehicle's.

    Args:
        vehicle: whose.
        ftp: reads its files.
        cache: where documents are kept; None keeps none.
        aside: `asyncio.to_thread` but in tests.
    """

    def __init__(
        self,
        vehicle: VehiclePort,
        ftp: FtpService,
        cache: Cache | None = None,
        aside: Aside = asyncio.to_thread,
    ) -> None:
        self._vehicle = vehicle
        self._ftp = ftp
        self.cache = cache
        self.aside = aside
        self._lock = asyncio.Lock()
        self._parsed: dict[int, tuple[int, Any]] = {}
        """By kind: (checksum, what it says)."""

    def keep_in(self, cache: Cache) -> None:
        """From now on."""
        self.cache = cache

    async def parameters(self) -> Facts:
        """Of all parameters the firmware has; by name.

        Raises:
            MetadataMissing, FtpFailed, NoReply: it could not be had.
        """
        return await self._load(PARAMETERS, param_facts.parse)

    async def events(self) -> Definitions:
        """Of all events the firmware has; raises as `parameters`."""
        return await self._load(EVENTS, event_definitions.parse)

    async def _load(self, kind: int, parse: Callable[[bytes], Result]) -> Result:
        self._vehicle.require_commandable()
        async with self._lock:
            general = await self._general()
            entry = next((t for t in general if t.get("type") == kind), None)
            if entry is None:
                raise MetadataMissing(f"Vehicle {self._vehicle.id} describes no {NAMES[kind]}.")
            crc = int(entry.get("fileCrc", 0))
            held = self._parsed.get(kind)
            if held is not None and held[0] == crc and crc:
                return held[1]
            content = await self._document(str(entry.get("uri", "")), crc)
            parsed = await self.aside(lambda: _read(parse, content, self._vehicle.id, NAMES[kind]))
            self._parsed[kind] = (crc, parsed)
            return parsed

    async def _general(self) -> list[dict[str, Any]]:
        message = await self._announced()
        content = await self._document(_text(message.uri), int(message.file_crc))
        document = await self.aside(lambda: _read(json.loads, content, self._vehicle.id, "metadata"))
        types = document.get("metadataTypes") if isinstance(document, dict) else None
        return [t for t in types or [] if isinstance(t, dict)]

    async def _announced(self) -> Reply:
        """COMPONENT_METADATA."""
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
            for _ in range(ASK_TIMES):
                vehicle.send(request)
                try:
                    async with asyncio.timeout(ASK_EVERY_S):
                        while True:
                            message = await waiter.next()
                            if message.get_msgId() == ids[0]:
                                if message.get_srcComponent() == identity.component_id:
                                    return message
                            elif is_our_ack(message, vehicle, d.MAV_CMD_REQUEST_MESSAGE) and (
                                message.result not in (d.MAV_RESULT_ACCEPTED, d.MAV_RESULT_IN_PROGRESS)
                            ):
                                refusals += 1  # it may be meant for another request: a second try tells
                                break
                except TimeoutError:
                    continue
                if refusals > 1:
                    raise MetadataMissing(
                        f"Vehicle {vehicle.id} does not describe itself.",
                        remedy="Its firmware may be too old; parameters can be set without ranges and units.",
                    )
        raise NoReply(
            f"Vehicle {vehicle.id} did not say where its metadata are.", deadline_s=ASK_TIMES * ASK_EVERY_S
        )

    async def _document(self, uri: str, crc: int) -> bytes:
        """Unpacked; from the cache, or fetched and kept."""
        name = f"metadata-{crc:08x}.json"
        cache = self.cache if crc else None
        if cache is not None:
            kept: bytes | None = await self.aside(functools.partial(cache.read, name))
            if kept is not None:
                return kept
        match = _uri.fullmatch(uri)
        component = self._vehicle.identity.component_id
        if match is None or match[1] not in (None, str(component)):
            raise MetadataMissing(
                f"Vehicle {self._vehicle.id} keeps its metadata at {uri!r}, not in its own files.",
                remedy="Addresses on the internet are not followed.",
            )
        for _ in range(FETCH_TIMES):
            packed = await self._ftp.read(match[2])
            content = await self.aside(functools.partial(_unpacked, packed, crc))
            if content is not None:
                if cache is not None:
                    await self.aside(functools.partial(cache.write, name, content))
                return content
        raise MetadataMissing(
            f"{match[2]} of vehicle {self._vehicle.id} is not what its checksum says.",
            remedy="Try again on a better link.",
        )


def crc32(data: bytes) -> int:
    """As MAVLink wants it: start value and final XOR zero."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _unpacked(packed: bytes, crc: int) -> bytes | None:
    """None where the checksum is neither the packed file's nor (as for PX4's general one) the content's."""
    content: bytes | None = packed
    if packed[:6] == b"\xfd7zXZ\0":
        unpacker = lzma.LZMADecompressor(memlimit=MOST_BYTES * 4)
        try:
            content = unpacker.decompress(packed, max_length=MOST_BYTES)
        except lzma.LZMAError:
            content = None
        if content is not None and not unpacker.eof:
            content = None
    if content is None or (crc and crc not in (crc32(packed), crc32(content))):
        return None
    return content


def _read(parse: Callable[[bytes], Result], content: bytes, vehicle: str, what: str) -> Result:
    try:
        return parse(content)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise MetadataMissing(
            f"The {what} that vehicle {vehicle} describes cannot be read: {error}."
        ) from error


def _text(value: str | bytes) -> str:
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return text.rstrip("\0")
