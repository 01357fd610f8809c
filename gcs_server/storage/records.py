"""Small JSON objects by name in one folder: read once at the start, written whole or not at all."""

from __future__ import annotations

import json
import os
import re
import stat
import tempfile
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

MOST_RECORDS = 2000
MOST_BYTES = 64_000
"""Most bytes of one record; a longer file is not read."""
_SUFFIX = ".json"
_name = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")


class Unreadable(str):
    """Why a record that is there cannot be read, in words."""


class Records:
    """One file a record.

    Writes run one after the other in a thread of their own: the caller gets a future and waits for no disk.

    Args:
        folder: made when first written to.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="records")

    def read_all(self) -> dict[str, dict[str, object] | Unreadable]:
        """Every record by its name; not for the event loop.

        Raises:
            OSError: the folder cannot be read, or holds more than `MOST_RECORDS`.
        """
        found: dict[str, dict[str, object] | Unreadable] = {}
        try:
            names = sorted(path.name for path in self.folder.iterdir())
        except FileNotFoundError:
            return found
        for name in names:
            stem = name.removesuffix(_SUFFIX)
            if not name.endswith(_SUFFIX) or not _name.fullmatch(stem):
                continue
            if len(found) >= MOST_RECORDS:
                raise OSError(f"it holds more than {MOST_RECORDS} files")
            try:
                found[stem] = _read(self.folder / name)
            except OSError as error:
                found[stem] = Unreadable(error.strerror or str(error))
            except (ValueError, RecursionError) as error:
                found[stem] = Unreadable(str(error) or type(error).__name__)
        return found

    def write(self, name: str, record: Mapping[str, object] | None) -> Future[None]:
        """Replaces a record, on the disk before the future is done; None removes it.

        The future raises OSError where the disk refuses; the record is then as it was.
        """
        path = self.folder / f"{_checked(name)}{_SUFFIX}"
        if record is None:
            return self._writer.submit(self._remove, path)
        content = json.dumps(record, allow_nan=False, indent=1).encode()
        return self._writer.submit(self._replace, path, content)

    def close(self) -> None:
        """Waits for what is being written."""
        self._writer.shutdown()

    def _replace(self, path: Path, content: bytes) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        descriptor, draft = tempfile.mkstemp(dir=self.folder, prefix=".")
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(content + b"\n")
                file.flush()
                os.fsync(file.fileno())
            Path(draft).replace(path)
        except OSError:
            Path(draft).unlink(missing_ok=True)
            raise
        self._sync_folder()

    def _remove(self, path: Path) -> None:
        path.unlink(missing_ok=True)
        if self.folder.is_dir():
            self._sync_folder()

    def _sync_folder(self) -> None:
        descriptor = os.open(self.folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _read(path: Path) -> dict[str, object]:
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a named pipe must not hold the start up
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise ValueError("it is no file")
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ValueError(f"it is longer than {MOST_BYTES} bytes")
    record = json.loads(content)
    if not isinstance(record, dict):
        raise ValueError("it is no JSON object")
    return record  # pyright: ignore[reportUnknownVariableType] json's keys are text


def _checked(name: str) -> str:
    if not _name.fullmatch(name):
        raise ValueError(f"{name!r} is no name for a record")
    return name
