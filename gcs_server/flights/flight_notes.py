"""Notes each flight of each vehicle, from arming to disarming, so that it can be joined with recordings and
logs later: which recordings, which plan or program and dry run, how it compared, which commands, which
parameters at the start. The head is written from time to time, so that a killed server leaves it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import msgspec

from gcs_server.clock import Clock
from gcs_server.errors import Refused, UnknownDryRun, UnknownLink
from gcs_server.flights.flights import Flights
from gcs_server.logbook.beside_plan import PREDICTED
from gcs_server.logbook.logged_flights import Ended, LoggedFlight
from gcs_server.logbook.notes import NotesHead, NotesStore
from gcs_server.mavlink.router import Router
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.fleet import Fleet
from gcs_server.vehicle.vehicle import Vehicle

log = logging.getLogger(__name__)

PERIOD_S = 1.0
WRITE_EVERY_S = 20.0
BEFORE_S = 120.0
"""Commands of this time before arming belong to the flight: the upload of its plan, its start [s]."""
AFTER_S = 2.0
MAX_COMMANDS = 1000
_ENDED: dict[str, Ended] = {"on_ground": "landed", "unknown": "disarmed"}
"""How a flight ended, by the state of the vehicle when it was disarmed."""
_PLAN = ("kind", "name", "id", "version", "dry_run", "flown")
Commands = Callable[[str, float, float], Sequence[Mapping[str, object]]]
"""Returns the commands to a vehicle between two times [s since 1970 UTC], oldest first."""


@dataclass(slots=True)
class _Flight:
    id: str
    vehicle: Vehicle
    began_s: float
    """Monotonic [s]."""
    began_unix_s: float
    begin_boot_s: float | None
    starts_armed: bool
    parameters: dict[str, float]
    recordings: dict[str, None] = field(default_factory=dict[str, None])
    modes: dict[str, None] = field(default_factory=dict[str, None])
    ended_s: float | None = None
    written_s: float = float("-inf")


class _DryFlight(msgspec.Struct):
    battery_start_share: float
    battery_end_share: float | None


class _DryRun(msgspec.Struct):
    """What is noted of a dry run."""

    nominal: _DryFlight
    group: msgspec.Raw | None = None
    """The flights of several vehicles; `nominal` is that of the first."""


class FlightNotes:
    """The notes of the flights of all vehicles.

    Args:
        clock: the server's clock.
        fleet: the vehicles.
        router: the links with their recordings.
        flights: plans and programs that are flown.
        store: keeps the notes.
        commands: the commands of the journal.
        on_ended: called with the recordings of a flight that has ended.
    """

    def __init__(
        self,
        clock: Clock,
        fleet: Fleet,
        router: Router,
        flights: Flights,
        store: NotesStore,
        commands: Commands,
        on_ended: Callable[[list[str]], Awaitable[None]],
    ) -> None:
        self._clock, self._fleet, self._router, self._flights = clock, fleet, router, flights
        self._store, self._commands, self._on_ended = store, commands, on_ended
        self._open: dict[str, _Flight] = {}
        self._seen_disarmed: set[str] = set()
        self._supervisor: Supervisor | None = None

    def start(self, supervisor: Supervisor) -> None:
        """Starts the periodic update."""
        self._supervisor = supervisor
        supervisor.repeat("notes of flights", self.update, PERIOD_S)

    def any_flying(self) -> bool:
        """Whether a vehicle of this server is armed."""
        return bool(self._open)

    def detach(self, vehicle: Vehicle) -> None:
        """Ends the notes of a vehicle that is removed."""
        self._seen_disarmed.discard(vehicle.id)
        if (flight := self._open.pop(vehicle.id, None)) is not None:
            self._write(flight, with_details=True)

    def close(self) -> None:
        """Writes the notes of vehicles that still fly; blocks."""
        for flight in self._open.values():
            self._save(self._head(flight), self._details(flight))
        self._open.clear()

    def update(self) -> None:
        """Looks at each vehicle. A fault of one affects only its notes."""
        for vehicle in self._fleet.all():
            if not vehicle.identity.replayed:
                vehicle.isolation.run("the notes of its flight", self._update, vehicle)

    def _update(self, vehicle: Vehicle) -> None:
        flight, now_s = self._open.get(vehicle.id), self._clock.monotonic_s()
        armed = vehicle.flight_state.armed
        if flight is None:
            if armed:
                flight = self._open[vehicle.id] = self._begin(vehicle, now_s)
                self._write(flight, with_details=True)
            else:
                self._seen_disarmed.add(vehicle.id)
            return
        if flight.ended_s is not None:  # one period later, when its plan has ended too
            del self._open[vehicle.id]
            self._write(flight, with_details=True)
            self._report_end(flight)
            return
        self._note_recordings(flight)
        flight.modes[vehicle.status.mode_label] = None
        if not armed:
            flight.ended_s = now_s
        elif now_s - flight.written_s >= WRITE_EVERY_S:
            self._write(flight, with_details=False)

    def _begin(self, vehicle: Vehicle, now_s: float) -> _Flight:
        boots = [e.boot_at_s for e in vehicle.endpoints if e.boot_at_s is not None]
        flight = _Flight(
            id=self._store.new_id(),
            vehicle=vehicle,
            began_s=now_s,
            began_unix_s=self._clock.unix_s(),
            begin_boot_s=now_s - boots[0] if boots else None,
            starts_armed=vehicle.id not in self._seen_disarmed,
            parameters={param.name: float(param.value) for param in vehicle.params.all()},
        )
        self._note_recordings(flight)
        return flight

    def _note_recordings(self, flight: _Flight) -> None:
        for link in flight.vehicle.links:
            try:
                recording = self._router.connection(link).info().recording
            except UnknownLink:
                continue
            if recording is not None and recording.file is not None:
                flight.recordings[recording.file] = None

    def _report_end(self, flight: _Flight) -> None:
        if self._supervisor is not None:
            ended = self._on_ended(list(flight.recordings))

            async def read() -> None:
                await ended

            self._supervisor.spawn(f"vehicle {flight.vehicle.id}: reading its recording", read())

    def _write(self, flight: _Flight, *, with_details: bool) -> None:
        flight.written_s = self._clock.monotonic_s()
        head, details = self._head(flight), self._details(flight) if with_details else None
        if self._supervisor is not None:
            work = asyncio.to_thread(self._save, head, details)
            self._supervisor.spawn(f"vehicle {flight.vehicle.id}: notes of its flight", work)

    def _save(self, head: NotesHead, details: dict[str, Any] | None) -> None:
        if details is not None and details["plan"]["dry_run"] is not None:
            details["plan"][PREDICTED] = self._predicted(details["plan"]["dry_run"])
        try:
            self._store.write(head, None if details is None else msgspec.json.encode(details))
        except OSError as error:
            log.warning("the notes of a flight of vehicle %s cannot be written: %s", head.vehicle, error)

    def _predicted(self, dry_run_id: str) -> float | None:
        """What the dry run used of the battery, 0 to 1; None: not known, or dropped. Blocks."""
        try:
            dry_run = msgspec.json.decode(self._flights.dry_runs.body(dry_run_id), type=_DryRun)
        except (UnknownDryRun, msgspec.ValidationError):
            return None
        start, end = dry_run.nominal.battery_start_share, dry_run.nominal.battery_end_share
        is_of_several = dry_run.group is not None and bytes(dry_run.group) != b"null"
        return None if end is None or is_of_several else round(start - end, 3)

    def _head(self, flight: _Flight) -> NotesHead:
        vehicle, end_s = flight.vehicle, flight.ended_s
        ended: Ended = "log_ends"
        if end_s is not None:
            ended = _ENDED.get(vehicle.flight_state.landed_state, "disarmed_in_air")
        duration_s = (self._clock.monotonic_s() if end_s is None else end_s) - flight.began_s
        logged = LoggedFlight(
            vehicle=str(vehicle.identity.system_id),
            uid=vehicle.identity.uid,
            begin_s=0.0,
            end_s=duration_s,
            begin_unix_s=flight.began_unix_s,
            by_gps=False,
            begin_boot_s=flight.begin_boot_s,
            duration_s=duration_s,
            distance_m=None,
            height_m=None,
            modes=tuple(flight.modes),
            failsafes=0,
            ended=ended,
            starts_armed=flight.starts_armed,
        )
        return NotesHead(flight.id, vehicle.id, tuple(flight.recordings), logged, self._flown(flight)["name"])

    def _details(self, flight: _Flight) -> dict[str, Any]:
        end_unix_s = self._clock.unix_s() + AFTER_S
        commands = self._commands(flight.vehicle.id, flight.began_unix_s - BEFORE_S, end_unix_s)
        return {
            "parameters": flight.parameters,
            "commands": commands[-MAX_COMMANDS:],
            "plan": self._flown(flight),
        }

    def _flown(self, flight: _Flight) -> dict[str, Any]:
        """The plan or program that was flown, with its comparison; all None: there was none."""
        vehicle_id = flight.vehicle.id
        plan: dict[str, Any] = dict.fromkeys(_PLAN)
        candidates: list[tuple[str, Any, Callable[[], Any]]] = []
        if (status := self._flights.waypoint_flights.status(vehicle_id)) is not None:
            flown = self._flights.waypoint_flights.flown
            candidates.append(("waypoint_plan", status, lambda: flown(vehicle_id)))
        if (mission := self._flights.missions.find_flight(vehicle_id)) is not None:
            candidates.append(("offboard_mission", mission.status(), mission.flown))
        for kind, status, read in candidates:
            if status.started_unix_s < flight.began_unix_s - BEFORE_S:
                continue  # of an earlier flight
            plan |= {"kind": kind, "name": status.name, "id": status.plan_id, "version": status.version}
            plan["dry_run"] = status.dry_run
            try:
                plan["flown"] = asdict(read())
            except Refused:
                continue
        return plan
