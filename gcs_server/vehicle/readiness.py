"""Why a vehicle cannot arm or fly each of its modes: the health and arming report, joined and in words.

A report is a summary, its findings and a second summary (PX4 sends it when something changed, or when asked).
A long one comes in chunks of that shape, numbered from 0: what any of them forbids is forbidden. A report has
limits; what is beyond them is left out and counted.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from gcs_server.vehicle.check_words import COMPONENTS, MANUAL_CONTROL_ID, MODE_NEEDS
from gcs_server.vehicle.foreign import cut
from gcs_server.vehicle.modes import BY_NAME, MODES, Mode

ALL_MODES = 0xFFFFFFFF
LEVEL_ERROR, LEVEL_WARNING = 3, 4
STICK_MODES = sum(1 << state for state in (0, 1, 2, 6, 8, 10, 15))
"""Manual, Altitude, Position, Position slow, Acro, Stabilized: those that a missing transmitter stops (as the
recorded reports show; the finding itself names all modes)."""
MOST_FINDINGS = 64
"""Most findings of one report."""
MOST_CAUSES = 6
"""That are told for one mode."""
LONGEST_CAUSE, LONGEST_REMEDY = 240, 480
"""Characters."""
TO_ARM_IN = ("hold", "position")
"""Modes that are offered where the present one cannot be armed in, best first."""
NOT_SHOWN = frozenset({"ready", "termination", "vtol_takeoff"})
EXTERNAL = "external_"

_arming = struct.Struct("<BIIII")
_health = struct.Struct("<BIII")
_finding = struct.Struct("<IB")


@dataclass(frozen=True, slots=True)
class Finding:
    """One check that found something."""

    id: int
    """The event's."""
    name: str
    """As PX4's metadata calls it; `event_…` where nobody told."""
    level: int
    """MAV_SEVERITY: up to 3 an error, 4 a warning, above it a note."""
    modes_mask: int
    """Bit mask over nav states: which modes it concerns."""
    component: str | None
    """The part of the vehicle that it concerns."""
    cause: str
    """What is wrong, in words."""
    remedy: str | None
    """What to do about it."""
    arguments: bytes = b""
    """As they came, to be put in other words."""

    def concerns(self, nav_state: int) -> bool:
        """Whether it is about this mode."""
        return bool(self.modes_mask >> nav_state & 1)

    def blocks(self, nav_state: int, *, running: bool = False) -> bool:
        """Whether it would keep the mode from being armed in, or from being flown."""
        if not self.concerns(nav_state):
            return False
        if self.id == MANUAL_CONTROL_ID:
            return bool(STICK_MODES >> nav_state & 1) or self.level <= LEVEL_ERROR
        return self.level != LEVEL_WARNING and (not running or self.id in MODE_NEEDS)


@dataclass(frozen=True, slots=True)
class Report:
    """A complete one."""

    can_arm: int
    """Bit mask over nav states."""
    can_run: int
    findings: tuple[Finding, ...] = ()
    errors: int = 0
    """Bit mask over components, as are the next two."""
    warnings: int = 0
    present: int = 0
    left_out: int = 0
    """How many findings were more than `MOST_FINDINGS`."""

    def causes(self, nav_state: int, *, running: bool = False) -> tuple[Finding, ...]:
        """What keeps the vehicle from arming in a mode (or from flying it), gravest first."""
        if (self.can_run if running else self.can_arm) >> nav_state & 1:
            return ()
        concerned = [f for f in self.findings if f.concerns(nav_state)]
        blocking = [f for f in concerned if f.blocks(nav_state, running=running)]
        if not blocking and running:
            blocking = [f for f in concerned if f.blocks(nav_state)]
        return tuple(sorted(blocking or concerned, key=lambda f: f.level))


class ReportJoiner:
    """Makes reports of the events of one vehicle, given in order."""

    def __init__(self) -> None:
        self._findings: list[Finding] | None = None
        self._chunk: tuple[int, int, int, int, int] = (0, 0, 0, 0, 0)
        self._whole: Report | None = None
        """Chunks joined so far."""
        self._next_chunk = 0
        self._left_out = 0

    def begin(self, arguments: bytes) -> None:
        """The first summary of a chunk."""
        self._chunk = _arming.unpack_from(arguments)
        if self._chunk[0] == 0:
            self._whole, self._next_chunk, self._left_out = None, 0, 0
        self._findings = [] if self._chunk[0] == self._next_chunk else None

    @property
    def collecting(self) -> bool:
        """Whether findings are expected."""
        return self._findings is not None

    def add(self, finding: Finding) -> None:
        """One between the summaries."""
        if self._findings is None:
            return
        before = 0 if self._whole is None else len(self._whole.findings)
        if before + len(self._findings) < MOST_FINDINGS:
            self._findings.append(finding)
        else:
            self._left_out += 1

    def end(self, arguments: bytes) -> Report | None:
        """The second summary; the report as far as it has come, None where its beginning was missed."""
        number, present, error, warning = _health.unpack_from(arguments)
        if self._findings is None or number != self._chunk[0]:
            self._findings = None
            return None
        _, errors, warnings, can_arm, can_run = self._chunk
        chunk = Report(can_arm, can_run, tuple(self._findings), errors | error, warnings | warning, present)
        self._findings = None
        self._next_chunk += 1
        before = self._whole
        whole = chunk if before is None else _joined(before, chunk)
        self._whole = replace(whole, left_out=self._left_out)
        return self._whole

    def abandon(self) -> None:
        """Something in between was lost: wait for the next whole one."""
        self._findings, self._whole, self._next_chunk = None, None, 0


def _joined(a: Report, b: Report) -> Report:
    return Report(
        a.can_arm & b.can_arm,
        a.can_run & b.can_run,
        a.findings + b.findings,
        a.errors | b.errors,
        a.warnings | b.warnings,
        a.present | b.present,
    )


def head_of(arguments: bytes) -> tuple[int, str | None]:
    """(modes, component) that every finding begins with."""
    modes, component = _finding.unpack_from(arguments)
    return modes, COMPONENTS[component] if 0 < component < len(COMPONENTS) - 1 else None


# --- as it is told ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Cause:
    """One check that found something, as the API tells it."""

    id: int
    """The event's id."""
    name: str
    """PX4's name of the check; `event_…` with the bare id where neither the vehicle nor we have one."""
    severity: str
    """`error`, `warning` or `info`."""
    modes: tuple[str, ...] | None
    """Modes it concerns; null: all."""
    component: str | None
    """The part of the vehicle it is about."""
    cause: str
    """What is wrong, as a sentence."""
    remedy: str | None
    """What to do about it."""


@dataclass(frozen=True, slots=True)
class ModeReadiness:
    """One mode."""

    mode: str
    """As the API calls it."""
    label: str
    """As people call it."""
    can_arm: bool
    """Whether the vehicle would arm in it."""
    can_run: bool
    """Whether it may be switched to, in the air too."""
    arming: tuple[Cause, ...]
    """What keeps it from arming, gravest first."""
    running: tuple[Cause, ...]
    """What keeps the mode from being flown, gravest first."""


@dataclass(frozen=True, slots=True)
class Offer:
    """Something that can be done now about what keeps the vehicle from arming, ready for a button."""

    code: Literal["choose_mode"]
    """What: `choose_mode` is `POST /vehicles/{v}/mode` with the mode named here."""
    mode: str
    """The mode to switch to."""
    label: str
    """What people call that mode."""
    text: str
    """Why, and what to do, for people."""


@dataclass(frozen=True, slots=True)
class Readiness:
    """Why the vehicle cannot arm or fly each of its modes, as it last said."""

    known: bool
    """False: the vehicle has not reported yet."""
    reported_unix_s: float | None
    """When the report came [s since 1970 UTC]."""
    words: str
    """`vehicle` where the sentences are from its own metadata, else `own`."""
    modes: tuple[ModeReadiness, ...]
    """Every mode it has."""
    findings: tuple[Cause, ...]
    """All that its checks found, those that block nothing included."""
    components_with_errors: tuple[str, ...]
    """Parts of the vehicle that report errors."""
    components_with_warnings: tuple[str, ...]
    """Parts of the vehicle that report warnings."""
    left_out: str | None = None
    """Text about findings beyond the limit of a report; null: none."""
    offers: tuple[Offer, ...] = ()
    """Actions that help now; empty if none is needed or none helps."""


NOTHING_KNOWN = Readiness(False, None, "own", (), (), (), ())


def told(report: Report, reported_unix_s: float, words: str, words_left_out: str | None = None) -> Readiness:
    """The whole report for people and programs.

    Args:
        report: the newest complete one.
        reported_unix_s: when it came.
        words: `vehicle` or `own`.
        words_left_out: what of the vehicle's own words could not be used.
    """
    shown = [mode for mode in MODES if _is_shown(mode, report)]
    causes = {finding: _cause(finding, shown) for finding in report.findings}
    modes = tuple(
        ModeReadiness(
            mode.name,
            mode.label,
            bool(report.can_arm >> mode.nav_state & 1),
            bool(report.can_run >> mode.nav_state & 1),
            tuple(causes[f] for f in report.causes(mode.nav_state)[:MOST_CAUSES]),
            tuple(causes[f] for f in report.causes(mode.nav_state, running=True)[:MOST_CAUSES]),
        )
        for mode in shown
    )
    findings = tuple(causes[f] for f in sorted(report.findings, key=lambda f: f.level))
    return Readiness(
        True,
        reported_unix_s,
        words,
        modes,
        findings,
        _components(report.errors),
        _components(report.warnings),
        _left_out(report, words_left_out),
    )


def _left_out(report: Report, words_left_out: str | None) -> str | None:
    findings = None
    if report.left_out:
        findings = (
            f"The vehicle reported {report.left_out + len(report.findings):,} findings; "
            f"{len(report.findings)} of them are shown."
        )
    return " ".join(text for text in (findings, words_left_out) if text) or None


def offers(report: Report | None, mode: Mode | None, armed: bool | None) -> tuple[Offer, ...]:
    """What can be done now.

    PX4 stays in Offboard (or Land, or Return) after it has landed and disarmed, and arms in none of them:
    another mode must be chosen.

    Args:
        report: the newest complete one; None: nothing is known.
        mode: that the vehicle is in; None: not known.
        armed: whether its motors run; None: not known.
    """
    if report is None or mode is None or armed is not False or report.can_arm >> mode.nav_state & 1:
        return ()
    for name in TO_ARM_IN:
        other = BY_NAME[name]
        if report.can_arm >> other.nav_state & 1:
            text = f"The vehicle is in {mode.label} and cannot be armed in it. Choose {other.label}."
            return (Offer("choose_mode", other.name, other.label, text),)
    return ()


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".") if text else text


def _is_shown(mode: Mode, report: Report) -> bool:
    """External modes only where one is registered or somebody asks for it."""
    if not mode.name.startswith(EXTERNAL):
        return mode.name not in NOT_SHOWN
    named = any(f.modes_mask != ALL_MODES and f.concerns(mode.nav_state) for f in report.findings)
    return named or bool((report.can_arm | report.can_run) >> mode.nav_state & 1)


def _cause(finding: Finding, shown: Iterable[Mode]) -> Cause:
    severity = (
        "error" if finding.level <= LEVEL_ERROR else "warning" if finding.level == LEVEL_WARNING else "info"
    )
    modes = None
    if finding.modes_mask != ALL_MODES:
        modes = tuple(mode.name for mode in shown if finding.concerns(mode.nav_state))
    return Cause(
        finding.id,
        finding.name,
        severity,
        modes,
        finding.component,
        sentence(cut(finding.cause, LONGEST_CAUSE)),
        sentence(cut(finding.remedy, LONGEST_REMEDY)) if finding.remedy else None,
    )


def _components(mask: int) -> tuple[str, ...]:
    return tuple(name for bit, name in enumerate(COMPONENTS[:-1]) if bit and mask >> bit & 1)


def unchanged(new: Report, old: Report | None) -> bool:
    """Whether two reports say the same, in whatever order."""
    return (
        old is not None
        and replace(new, findings=()) == replace(old, findings=())
        and sorted(new.findings, key=lambda f: f.id) == sorted(old.findings, key=lambda f: f.id)
    )
