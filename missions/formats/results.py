"""Results of reading and writing a format: the plan or the bytes, and notes about data that are lost."""

from __future__ import annotations

from dataclasses import dataclass

from missions.documents import Document
from missions.plan import Plan
from missions.values import Altitude, Point


@dataclass(frozen=True, slots=True)
class Area:
    """An area in a file of another program; the user decides whether it becomes a survey or a geofence."""

    name: str
    outer: tuple[Point, ...]
    holes: tuple[tuple[Point, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class Imported:
    """A plan that was read; `notes` describe how the file was interpreted and what is lost."""

    plan: Document
    areas: tuple[Area, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Written:
    """A file that was written; `notes` describe what the format cannot store."""

    data: bytes
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """Values for data that a file does not contain.

    `altitude` is used for points without an altitude. If it is None, a file with such points is refused.
    """

    altitude: Altitude | None = None


def count(number: int, noun: str) -> str:
    """A number with its noun, in singular or plural: `1 rally point`, `2 rally points`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def loss_notes(
    plan: Plan,
    format_name: str,
    *,
    fence: bool = False,
    rally: bool = False,
    home: bool = False,
    obstacles: bool = False,
) -> tuple[str, ...]:
    """Notes about the parts of a plan that a format cannot store. A true flag means that the format can store
    the part."""
    parts: list[str] = []
    if plan.fence and not fence:
        parts.append(f"the geofence ({count(len(plan.fence), 'zone')})")
    if plan.rally_points and not rally:
        parts.append(count(len(plan.rally_points), "rally point"))
    if plan.obstacles and not obstacles:
        parts.append(count(len(plan.obstacles), "obstacle"))
    if plan.hover_speed_m_s or plan.cruise_speed_m_s:
        parts.append("the planned speeds")
    if plan.planned_home and not home:
        parts.append("the planned home position")
    return (f"{format_name} cannot store everything. Left out: {', '.join(parts)}.",) if parts else ()
