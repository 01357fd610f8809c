"""Changes several parameters of a vehicle: reviewed before, written only as reviewed, and undone.

A change is written if the vehicle still has the value that the review showed. The vehicle's answer decides
whether a value was taken; nothing is written while the vehicle is armed, unless the caller says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, Protocol

from gcs_server.errors import ChangesRefused, Disconnected, InvalidRequest, NoReply, Refused, Rejected
from gcs_server.vehicle.param_review import ReviewRow, WantedParam, repeated, review_row, same_value
from gcs_server.vehicle.param_table import Param
from gcs_server.vehicle.services.params import ParamService
from gcs_server.vehicle.services.port import VehiclePort

MAX_UNDO: Final = 20
"""Changes that can be undone, one after the other."""
MAX_SINGLE_READS: Final = 80
"""Parameters that a review reads one by one; more need the vehicle's whole list."""
MAX_UNANSWERED: Final = 3
"""Names without an answer in one review; after more, the vehicle counts as not answering."""
MAX_REASONS: Final = 10

Progress = Callable[[str, float | None], None]


class ConfigurableVehicle(VehiclePort, Protocol):
    """A vehicle with parameters."""

    @property
    def params(self) -> ParamService: ...


@dataclass(frozen=True, slots=True)
class ParamChange:
    """A reviewed change."""

    name: str
    old: float | None
    """The value that the review showed; None: not a number."""
    value: float


@dataclass(frozen=True, slots=True)
class WrittenParam:
    """What became of one change."""

    name: str
    old: float | int | None
    value: float | int
    """The wanted value."""
    now: float | int | None
    """The value that the vehicle reported afterwards; null: it did not answer, or it was not written."""
    state: Literal["set", "not_taken", "no_answer", "not_written"]
    """set: the vehicle has the value; not_taken: it has another; no_answer: it may or may not have it;
    not_written: nothing was sent."""
    problem: str | None


@dataclass(frozen=True, slots=True)
class WrittenParams:
    """What became of all changes."""

    rows: tuple[WrittenParam, ...]
    stopped: str | None
    """Why the rest was not written; null: all were sent."""
    waiting: tuple[str, ...]
    """Parameters whose change takes effect only after a restart of the vehicle."""
    undo_count: int
    """Number of changes that can be undone."""


class ParamChanges:
    """Changes the parameters of one vehicle, one change at a time."""

    def __init__(self, vehicle: ConfigurableVehicle) -> None:
        self._vehicle = vehicle
        self._undo: list[tuple[WantedParam, ...]] = []
        self._waiting: dict[str, float] = {}
        """Time since the vehicle's boot [s] at which a parameter was set that needs a restart."""
        self._writing = False
        self.last: WrittenParams | None = None
        """What became of the newest change; None: there was none."""

    @property
    def is_writing(self) -> bool:
        """Whether a change is being written."""
        return self._writing

    @property
    def undo_count(self) -> int:
        """Number of changes that can be undone."""
        return len(self._undo)

    def undone(self) -> tuple[WantedParam, ...]:
        """The values before the newest change.

        Raises:
            Refused: nothing was changed by this server since it found the vehicle.
        """
        if not self._undo:
            raise Refused(
                f"Vehicle {self._vehicle.id} has no change that this server could undo.",
                remedy="Compare with the defaults, or with a file.",
            )
        return self._undo[-1]

    def waiting(self) -> tuple[str, ...]:
        """Parameters whose change takes effect only after a restart, in the order of their names."""
        boot_s = self._time_since_boot_s()
        if boot_s is not None:
            self._waiting = {name: set_s for name, set_s in self._waiting.items() if set_s <= boot_s}
        return tuple(sorted(self._waiting))

    def note(self, before: Param | None, now: Param) -> None:
        """Notes a parameter that was set singly, so that it is undone and waits for a restart like others."""
        if before is None or before.value == now.value or not math.isfinite(before.value):
            return
        self._undo = [*self._undo, (WantedParam(now.name, before.value),)][-MAX_UNDO:]
        metadata = self._vehicle.params.metadata_of(now.name)
        if metadata is not None and metadata.reboot_required:
            self._waiting[now.name] = self._time_since_boot_s() or 0.0

    def took_effect(self, prefix: str) -> None:
        """Called when the part of the vehicle was restarted that reads the parameters with this prefix."""
        self._waiting = {name: s for name, s in self._waiting.items() if not name.startswith(prefix)}

    async def review(
        self, wanted: Sequence[WantedParam], *, force: bool = False, fresh: bool = False
    ) -> tuple[ReviewRow, ...]:
        """Compares wanted values with the vehicle's; writes nothing.

        Args:
            wanted: the values.
            force: accepts values outside the documented range and choices.
            fresh: reads the parameters again, unless they are too many.

        Raises:
            Refused: the vehicle's parameters have not been read, and these are too many to be read singly.
            NoReply: the vehicle does not answer.
        """
        params = self._vehicle.params
        await params.describe()
        ambiguous = repeated(wanted)
        current = await self._current({each.name for each in wanted if each.problem is None}, fresh=fresh)
        rows: list[ReviewRow] = []
        for each in wanted:
            if each.name in ambiguous:
                each = replace(each, problem="It is given several times, with different values.")
            row = review_row(each, current.get(each.name), params.metadata_of(each.name), force=force)
            rows.append(row)
        return tuple(rows)

    async def apply(
        self,
        changes: Sequence[ParamChange],
        *,
        force: bool = False,
        while_armed: bool = False,
        undoes: bool = False,
        may_go_on: Callable[[], None] = lambda: None,
        progress: Progress = lambda _text, _fraction: None,
    ) -> WrittenParams:
        """Writes reviewed changes one after the other.

        Args:
            changes: the changes, with the values that the review showed.
            force: also writes values outside the documented range and choices.
            while_armed: also writes while the vehicle is armed.
            undoes: whether this undoes the newest change, which then cannot be undone again.
            may_go_on: raises if the caller must not write any more; called before each value.
            progress: called before each value.

        Raises:
            Refused: nothing was written: the vehicle is armed, has other values than the review showed, or a
                change is refused.
        """
        vehicle = self._vehicle
        vehicle.require("parameters")
        if self._writing:
            raise Refused(
                f"Parameters of vehicle {vehicle.id} are being written. Nothing was written.",
                remedy="Wait for the end, then review again.",
            )
        self._writing = True
        try:
            self._require_disarmed(while_armed)
            wanted = [WantedParam(c.name, c.value) for c in changes]
            rows = await self.review(wanted, force=force, fresh=True)
            self._require_as_reviewed(rows, changes)
            written, stopped = await self._write(rows, force, while_armed, undoes, may_go_on, progress)
        finally:
            self._writing = False
        self.last = WrittenParams(written, stopped, self.waiting(), self.undo_count)
        return self.last

    async def _write(
        self,
        rows: Sequence[ReviewRow],
        force: bool,
        while_armed: bool,
        undoes: bool,
        may_go_on: Callable[[], None],
        progress: Progress,
    ) -> tuple[tuple[WrittenParam, ...], str | None]:
        written: list[WrittenParam] = []
        before: list[WantedParam] = []
        stopped: str | None = None
        try:
            for number, row in enumerate(rows):
                if row.state == "same":
                    continue
                assert row.new is not None
                if stopped is None:
                    try:
                        may_go_on()
                        self._require_disarmed(while_armed)
                        progress(f"Writing {row.name}, {number + 1} of {len(rows)}.", number / len(rows))
                        # noted before it is sent, so that a cancelled change can be undone, too
                        before.append(WantedParam(row.name, row.old))
                        written.append(await self._set(row, row.new, force))
                        continue
                    except (Refused, Disconnected) as error:
                        stopped = str(error)
                written.append(WrittenParam(row.name, row.old, row.new, None, "not_written", stopped))
        finally:
            self._note_undo(before, written, undoes)
        return tuple(written), stopped

    def _note_undo(
        self, before: Sequence[WantedParam], written: Sequence[WrittenParam], undoes: bool
    ) -> None:
        """Notes the values before a change, or what is left of the change that it undoes."""
        if undoes and self._undo:
            left = {each.name for each in written if each.state != "set"}
            undo = tuple(each for each in self._undo.pop() if each.name in left)
        else:
            not_taken = {each.name for each in written if each.state == "not_taken"}
            undo = tuple(each for each in before if each.name not in not_taken and each.value is not None)
        if undo:
            self._undo = [*self._undo, undo][-MAX_UNDO:]

    async def _set(self, row: ReviewRow, value: float, force: bool) -> WrittenParam:
        params = self._vehicle.params
        written = WrittenParam(row.name, row.old, value, None, "set", None)
        try:
            now = await params.set(row.name, value, force=force)
        except NoReply as error:
            return replace(written, state="no_answer", problem=str(error))
        except (Rejected, InvalidRequest) as error:
            known = params.known(row.name)
            return replace(
                written, state="not_taken", now=None if known is None else known.value, problem=str(error)
            )
        if row.reboot_required:
            self._waiting[row.name] = self._time_since_boot_s() or 0.0
        return replace(written, now=now.value)

    async def _current(self, names: set[str], *, fresh: bool) -> dict[str, Param]:
        """The vehicle's parameters of these names: as they were read, or read now."""
        params = self._vehicle.params
        is_read = params.list.state == "ready"
        if len(names) > MAX_SINGLE_READS and not is_read:
            raise Refused(
                f"The parameters of vehicle {self._vehicle.id} have not been read yet.",
                remedy="Read them first (POST …/params/refresh).",
            )
        known = {name: param for name in names if (param := params.known(name)) is not None}
        if is_read and (not fresh or len(names) > MAX_SINGLE_READS):
            return known
        self._vehicle.require("parameters")
        found: dict[str, Param] = {}
        unanswered = 0
        for name in sorted(known if is_read else names):
            try:
                found[name] = await params.get(name)
            except (Rejected, InvalidRequest):
                continue
            except NoReply:  # also of an unknown name
                unanswered += 1
                if name in known or unanswered > MAX_UNANSWERED:
                    raise
        return found

    def _require_disarmed(self, while_armed: bool) -> None:
        vehicle = self._vehicle
        if vehicle.status.armed and not while_armed:
            raise Refused(
                f"Vehicle {vehicle.id} is armed, and changed parameters act at once.",
                remedy="Write them after landing, or with while_armed if that is meant.",
            )

    def _require_as_reviewed(self, rows: Sequence[ReviewRow], changes: Sequence[ParamChange]) -> None:
        problems: list[str] = []
        for row, change in zip(rows, changes, strict=True):
            if row.problem is not None:
                problems.append(f"{row.name}: {row.problem}")
            elif not _is_old(row, change.old):
                now = "no number" if row.old is None else f"{row.old:.9g}"
                problems.append(f"{row.name}: the vehicle now has {now}, not what was reviewed.")
        if problems:
            more = len(problems) - MAX_REASONS
            raise ChangesRefused(
                f"{len(problems)} of {len(changes)} changes cannot be written to vehicle {self._vehicle.id}.",
                reasons=(*problems[:MAX_REASONS], *((f"{more} more",) if more > 0 else ())),
                remedy="Review the changes again.",
            )

    def _time_since_boot_s(self) -> float | None:
        sample = self._vehicle.topic("attitude")
        return None if sample is None else sample.vehicle_time_boot_s


def _is_old(row: ReviewRow, old: float | None) -> bool:
    if row.old is None or old is None:
        return row.old is None and old is None
    return same_value(Param(row.name, row.old, isinstance(row.old, int)), old)
