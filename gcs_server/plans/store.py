"""The plans in the data folder, with versions. Each save names the version that it changes. All disk work
runs in one thread, one task after another, so that saves never interleave and a cancelled caller does not
interrupt a save.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeVar

from gcs_server.clock import Clock
from gcs_server.errors import PlanConflict, Refused, UnknownPlan
from gcs_server.mavlink.dialect import MAV_SEVERITY_DEBUG
from gcs_server.plans.files import PlanFiles, PlanVersion
from gcs_server.plans.tasks import ReadDocument
from gcs_server.storage.folder import StorageError
from gcs_server.vehicle.events import EventFeed

MAX_PLANS = 500
MAX_VERSIONS = 50
"""Maximum number of versions per plan; the oldest are removed first."""
MAX_TOTAL_BYTES = 500_000_000
"""Maximum total size of all versions of all plans."""

Action = Literal["created", "saved", "deleted"]
T = TypeVar("T")


@dataclass(slots=True)
class _Index:
    """Index of the folder; only the thread changes it."""

    newest: dict[str, PlanVersion] = field(default_factory=dict[str, PlanVersion])
    size_bytes: dict[str, int] = field(default_factory=dict[str, int])
    """Total size of the versions of each plan."""
    problems: list[str] = field(default_factory=list[str])


class PlanStore:
    """All plans of one server.

    Args:
        folder: created when first written to.
        clock: clock for the times of changes.
        events: receives every change; the events are not stored.
    """

    def __init__(self, folder: Path, clock: Clock, events: EventFeed) -> None:
        self._files = PlanFiles(folder)
        self._clock, self._events = clock, events
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="plans")
        self._index: _Index | None = None

    def warnings(self) -> list[str]:
        """Warnings about unreadable plans; available after the first request for plans."""
        return [] if self._index is None else list(self._index.problems)

    def close(self) -> None:
        """Waits for pending writes."""
        self._thread.shutdown()

    async def all(self) -> list[PlanVersion]:
        """The newest version of each plan, by name.

        Raises:
            StorageError: the folder cannot be read.
        """
        newest = await self._run(lambda index: list(index.newest.values()))
        return sorted(newest, key=lambda head: (head.name.casefold(), head.id))

    async def versions(self, plan_id: str) -> list[PlanVersion]:
        """The stored versions, newest first; raises the same errors as `get`."""

        def work(index: _Index) -> list[PlanVersion]:
            self._newest(index, plan_id)
            return [self._files.head(plan_id, version) for version in reversed(self._files.versions(plan_id))]

        return await self._run(work)

    async def get(self, plan_id: str, version: int | None = None) -> tuple[PlanVersion, bytes]:
        """A version (default: the newest) and its plan as JSON.

        Raises:
            UnknownPlan: there is no such plan or version.
            StorageError: the plan cannot be read.
        """

        def work(index: _Index) -> tuple[PlanVersion, bytes]:
            newest = self._newest(index, plan_id)
            try:
                return self._files.read(plan_id, newest.version if version is None else version)
            except FileNotFoundError:
                raise UnknownPlan(
                    f"Plan {newest.name!r} has no version {version}.",
                    remedy=f"Its newest version is {newest.version}; the last {MAX_VERSIONS} versions are "
                    "kept.",
                ) from None

        return await self._run(work)

    async def create(self, name: str, document: ReadDocument, *, by: tuple[str, str]) -> PlanVersion:
        """Stores a new plan as version 1.

        Args:
            name: name of the plan.
            document: the plan; an offboard mission has this name, too.
            by: name and key of the client.

        Raises:
            Refused: the limit of plans, or of their total size, is reached.
            StorageError: writing failed.
        """

        def work(index: _Index) -> PlanVersion:
            if len(index.newest) >= MAX_PLANS:
                raise Refused(
                    f"{MAX_PLANS} plans are stored, which is the limit.", remedy="Delete one first."
                )
            plan_id, now_unix_s = secrets.token_hex(6), self._clock.unix_s()
            count, kind = document.head.steps, document.head.kind
            head = PlanVersion(plan_id, name, 1, now_unix_s, by[0], count, kind)
            return self._write(index, head, document.text)

        return await self._change("created", work, by)

    async def save(
        self, plan_id: str, name: str, document: ReadDocument, *, base_version: int, by: tuple[str, str]
    ) -> PlanVersion:
        """Adds a version, if the caller's base version is still the newest.

        Raises:
            UnknownPlan: there is no such plan.
            PlanConflict: another client has saved a newer version; nothing is overwritten.
            Refused, StorageError: the same as for `create`.
        """

        def work(index: _Index) -> PlanVersion:
            newest = self._require_newest(index, plan_id, base_version)
            head = replace(
                newest,
                name=name,
                version=newest.version + 1,
                changed_unix_s=self._clock.unix_s(),
                changed_by=by[0],
                item_count=document.head.steps,
                kind=document.head.kind,
            )
            return self._write(index, head, document.text)

        return await self._change("saved", work, by)

    async def delete(self, plan_id: str, *, base_version: int, by: tuple[str, str]) -> None:
        """Deletes a plan and all its versions; raises the same errors as `save`."""

        def work(index: _Index) -> PlanVersion:
            newest = self._require_newest(index, plan_id, base_version)
            self._files.remove(plan_id)
            del index.newest[plan_id], index.size_bytes[plan_id]
            return newest

        await self._change("deleted", work, by)

    # --- internal -------------------------------------------------------------------------------------

    async def _change(
        self, action: Action, work: Callable[[_Index], PlanVersion], by: tuple[str, str]
    ) -> PlanVersion:
        loop = asyncio.get_running_loop()

        def report_change(index: _Index) -> PlanVersion:
            head = work(index)
            loop.call_soon_threadsafe(self._announce, action, head, by)
            return head

        return await self._run(report_change)

    def _announce(self, action: Action, plan: PlanVersion, by: tuple[str, str]) -> None:
        text = f"{by[0]} {action} the plan {plan.name!r} (version {plan.version})."
        data = {"action": action, "plan": asdict(plan), "client": by[0], "client_key": by[1]}
        self._events.add(
            "plan_changed", self._clock.unix_s(), text, severity=MAV_SEVERITY_DEBUG, data=data, stored=False
        )

    async def _run(self, work: Callable[[_Index], T]) -> T:
        def run() -> T:
            try:
                if self._index is None:
                    self._index = self._load()
                return work(self._index)
            except OSError as error:
                raise StorageError(
                    f"The plans in {self._files.folder} cannot be used: {error.strerror or error}.",
                    remedy="Free space or correct the folder's permissions; nothing was changed.",
                ) from error
            except ValueError as error:
                raise StorageError(
                    f"A plan in {self._files.folder} cannot be read: {error}.",
                    remedy="Open another version of it, or restore the file from a backup.",
                ) from error

        return await asyncio.get_running_loop().run_in_executor(self._thread, run)

    def _load(self) -> _Index:
        index = _Index()
        for plan_id in self._files.ids():
            try:
                versions = self._files.versions(plan_id)
                if versions:
                    index.newest[plan_id] = self._files.head(plan_id, versions[-1])
                    index.size_bytes[plan_id] = self._files.size_bytes(plan_id)
            except (OSError, ValueError) as error:
                index.problems.append(
                    f"The plan in {self._files.folder / plan_id} cannot be read ({error}); it is not "
                    "listed, and nothing is written there. Restore its newest file, or move the folder away."
                )
        return index

    def _newest(self, index: _Index, plan_id: str) -> PlanVersion:
        newest = index.newest.get(plan_id)
        if newest is None:
            raise UnknownPlan(
                f"There is no plan {plan_id[:40]!r}.",
                remedy="GET /plans lists them; it may have been deleted.",
            )
        return newest

    def _require_newest(self, index: _Index, plan_id: str, base_version: int) -> PlanVersion:
        newest = self._newest(index, plan_id)
        if newest.version != base_version:
            raise PlanConflict(
                newest.id, newest.name, newest.version, newest.changed_by, newest.changed_unix_s, base_version
            )
        return newest

    def _write(self, index: _Index, head: PlanVersion, content: bytes) -> PlanVersion:
        if sum(index.size_bytes.values()) + len(content) > MAX_TOTAL_BYTES:
            raise Refused(
                f"The plans would take more than {MAX_TOTAL_BYTES // 1_000_000} MB, which is the limit.",
                remedy="Delete plans that are not needed any more.",
            )
        size = self._files.write(head, content)
        index.newest[head.id] = head
        index.size_bytes[head.id] = index.size_bytes.get(head.id, 0) + size
        with suppress(OSError):  # the version is saved; old ones are removed with the next save
            old = self._files.versions(head.id)[:-MAX_VERSIONS]
            index.size_bytes[head.id] -= self._files.remove_versions(head.id, old)
        return head
