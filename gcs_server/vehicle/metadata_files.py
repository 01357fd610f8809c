"""Unpacks, checks and reads a vehicle's metadata files within limits. All of it runs in a process of its own
(`metadata_process.py`), except for the small general file.
"""

from __future__ import annotations

import lzma
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec

from gcs_server.vehicle import event_document, param_document
from gcs_server.vehicle.event_definitions import Definition
from gcs_server.vehicle.metadata_limits import Document, LeftOut, cut
from gcs_server.vehicle.param_metadata import ParamMetadata

PARAMETERS, EVENTS = 1, 4
"""COMP_METADATA_TYPE."""
MAX_PACKED_BYTES, MAX_BYTES = 2_000_000, 8_000_000
"""Limits of a file; PX4's largest file has 60 kB, and 0.8 MB unpacked."""
MAX_GENERAL_PACKED_BYTES, MAX_GENERAL_BYTES = 16_000, 64_000
MAX_GENERAL_ENTRIES, MAX_URI_LENGTH = 32, 200
MAX_ANSWER_BYTES = 3_000_000
"""Size of the encoded answer; it takes about three times as much memory in the server. PX4's largest has 0.6
MB."""
BATCH = 50
"""Number of entries decoded at a time while the event loop waits."""
MAX_PROBLEM_LENGTH = 200
DICTIONARY_BYTES = 100_000_000
"""Memory limit of the decoder; xz -9 requests 65 MB, but only the memory for the content is used."""
XZ_MAGIC = b"\xfd7zXZ\0"


class Damaged(ValueError):
    """The file differs from the announced one: it may have been damaged in transfer."""


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


class Answer(msgspec.Struct, frozen=True):
    """Answer of the process."""

    problem: str | None = None
    """Why the file cannot be used."""
    is_damaged: bool = False
    left_out: str | None = None
    batches: tuple[bytes, ...] = ()
    """Encoded entries, `BATCH` each."""


_answer = msgspec.msgpack.Decoder(Answer)
_encoder = msgspec.msgpack.Encoder()
_parsers: dict[int, Callable[[bytes], Document[Any, Any]]] = {
    PARAMETERS: param_document.parse,
    EVENTS: event_document.parse,
}
_decoders: dict[int, msgspec.msgpack.Decoder[Any]] = {
    PARAMETERS: msgspec.msgpack.Decoder(list[tuple[str, ParamMetadata]]),
    EVENTS: msgspec.msgpack.Decoder(list[tuple[int, Definition]]),
}


def crc32(data: bytes) -> int:
    """MAVLink's CRC32: start value and final XOR are zero."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def unpacked(packed: bytes, crc: int, most_bytes: int = MAX_BYTES) -> bytes:
    """Unpacks a file, if it is packed.

    Args:
        packed: the file.
        crc: checksum of the file, or of its content as in PX4's general file; 0: no checksum.
        most_bytes: larger content is refused before it is completely unpacked.

    Raises:
        Damaged: the checksum differs, or the file cannot be unpacked.
        ValueError: the content is too large.
    """
    content = packed
    if packed.startswith(XZ_MAGIC):
        unpacker = lzma.LZMADecompressor(memlimit=DICTIONARY_BYTES)
        try:
            content = unpacker.decompress(packed, max_length=most_bytes + 1)
        except lzma.LZMAError as error:
            raise Damaged(f"it cannot be unpacked ({error})") from error
        if len(content) <= most_bytes and not unpacker.eof:
            raise Damaged("it is incomplete")
    if len(content) > most_bytes:
        raise ValueError(f"unpacked it has more than {most_bytes:,} bytes")
    if crc and crc not in (crc32(packed), crc32(content)):
        raise Damaged("its checksum does not match")
    return content


def read_general(packed: bytes, crc: int) -> list[FileEntry]:
    """Reads the general file, which lists the other files. It is small enough for any thread.

    Raises:
        Damaged: see `unpacked`.
        ValueError: the text is not a general file.
    """
    content = unpacked(packed, crc, MAX_GENERAL_BYTES)
    found: list[FileEntry] = []
    for raw in msgspec.json.decode(content, type=_General).metadata_types[:MAX_GENERAL_ENTRIES]:
        try:
            entry = msgspec.json.decode(raw, type=_FileEntry)
        except (ValueError, RecursionError):
            continue
        if len(entry.uri) <= MAX_URI_LENGTH:
            found.append(FileEntry(entry.type, entry.uri, entry.file_crc & 0xFFFFFFFF))
    return found


def answer(kind: int, packed: bytes, crc: int) -> bytes:
    """Reads a complete file; problems are part of the answer. Used by `metadata_process.py`."""
    try:
        document = _parsers[kind](unpacked(packed, crc))
    except (ValueError, RecursionError, MemoryError) as error:
        problem = cut(str(error) or type(error).__name__, MAX_PROBLEM_LENGTH)
        return _encoder.encode(Answer(problem, isinstance(error, Damaged)))
    batches: list[bytes] = []
    size = kept = 0
    items = list(document.items())
    while kept < len(items):
        batch = _encoder.encode(items[kept : kept + BATCH])
        if size + len(batch) > MAX_ANSWER_BYTES:
            break
        batches.append(batch)
        size += len(batch)
        kept = min(kept + BATCH, len(items))
    words = document.left_out
    if kept < len(items):
        left_out = LeftOut("entry", "entries")
        left_out.add("the rest", "together they are too large", len(items) - kept)
        words = " ".join(w for w in (words, left_out.text()) if w)
    return _encoder.encode(Answer(left_out=words, batches=tuple(batches)))


def read_answer(kind: int, data: bytes) -> Document[Any, Any]:
    """Reads the output of `answer`.

    Raises:
        Damaged: the file differs from the announced one.
        ValueError: the file cannot be read; the text is the reason.
    """
    given = _answer.decode(data)
    if given.problem is not None:
        raise (Damaged if given.is_damaged else ValueError)(given.problem)
    entries: dict[Any, Any] = {}
    for batch in given.batches:
        entries.update(_decoders[kind].decode(batch))
    return Document(entries, given.left_out, sum(map(len, given.batches)))
