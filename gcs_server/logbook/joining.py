"""Joins what is known of one flight: the server's recording, the vehicle's own log, and the server's notes.

The same flight of the same vehicle is recognised by the time since the vehicle's boot, the time of day (the
vehicle's by GPS, or that of the server which recorded it), the vehicle's identity, and arming and disarming.
What agrees in one of them but not surely in all is not joined, and says why. A person's decision comes first.
Pure: the result depends only on what there is, not on the order in which it came.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from gcs_server.logbook.logged_flights import LoggedFlight

Source = Literal["recording", "vehicle", "file", "notes"]
Pair = frozenset[str]
"""Ids of two parts."""

SAME_BOOT_S = 2.5
"""Maximum difference of the time since the boot: a HEARTBEAT, which shows arming, comes once a second."""
SAME_CLOCK_S = 5.0
"""Maximum difference of two clocks that show the time of day."""
SERVER_CLOCK_S = 300.0
"""A server's clock without a network may be wrong by this; the flight must then be the only one that fits."""
SAME_DURATION_S = 3.0
MIN_SHARE = 0.5
"""Least part of the shorter flight in which both were in the air."""
NEIGHBOURS = 60
GAP_S = 60.0
"""Maximum gap between two files of one flight."""


@dataclass(frozen=True, slots=True)
class Part:
    """What one file knows of one flight."""

    id: str
    """Id of the file and number of the flight in it: `0123456789abcdef-0`."""
    file: str
    """Id of the file."""
    source: Source
    flight: LoggedFlight
    recordings: frozenset[str] = frozenset()
    """Names of the recordings that were written: a recording's own; of notes those of the vehicle's links."""


@dataclass(slots=True)
class Joined:
    """One flight."""

    parts: list[Part]
    """The main one first, on whose time the others are shown: the vehicle's log, or else a recording."""
    why: dict[str, str]
    """By part: why it was joined."""
    unsure: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    """Parts of other flights that could be the same one, and why they were not joined."""

    @property
    def id(self) -> str:
        """The id of the part that was there first; those of all parts are accepted."""
        return min(part.id for part in self.parts)

    def offset_s(self, part: Part) -> float:
        """What is added to a part's times, so that they are those of the main part [s]."""
        main = self.parts[0].flight
        other = part.flight
        if main.begin_boot_s is not None and other.begin_boot_s is not None:
            return (other.begin_boot_s - other.begin_s) - (main.begin_boot_s - main.begin_s)
        if main.begin_unix_s is not None and other.begin_unix_s is not None:
            offset_s = (other.begin_unix_s - other.begin_s) - (main.begin_unix_s - main.begin_s)
            if (main.by_gps and other.by_gps) or abs(offset_s + other.begin_s - main.begin_s) < SAME_BOOT_S:
                return offset_s
        return main.begin_s - other.begin_s  # both begin at arming


CERTAIN, STRONG, TIMELY, WEAK = 3, 2, 1, 0


@dataclass(frozen=True, slots=True)
class Match:
    """How well two parts agree."""

    sure: bool
    strength: int
    """The strongest is joined first; `WEAK`: without the time of day another flight could agree as well."""
    why: str


def join(parts: Iterable[Part], decided: Mapping[Pair, bool]) -> list[Joined]:
    """The flights of all parts.

    Args:
        parts: the parts.
        decided: pairs that a person has joined (true) or separated.
    """
    parts = sorted(parts, key=lambda each: each.id)
    matches = _matches(parts, decided)
    groups = {part.id: Joined([part], {}) for part in parts}
    unsure: list[tuple[Part, Part, str]] = []
    for a, b, match in sorted(matches, key=lambda m: (-m[2].strength, m[0].id, m[1].id)):
        one, other = groups[a.id], groups[b.id]
        if one is other:
            continue
        reason = _conflict(one, other, match, decided) if match.sure else match.why
        if reason is not None:
            unsure.append((a, b, reason))
            continue
        one.parts += other.parts
        one.why |= other.why
        for each in (a, b):
            one.why.setdefault(each.id, match.why)
        groups.update({part.id: one for part in other.parts})
    for a, b, reason in unsure:
        if groups[a.id] is not groups[b.id] and decided.get(frozenset((a.id, b.id))) is not False:
            groups[a.id].unsure.append((b.id, reason))
            groups[b.id].unsure.append((a.id, reason))
    flights = list({id(group): group for group in groups.values()}.values())
    for flight in flights:
        flight.parts.sort(key=_rank)
    return flights


def _rank(part: Part) -> tuple[int, float, str]:
    """The main part first: the vehicle's log, a recording, notes; of several the longest."""
    kinds = {"vehicle": 0, "file": 0, "recording": 1, "notes": 2}
    return kinds[part.source], -part.flight.duration_s, part.id


def _matches(parts: Sequence[Part], decided: Mapping[Pair, bool]) -> list[tuple[Part, Part, Match]]:
    """All pairs that agree in one way or another. Only neighbours are compared: by the time of day, and by
    the time since the boot."""
    by_id = {part.id: part for part in parts}
    pairs = {pair for pair, joined in decided.items() if joined and pair <= by_id.keys() and len(pair) == 2}
    times: tuple[Callable[[LoggedFlight], float | None], ...] = (
        lambda flight: flight.begin_unix_s,
        lambda flight: flight.begin_boot_s,
    )
    for key in times:
        ordered = sorted((p for p in parts if key(p.flight) is not None), key=lambda p: key(p.flight) or 0.0)
        for i, part in enumerate(ordered):
            pairs |= {frozenset((part.id, other.id)) for other in ordered[max(0, i - NEIGHBOURS) : i]}
    found: list[tuple[Part, Part, Match]] = []
    for pair in pairs:
        a, b = (by_id[each] for each in sorted(pair))
        if (decision := decided.get(pair)) is not None:
            match = Match(True, CERTAIN, "joined by a person") if decision else None
        else:
            match = compare(a, b) if a.file != b.file else None
        if match is not None:
            found.append((a, b, match))
    return _only_ones(found)


def _only_ones(found: list[tuple[Part, Part, Match]]) -> list[tuple[Part, Part, Match]]:
    """Matches without the time of day are sure only if each part has one in each other kind of source."""
    counts: dict[tuple[str, Source], int] = {}
    for a, b, match in found:
        if match.sure and match.strength == WEAK:
            for one, other in ((a, b), (b, a)):
                counts[(one.id, other.source)] = counts.get((one.id, other.source), 0) + 1
    why = "several flights have the same time since the boot and the same duration"
    return [
        (a, b, Match(False, WEAK, why))
        if match.sure
        and match.strength == WEAK
        and max(counts[(a.id, b.source)], counts[(b.id, a.source)]) > 1
        else (a, b, match)
        for a, b, match in found
    ]


def _conflict(one: Joined, other: Joined, match: Match, decided: Mapping[Pair, bool]) -> str | None:
    """Why two groups cannot be one flight."""
    if match.strength == WEAK and {p.source for p in one.parts} & {p.source for p in other.parts}:
        return f"{match.why}; but the flight has such a file already, which agrees better"
    for a in one.parts:
        for b in other.parts:
            if decided.get(frozenset((a.id, b.id))) is False:
                return "a person has separated them"
            if a.file == b.file and a.source != "notes":
                return "both are flights of one file"
            if _identity(a.flight, b.flight) is False:
                return "they are of different vehicles"
    return None


def _identity(a: LoggedFlight, b: LoggedFlight) -> bool | None:
    """Whether both are of one vehicle; None: not known."""
    if a.uid is not None and b.uid is not None and len(a.uid) == len(b.uid):
        return a.uid.lower() == b.uid.lower()
    if a.vehicle and b.vehicle:
        return a.vehicle == b.vehicle
    return None


def _share(a_s: float, a_length_s: float, b_s: float, b_length_s: float) -> float:
    """Part of the shorter of two times in which they overlap, by their begins and lengths."""
    overlap_s = min(a_s + a_length_s, b_s + b_length_s) - max(a_s, b_s)
    return max(0.0, overlap_s) / max(1e-3, min(a_length_s, b_length_s))


def _same_time(a: LoggedFlight, b: LoggedFlight) -> bool | None:
    """Whether both flew at one time since the boot, as sharply as arming was seen; None: not known."""
    if a.begin_boot_s is None or b.begin_boot_s is None:
        return None
    both_saw_arming = not (a.starts_armed or b.starts_armed)
    if both_saw_arming and abs(a.begin_boot_s - b.begin_boot_s) > SAME_BOOT_S:
        return False
    return _share(a.begin_boot_s, a.duration_s, b.begin_boot_s, b.duration_s) >= MIN_SHARE


def compare(one: Part, other: Part) -> Match | None:
    """How well two parts of different files agree; None: they are different flights."""
    a, b = one.flight, other.flight
    identity, same_boot = _identity(a, b), _same_time(a, b)
    if identity is False:
        return None
    if "notes" in (one.source, other.source) and one.recordings & other.recordings:
        return _noted(a, b)
    if (continued := _continued(a, b, identity)) is not None:
        return continued
    if same_boot is False:
        return None
    same_duration = abs(a.duration_s - b.duration_s) <= SAME_DURATION_S
    if a.begin_unix_s is None or b.begin_unix_s is None:
        return _without_day(identity) if same_boot and same_duration else None
    apart_s = _apart_s(a, b)
    by_gps = a.by_gps and b.by_gps
    clock = "time by GPS" if by_gps else "time of day"
    if apart_s <= SAME_CLOCK_S:
        if identity is None:
            return Match(False, TIMELY, f"{clock} agrees, but the vehicle is not known")
        if same_boot:
            return Match(True, STRONG, f"same vehicle, {clock} and time since its boot")
        if same_duration:
            return Match(True, TIMELY, f"same vehicle, {clock} and duration")
        return Match(False, TIMELY, f"vehicle and {clock} agree, but not the durations")
    if by_gps or not same_boot or not same_duration:
        return None
    apart = f"the clock of the server was wrong by {apart_s:.0f} s"
    if identity and (apart_s <= SERVER_CLOCK_S or (a.uid is not None and a.uid == b.uid)):
        return Match(True, WEAK, f"same vehicle, time since its boot and duration; {apart}")
    why = f"time since the boot and duration agree, but the clocks are {apart_s:.0f} s apart"
    return Match(False, WEAK, why)


def _without_day(identity: bool | None) -> Match:
    if identity is None:
        return Match(False, WEAK, "time since the boot and duration agree, but the vehicle is not known")
    return Match(True, WEAK, "same vehicle, time since its boot and duration")


def _apart_s(a: LoggedFlight, b: LoggedFlight) -> float:
    """How far the clocks of two parts are apart: at their boots, or else at arming [s]."""
    a_s, b_s = a.begin_unix_s or 0.0, b.begin_unix_s or 0.0
    apart_s = a_s - b_s
    if a.begin_boot_s is not None and b.begin_boot_s is not None:
        apart_s -= a.begin_boot_s - b.begin_boot_s
    elif a.starts_armed or b.starts_armed:
        overlap = _share(a_s, a.duration_s, b_s, b.duration_s) >= MIN_SHARE
        apart_s = 0.0 if overlap else apart_s
    return abs(apart_s)


def _noted(a: LoggedFlight, b: LoggedFlight) -> Match | None:
    """Notes and a recording of one server have one clock."""
    if a.begin_unix_s is None or b.begin_unix_s is None:
        return None
    if _same_time(a, b) or _share(a.begin_unix_s, a.duration_s, b.begin_unix_s, b.duration_s) >= MIN_SHARE:
        return Match(True, CERTAIN, "recorded by this server")
    return None


def _continued(a: LoggedFlight, b: LoggedFlight, identity: bool | None) -> Match | None:
    """One goes on where the other ends: a recording was closed and opened again in flight."""
    for first, then in ((a, b), (b, a)):
        boots = first.begin_boot_s, then.begin_boot_s
        if first.ended != "log_ends" or not then.starts_armed or None in boots or not identity:
            continue
        gap_s = (boots[1] or 0.0) - (boots[0] or 0.0) - first.duration_s
        if first.begin_unix_s is None or then.begin_unix_s is None or not -1.0 <= gap_s <= GAP_S:
            continue
        if abs(then.begin_unix_s - first.begin_unix_s - first.duration_s - gap_s) <= SAME_CLOCK_S:
            return Match(True, STRONG, f"goes on after a gap of {max(0.0, gap_s):.0f} s in the recording")
    return None
