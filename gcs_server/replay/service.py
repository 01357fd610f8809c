"""Opens and controls recordings, for the API's routes."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TypeVar
from urllib.parse import quote

from gcs_server.errors import RecordingUnusable, Refused, UnknownRecording
from gcs_server.mavlink.router import Router
from gcs_server.replay.catalogue import Catalogue, FileVersion, RecordingInfo, file_version
from gcs_server.replay.index import Index, UnreadableRecording, explain
from gcs_server.replay.index_process import IndexProcess
from gcs_server.replay.link import ReplayState, TlogLink
from gcs_server.replay.marks import VehicleMarks, make_marks
from gcs_server.vehicle.fleet import Fleet

MAX_INDEXES = 4
"""Maximum number of indexes in memory; the index of a long flight needs a few megabytes, the largest possible
index 20 MB."""
MAX_READERS = 2
MAX_REPLAYS = 8

T = TypeVar("T")
FileKey = tuple[Path, FileVersion]


@dataclass(frozen=True, slots=True)
class Replay(ReplayState):
    """An open replay."""

    name: str
    """Name in the API, the same as the name of its link."""
    recording: str
    """Name of the file."""
    vehicles: tuple[str, ...]
    """Ids of the vehicles that are replayed."""


@dataclass(frozen=True, slots=True)
class RecordingIndex:
    """The data of a recording that a time bar shows."""

    recording: str
    begin_unix_s: float
    end_unix_s: float
    records: int
    bytes_skipped: int
    """Damaged bytes outside records."""
    left_out: int
    """Records left out of the index, because there are too many senders, changes or messages."""
    vehicles: tuple[VehicleMarks, ...]


class Replays:
    """All recordings and open replays of a server.

    Args:
        folder: folder of the recordings.
    """

    def __init__(self, router: Router, fleet: Fleet, folder: Path) -> None:
        self._router, self._fleet = router, fleet
        self._catalogue = Catalogue(folder)
        self._processes: set[IndexProcess] = set()
        self._readers = ThreadPoolExecutor(MAX_READERS, thread_name_prefix="recordings")
        self._listing = asyncio.Lock()
        self._indexes: OrderedDict[FileKey, asyncio.Future[Index]] = OrderedDict()
        self._marks: OrderedDict[FileKey, asyncio.Future[tuple[VehicleMarks, ...]]] = OrderedDict()

    async def recordings(self) -> list[RecordingInfo]:
        """All recordings in the folder, newest first."""
        being_recorded = {
            info.recording.file
            for info in self._router.links()
            if info.recording is not None and info.recording.file and info.recording.stopped is None
        }
        async with self._listing:  # a second concurrent caller then finds the files in the catalogue's cache
            infos = await asyncio.to_thread(self._catalogue.all, being_recorded)
        indexes = {
            (path.name, version[0]): future.result()
            for (path, version), future in self._indexes.items()
            if future.done() and not future.cancelled() and future.exception() is None
        }
        return [_with_index(info, indexes.get((info.name, info.bytes))) for info in infos]

    def path(self, name: str) -> Path:
        """Path of a recording's file. Raises UnknownRecording."""
        return self._catalogue.path(name)

    async def index_of_recording(self, name: str) -> RecordingIndex:
        """Start, end and time bar marks of a recording, which are computed once, outside the event loop.

        Raises:
            UnknownRecording: there is no such recording.
            RecordingUnusable: the recording cannot be read.
        """
        path = self.path(name)
        return await self._recording_index(path, await self._index(path))

    def is_indexed(self, name: str) -> bool:
        """Whether `index_of_recording` returns immediately. Raises UnknownRecording."""
        path = self.path(name)
        with suppress(OSError):
            future = self._indexes.get((path, file_version(path)))
            return future is not None and future.done() and not future.cancelled()
        return False

    def stop_reading(self, name: str) -> None:
        """Cancels the indexing of a recording; all waiting callers get an error."""
        for process in tuple(self._processes):
            if process.path.name == name:
                process.stop()
                for key in [key for key in self._indexes if key[0] == process.path]:
                    del self._indexes[key]

    async def index_of_replay(self, name: str) -> RecordingIndex:
        """Start, end and time bar marks of an open replay. Raises UnknownRecording, RecordingUnusable."""
        link = self._link(name)
        await link.opened()
        if link.index is None:
            raise RecordingUnusable(link.replay_state().detail or "The recording was closed.")
        return await self._recording_index(link.path, link.index)

    async def open(self, name: str, *, speed: float, playing: bool) -> Replay:
        """Opens a replay from the start; a replay that is already open is not changed.

        Raises:
            UnknownRecording: there is no such recording.
            RecordingUnusable: the recording cannot be read.
            Refused: `MAX_REPLAYS` replays are open.
        """
        path = self.path(name)
        link_name = f"replay-{path.name}"
        index = await self._index(path)
        open_names = {link.name for link in self._links()}
        if link_name not in open_names and len(open_names) >= MAX_REPLAYS:
            raise Refused(
                f"{len(open_names)} recordings are open already.", remedy="Close one of them first."
            )
        if link_name not in open_names:
            url = f"tlog:{quote(str(path))}"
            link = TlogLink(link_name, url, path, speed, index=index)
            self._router.add(link)
            await link.opened()
            if not playing and link.replay_state().position_unix_s is not None:
                link.pause()
        return self.get(link_name)

    def all(self) -> list[Replay]:
        """All open replays."""
        return [self._replay(link) for link in self._links()]

    def get(self, name: str) -> Replay:
        """The replay of this name. Raises UnknownRecording."""
        return self._replay(self._link(name))

    async def change(
        self, name: str, *, playing: bool | None, speed: float | None, position_unix_s: float | None
    ) -> Replay:
        """Sets speed, position and play state, in this order; returns once the vehicles show their state at
        that time.

        Raises:
            UnknownRecording: there is no such replay.
            RecordingUnusable: the recording cannot be played.
        """
        link = self._link(name)
        await link.opened()
        try:
            if speed is not None:
                link.set_speed(speed)
            if playing is False:
                link.pause()
            if position_unix_s is not None:
                await link.seek(round(position_unix_s * 1e6))
            if playing is True:
                link.play()
        except UnreadableRecording as error:
            raise RecordingUnusable(str(error)) from None
        return self._replay(link)

    async def close(self, name: str) -> None:
        """Closes a replay and removes its vehicles. Raises UnknownRecording."""
        await self._router.remove_link(self._link(name).name)

    def stop(self) -> None:
        """Stops all running indexing."""
        for process in tuple(self._processes):
            process.stop()
        self._readers.shutdown(wait=False, cancel_futures=True)

    def _links(self) -> list[TlogLink]:
        return [c.link for c in self._router.connections() if isinstance(c.link, TlogLink)]

    def _link(self, name: str) -> TlogLink:
        links = {link.name: link for link in self._links()}
        if name not in links:
            raise UnknownRecording(
                f"No replay {name!r} is open.",
                remedy=f"Open now: {', '.join(links)}." if links else "Open one with POST /replays.",
            )
        return links[name]

    def _replay(self, link: TlogLink) -> Replay:
        vehicles = tuple(v.id for v in self._fleet.all() if v.identity.replayed and link.name in v.links)
        state = link.replay_state()
        return Replay(**asdict(state), name=link.name, recording=link.path.name, vehicles=vehicles)

    async def _recording_index(self, path: Path, index: Index) -> RecordingIndex:
        marks = await self._compute_once(self._marks, path, lambda: make_marks(path, index))
        return RecordingIndex(
            path.name,
            index.begin_us / 1e6,
            index.end_us / 1e6,
            index.records,
            index.bytes_skipped,
            index.left_out,
            marks,
        )

    async def _index(self, path: Path) -> Index:
        def make() -> Index:
            process = IndexProcess(path)
            self._processes.add(process)
            try:
                return process.run()
            finally:
                self._processes.discard(process)

        return await self._compute_once(self._indexes, path, make)

    async def _compute_once(
        self,
        results: OrderedDict[FileKey, asyncio.Future[T]],
        path: Path,
        make: Callable[[], T],
    ) -> T:
        """Runs a computation once per file; returns the result of an earlier or running call if there is
        one."""
        key = None
        try:
            key = path, file_version(path)
            future = results.get(key)
            if future is None or future.cancelled():
                future = results[key] = asyncio.get_running_loop().run_in_executor(self._readers, make)
            results.move_to_end(key)
            while len(results) > MAX_INDEXES:
                results.popitem(last=False)
            return await asyncio.shield(future)
        except UnreadableRecording as error:
            raise RecordingUnusable(f"{path.name}: {error}") from None
        except OSError as error:
            if key is not None:
                # Computed again at the next call: the disk may then have space to unpack the recording.
                results.pop(key, None)
            raise RecordingUnusable(explain(path, error)) from None


def _with_index(info: RecordingInfo, index: Index | None) -> RecordingInfo:
    if index is None or info.running:
        return info
    problem = (
        f"{index.bytes_skipped} damaged bytes of the recording are left out." if index.bytes_skipped else None
    )
    if index.left_out:
        problem = f"The recording has too many senders or messages; {index.left_out} records are left out."
    return replace(
        info,
        started_unix_s=index.begin_us / 1e6,
        duration_s=(index.end_us - index.begin_us) / 1e6,
        vehicles=index.systems,
        problem=problem,
    )
