"""The flights of a server: what its files and notes know of each, joined, with the decisions of people. All
functions block; they may be called from several threads."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec

from gcs_server.errors import InvalidRequest, UnknownFlight
from gcs_server.logbook.decisions import Decisions
from gcs_server.logbook.joining import Joined, Part, join
from gcs_server.logbook.library import LogFile
from gcs_server.logbook.logged_flights import Ended, LoggedFlight
from gcs_server.logbook.notes import NotesHead, NotesStore

log = logging.getLogger(__name__)

_SAYS_MOST: list[Ended] = ["log_ends", "disarmed", "disarmed_in_air", "landed"]
"""How a flight ended, what says most last."""


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight of one vehicle."""

    id: str
    name: str | None
    """Given by a person; None: no name."""
    joined: Joined
    files: dict[str, LogFile]
    """The files of its parts, by id."""
    notes: tuple[NotesHead, ...]
    """What the server noted of it."""

    @property
    def best(self) -> LoggedFlight:
        """What the main part says of the flight, completed by the others."""
        flights = [part.flight for part in self.joined.parts]
        main = flights[0]
        start = next((f for f in flights if f.by_gps and f.begin_unix_s is not None), None) or next(
            (f for f in flights if f.begin_unix_s is not None), main
        )
        return replace(
            main,
            uid=next((f.uid for f in flights if f.uid is not None), None),
            vehicle=next((f.vehicle for f in flights if f.vehicle), ""),
            begin_unix_s=start.begin_unix_s,
            by_gps=start.by_gps,
            duration_s=max(f.duration_s for f in flights),
            distance_m=next((f.distance_m for f in flights if f.distance_m is not None), None),
            height_m=next((f.height_m for f in flights if f.height_m is not None), None),
            modes=next((f.modes for f in flights if f.modes), ()),
            failsafes=max(f.failsafes for f in flights),
            ended=max(flights, key=lambda f: _SAYS_MOST.index(f.ended)).ended,
        )


class JoinedFlights:
    """Joins files and notes to flights.

    Args:
        notes: the server's own notes.
        decisions: names, and what people joined or separated.
    """

    def __init__(self, notes: NotesStore, decisions: Decisions) -> None:
        self.notes, self._decisions = notes, decisions
        self._last: tuple[object, list[Joined]] = (None, [])

    def flights(self, files: Sequence[LogFile]) -> list[Flight]:
        """All flights, the newest first."""
        by_id = {file.id: file for file in files}
        heads = {head.id: head for head in self.notes.heads()}
        parts = [*_parts_of_files(files), *(_part_of_notes(head) for head in heads.values())]
        keys = {part.id: _key(part, by_id) for part in parts}
        ids = {key: part for part, key in keys.items()}
        decided = {
            frozenset(ids[key] for key in pair): joined
            for pair, joined in self._decisions.pairs().items()
            if pair <= ids.keys()
        }
        names = self._decisions.names()
        flights: list[Flight] = []
        for joined in self._join(parts, decided):
            name = next((names[keys[p.id]] for p in joined.parts if keys[p.id] in names), None)
            of_files = {p.file: by_id[p.file] for p in joined.parts if p.file in by_id}
            of_notes = tuple(heads[p.file] for p in joined.parts if p.file in heads)
            flights.append(Flight(joined.id, name, joined, of_files, of_notes))
        return sorted(flights, key=lambda each: each.best.begin_unix_s or 0.0, reverse=True)

    def find(self, files: Sequence[LogFile], flight_id: str) -> Flight:
        """The flight with this id, or with a part of this id. Raises UnknownFlight."""
        for flight in self.flights(files):
            if flight_id in {part.id for part in flight.joined.parts}:
                return flight
        shown = flight_id if len(flight_id) <= 40 else f"{flight_id[:40]}…"
        raise UnknownFlight(f"There is no flight {shown!r}.", remedy="GET /flights lists them.")

    def set_name(self, files: Sequence[LogFile], flight_id: str, name: str | None) -> Flight:
        """Names a flight; None takes its name away. Raises UnknownFlight, OSError."""
        flight = self.find(files, flight_id)
        self._decisions.set_name([_key(p, flight.files) for p in flight.joined.parts], name)
        return self.find(files, flight_id)

    def decide(self, files: Sequence[LogFile], flight_id: str, part_id: str, *, joined: bool) -> Flight:
        """Joins a part of another flight to this one, or separates one of its parts.

        Raises:
            UnknownFlight: there is no such flight.
            InvalidRequest: there is no such part, it is the main one, or both are flights of one file.
            OSError: the decision cannot be written.
        """
        flight = self.find(files, flight_id)
        others = self.find(files, part_id) if joined else flight
        part = next((p for p in others.joined.parts if p.id == part_id), None)
        if part is None:
            raise InvalidRequest("part", "The flight has no such part.", remedy="GET /flights lists them.")
        if not joined and len(flight.joined.parts) == 1:
            raise InvalidRequest("part", "It is the only part of the flight.")
        kept = [p for p in flight.joined.parts if p.id != part_id]
        if joined and any(p.file == part.file for p in kept):
            raise InvalidRequest("part", "Both are flights of one file, which cannot be one flight.")
        all_files = {file.id: file for file in files}
        mine = [_key(p, all_files) for p in (others.joined.parts if joined else [part])]
        self._decisions.decide(mine, [_key(p, all_files) for p in kept], joined=joined)
        return self.find(files, flight_id if joined or flight_id != part_id else kept[0].id)

    def _join(self, parts: list[Part], decided: dict[frozenset[str], bool]) -> list[Joined]:
        """The joined parts, again only after a change."""
        question = (parts, decided)
        if self._last[0] != question:
            self._last = (question, join(parts, decided))
        return self._last[1]


def _parts_of_files(files: Sequence[LogFile]) -> list[Part]:
    parts: list[Part] = []
    for file in files:
        try:
            flights = msgspec.convert((file.summary or {}).get("flights", []), list[LoggedFlight])
        except msgspec.ValidationError as error:  # of another version; it is read again
            log.warning("what was read of %s is not usable: %s", file.path.name, error)
            continue
        recordings = frozenset({file.path.name} if file.source == "recording" else ())
        parts += [
            Part(f"{file.id}-{number}", file.id, file.source, flight, recordings)
            for number, flight in enumerate(flights)
        ]
    return parts


def _part_of_notes(head: NotesHead) -> Part:
    return Part(f"{head.id}-0", head.id, "notes", head.flight, frozenset(head.recordings))


def _key(part: Part, files: dict[str, LogFile]) -> str:
    """The name of a part that outlives the index of files."""
    number = part.id.rsplit("-", 1)[1]
    file = files.get(part.file)
    return f"{part.source}/{part.file if file is None else file.path.name}#{number}"
