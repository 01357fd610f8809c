"""Files that are complete or not changed at all, and that anybody may have damaged. All functions block."""

from __future__ import annotations

import json
import os
import stat
import tempfile
from functools import cache
from pathlib import Path
from typing import Annotated, BinaryIO, TypeVar

from pydantic import Field, TypeAdapter, ValidationError

T = TypeVar("T")
StoredTime = Annotated[float, Field(ge=0.0, le=1e11, allow_inf_nan=False)]
"""A time [s since 1970 UTC] in a file."""


def replace_file(path: Path, content: bytes, *, sync: bool = True) -> None:
    """Writes a file, readable by its owner only, in place of an earlier one.

    Args:
        path: the file, in an existing folder.
        content: the whole content.
        sync: whether the file must survive a power failure.

    Raises:
        OSError: writing failed; the earlier file is unchanged.
    """
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=".")
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            if sync:
                os.fsync(file.fileno())
        Path(temporary).replace(path)
    except OSError:
        Path(temporary).unlink(missing_ok=True)
        raise
    if sync:
        sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Writes the names in a folder to disk. Raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def open_file(path: Path) -> BinaryIO:
    """Opens a file for reading; a named pipe must not block the server.

    Raises:
        OSError: it cannot be opened.
        ValueError: it is not a file.
    """
    file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb")
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise ValueError("it is not a file")
    return file


def read_limited(file: BinaryIO, max_bytes: int) -> bytes:
    """The rest of a file. Raises ValueError if it is longer than `max_bytes`."""
    content = file.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise ValueError(f"it is longer than {max_bytes} bytes")
    return content


def typed(kind: type[T], value: object) -> T:
    """A value read from a JSON file as a dataclass: its fields and no others, with their types and bounds.

    Raises:
        ValueError: names the first wrong field.
    """
    try:
        return _adapter(kind).validate_json(json.dumps(value), strict=True, extra="forbid")
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{place}: {first['msg']}" if place else first["msg"]) from None


@cache
def _adapter(kind: type[T]) -> TypeAdapter[T]:
    return TypeAdapter(kind)
