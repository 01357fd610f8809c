"""Stores plans in one folder per plan and one file per version: a line with the head (`PlanVersion`), then
the plan, both as JSON.

A version is written completely or not at all, and is never changed afterwards. All functions block, so do not
call them in the event loop.
"""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path

from gcs_server.storage.files import open_file, read_limited, replace_file, sync_folder, typed
from missions.documents import PlanKind

MAX_FILE_BYTES = 16 * 1024 * 1024
MAX_HEAD_BYTES = 4096
_ID = re.compile(r"[a-z0-9]{12}")
_FILE = re.compile(r"([0-9]{8})\.plan")


@dataclass(frozen=True, slots=True)
class PlanVersion:
    """One version of a plan, without the plan itself."""

    id: str
    """The plan's id, which does not change when the plan is renamed."""
    name: str
    """Name of the plan."""
    version: int
    """Number of the version, from 1; every save adds 1."""
    changed_unix_s: float
    """Time when the version was saved [s since 1970 UTC]."""
    changed_by: str
    """Name of the client that saved the version."""
    item_count: int
    """Number of items of a waypoint plan as uploaded, or of steps of an offboard mission with nested
    steps."""
    kind: PlanKind = "waypoint_plan"
    """Waypoint plan (flown by the vehicle) or offboard mission (flown by the server's setpoints)."""


class PlanFiles:
    """The folder of all plans.

    Args:
        folder: created when first written to.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def ids(self) -> list[str]:
        """Ids of all plans.

        Raises:
            OSError: the folder cannot be read.
        """
        try:
            return sorted(path.name for path in self.folder.iterdir() if _ID.fullmatch(path.name))
        except FileNotFoundError:
            return []

    def versions(self, plan_id: str) -> list[int]:
        """Numbers of the stored versions, oldest first.

        Raises:
            OSError: the plan's folder cannot be read.
        """
        matches = (_FILE.fullmatch(path.name) for path in (self.folder / plan_id).iterdir())
        return sorted(int(match[1]) for match in matches if match)

    def size_bytes(self, plan_id: str) -> int:
        """Total size of a plan's versions."""
        return sum(path.stat().st_size for path in (self.folder / plan_id).iterdir())

    def head(self, plan_id: str, version: int) -> PlanVersion:
        """The head of one version.

        Raises:
            OSError: the file cannot be read.
            ValueError: the file is not a version of a plan.
        """
        return self._read(plan_id, version, with_plan=False)[0]

    def read(self, plan_id: str, version: int) -> tuple[PlanVersion, bytes]:
        """One version and the plan's JSON; raises the same errors as `head`."""
        return self._read(plan_id, version, with_plan=True)

    def write(self, head: PlanVersion, plan: bytes) -> int:
        """Adds a version and syncs it to disk; returns its size in bytes.

        Raises:
            OSError: writing failed; nothing has changed.
        """
        path = self._path(head.id, head.version)
        content = json.dumps(asdict(head)).encode() + b"\n" + plan
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, content)
        sync_folder(self.folder)
        return len(content)

    def remove_versions(self, plan_id: str, versions: list[int]) -> int:
        """Removes old versions; returns the freed bytes."""
        freed_bytes = 0
        for version in versions:
            path = self._path(plan_id, version)
            freed_bytes += path.stat().st_size
            path.unlink()
        return freed_bytes

    def remove(self, plan_id: str) -> None:
        """Removes a plan with all its versions.

        Raises:
            OSError: removing failed; the plan still exists.
        """
        removed = self.folder / f".removed-{plan_id}"
        shutil.rmtree(removed, ignore_errors=True)
        (self.folder / plan_id).rename(removed)
        sync_folder(self.folder)
        shutil.rmtree(removed, ignore_errors=True)

    def _path(self, plan_id: str, version: int) -> Path:
        return self.folder / plan_id / f"{version:08d}.plan"

    def _read(self, plan_id: str, version: int, *, with_plan: bool) -> tuple[PlanVersion, bytes]:
        with open_file(self._path(plan_id, version)) as file:
            line = file.readline(MAX_HEAD_BYTES)
            plan = read_limited(file, MAX_FILE_BYTES) if with_plan else b""
        head = typed(PlanVersion, json.loads(line))
        if (head.id, head.version) != (plan_id, version):
            raise ValueError("its first line names another plan or version")
        return head, plan
