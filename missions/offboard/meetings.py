"""Meetings of the roles of a mission: each role comes to the same ones, so that none waits in vain."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

from missions.errors import PlanError
from missions.offboard.document import OffboardMission
from missions.offboard.steps import Branch, Call, Meet, MissionStep, Repeat

MAX_MEETINGS = 1000
"""Of one role, repeats counted each time."""


def check_meetings(mission: OffboardMission) -> None:
    """Refuses meetings that some role does not come to.

    Args:
        mission: its calls have been checked.

    Raises:
        PlanError: There is one; names role and meeting.
    """
    meetings = _Meetings(mission)
    meetings.refuse_in_branches()
    found = {role: meetings.of(role, steps) for role, steps in mission.flown.items()}
    if not mission.roles:
        if found[None]:
            raise PlanError("the steps", "a `meet` without roles: no other vehicle comes", "Remove it.")
        return
    (first, wanted), *others = found.items()
    for role, names in others:
        for number, (one, two) in enumerate(itertools.zip_longest(wanted, names), 1):
            if one != two:
                raise PlanError(
                    f"role {role!r}, meeting {number}",
                    f"it is {_quoted(two)}, but {_quoted(one)} in role {first!r}",
                    "Give all roles the same meetings, in the same order.",
                )


def _quoted(meeting: str | None) -> str:
    return "missing" if meeting is None else repr(meeting)


class _Meetings:
    """The meetings of a mission's lists of steps."""

    def __init__(self, mission: OffboardMission) -> None:
        self._mission = mission
        self._known: dict[str, bool] = {}
        """Whether a list that `call` names has any: each list is looked through once."""

    def of(self, role: str | None, steps: Iterable[MissionStep]) -> list[str]:
        """Their names, in the order in which they are flown.

        Raises:
            PlanError: There are too many.
        """
        found = list(itertools.islice(self._flown(steps), MAX_MEETINGS + 1))
        if len(found) > MAX_MEETINGS:
            raise PlanError(f"role {role!r}", f"more than {MAX_MEETINGS} meetings", "Repeat them less often.")
        return found

    def refuse_in_branches(self) -> None:
        """Raises PlanError: the other roles cannot know whether this one comes."""
        lists = {
            "the steps" if role is None else f"role {role!r}": s for role, s in self._mission.flown.items()
        }
        lists |= {f"mission {name!r}": steps for name, steps in self._mission.missions.items()}
        for place, steps in lists.items():
            for branch in _branches(steps):
                if self._any((*branch.then, *branch.otherwise)):
                    reason = "a `meet` inside a branch: the other roles cannot know whether this one comes"
                    raise PlanError(place, reason, "Put it before or after the branch.")

    def _flown(self, steps: Iterable[MissionStep]) -> Iterator[str]:
        for step in steps:
            if isinstance(step, Meet):
                yield step.meeting
            elif isinstance(step, Call) and self._called(step.mission):
                yield from self._flown(self._mission.missions[step.mission])
            elif isinstance(step, Repeat) and self._any(step.steps):
                for _ in range(step.times):
                    yield from self._flown(step.steps)

    def _any(self, steps: Iterable[MissionStep]) -> bool:
        return any(
            isinstance(step, Meet)
            or (isinstance(step, Call) and self._called(step.mission))
            or (isinstance(step, Repeat) and self._any(step.steps))
            or (isinstance(step, Branch) and self._any((*step.then, *step.otherwise)))
            for step in steps
        )

    def _called(self, name: str) -> bool:
        if name not in self._known:
            self._known[name] = self._any(self._mission.missions[name])
        return self._known[name]


def _branches(steps: Iterable[MissionStep]) -> Iterator[Branch]:
    for step in steps:
        if isinstance(step, Branch):
            yield step
            yield from _branches((*step.then, *step.otherwise))
        elif isinstance(step, Repeat):
            yield from _branches(step.steps)
