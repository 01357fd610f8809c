"""Unpacks, checks and reads a vehicle's metadata files within limits, in a separate process
(`metadata_process.py`). Only the small general file is read in the server.
"""

from __future__ import annotations

import lzma
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec

from gcs_server.vehicle import actuator_document, event_document, param_document
from gcs_server.vehicle.actuator_document import Output
from gcs_server.vehicle.event_definitions import Definition
from gcs_server.vehicle.metadata_limits import Document, OmittedEntries, cut
from gcs_server.vehicle.param_metadata import ParamMetadata

PARAMETERS, EVENTS, ACTUATORS = 1, 4, 5
"""COMP_METADATA_TYPE."""
MAX_PACKED_BYTES, MAX_BYTES = 2_000_000, 8_000_000
"""Limits of a file; PX4's largest file has 60 kB, and 0.8 MB unpacked."""
MAX_GENERAL_PACKED_BYTES, MAX_GENERAL_BYTES = 16_000, 64_000
MAX_GENERAL_ENTRIES, MAX_URI_LENGTH = 32, 200
MAX_OUTPUT_BYTES = 3_000_000
"""Maximum size of the encoded document, which takes about three times as much memory in the server. PX4's
largest has 0.6 MB."""
BATCH = 50
"""Number of entries that are decoded in one call, during which no other thread runs."""
MAX_PROBLEM_LENGTH = 200
DECODER_MEMORY_BYTES = 100_000_000
"""Memory limit of the xz decoder. A file packed with xz -9 needs a limit of 65 MB, even if it is small."""
XZ_MAGIC = b"\xfd7zXZ\0"


class Damaged(ValueError):
    """The file does not match its checksum or is incomplete, perhaps because of a damaged transfer."""


@dataclass(frozen=True, slots=True)
class FileEntry:
    """One entry of the general file."""

    kind: int
    """COMP_METADATA_TYPE."""
    uri: str
    crc: int
    """0: no checksum."""


class _General(msgspec.Struct, rename="camel"):
    metadata_types: list[msgspec.Raw] = []


class _FileEntry(msgspec.Struct, rename="camel"):
    type: int
    uri: str
    file_crc: int = 0


class ReaderOutput(msgspec.Struct, frozen=True):
    """Output of the reading process."""

    problem: str | None = None
    """Why the file cannot be used."""
    is_damaged: bool = False
    omission_text: str | None = None
    batches: tuple[bytes, ...] = ()
    """Encoded entries, `BATCH` each."""


_output = msgspec.msgpack.Decoder(ReaderOutput)
_encoder = msgspec.msgpack.Encoder()
_parsers: dict[int, Callable[[bytes], Document[Any, Any]]] = {
    PARAMETERS: param_document.parse,
    EVENTS: event_document.parse,
    ACTUATORS: actuator_document.parse,
}
_decoders: dict[int, msgspec.msgpack.Decoder[Any]] = {
    PARAMETERS: msgspec.msgpack.Decoder(list[tuple[str, ParamMetadata]]),
    EVENTS: msgspec.msgpack.Decoder(list[tuple[int, Definition]]),
    ACTUATORS: msgspec.msgpack.Decoder(list[tuple[str, Output]]),
}


def crc32(data: bytes) -> int:
    """MAVLink's CRC32: start value and final XOR are zero."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def unpacked(packed: bytes, crc: int, max_bytes: int = MAX_BYTES) -> bytes:
    """Unpacks a file, if it is packed.

    Args:
        packed: the file.
        crc: checksum of the file, or of its content as in PX4's general file; 0: no checksum.
        max_bytes: larger content is refused before it is completely unpacked.

    Raises:
        Damaged: the checksum differs, or the file cannot be unpacked.
        ValueError: the content is too large.
    """
    content = packed
    if packed.startswith(XZ_MAGIC):
        unpacker = lzma.LZMADecompressor(memlimit=DECODER_MEMORY_BYTES)
        try:
            content = unpacker.decompress(packed, max_length=max_bytes + 1)
        except lzma.LZMAError as error:
            raise Damaged(f"it cannot be unpacked ({error})") from error
        if len(content) <= max_bytes and not unpacker.eof:
            raise Damaged("it is incomplete")
    if len(content) > max_bytes:
        raise ValueError(f"unpacked it has more than {max_bytes:,} bytes")
    if crc and crc not in (crc32(packed), crc32(content)):
        raise Damaged("its checksum does not match")
    return content


def read_general(packed: bytes, crc: int) -> list[FileEntry]:
    """Reads the general file, which lists the other files; it is small enough to read in the event loop.

    Raises:
        Damaged: see `unpacked`.
        ValueError: the text is not a general file.
    """
    content = unpacked(packed, crc, MAX_GENERAL_BYTES)
    entries: list[FileEntry] = []
    for raw in msgspec.json.decode(content, type=_General).metadata_types[:MAX_GENERAL_ENTRIES]:
        try:
            entry = msgspec.json.decode(raw, type=_FileEntry)
        except (ValueError, RecursionError):
            continue
        if len(entry.uri) <= MAX_URI_LENGTH:
            entries.append(FileEntry(entry.type, entry.uri, entry.file_crc & 0xFFFFFFFF))
    return entries


def encode_document(kind: int, packed: bytes, crc: int) -> bytes:
    """Reads a file and encodes its entries; a problem is part of the output. Runs in
    `metadata_process.py`."""
    try:
        document = _parsers[kind](unpacked(packed, crc))
    except (ValueError, RecursionError, MemoryError) as error:
        problem = cut(str(error) or type(error).__name__, MAX_PROBLEM_LENGTH)
        return _encoder.encode(ReaderOutput(problem, isinstance(error, Damaged)))
    batches: list[bytes] = []
    size = encoded_count = 0
    items = list(document.items())
    while encoded_count < len(items):
        batch = _encoder.encode(items[encoded_count : encoded_count + BATCH])
        if size + len(batch) > MAX_OUTPUT_BYTES:
            break
        batches.append(batch)
        size += len(batch)
        encoded_count = min(encoded_count + BATCH, len(items))
    omission_text = document.omission_text
    if encoded_count < len(items):
        omitted = OmittedEntries("entry", "entries")
        omitted.add("the rest", "together they are too large", len(items) - encoded_count)
        omission_text = " ".join(w for w in (omission_text, omitted.text()) if w)
    return _encoder.encode(ReaderOutput(omission_text=omission_text, batches=tuple(batches)))


def decode_document(kind: int, data: bytes) -> Document[Any, Any]:
    """Reads the output of `encode_document`.

    Raises:
        Damaged: see `unpacked`.
        ValueError: the file cannot be read; the text is the reason.
    """
    output = _output.decode(data)
    if output.problem is not None:
        raise (Damaged if output.is_damaged else ValueError)(output.problem)
    entries: dict[Any, Any] = {}
    for batch in output.batches:
        entries.update(_decoders[kind].decode(batch))
    return Document(entries, output.omission_text, sum(map(len, output.batches)))
