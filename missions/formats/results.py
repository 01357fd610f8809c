"""Results of reading and writing a format: the plan or the bytes, and notes about data that are lost."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from pydantic import ValidationError

from missions.documents import Document
from missions.plan import Plan
from missions.values import Altitude, FencePolygon, FenceZone, Point, Reference

AreaUseName = Literal["stay_inside", "stay_outside", "survey"]
_FORBIDDEN_NAMES = re.compile(
    r"no[\s_-]*(fly|flight)|nfz|exclu|(keep|stay)[\s_-]*out|prohibit|forbid|restrict|danger|verbot",
    re.IGNORECASE,
)
"""Words in the name of an area in which nobody may fly."""


@dataclass(frozen=True, slots=True)
class AreaUse:
    """One answer to the question what an area of a file is."""

    use: AreaUseName
    text: str
    """The answer as a sentence for the user."""
    fence: tuple[FenceZone, ...] = ()
    """The geofence zones of this answer; empty: a survey of the area."""


@dataclass(frozen=True, slots=True)
class Area:
    """An area in a file of another program. Such a file does not say what the area is for, and a wrong guess
    is dangerous: a no-fly area would become the area to fly in. So the user chooses one of `uses`."""

    name: str
    outer: tuple[Point, ...]
    holes: tuple[tuple[Point, ...], ...] = ()

    @property
    def likely_use(self) -> AreaUseName | None:
        """The use that the area's name suggests; None: the name suggests none."""
        return "stay_outside" if _FORBIDDEN_NAMES.search(self.name) else None

    @property
    def uses(self) -> tuple[AreaUse, ...]:
        """What the area may become. An area with more corners than a geofence zone can have is for a survey
        only."""
        holes = count(len(self.holes), "hole")
        survey = f"Survey it, without its {holes}." if self.holes else "Survey it."
        answers = [AreaUse("survey", survey)]
        try:
            outer = FencePolygon(inclusion=True, polygon=self.outer)
            inner = tuple(FencePolygon(inclusion=False, polygon=hole) for hole in self.holes)
        except ValidationError:
            return tuple(answers)
        inside = f"Stay inside it, and out of its {holes}." if self.holes else "Stay inside it."
        outside = "Stay out of it."
        if self.holes:
            outside = f"Stay out of it, also out of its {holes}: PX4 cannot open an area to stay out of."
        exclusion = outer.model_copy(update={"inclusion": False})
        return (
            AreaUse("stay_inside", inside, (outer, *inner)),
            AreaUse("stay_outside", outside, (exclusion,)),
            *answers,
        )


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
    `reference` is what the altitudes of a file are above, if the file has altitudes but does not say above
    what; None: the reference of `altitude`.
    """

    altitude: Altitude | None = None
    reference: Reference | None = None

    @property
    def reference_of_heights(self) -> Reference | None:
        """The reference of altitudes whose reference the file does not state; None: unknown."""
        return self.reference or (self.altitude.reference if self.altitude else None)


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
