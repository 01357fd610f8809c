"""Joins and describes a vehicle's health and arming report: for each mode, why the vehicle cannot arm or fly.

A report is a summary, the findings and a second summary; PX4 sends it after a change, or on request. A long
report is sent in chunks of the same form, numbered from 0; the restrictions of all chunks apply. The size of
a report is limited; further findings are dropped and counted.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from gcs_server.vehicle.metadata_limits import cut
from gcs_server.vehicle.px4.checks import HEALTH_COMPONENTS, MANUAL_CONTROL_ID, MODE_NEEDS
from gcs_server.vehicle.px4.modes import BY_NAME, MODES, Mode

ALL_MODES = 0xFFFFFFFF
LEVEL_ERROR, LEVEL_WARNING = 3, 4
STICK_MODES = sum(1 << state for state in (0, 1, 2, 6, 8, 10, 15))
"""Modes that need an RC transmitter: Manual, Altitude, Position, Position slow, Altitude cruise, Acro,
Stabilized. The mask comes from recorded reports, because the finding itself names all modes."""
MAX_FINDINGS = 64
"""Maximum number of findings of one report."""
MAX_CAUSES = 6
"""Maximum number of causes per mode."""
MAX_CAUSE_LENGTH, MAX_REMEDY_LENGTH = 240, 480
"""Maximum lengths [characters]."""
SUGGESTED_MODES = ("hold", "position")
"""Modes that are suggested if the vehicle cannot be armed in its current mode, best first."""
HIDDEN_MODES = frozenset({"ready", "termination", "vtol_takeoff"})
EXTERNAL = "external_"

_arming = struct.Struct("<BIIII")
_health = struct.Struct("<BIII")
_finding = struct.Struct("<IB")


@dataclass(frozen=True, slots=True)
class Finding:
    """One failed check."""

    id: int
    """Id of the event."""
    name: str
    """Name in PX4's metadata; `event_…` if unknown."""
    level: int
    """MAV_SEVERITY: up to 3 error, 4 warning, from 5 information."""
    modes_mask: int
    """Affected modes: bit mask over nav states."""
    component: str | None
    """The affected part of the vehicle."""
    cause: str
    """What is wrong, as a sentence."""
    remedy: str | None
    """How to correct it, as a sentence."""
    arguments: bytes = b""
    """Raw arguments, for a later description."""

    def affects(self, nav_state: int) -> bool:
        """Whether the check affects this mode."""
        return bool(self.modes_mask >> nav_state & 1)

    def blocks(self, nav_state: int, *, running: bool = False) -> bool:
        """Whether the check prevents arming in this mode (or, if `running`, flying it)."""
        if not self.affects(nav_state):
            return False
        if self.id == MANUAL_CONTROL_ID:
            return bool(STICK_MODES >> nav_state & 1) or self.level <= LEVEL_ERROR
        return self.level != LEVEL_WARNING and (not running or self.id in MODE_NEEDS)


@dataclass(frozen=True, slots=True)
class HealthReport:
    """A complete health and arming report."""

    can_arm: int
    """Modes in which the vehicle can be armed: bit mask over nav states."""
    can_run: int
    """Modes that the vehicle can fly: bit mask over nav states."""
    findings: tuple[Finding, ...] = ()
    errors: int = 0
    """Components with errors: bit mask over `HEALTH_COMPONENTS`."""
    warnings: int = 0
    """Components with warnings: bit mask over `HEALTH_COMPONENTS`."""
    present: int = 0
    """Components of the vehicle: bit mask over `HEALTH_COMPONENTS`."""
    omitted_count: int = 0
    """Number of findings beyond `MAX_FINDINGS`."""

    def causes(self, nav_state: int, *, running: bool = False) -> tuple[Finding, ...]:
        """Findings that prevent arming in a mode (with `running`: flying it), most severe first."""
        if (self.can_run if running else self.can_arm) >> nav_state & 1:
            return ()
        affecting = [f for f in self.findings if f.affects(nav_state)]
        blocking = [f for f in affecting if f.blocks(nav_state, running=running)]
        if not blocking and running:
            blocking = [f for f in affecting if f.blocks(nav_state)]
        return tuple(sorted(blocking or affecting, key=lambda f: f.level))


class ReportJoiner:
    """Joins the events of one vehicle, in their order, into reports."""

    def __init__(self) -> None:
        self._findings: list[Finding] | None = None
        self._first_summary: tuple[int, int, int, int, int] = (0, 0, 0, 0, 0)
        """Of the open chunk: (chunk number, errors, warnings, can_arm, can_run)."""
        self._joined_chunks: HealthReport | None = None
        """Chunks joined so far."""
        self._next_chunk = 0
        self._omitted_count = 0

    def begin(self, arguments: bytes) -> None:
        """Begins a chunk with its first summary."""
        self._first_summary = _arming.unpack_from(arguments)
        if self._first_summary[0] == 0:
            self._joined_chunks, self._next_chunk, self._omitted_count = None, 0, 0
        self._findings = [] if self._first_summary[0] == self._next_chunk else None

    @property
    def collecting(self) -> bool:
        """Whether a chunk is open, so that findings are expected."""
        return self._findings is not None

    def add(self, finding: Finding) -> None:
        """Adds a finding to the chunk."""
        if self._findings is None:
            return
        before = 0 if self._joined_chunks is None else len(self._joined_chunks.findings)
        if before + len(self._findings) < MAX_FINDINGS:
            self._findings.append(finding)
        else:
            self._omitted_count += 1

    def end(self, arguments: bytes) -> HealthReport | None:
        """Ends the chunk with its second summary. Returns the chunks joined so far; None if the first
        summary was not received."""
        number, present, error, warning = _health.unpack_from(arguments)
        if self._findings is None or number != self._first_summary[0]:
            self._findings = None
            return None
        _, errors, warnings, can_arm, can_run = self._first_summary
        chunk = HealthReport(
            can_arm, can_run, tuple(self._findings), errors | error, warnings | warning, present
        )
        self._findings = None
        self._next_chunk += 1
        before = self._joined_chunks
        joined = chunk if before is None else _join(before, chunk)
        self._joined_chunks = replace(joined, omitted_count=self._omitted_count)
        return self._joined_chunks

    def discard(self) -> None:
        """Discards an incomplete report, because one of its events was lost."""
        self._findings, self._joined_chunks, self._next_chunk = None, None, 0


def _join(a: HealthReport, b: HealthReport) -> HealthReport:
    return HealthReport(
        a.can_arm & b.can_arm,
        a.can_run & b.can_run,
        a.findings + b.findings,
        a.errors | b.errors,
        a.warnings | b.warnings,
        a.present | b.present,
    )


def modes_and_component(arguments: bytes) -> tuple[int, str | None]:
    """(bit mask of the modes, name of the component), from the first arguments of a finding."""
    modes, component = _finding.unpack_from(arguments)
    return modes, HEALTH_COMPONENTS[component] if 0 < component < len(HEALTH_COMPONENTS) - 1 else None


# --- for the API ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Cause:
    """One failed check, as the API shows it."""

    id: int
    """The event's id."""
    name: str
    """PX4's name of the check; `event_…` with its id if neither the vehicle nor this server has a name."""
    severity: str
    """`error`, `warning` or `info`."""
    modes: tuple[str, ...] | None
    """Affected modes; null: all modes."""
    component: str | None
    """The affected part of the vehicle."""
    cause: str
    """What is wrong, as a sentence."""
    remedy: str | None
    """How to correct it, as a sentence."""


@dataclass(frozen=True, slots=True)
class ModeReadiness:
    """One mode."""

    mode: str
    """Name of the mode in the API."""
    label: str
    """Label of the mode."""
    can_arm: bool
    """Whether the vehicle can be armed in this mode."""
    can_run: bool
    """Whether the vehicle can switch to this mode, also in flight."""
    arming: tuple[Cause, ...]
    """What prevents arming, most severe first."""
    running: tuple[Cause, ...]
    """What prevents flying the mode, most severe first."""


@dataclass(frozen=True, slots=True)
class Offer:
    """An action that can help the vehicle to arm now, for a button."""

    code: Literal["choose_mode"]
    """The action: `choose_mode` is `POST /vehicles/{v}/mode` with the mode named here."""
    mode: str
    """The mode to switch to."""
    label: str
    """Label of that mode."""
    text: str
    """Reason and action, as sentences."""


@dataclass(frozen=True, slots=True)
class Readiness:
    """Why the vehicle cannot arm or fly each of its modes, from its last report."""

    known: bool
    """False: the vehicle has not reported yet."""
    reported_unix_s: float | None
    """Time of the report [s since 1970 UTC]."""
    words: str
    """Source of the texts: `vehicle` (its metadata) or `own` (this server)."""
    modes: tuple[ModeReadiness, ...]
    """All modes of the vehicle."""
    findings: tuple[Cause, ...]
    """All findings, including findings that prevent nothing."""
    components_with_errors: tuple[str, ...]
    """Parts of the vehicle that report errors."""
    components_with_warnings: tuple[str, ...]
    """Parts of the vehicle that report warnings."""
    left_out: str | None = None
    """Text about findings beyond the limit of a report; null: no such findings."""
    offers: tuple[Offer, ...] = ()
    """Actions that can help the vehicle to arm now; may be empty."""


NOTHING_KNOWN = Readiness(False, None, "own", (), (), (), ())


def readiness_of(
    report: HealthReport, reported_unix_s: float, text_source: str, unusable_texts: str | None = None
) -> Readiness:
    """The report for the API.

    Args:
        report: the newest complete report.
        reported_unix_s: time of the report.
        text_source: `vehicle`: the texts are the vehicle's; `own`: they are the server's.
        unusable_texts: which of the vehicle's texts could not be used.
    """
    shown = [mode for mode in MODES if _is_shown(mode, report)]
    causes = {finding: _cause(finding, shown) for finding in report.findings}
    modes = tuple(
        ModeReadiness(
            mode.name,
            mode.label,
            bool(report.can_arm >> mode.nav_state & 1),
            bool(report.can_run >> mode.nav_state & 1),
            tuple(causes[f] for f in report.causes(mode.nav_state)[:MAX_CAUSES]),
            tuple(causes[f] for f in report.causes(mode.nav_state, running=True)[:MAX_CAUSES]),
        )
        for mode in shown
    )
    findings = tuple(causes[f] for f in sorted(report.findings, key=lambda f: f.level))
    return Readiness(
        True,
        reported_unix_s,
        text_source,
        modes,
        findings,
        _components(report.errors),
        _components(report.warnings),
        _omission_text(report, unusable_texts),
    )


def _omission_text(report: HealthReport, unusable_texts: str | None) -> str | None:
    findings = None
    if report.omitted_count:
        findings = (
            f"The vehicle reported {report.omitted_count + len(report.findings):,} findings; "
            f"{len(report.findings)} of them are shown."
        )
    return " ".join(text for text in (findings, unusable_texts) if text) or None


def offers(report: HealthReport | None, mode: Mode | None, armed: bool | None) -> tuple[Offer, ...]:
    """Actions that can help the vehicle to arm now.

    After landing and disarming, PX4 stays in Offboard, Land or Return, and does not arm in these modes, so
    the pilot must select another mode.

    Args:
        report: the newest complete report; None: the vehicle has sent none.
        mode: current mode; None: unknown.
        armed: whether the vehicle is armed; None: unknown.
    """
    if report is None or mode is None or armed is not False or report.can_arm >> mode.nav_state & 1:
        return ()
    for name in SUGGESTED_MODES:
        suggested = BY_NAME[name]
        if report.can_arm >> suggested.nav_state & 1:
            text = f"The vehicle is in {mode.label} and cannot be armed in it. Choose {suggested.label}."
            return (Offer("choose_mode", suggested.name, suggested.label, text),)
    return ()


def sentence(text: str) -> str:
    """The text with a capital letter and a full stop."""
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".") if text else text


def _is_shown(mode: Mode, report: HealthReport) -> bool:
    """Whether a mode is shown. An external mode is shown only if it is registered or a finding names it."""
    if not mode.name.startswith(EXTERNAL):
        return mode.name not in HIDDEN_MODES
    named = any(f.modes_mask != ALL_MODES and f.affects(mode.nav_state) for f in report.findings)
    return named or bool((report.can_arm | report.can_run) >> mode.nav_state & 1)


def _cause(finding: Finding, shown: Iterable[Mode]) -> Cause:
    severity = (
        "error" if finding.level <= LEVEL_ERROR else "warning" if finding.level == LEVEL_WARNING else "info"
    )
    modes = None
    if finding.modes_mask != ALL_MODES:
        modes = tuple(mode.name for mode in shown if finding.affects(mode.nav_state))
    return Cause(
        finding.id,
        finding.name,
        severity,
        modes,
        finding.component,
        sentence(cut(finding.cause, MAX_CAUSE_LENGTH)),
        sentence(cut(finding.remedy, MAX_REMEDY_LENGTH)) if finding.remedy else None,
    )


def _components(mask: int) -> tuple[str, ...]:
    return tuple(name for bit, name in enumerate(HEALTH_COMPONENTS[:-1]) if bit and mask >> bit & 1)


def is_unchanged(new: HealthReport, old: HealthReport | None) -> bool:
    """Whether two reports are equal, apart from the order of their findings."""
    return (
        old is not None
        and replace(new, findings=()) == replace(old, findings=())
        and sorted(new.findings, key=lambda f: f.id) == sorted(old.findings, key=lambda f: f.id)
    )
