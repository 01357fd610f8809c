"""Results of reading and writing a format: the plan or the bytes, and notes about what did not fit."""

from __future__ import annotations

from dataclasses import dataclass

from missions.documents import Document
from missions.plan import Plan
from missions.values import Altitude, Point


@dataclass(frozen=True, slots=True)
class Area:
    """An area of a foreign file: for a survey or a fence, as a person decides."""

    name: str
    outer: tuple[Point, ...]
    holes: tuple[tuple[Point, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class Imported:
    """A plan that was read; `notes` are sentences for a person about what was understood and what was not."""

    plan: Document
    areas: tuple[Area, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Written:
    """A file that was written; `notes` are sentences for a person about what the format cannot hold."""

    data: bytes
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """What a file may leave open.

    `altitude` is for points without one (and replaces none that is given). Without it such a file is refused:
    an altitude is never made up.
    """

    altitude: Altitude | None = None


def count(number: int, noun: str) -> str:
    """`1 rally point`, `2 rally points`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def lost(
    plan: Plan, format_name: str, *, fence: bool = False, rally: bool = False, home: bool = False
) -> tuple[str, ...]:
    """Sentences about the parts of this plan that a format cannot hold; the flags say what it holds."""
    parts: list[str] = []
    if plan.fence and not fence:
        parts.append(f"the geofence ({count(len(plan.fence), 'zone')})")
    if plan.rally_points and not rally:
        parts.append(count(len(plan.rally_points), "rally point"))
    if plan.hover_speed_m_s or plan.cruise_speed_m_s:
        parts.append("the planned speeds")
    if plan.planned_home and not home:
        parts.append("the planned home position")
    return (f"{format_name} cannot hold everything. Left out: {', '.join(parts)}.",) if parts else ()
