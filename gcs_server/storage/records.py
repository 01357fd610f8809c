"""Small JSON objects by name in one folder: read once at the start, written completely or not at all."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from gcs_server.storage.files import open_file, read_limited, replace_file, sync_folder

MAX_RECORDS = 2000
MAX_BYTES = 64_000
"""Maximum size of one record [bytes]; a larger file is not read."""
_SUFFIX = ".json"
_NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")


class Unreadable(str):
    """A record that cannot be read; the text is the reason."""


class Records:
    """Records, one file each. A thread writes one record after another; the caller gets a future and does not
    wait for the disk.

    Args:
        folder: folder of the files; created at the first write.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="records")

    def read_all(self) -> dict[str, dict[str, object] | Unreadable]:
        """All records by name; blocks.

        Raises:
            OSError: the folder cannot be read, or contains more than `MAX_RECORDS` files.
        """
        records: dict[str, dict[str, object] | Unreadable] = {}
        try:
            names = sorted(path.name for path in self.folder.iterdir())
        except FileNotFoundError:
            return records
        for name in names:
            stem = name.removesuffix(_SUFFIX)
            if not name.endswith(_SUFFIX) or not _NAME_PATTERN.fullmatch(stem):
                continue
            if len(records) >= MAX_RECORDS:
                raise OSError(f"it holds more than {MAX_RECORDS} files")
            try:
                records[stem] = _read(self.folder / name)
            except OSError as error:
                records[stem] = Unreadable(error.strerror or str(error))
            except (ValueError, RecursionError) as error:
                records[stem] = Unreadable(str(error) or type(error).__name__)
        return records

    def write(self, name: str, record: Mapping[str, object] | None) -> Future[None]:
        """Replaces a record, or removes it (None). The future is done once the record is on disk, or raises
        OSError if writing failed; the record is then unchanged.
        """
        path = self.folder / f"{_require_valid_name(name)}{_SUFFIX}"
        if record is None:
            return self._writer.submit(self._remove, path)
        content = json.dumps(record, allow_nan=False, indent=1).encode()
        return self._writer.submit(self._replace, path, content + b"\n")

    def close(self) -> None:
        """Waits for pending writes."""
        self._writer.shutdown()

    def _replace(self, path: Path, content: bytes) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        replace_file(path, content)

    def _remove(self, path: Path) -> None:
        path.unlink(missing_ok=True)
        if self.folder.is_dir():
            sync_folder(self.folder)


def _read(path: Path) -> dict[str, object]:
    with open_file(path) as file:
        content = read_limited(file, MAX_BYTES)
    record = json.loads(content)
    if not isinstance(record, dict):
        raise ValueError("it is not a JSON object")
    return record  # pyright: ignore[reportUnknownVariableType] json's keys are text


def _require_valid_name(name: str) -> str:
    if not _NAME_PATTERN.fullmatch(name):
        raise ValueError(f"{name!r} is not a valid name of a record")
    return name
