"""Inserts a mission into another one: its steps become a list in `missions`, which a new `call` step calls.

The page uses this code through `POST /plans/insert`, because the new document must be checked as a whole and
positions must be converted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from missions.errors import PlanError
from missions.offboard import reader
from missions.offboard.document import OffboardMission, calls_of, write
from missions.offboard.insertion_settings import merged_settings
from missions.offboard.insertion_steps import Adapter, Positions, start_conversion
from missions.offboard.names import free_name, valid_name
from missions.offboard.steps import Branch, Call, Gimbal, Land, MissionStep, Photo, Repeat, TakeOff, Wait
from missions.values import Model

StepPath = Sequence[str | int]
"""Keys and indexes of a step in the document: `["steps", 2]`, `["roles", "lead", "steps", 0]`,
`["missions", "round", 1]`, `["steps", 3, "then", 0]`."""
Lists = dict[str | None, tuple[MissionStep, ...]]
"""Lists of steps by name; None: the steps of the inserted mission."""
_PATH_KEYS = ("steps", "roles", "missions", "then", "otherwise")


@dataclass(frozen=True, slots=True)
class InsertionResult:
    """A mission into which another mission was inserted."""

    mission: OffboardMission
    called: str
    """Name of the list that the new step calls."""
    notes: tuple[str, ...]
    """Differences from flying each mission alone, as sentences."""


def insert(
    mission: OffboardMission,
    inserted: OffboardMission,
    target: StepPath,
    *,
    in_air: bool = False,
    positions: Positions | None = None,
) -> InsertionResult:
    """Inserts a mission. Lists and tables that the mission already has are reused.

    Args:
        mission: the mission to change.
        inserted: the mission to insert, for one vehicle.
        target: path of the new step in the document. The index of each step at this path or after it
            increases by one.
        in_air: omit the inserted take-off and last landing, because the vehicle is already flying at that
            step.
        positions: used if the planned starts differ. `from_start`: positions relative to start or home refer
            to the start and home of `mission`. `same_places`: these positions are converted, so that they
            stay at the same places.

    Raises:
        PlanError: The mission cannot be inserted; the error names the part and the fix.
    """
    if inserted.roles:
        reason = f"it is for {len(inserted.roles)} vehicles (roles: {', '.join(inserted.roles)})"
        raise PlanError(
            f"mission {inserted.name!r}", reason, "A call inserts a mission for one vehicle only."
        )
    if len(target) < 2:
        raise _invalid_target(target, f"{list(target)} is not a valid position for a step")
    # An invalid target is reported before all other errors.
    _with_step(mission, target, Call(mission="-"), target)
    steps, notes = _steps_to_insert(inserted, in_air)
    adapter = Adapter(
        mission, inserted, start_conversion(mission, inserted, _role_at(mission, target)), positions
    )
    lists: Lists = {None: adapter.steps(steps)}
    for name in _called_lists(inserted, steps):
        lists[name] = adapter.steps(inserted.missions[name])
    merged, called = _merged(mission, valid_name(inserted.name, "mission"), lists, target)
    fields, setting_notes = merged_settings(mission, inserted)
    merged = merged.model_copy(update={**fields, "tables": adapter.tables})
    return InsertionResult(
        reader.read_json(write(merged)), called, (*notes, *adapter.notes(), *setting_notes)
    )


def _role_at(mission: OffboardMission, target: StepPath) -> str | None:
    return str(target[1]) if target[0] == "roles" and str(target[1]) in mission.roles else None


def _steps_to_insert(inserted: OffboardMission, in_air: bool) -> tuple[tuple[MissionStep, ...], list[str]]:
    """The steps to insert, and a sentence about the omitted steps."""
    steps = inserted.steps
    if not in_air:
        return steps, []
    first_step = next((i for i, step in enumerate(steps) if not isinstance(step, Gimbal | Photo | Wait)), 0)
    omitted: list[str] = []
    if isinstance(steps[first_step], TakeOff):
        steps = (*steps[:first_step], *steps[first_step + 1 :])
        omitted.append("take-off")
    if steps and isinstance(steps[-1], Land):
        steps = steps[:-1]
        omitted.append("landing")
    if not steps:
        reason = "without its take-off and landing it has no steps"
        raise PlanError(f"mission {inserted.name!r}", reason, "Choose another mission.", field="in_air")
    if not omitted:
        return steps, []
    verb = "is" if len(omitted) == 1 else "are"
    note = " The vehicle flies straight to its first position." if "take-off" in omitted else ""
    return steps, [f"{' and '.join(omitted).capitalize()} of {inserted.name!r} {verb} left out.{note}"]


def _called_lists(inserted: OffboardMission, steps: Iterable[MissionStep]) -> list[str]:
    """Names of the lists that these steps call, also indirectly."""
    found: dict[str, None] = {}
    to_visit = list(calls_of(steps))
    while to_visit:
        name = to_visit.pop(0)
        if name not in found:
            found[name] = None
            to_visit += calls_of(inserted.missions[name])
    return list(found)


def _merged(
    mission: OffboardMission, wanted: str, lists: Lists, target: StepPath
) -> tuple[OffboardMission, str]:
    """The mission with the new step and the lists that the step needs, and the name of the called list."""
    called = free_name(wanted, lambda name: name in mission.missions or name in lists)
    merged = _with_step(mission, target, Call(mission=called), target)
    with_existing_list = _with_step(mission, target, Call(mission=wanted), target)
    if with_existing_list.missions.get(wanted) == lists[None] and not _missing_lists(
        with_existing_list.missions, lists
    ):
        return with_existing_list, wanted
    missing = _missing_lists(merged.missions, lists)
    names: dict[str | None, str] = {None: called}
    for name in lists:
        if name is not None:
            taken = {*merged.missions, *names.values()}
            names[name] = free_name(name, taken.__contains__) if name in missing else name
    missions = dict(merged.missions)
    for name, steps in lists.items():
        missions.setdefault(names[name], _with_list_names(steps, names))
    return merged.model_copy(update={"missions": missions}), called


def _missing_lists(missions: Mapping[str, tuple[MissionStep, ...]], lists: Lists) -> set[str]:
    """Names of the lists that the mission does not have, or that call such a list."""
    calls = {name: set(calls_of(steps)) for name, steps in lists.items() if name is not None}
    missing = {name for name in calls if missions.get(name) != lists[name]}
    while callers := {name for name in calls if name not in missing and calls[name] & missing}:
        missing |= callers
    return missing


def _with_list_names(
    steps: Iterable[MissionStep], names: Mapping[str | None, str]
) -> tuple[MissionStep, ...]:
    """The steps with the new names of the lists that they call."""

    def renamed(step: MissionStep) -> MissionStep:
        if isinstance(step, Call):
            return step.model_copy(update={"mission": names[step.mission]})
        if isinstance(step, Repeat):
            return step.model_copy(update={"steps": _with_list_names(step.steps, names)})
        if isinstance(step, Branch):
            then, otherwise = _with_list_names(step.then, names), _with_list_names(step.otherwise, names)
            return step.model_copy(update={"then": then, "otherwise": otherwise})
        return step

    return tuple(renamed(step) for step in steps)


def _with_step(value: Any, path: StepPath, step: MissionStep, target: StepPath) -> Any:
    """A copy of the document with a step inserted."""
    if isinstance(value, OffboardMission) and value.roles and path[0] == "steps":
        raise _invalid_target(target, f"the mission has roles ({', '.join(value.roles)})")
    key, inner_path = path[0], path[1:]
    if isinstance(value, tuple) and isinstance(key, int) and 0 <= key < len(value) + (not inner_path):
        inner = (
            (_with_step(value[key], inner_path, step, target), *value[key + 1 :])
            if inner_path
            else (step, *value[key:])
        )
        return (*value[:key], *inner)
    if isinstance(value, dict) and inner_path and key in value:
        return {**value, key: _with_step(value[key], inner_path, step, target)}
    if isinstance(value, Model) and inner_path and key in _PATH_KEYS and key in type(value).model_fields:
        return value.model_copy(update={key: _with_step(getattr(value, key), inner_path, step, target)})
    raise _invalid_target(target, f"{list(target)} is not a valid position for a step")


def _invalid_target(target: StepPath, reason: str) -> PlanError:
    fix = 'Give the keys and indexes of a step: ["steps", 2], or ["roles", "lead", "steps", 0].'
    return PlanError("field at", reason, fix, field="at")
