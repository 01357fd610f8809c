"""What happens with a vehicle's log after its flight, as an operator has chosen: nothing, an offer to
download it, or its download by the server, without anyone. What was offered or not yet downloaded outlives
the server."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Literal

from gcs_server.clock import Clock
from gcs_server.errors import Refused, UnknownOperation
from gcs_server.logbook.downloads import LogDownloads, log_of
from gcs_server.operations.operations import Operation, Operations
from gcs_server.storage.files import typed
from gcs_server.storage.folder import StorageError
from gcs_server.storage.records import Records, Unreadable
from gcs_server.vehicle.fleet import Fleet
from gcs_server.vehicle.services.logs import FlightLog
from gcs_server.vehicle.vehicle import Vehicle

Choice = Literal["never", "offer", "download"]
State = Literal["none", "offered", "waiting", "running", "succeeded", "failed"]
KIND, RECORD = "logs/download", "after_landing"
PERIOD_S = 1.0
MAX_ENTRIES = 100
"""Flights with an open offer or download; with more, the oldest goes."""
MAX_RUNNING = 4
"""Downloads that the server starts at once. They take turns; a vehicle that is armed again holds up none."""


@dataclass(frozen=True, slots=True)
class LandedLog:
    """What happens with the log of a vehicle's newest flight."""

    state: State
    """`none`: there is no offer; `offered`; `waiting`: it will be downloaded in turn; `running`: it is being
    downloaded, or its download is paused; `succeeded`, `failed`."""
    ended_unix_s: float | None = None
    """End of the flight [s since 1970 UTC]; null: there is none."""
    text: str = ""
    """How the download goes, or ended."""
    progress: float | None = None
    """Progress, 0 to 1; null: not known."""
    flight: str | None = None
    """Id of the downloaded log, for `GET /flights/{f}`; null: it is not on the server."""


@dataclass(frozen=True, slots=True)
class _Entry:
    vehicle: str
    ended_unix_s: float


@dataclass(frozen=True, slots=True)
class _Stored:
    choice: Choice = "offer"
    open: list[_Entry] = field(default_factory=list["_Entry"])


class AfterLanding:
    """The logs of flights that have ended.

    Args:
        clock: the server's clock.
        fleet: the vehicles.
        operations: the operations of the server.
        downloads: downloads logs.
        records: where choice and open entries are stored.
        on_start: called with the vehicle's id when the server starts a download by itself.
    """

    def __init__(
        self,
        clock: Clock,
        fleet: Fleet,
        operations: Operations,
        downloads: LogDownloads,
        records: Records,
        on_start: Callable[[str], object] = lambda _: None,
    ) -> None:
        self._clock, self._fleet, self._operations, self._downloads = clock, fleet, operations, downloads
        self._records, self._on_start = records, on_start
        downloads.on_downloaded = self._end_offer
        self.choice: Choice = "offer"
        self._entries: dict[_Entry, str | None] = {}
        """Open flights, oldest first, with the ids of their downloads; None: not begun."""
        self._flying: set[str] = set()
        self._shown: set[str] = set()
        """Vehicles that have had an entry."""
        self._done: set[_Entry] = set()
        """Those whose log is on the server: they are not stored."""
        self._written: Future[None] | None = None
        self._problem: str | None = None

    def load(self) -> None:
        """Reads what is stored; blocks."""
        try:
            record = self._records.read_all().get(RECORD)
            stored = _Stored() if record is None else _read(record)
        except (OSError, ValueError) as error:
            where = self._records.folder / f"{RECORD}.json"
            self._problem = f"What happens with logs after a landing cannot be read from {where}: {error}."
            return
        self.choice = stored.choice
        self._entries = dict.fromkeys(stored.open[-MAX_ENTRIES:])
        self._shown = {entry.vehicle for entry in self._entries}

    def warnings(self) -> str | None:
        """Why what is stored cannot be used, or was not stored."""
        if self._written is not None and self._written.done():
            error = self._written.exception()
            return (
                None
                if error is None
                else f"What happens with logs after a landing cannot be stored: {error}."
            )
        return self._problem

    async def choose(self, choice: Choice) -> None:
        """Sets what happens from now on; open offers follow it. Raises StorageError: nothing has changed."""
        before, self.choice = self.choice, choice
        try:
            await asyncio.wrap_future(self._store())
        except OSError as error:
            self.choice = before
            reason = error.strerror or str(error)
            raise StorageError(f"The choice cannot be stored: {reason}. Nothing has changed.") from error
        self._problem = None
        if choice == "never":
            self._keep(lambda entry: self._entries[entry] is not None)

    def of(self, vehicle: Vehicle) -> LandedLog | None:
        """The log of a vehicle's newest flight; None: it has not flown."""
        if vehicle.id not in self._shown:
            return None
        entry = self._newest(vehicle.id)
        if entry is None:
            return LandedLog("none")
        state, operation = self._state(entry), self._operation(entry)
        if operation is None:
            return LandedLog(state, entry.ended_unix_s)
        flight = None if operation.result is None else str(operation.result["flight"])
        return LandedLog(state, entry.ended_unix_s, operation.text, operation.progress, flight)

    def download(self, vehicle_id: str, by: tuple[str, str] = ("server", "")) -> Operation:
        """Starts the download of the log of a vehicle's newest flight, or returns the one that runs.

        Args:
            vehicle_id: the vehicle.
            by: name and key of the client.

        Raises:
            Refused: the vehicle has not flown, or too many operations run.
        """
        entry = self._newest(vehicle_id)
        if entry is None:
            raise Refused(
                f"This server has seen no flight of vehicle {vehicle_id} whose log is still open.",
                remedy="Its logs are listed by GET /vehicles/{v}/logs.",
            )
        return self._start(entry, by)

    async def drop(self, vehicle_id: str) -> None:
        """Takes back the offers of a vehicle, and cancels the download of its newest flight."""
        entry = self._newest(vehicle_id)
        operation = None if entry is None else self._operation(entry)
        self._keep(lambda each: each.vehicle != vehicle_id)
        if operation is not None:
            await self._operations.cancel(operation.id)

    def detach(self, vehicle: Vehicle) -> None:
        """Called when a vehicle is removed."""
        self._flying.discard(vehicle.id)
        self._keep(lambda entry: entry.vehicle != vehicle.id)
        self._shown.discard(vehicle.id)

    def update(self) -> None:
        """Notices landings and take-offs, and starts downloads; called each second."""
        for vehicle in self._fleet.all():
            if vehicle.flight_state.armed:
                self._take_off(vehicle)
            elif vehicle.id in self._flying:
                self._flying.discard(vehicle.id)
                identity = vehicle.identity
                has_logs = (
                    identity.commandable and not identity.replayed and "files" not in vehicle.reach.missing
                )
                if self.choice != "never" and has_logs:
                    self._add(_Entry(vehicle.id, self._clock.unix_s()))
        done = {entry for entry in self._entries if self._state(entry) == "succeeded"}
        if done - self._done:
            self._done = done
            self._store_entries()
        if self.choice == "download":
            self._start_waiting()

    # --- internal -------------------------------------------------------------------------------------

    def _take_off(self, vehicle: Vehicle) -> None:
        """Offers, and what has ended, are of the flight before; downloads wait until the landing."""
        self._keep(lambda entry: entry.vehicle != vehicle.id or self._is_to_be_downloaded(entry))
        if vehicle.flight_state.landed_state != "on_ground":
            self._flying.add(vehicle.id)

    def _end_offer(self, vehicle_id: str, log: FlightLog, logs: Sequence[FlightLog]) -> None:
        """A log that a person has downloaded is not offered any more; the download of an offer is shown."""
        self._keep(
            lambda entry: (
                entry.vehicle != vehicle_id
                or self._state(entry) == "running"
                or log_of(logs, entry.ended_unix_s) != log
            )
        )

    def _is_to_be_downloaded(self, entry: _Entry) -> bool:
        return self._state(entry) in ("waiting", "running")

    def _state(self, entry: _Entry) -> State:
        operation = self._operation(entry)
        if operation is None:
            return "waiting" if self.choice == "download" else "offered"
        return "failed" if operation.state == "cancelled" else operation.state

    def _start_waiting(self) -> None:
        here = {vehicle.id: vehicle for vehicle in self._fleet.all()}
        free = MAX_RUNNING - sum(self._state(entry) == "running" for entry in self._entries)
        for entry in [entry for entry in self._entries if self._state(entry) == "waiting"]:
            vehicle = here.get(entry.vehicle)
            if vehicle is None or vehicle.flight_state.armed or vehicle.link_lost:
                continue
            if free <= 0:
                return
            free -= 1
            try:
                self._start(entry, ("server", ""))
            except Refused:
                return  # too many operations run: later
            self._on_start(entry.vehicle)

    def _start(self, entry: _Entry, by: tuple[str, str]) -> Operation:
        known = self._operation(entry)
        if known is not None and known.state in ("running", "succeeded"):
            return known
        operation = self._operations.start(
            KIND,
            partial(self._downloads.run_landed, entry.vehicle, entry.ended_unix_s),
            text=f"Downloading the log of the last flight of vehicle {entry.vehicle}.",
            vehicle=entry.vehicle,
            subject=f"flight until {entry.ended_unix_s:.0f}",
            by=by,
        )
        self._entries[entry] = operation.id
        return operation

    def _operation(self, entry: _Entry) -> Operation | None:
        """The download of a flight's log; None: not begun, or ended so long ago that it was dropped."""
        operation_id = self._entries[entry]
        try:
            return None if operation_id is None else self._operations.get(operation_id)
        except UnknownOperation:
            return None

    def _newest(self, vehicle_id: str) -> _Entry | None:
        return next((entry for entry in reversed(self._entries) if entry.vehicle == vehicle_id), None)

    def _add(self, entry: _Entry) -> None:
        self._entries[entry] = None
        self._shown.add(entry.vehicle)
        newest = list(self._entries)[-MAX_ENTRIES:]
        self._keep(lambda each: each in newest, changed=True)

    def _keep(self, wanted: Callable[[_Entry], bool], *, changed: bool = False) -> None:
        kept = {entry: operation for entry, operation in self._entries.items() if wanted(entry)}
        if changed or len(kept) < len(self._entries):
            self._entries = kept
            self._store_entries()

    def _store_entries(self) -> None:
        if self._problem is None:  # a record that cannot be read stays until a person chooses again
            self._store()

    def _store(self) -> Future[None]:
        stored = _Stored(self.choice, [entry for entry in self._entries if entry not in self._done])
        self._written = self._records.write(RECORD, asdict(stored))
        return self._written

    def close(self) -> None:
        """Waits for pending writes."""
        self._records.close()


def _read(record: dict[str, object] | Unreadable) -> _Stored:
    """Raises ValueError: it is not a record of this class."""
    if isinstance(record, Unreadable):
        raise ValueError(record)
    return typed(_Stored, record)
