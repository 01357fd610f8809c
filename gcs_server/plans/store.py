"""Plans in the data folder, with versions; a save names the version that it changes.

Everything that touches the disk runs in one thread, one piece of work after the other: no two saves cross,
and a caller that goes away leaves a save whole.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeVar

from gcs_server.clock import Clock
from gcs_server.errors import PlanConflict, Refused, UnknownPlan
from gcs_server.plans.files import PlanFiles, PlanVersion
from gcs_server.storage.folder import StorageError
from missions import documents
from missions.documents import Document

MAX_PLANS = 500
MAX_VERSIONS = 50
"""Of one plan; the oldest go first."""
MAX_TOTAL_BYTES = 500_000_000
"""Of all versions of all plans."""

Action = Literal["created", "saved", "deleted"]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class PlanChange:
    """What somebody did to a plan."""

    action: Action
    plan: PlanVersion
    """After the change; the last version of a plan that was deleted."""
    by: str
    """Who did it."""
    by_key: str
    """Tells callers of one name apart."""


@dataclass(slots=True)
class _Index:
    """What the thread knows of the folder."""

    newest: dict[str, PlanVersion] = field(default_factory=dict[str, PlanVersion])
    bytes_of: dict[str, int] = field(default_factory=dict[str, int])
    problems: list[str] = field(default_factory=list[str])


class PlanStore:
    """All plans of one server.

    Args:
        folder: made when first written to.
        clock: for the times of changes.
        tell: called in the event loop with every change.
    """

    def __init__(
        self, folder: Path, clock: Clock, tell: Callable[[PlanChange], None] = lambda _: None
    ) -> None:
        self._files = PlanFiles(folder)
        self._clock = clock
        self._tell = tell
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="plans")
        self._index: _Index | None = None

    def warnings(self) -> list[str]:
        """Plans in the folder that cannot be read; known once plans were asked for."""
        return [] if self._index is None else list(self._index.problems)

    def close(self) -> None:
        """Waits for what is being written."""
        self._thread.shutdown()

    async def all(self) -> list[PlanVersion]:
        """The newest version of each plan, by name.

        Raises:
            StorageError: the folder cannot be read.
        """
        found = await self._run(lambda index: list(index.newest.values()))
        return sorted(found, key=lambda head: (head.name.casefold(), head.id))

    async def versions(self, plan_id: str) -> list[PlanVersion]:
        """The versions that are kept, newest first; raises as `get`."""

        def work(index: _Index) -> list[PlanVersion]:
            self._newest(index, plan_id)
            return [self._files.head(plan_id, each) for each in reversed(self._files.versions(plan_id))]

        return await self._run(work)

    async def get(self, plan_id: str, version: int | None = None) -> tuple[PlanVersion, bytes]:
        """A version (the newest unless named) and its plan as JSON.

        Raises:
            UnknownPlan: there is no such plan or version.
            StorageError: it cannot be read.
        """

        def work(index: _Index) -> tuple[PlanVersion, bytes]:
            newest = self._newest(index, plan_id)
            try:
                return self._files.read(plan_id, newest.version if version is None else version)
            except FileNotFoundError:
                raise UnknownPlan(
                    f"Plan {newest.name!r} has no version {version}.",
                    remedy=f"Its newest is {newest.version}; the last {MAX_VERSIONS} are kept.",
                ) from None

        return await self._run(work)

    async def create(self, name: str, plan: Document, *, by: tuple[str, str]) -> PlanVersion:
        """Keeps a new plan as version 1.

        Args:
            by: name and key of who saves it.

        Raises:
            Refused: as many or as large plans as possible are kept.
            StorageError: the disk refuses.
        """

        def work(index: _Index) -> PlanVersion:
            if len(index.newest) >= MAX_PLANS:
                raise Refused(f"{MAX_PLANS} plans are kept, no more.", remedy="Delete one first.")
            plan_id, now_unix_s = secrets.token_hex(6), self._clock.unix_s()
            count, kind = documents.count(plan), documents.kind_of(plan)
            return self._write(index, PlanVersion(plan_id, name, 1, now_unix_s, by[0], count, kind), plan)

        return await self._change("created", work, by)

    async def save(
        self, plan_id: str, name: str, plan: Document, *, base_version: int, by: tuple[str, str]
    ) -> PlanVersion:
        """Adds a version, where the newest is still the one that the caller changed.

        Raises:
            UnknownPlan: there is no such plan.
            PlanConflict: somebody else saved meanwhile; nothing is overwritten.
            Refused, StorageError: as `create`.
        """

        def work(index: _Index) -> PlanVersion:
            newest = self._checked(index, plan_id, base_version)
            head = replace(
                newest,
                name=name,
                version=newest.version + 1,
                changed_unix_s=self._clock.unix_s(),
                changed_by=by[0],
                item_count=documents.count(plan),
                kind=documents.kind_of(plan),
            )
            return self._write(index, head, plan)

        return await self._change("saved", work, by)

    async def delete(self, plan_id: str, *, base_version: int, by: tuple[str, str]) -> None:
        """Removes a plan and all its versions; raises as `save`."""

        def work(index: _Index) -> PlanVersion:
            newest = self._checked(index, plan_id, base_version)
            self._files.remove(plan_id)
            del index.newest[plan_id], index.bytes_of[plan_id]
            return newest

        await self._change("deleted", work, by)

    # --- in the thread --------------------------------------------------------------------------------

    async def _change(
        self, action: Action, work: Callable[[_Index], PlanVersion], by: tuple[str, str]
    ) -> PlanVersion:
        loop = asyncio.get_running_loop()

        def told(index: _Index) -> PlanVersion:
            head = work(index)
            loop.call_soon_threadsafe(self._tell, PlanChange(action, head, *by))
            return head

        return await self._run(told)

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
                    index.bytes_of[plan_id] = self._files.size_bytes(plan_id)
            except (OSError, ValueError) as error:
                index.problems.append(
                    f"The plan in {self._files.folder / plan_id} cannot be read ({error}); it is not "
                    "listed, and nothing is written there. Restore its newest file, or move the folder away."
                )
        return index

    def _newest(self, index: _Index, plan_id: str) -> PlanVersion:
        found = index.newest.get(plan_id)
        if found is None:
            raise UnknownPlan(
                f"There is no plan {plan_id[:40]!r}.",
                remedy="GET /plans lists them; it may have been deleted.",
            )
        return found

    def _checked(self, index: _Index, plan_id: str, base_version: int) -> PlanVersion:
        newest = self._newest(index, plan_id)
        if newest.version != base_version:
            raise PlanConflict(
                newest.id, newest.name, newest.version, newest.changed_by, newest.changed_unix_s, base_version
            )
        return newest

    def _write(self, index: _Index, head: PlanVersion, plan: Document) -> PlanVersion:
        content = documents.write(documents.named(plan, head.name))
        if sum(index.bytes_of.values()) + len(content) > MAX_TOTAL_BYTES:
            raise Refused(
                f"The plans that are kept take {MAX_TOTAL_BYTES // 1_000_000} MB, no more are kept.",
                remedy="Delete plans that nobody needs.",
            )
        size = self._files.write(head, content)
        index.newest[head.id] = head
        index.bytes_of[head.id] = index.bytes_of.get(head.id, 0) + size
        with suppress(OSError):  # the version is saved; old ones go with the next save
            old = self._files.versions(head.id)[:-MAX_VERSIONS]
            index.bytes_of[head.id] -= self._files.remove_versions(head.id, old)
        return head
