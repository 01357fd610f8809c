"""Checks that all roles of a mission have the same meetings, so that no role waits forever."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

from missions.errors import PlanError
from missions.offboard.document import OffboardMission
from missions.offboard.steps import Branch, Call, Meet, MissionStep, Repeat

MAX_MEETINGS = 1000
"""Maximum number of meetings of one role; each repeat counts."""


def check_meetings(mission: OffboardMission) -> None:
    """Checks that all roles have the same meetings.

    Args:
        mission: a mission whose calls have been checked.

    Raises:
        PlanError: The meetings of two roles differ; the error names the role and the meetings.
    """
    meetings = _Meetings(mission)
    meetings.refuse_in_branches()
    meetings_of = {role: meetings.names_of(role, steps) for role, steps in mission.steps_by_role.items()}
    if not mission.roles:
        if meetings_of[None]:
            raise PlanError("the steps", "a `meet`, but the mission has no roles", "Remove the `meet` step.")
        return
    (first_role, expected), *other_roles = meetings_of.items()
    for role, names in other_roles:
        for number, (expected_name, name) in enumerate(itertools.zip_longest(expected, names), 1):
            if expected_name != name:
                raise PlanError(
                    f"role {role!r}, meeting {number}",
                    f"it is {_quoted(name)}, but {_quoted(expected_name)} in role {first_role!r}",
                    "Give all roles the same meetings, in the same order.",
                )


def _quoted(meeting: str | None) -> str:
    return "missing" if meeting is None else repr(meeting)


class _Meetings:
    """Collects the meetings of a mission's lists of steps."""

    def __init__(self, mission: OffboardMission) -> None:
        self._mission = mission
        self._cache: dict[str, bool] = {}
        """Results of `_list_has_meeting`, by name of the list."""

    def names_of(self, role: str | None, steps: Iterable[MissionStep]) -> list[str]:
        """The names of a role's meetings, in flight order.

        Raises:
            PlanError: There are too many meetings.
        """
        names = list(itertools.islice(self._names(steps), MAX_MEETINGS + 1))
        if len(names) > MAX_MEETINGS:
            raise PlanError(f"role {role!r}", f"more than {MAX_MEETINGS} meetings", "Repeat them less often.")
        return names

    def refuse_in_branches(self) -> None:
        """Refuses meetings inside branches, because the other roles cannot know which branch is flown.

        Raises:
            PlanError: A branch contains a meeting.
        """
        lists = {
            "the steps" if role is None else f"role {role!r}": s
            for role, s in self._mission.steps_by_role.items()
        }
        lists |= {f"list {name!r}": steps for name, steps in self._mission.missions.items()}
        for place, steps in lists.items():
            for branch in _branches(steps):
                if self._has_meeting((*branch.then, *branch.otherwise)):
                    reason = (
                        "a `meet` inside a branch: other roles cannot know whether the vehicle reaches it"
                    )
                    raise PlanError(place, reason, "Move the meeting before or after the branch.")

    def _names(self, steps: Iterable[MissionStep]) -> Iterator[str]:
        for step in steps:
            if isinstance(step, Meet):
                yield step.meeting
            elif isinstance(step, Call) and self._list_has_meeting(step.mission):
                yield from self._names(self._mission.missions[step.mission])
            elif isinstance(step, Repeat) and self._has_meeting(step.steps):
                for _ in range(step.times):
                    yield from self._names(step.steps)

    def _has_meeting(self, steps: Iterable[MissionStep]) -> bool:
        return any(
            isinstance(step, Meet)
            or (isinstance(step, Call) and self._list_has_meeting(step.mission))
            or (isinstance(step, Repeat) and self._has_meeting(step.steps))
            or (isinstance(step, Branch) and self._has_meeting((*step.then, *step.otherwise)))
            for step in steps
        )

    def _list_has_meeting(self, name: str) -> bool:
        if name not in self._cache:
            self._cache[name] = self._has_meeting(self._mission.missions[name])
        return self._cache[name]


def _branches(steps: Iterable[MissionStep]) -> Iterator[Branch]:
    for step in steps:
        if isinstance(step, Branch):
            yield step
            yield from _branches((*step.then, *step.otherwise))
        elif isinstance(step, Repeat):
            yield from _branches(step.steps)
