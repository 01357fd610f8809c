"""The flights of a server: their files, what was read of them, and room for new ones."""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
from collections.abc import AsyncGenerator, Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, InvalidRequest, LogUnusable, Refused
from gcs_server.logbook.joined_flights import Flight, JoinedFlights
from gcs_server.logbook.library import Library, LogFile, Removed
from gcs_server.logbook.names import kind_of
from gcs_server.logbook.notes import NotesHead
from gcs_server.logbook.uploads import Uploads
from gcs_server.logbook.work import LogWork

CACHE_BYTES = 4_000_000_000
"""Size of the columns of logs that have been read; then the longest unused are deleted, and made again when
needed."""
CHECK_PERIOD_S = 60.0
_OVERVIEW = "overview.json"
_SUMMARY = ("kind", "start_unix_s", "duration_s", "firmware", "flights")
FORMAT = 2
"""Version of what is kept of a log that was read; a log of another version is read again."""
IDENTIFIED_S = 600.0
"""Of a longer flight the model of its aircraft is found in this part: more says no more of it."""
MAX_UNASKED_BYTES = 200_000_000
"""A larger log is read only when a person opens it."""


class Logbook:
    """All flights of one server.

    Args:
        clock: the server's clock.
        library: the files.
        work: reads logs.
        joined: joins files and notes to flights.
        cache: folder of the columns of logs that have been read.
        max_bytes: size of all files; then the oldest are deleted.
        in_use: returns the files that are being recorded or replayed.
        on_removed: called with each file that was deleted to make room.
        is_busy: returns whether a vehicle flies; logs that nobody has opened are then not read.
    """

    def __init__(
        self,
        clock: Clock,
        library: Library,
        work: LogWork,
        joined: JoinedFlights,
        cache: Path,
        max_bytes: int,
        in_use: Callable[[], frozenset[Path]],
        on_removed: Callable[[Removed], None],
        is_busy: Callable[[], bool] = lambda: False,
    ) -> None:
        self.library, self.joined, self.max_bytes = library, joined, max_bytes
        self.uploads = Uploads(clock, library)
        self._clock = clock
        self._work = work
        self._cache = cache
        self._in_use = in_use
        self._on_removed = on_removed
        self._is_busy = is_busy
        self._ended: set[str] = set()
        """Names of the recordings in which flights have ended that were not read yet."""
        self._locks: dict[str, asyncio.Lock] = {}
        """Locks of the files that are being read."""

    async def run(self) -> None:
        """Makes room at the start and from time to time, as recordings grow."""
        await asyncio.to_thread(self.uploads.remove_leftovers)
        while True:
            await self.make_room()
            await self._clock.sleep(CHECK_PERIOD_S)
            await self.read_unasked(())
            await self._read_new()

    async def flights(self) -> tuple[list[Flight], list[LogFile]]:
        """All flights and all files, the newest first."""
        files = await self.files()
        return await asyncio.to_thread(self.joined.flights, files), files

    async def flight(self, flight_id: str) -> Flight:
        """One flight, by the id of any of its parts. Raises UnknownFlight."""
        return await asyncio.to_thread(self.joined.find, await self.files(), flight_id)

    async def delete_flight(self, flight_id: str) -> None:
        """Deletes a flight: its notes, and the files that have no other flight.

        Raises:
            UnknownFlight: there is no such flight.
            Refused: a file is in use or cannot be deleted, or all of them have other flights.
        """
        flight = await self.flight(flight_id)
        others = {
            part.file
            for other in (await self.flights())[0]
            if other.id != flight.id
            for part in other.joined.parts
        }
        own = [file for file in flight.files.values() if file.id not in others]
        if flight.files and not own:
            raise Refused(
                "The flight is part of a recording with other flights.",
                remedy="Delete the recording with all its flights.",
            )
        for file in own:
            await self.delete(file.id)
        for head in flight.notes:
            await asyncio.to_thread(self.joined.notes.delete, head.id)

    async def read_unasked(self, names: Iterable[str]) -> None:
        """Reads recordings in which a flight has ended, so that the list says more of it."""
        self._ended |= set(names)
        if self._is_busy():
            return  # `run` reads them when all have landed
        names, self._ended = self._ended, set()
        for file in await self.files():
            if file.source == "recording" and file.path.name in names and not file.is_current:
                await self._read_unasked(file)

    async def files(self) -> list[LogFile]:
        """All files, the newest first."""
        return await asyncio.to_thread(self.library.files, self._clock.unix_s())

    async def get(self, file_id: str) -> LogFile:
        """One file. Raises UnknownFlight."""
        return await asyncio.to_thread(self.library.get, file_id)

    async def is_read(self, file_id: str) -> bool:
        """Whether `overview` answers immediately. Raises UnknownFlight."""
        folder = self._folder(await self.get(file_id))
        return await asyncio.to_thread((folder / _OVERVIEW).is_file)

    async def overview(self, file_id: str) -> bytes:
        """The overview of a log, as JSON; reads the log if it has changed or was not read yet.

        Raises:
            UnknownFlight: there is no such file.
            LogUnusable: it cannot be read; the text says why.
            ClientHasTooMany, ServerBusy: too many logs are being read or wait.
        """
        lock = self._locks.setdefault(file_id, asyncio.Lock())
        try:
            async with lock:
                file = await self.get(file_id)
                folder = self._folder(file)
                known = await asyncio.to_thread(_read_overview, folder)
                return known if known is not None else await self._read(file, folder)
        finally:
            if not lock.locked():
                self._locks.pop(file_id, None)

    async def plot(
        self, file_id: str, fields: list[str], from_s: float | None, to_s: float | None, points: int
    ) -> bytes:
        """Values of fields and expressions, as JSON; of a recording that still grows, as far as it was read.

        Raises:
            UnknownFlight, LogUnusable, ClientHasTooMany, ServerBusy: see `overview`.
            InvalidRequest: the log has no such field, or an expression is invalid.
        """
        folder = await self._read_folder(file_id)
        return await self._work.plot(folder, fields, from_s, to_s, points)

    async def spectrum(self, file_id: str, field: str, from_s: float | None, to_s: float | None) -> bytes:
        """Which frequencies a field or expression has, and when, as JSON. Raises as `plot`."""
        return await self._work.spectrum(await self._read_folder(file_id), field, from_s, to_s)

    async def loops(self, file_id: str, from_s: float | None, to_s: float | None) -> bytes:
        """How the rate and attitude loops follow their setpoints (`loops.Loops`), as JSON.

        Raises:
            UnknownFlight, LogUnusable, ClientHasTooMany, ServerBusy: see `overview`.
        """
        return await self._work.loops(await self._read_folder(file_id), from_s, to_s)

    async def findings(self, file_id: str) -> bytes:
        """What a log means, as JSON; of a recording that still grows, as far as it was read.

        Raises:
            UnknownFlight, LogUnusable, ClientHasTooMany, ServerBusy: see `overview`.
        """
        return await self._work.findings(await self._read_folder(file_id))

    async def table(
        self, file_id: str, topic: str, from_row: int | None, at_s: float | None, count: int
    ) -> bytes:
        """Rows of a topic from a row or a time on, as JSON.

        Raises:
            UnknownFlight, LogUnusable, ClientHasTooMany, ServerBusy: see `overview`.
            InvalidRequest: the log has no such topic.
        """
        return await self._work.table(await self._read_folder(file_id), topic, from_row, at_s, count)

    async def export(self, file_id: str, request: Mapping[str, Any]) -> AsyncGenerator[bytes]:
        """The pieces of a log's export (`exports.export.Request`); see `LogWork.export`.

        Raises:
            UnknownFlight, LogUnusable, ClientHasTooMany, ServerBusy: see `overview`.
        """
        folder = await self._read_folder(file_id)
        return self._work.export(folder, (await self.get(file_id)).path.name, request)

    async def rerun(
        self,
        file_id: str,
        from_s: float,
        to_s: float,
        change: Mapping[str, Any],
        plan: Mapping[str, str] | None = None,
    ) -> bytes:
        """A part of a flight flown again in simulation, as it was and with a change (`tasks.rerun`), as JSON.

        Raises:
            UnknownFlight, LogUnusable, ClientHasTooMany, ServerBusy: see `overview`.
            InvalidRequest: this part cannot be flown, or the change has no effect on it.
        """
        return await self._work.rerun(await self._read_folder(file_id), from_s, to_s, change, plan)

    async def flown_plan(self, file_id: str, at_s: float) -> dict[str, Any] | None:
        """What the server noted of the plan or program (`kind`, `id`, `version`, …) of the flight at a time
        of a file; None: nothing. Raises UnknownFlight."""
        await self.get(file_id)
        for flight in (await self.flights())[0]:
            for part in flight.joined.parts:
                if part.file == file_id and part.flight.begin_s <= at_s <= part.flight.end_s:
                    details = [
                        await asyncio.to_thread(self.joined.notes.details, head.id) for head in flight.notes
                    ]
                    plans = [json.loads(each)["plan"] for each in details if each is not None]
                    return next((plan for plan in plans if plan["id"] is not None), None)
        return None

    async def identify(self, flight: Flight, mass_kg: float | None) -> bytes:
        """The model of the aircraft of a flight, as JSON (`missions.what_if.vehicle_model.VehicleModel`).

        Args:
            flight: the flight; its vehicle's own log is read.
            mass_kg: known take-off mass; None: not known.

        Raises:
            LogUnusable, ClientHasTooMany, ServerBusy: see `overview`.
            InvalidRequest: it has no log of the vehicle, or the log says too little.
        """
        parts = [each for each in flight.joined.parts if each.file in flight.files]
        part = next((each for each in parts if kind_of(flight.files[each.file].path.name) == "ulog"), None)
        if part is None:
            raise InvalidRequest("flight", "The flight has no log of the vehicle (ULog).")
        begin_s = part.flight.begin_s
        to_s = min(part.flight.end_s, begin_s + IDENTIFIED_S)
        return await self._work.identify(await self._read_folder(part.file), begin_s, to_s, mass_kg)

    async def beside(self, ids: Sequence[str], align: str, offset_s: float) -> bytes:
        """Two flights over each other, as JSON (`two_flights.TwoFlights`): the main log of each.

        Args:
            ids: of two flights or files.
            align: by what their times are brought together (`two_flights.Align`).
            offset_s: with `offset`, what is added to times of the second log.

        Raises:
            UnknownFlight, LogUnusable, ClientHasTooMany, ServerBusy: see `overview`.
            InvalidRequest: they cannot be compared like this.
        """
        found = [await self._main_part(each) for each in ids]
        folders = [await self._read_folder(file) for file, _ in found]
        return await self._work.beside(folders, [part for _, part in found], align, offset_s)

    async def _main_part(self, flight_id: str) -> tuple[str, dict[str, Any]]:
        """The file of a flight's main part, and where the flight is in it; of a file the whole."""
        if "-" not in flight_id:
            return flight_id, {"vehicle": ""}
        flight = await self.flight(flight_id)
        part = next((each for each in flight.joined.parts if each.file in flight.files), None)
        if part is None:
            raise InvalidRequest("other", "The flight has no recording and no log.")
        span = {"begin_s": part.flight.begin_s, "end_s": part.flight.end_s}
        return part.file, {"vehicle": part.flight.vehicle, **span}

    async def delete(self, file_id: str) -> None:
        """Deletes a file.

        Raises:
            UnknownFlight: there is no such file.
            Refused: it is being recorded or replayed, or the system does not allow it.
        """
        file = await self.get(file_id)
        if file.path in self._in_use():
            raise Refused(
                "The file is being recorded or replayed.", remedy="Close its link or replay, then try again."
            )
        try:
            await asyncio.to_thread(self.library.delete, file_id)
        except OSError as error:
            raise Refused(
                f"The file cannot be deleted: {error.strerror or error}.", remedy="Delete it on the server."
            ) from error
        await asyncio.to_thread(self._forget_columns, file_id, None)

    async def id_of(self, path: Path) -> str:
        """The id of a file that was just written. Raises OSError if it is gone."""
        file_id = await asyncio.to_thread(self.library.id_of, path, self._clock.unix_s())
        if file_id is None:
            raise FileNotFoundError(path)
        return file_id

    async def make_room(self) -> None:
        """Deletes the oldest files if all together are too large."""
        removed = await asyncio.to_thread(
            self.library.make_room, self.max_bytes, self._in_use(), self._clock.unix_s()
        )
        for each in removed:
            self._on_removed(each)
        await asyncio.to_thread(self._drop_notes)

    def _drop_notes(self) -> None:
        """Notes last as long as their recordings, or as another file of their flight."""
        files = self.library.files(self._clock.unix_s())
        kept = {head.id for flight in self.joined.flights(files) if flight.files for head in flight.notes}
        kept |= {head.id for head in self.joined.notes.heads() if _is_new(head, self._clock.unix_s())}
        recordings = {file.path.name for file in files if file.source == "recording"}
        self.joined.notes.drop_unrecorded(recordings, kept)

    async def _read_new(self) -> None:
        """Reads logs that nobody has opened, one at a time, while no vehicle flies."""
        in_use = self._in_use()
        for file in await self.files():
            known = file.summary or {}
            if file.path in in_use or (file.is_current and ("flights" in known or "problem" in known)):
                continue
            if self._is_busy():
                return
            await self._read_unasked(file)

    async def _read_unasked(self, file: LogFile) -> None:
        if file.size_bytes <= MAX_UNASKED_BYTES:
            with contextlib.suppress(GcsError):  # the list says what is wrong with it
                await self.overview(file.id)

    def close(self) -> None:
        """Ends the process that reads logs, and closes the index."""
        self._work.close()
        self.library.close()

    async def _read(self, file: LogFile, folder: Path) -> bytes:
        try:
            overview = await self._work.read(file.path, folder)
        except LogUnusable as error:
            await asyncio.to_thread(self.library.note, file, {"problem": error.message})
            raise
        summary = await asyncio.to_thread(_summary, overview)
        await asyncio.to_thread(self.library.note, file, summary)
        await asyncio.to_thread(self._forget_columns, file.id, folder)
        await asyncio.to_thread(self._limit_cache, folder)
        return overview

    def _folder(self, file: LogFile) -> Path:
        return self._cache / f"{file.id}-{file.version[0]}-{file.version[1]}-{FORMAT}"

    async def _read_folder(self, file_id: str) -> Path:
        """The columns of a log, which is read if it was not yet."""
        file = await self.get(file_id)
        folder = await asyncio.to_thread(self._newest_folder, file)
        if folder is None:
            await self.overview(file_id)
            folder = self._folder(file)
        return folder

    def _newest_folder(self, file: LogFile) -> Path | None:
        folders = [self._folder(file), *self._cache.glob(f"{file.id}-*")]
        return next((folder for folder in folders if (folder / _OVERVIEW).is_file()), None)

    def _forget_columns(self, file_id: str, kept: Path | None) -> None:
        for folder in self._cache.glob(f"{file_id}-*"):
            if folder != kept:
                shutil.rmtree(folder, ignore_errors=True)

    def _limit_cache(self, kept: Path) -> None:
        sizes = {
            folder: sum(path.stat().st_size for path in folder.iterdir())
            for folder in self._cache.iterdir()
            if folder.is_dir()
        }
        total = sum(sizes.values())
        for folder in sorted(sizes, key=lambda each: each.stat().st_mtime):
            if total <= CACHE_BYTES:
                return
            if folder != kept:
                shutil.rmtree(folder, ignore_errors=True)
                total -= sizes[folder]


def _is_new(head: NotesHead, unix_s: float) -> bool:
    """Whether notes may be of a flight that goes on, or has just ended."""
    begin_s = head.flight.begin_unix_s
    return begin_s is None or unix_s - begin_s - head.flight.duration_s < 2 * CHECK_PERIOD_S


def _read_overview(folder: Path) -> bytes | None:
    with contextlib.suppress(OSError):
        overview = (folder / _OVERVIEW).read_bytes()
        folder.touch()  # the newest of the cache
        return overview
    return None


def _summary(overview: bytes) -> dict[str, Any]:
    """What the list shows of a log."""
    values = json.loads(overview)
    problems = values["problems"]
    return {
        **{name: values[name] for name in _SUMMARY},
        "vehicles": [vehicle["id"] for vehicle in values["vehicles"] if vehicle["id"]],
        "problem": " ".join(problems)[:500] or None,
    }
