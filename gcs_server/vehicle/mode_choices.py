"""The modes of a vehicle as a person chooses from them: the vehicle's own list, with the reasons why a mode
cannot be entered now, from its newest arming report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gcs_server.vehicle.px4.modes import BY_CUSTOM_MODE, MODES, ModeNames, mode_name
from gcs_server.vehicle.readiness import EXTERNAL, HIDDEN_MODES, Cause, Readiness
from gcs_server.vehicle.services.mode_list import AnnouncedMode

NOT_SELECTED_HERE = {
    "orbit": "Orbit needs a centre and a radius: use the command Orbit.",
}
"""Why `POST /mode` does not take a mode that the vehicle offers, by name."""
UNKNOWN_MODE = "This server does not know this mode of the vehicle, so it does not select it."


@dataclass(frozen=True, slots=True)
class ModeChoice:
    """One mode that the vehicle offers."""

    mode: str
    """Name of the mode in the API."""
    label: str
    """Registered name of an external mode; otherwise the mode's label."""
    settable: bool
    """Whether `POST /vehicles/{v}/mode` takes the mode."""
    can_run: bool | None
    """Whether the vehicle can fly the mode now; null: it has not reported."""
    reasons: tuple[str, ...]
    """Why the mode cannot be selected or flown now, with the remedy, as sentences; may be empty."""


@dataclass(frozen=True, slots=True)
class ModesOffered:
    """The modes that a person may choose from."""

    of_vehicle: bool
    """Whether the list is the vehicle's own. Otherwise the vehicle sends none, and the modes are those that
    the server can set."""
    modes: tuple[ModeChoice, ...]
    """In the vehicle's order."""


def mode_choices(announced: Sequence[AnnouncedMode], names: ModeNames, readiness: Readiness) -> ModesOffered:
    """The modes that a person may choose from, in the vehicle's order.

    Args:
        announced: the vehicle's own list; empty: it sends none, so the modes that the server can set are
            offered, and the external modes whose names are known.
        names: the vehicle's names of external modes.
        readiness: the vehicle's newest report.
    """
    reports = {each.mode: each for each in readiness.modes}

    def choice(name: str, label: str, settable: bool) -> ModeChoice:
        report = reports.get(name)
        causes = () if report is None or report.can_run else report.running
        reasons = tuple(map(_sentences, causes))
        if not settable:
            reasons = (NOT_SELECTED_HERE.get(name, UNKNOWN_MODE), *reasons)
        return ModeChoice(
            name,
            names.name_or_label(name, label),
            settable,
            None if report is None else report.can_run,
            reasons,
        )

    if announced:
        offered = [each for each in announced if each.selectable]
        shown = [named for each in offered if (named := _named(each))[0] not in HIDDEN_MODES]
        return ModesOffered(True, tuple(choice(*named) for named in shown))
    named = names.external.keys() | names.announced.keys()
    settable = [m for m in MODES if m.settable and (not m.name.startswith(EXTERNAL) or m.name in named)]
    return ModesOffered(False, tuple(choice(m.name, m.label, True) for m in settable))


def _named(announced: AnnouncedMode) -> tuple[str, str, bool]:
    """Name in the API, label, and whether the server sets the mode."""
    mode = BY_CUSTOM_MODE.get(announced.custom_mode)
    if mode is None:
        name, label = mode_name(announced.custom_mode)
        return name, announced.name or label, False
    return mode.name, mode.label, mode.settable or mode.by_announcement


def _sentences(cause: Cause) -> str:
    return cause.cause if cause.remedy is None else f"{cause.cause} {cause.remedy}"
