"""The known ground as tiles of heights (Terrarium), with which the page shades its map: made of the
elevation files by a process, one tile at a time, so that the work on plans comes first, and kept until a
file changes."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from gcs_server.clock import Clock
from gcs_server.errors import ServerBusy
from gcs_server.maps.tiles import KeptTile, TileStore
from gcs_server.plans.known_ground import files_in
from gcs_server.plans.work import PlanWork

MIN_ZOOM, MAX_ZOOM = 8, 14
"""Zooms with tiles; the page enlarges those of the largest."""
MAX_WAITING = 100
T = TypeVar("T")


class GroundTiles:
    """Answers with tiles of the known ground.

    Args:
        clock: the server's clock.
        work: runs the process that reads the elevation files.
        folder: folder of the kept tiles; created when the first tile is kept.
    """

    def __init__(self, clock: Clock, work: PlanWork, folder: Path) -> None:
        self._clock, self._work, self._folder = clock, work, folder
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="ground-tiles")
        self._one_at_a_time = asyncio.Lock()
        self._waiting = 0
        self._store: tuple[str, TileStore] | None = None
        """The kept tiles, and the version of the files of which they were made."""
        self._listing: tuple[str | None, dict[str, Any]] | None = None

    async def version(self) -> str | None:
        """Changes whenever an elevation file changes; None: there are none."""
        files = await self._in_thread(lambda: files_in(self._work.elevation_folder))
        return hashlib.sha256(repr(files).encode()).hexdigest()[:16] if files else None

    async def listing(self) -> tuple[str | None, dict[str, Any]]:
        """The version, and the elevation files: `files`, `unreadable`. Raises as `PlanWork.run`."""
        version = await self.version()
        if self._listing is None or self._listing[0] != version:
            answer = await self._work.run("elevation_files", {}, small=False)
            self._listing = (version, answer.values)
        return self._listing

    async def tile(self, version: str, zoom: int, x: int, y: int) -> bytes:
        """A tile, y counted from the north; empty: the ground there is not known.

        Raises:
            ServerBusy: too many tiles are being made.
            Refused: the files take too much memory or time.
        """
        if not MIN_ZOOM <= zoom <= MAX_ZOOM or max(x, y) >= 1 << zoom:
            return b""
        kept = await self._in_thread(lambda: self._store_of(version).get(zoom, x, y))
        if kept is not None:
            return kept.content
        if self._waiting >= MAX_WAITING:
            raise ServerBusy(f"{MAX_WAITING} tiles of the ground are being made.", remedy="Wait a moment.")
        self._waiting += 1
        try:
            async with self._one_at_a_time:
                answer = await self._work.run("ground_tile", {"zoom": zoom, "x": x, "y": y}, small=False)
        finally:
            self._waiting -= 1
        tile = KeptTile(answer.body, self._clock.unix_s())
        await self._in_thread(lambda: self._store_of(version).put(zoom, x, y, tile))
        return answer.body

    async def close(self) -> None:
        """Closes the file of the kept tiles."""
        await self._in_thread(lambda: None if self._store is None else self._store[1].close())
        self._thread.shutdown()

    async def _in_thread(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._thread, work)

    def _store_of(self, version: str) -> TileStore:
        """The kept tiles of this version; those of earlier versions are deleted. Runs in the thread."""
        if self._store is None or self._store[0] != version:
            if self._store is not None:
                self._store[1].close()
            for path in self._folder.glob("*.sqlite*"):
                if not path.name.startswith(f"{version}."):
                    path.unlink(missing_ok=True)
            self._store = (version, TileStore(self._folder / f"{version}.sqlite"))
        return self._store[1]
