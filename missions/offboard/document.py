"""The document of an offboard mission, its JSON Schema, and checks across its parts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from missions.errors import PlanError
from missions.offboard.positions import Ned
from missions.offboard.steps import (
    MAX_STEPS,
    Action,
    Avoidance,
    Branch,
    Call,
    MissionStep,
    Name,
    Repeat,
    Speed,
)
from missions.values import FenceZone, HomePosition, Model, Obstacles

MAX_CALL_DEPTH = 8
MAX_ROLES = 10
MINIMUM_SEPARATION_M = 5.0
"""Default of `minimum_separation_m`, as for groups of vehicles."""
MAX_TABLE_LENGTH = 1_000_000
"""Maximum length of a table's CSV text."""
Steps = Annotated[tuple[MissionStep, ...], Field(min_length=1, max_length=MAX_STEPS)]
TableText = Annotated[str, Field(max_length=MAX_TABLE_LENGTH)]


class Actions(Model):
    """Actions of the mission runner on errors; the vehicle's own failsafes take precedence."""

    failure: Action = "hold"
    """A step cannot be flown."""
    low_battery: Action = "return"
    link_loss: Action = "hold"
    """The link to the vehicle was lost and is back."""
    control_lost: Action = "hold"
    """Control of the vehicle has expired, because the browser or program that had control disconnected."""


class Bounds(Model):
    """Limits of this mission; each applies if it is lower than the vehicle's limit."""

    speed_m_s: Speed | None = None
    climb_m_s: Speed | None = None
    descent_m_s: Speed | None = None
    acceleration_m_s2: Annotated[float, Field(ge=0.1, le=50.0, allow_inf_nan=False)] | None = None
    jerk_m_s3: Annotated[float, Field(ge=0.1, le=500.0, allow_inf_nan=False)] | None = None
    tilt_rad: Annotated[float, Field(ge=0.05, le=1.55, allow_inf_nan=False)] | None = None
    yaw_rate_rad_s: Annotated[float, Field(ge=0.05, le=10.0, allow_inf_nan=False)] | None = None


class Role(Model):
    """The part of one vehicle in a mission of several vehicles."""

    start_ned_m: Ned | None = None
    """Planned start position relative to `home`, for planning without vehicles."""
    steps: Steps


class OffboardMission(Model):
    """A mission that the server flies with offboard setpoints: `steps` for one vehicle or `roles` for
    several."""

    format: Literal["offboard-gcs-mission"] = "offboard-gcs-mission"
    version: Literal[1] = 1
    name: Name
    description: Annotated[str, Field(max_length=5000)] = ""
    home: HomePosition | None = None
    """Planned start position, for planning without a vehicle."""
    limits: Bounds = Bounds()
    actions: Actions = Actions()
    avoidance: Avoidance = False
    """Avoid obstacles that the vehicle's sensors measure; a step can override this setting."""
    fence: Annotated[tuple[FenceZone, ...], Field(max_length=100)] = ()
    obstacles: Obstacles = ()
    """Known obstacles, for checks and dry runs."""
    steps: Annotated[tuple[MissionStep, ...], Field(max_length=MAX_STEPS)] = ()
    """Steps of one vehicle; empty with `roles`."""
    roles: dict[Name, Role] = Field(max_length=MAX_ROLES, default_factory=dict[str, Role])
    """Steps of several vehicles, by role name; all other fields apply to all vehicles."""
    minimum_separation_m: Annotated[float, Field(ge=1.0, le=100.0, allow_inf_nan=False)] | None = None
    """Minimum distance between any two vehicles, also if both brake to a stop at any time; None: 5 m."""
    missions: dict[Name, Steps] = Field(max_length=100, default_factory=dict[str, tuple[MissionStep, ...]])
    """Named lists of steps for `call`."""
    tables: dict[Name, TableText] = Field(max_length=20, default_factory=dict[str, str])
    """Trajectories for `table` steps: name and CSV text."""

    @model_validator(mode="after")
    def _steps_or_roles(self) -> OffboardMission:
        if bool(self.steps) == bool(self.roles):
            raise ValueError("give `steps` for one vehicle, or `roles` for several")
        if len(self.roles) == 1:
            raise ValueError("`roles` has a single role; write its steps as `steps`")
        if self.minimum_separation_m is not None and not self.roles:
            raise ValueError("`minimum_separation_m` belongs to `roles`")
        return self

    @property
    def steps_by_role(self) -> dict[str | None, tuple[MissionStep, ...]]:
        """The steps by role; a mission without roles has the single key None."""
        return {name: role.steps for name, role in self.roles.items()} or {None: self.steps}

    @property
    def separation_m(self) -> float:
        """The minimum separation of any two vehicles."""
        return self.minimum_separation_m or MINIMUM_SEPARATION_M


def schema() -> dict[str, Any]:
    """The JSON Schema of the document."""
    return OffboardMission.model_json_schema() | {"oneOf": [{"required": ["steps"]}, {"required": ["roles"]}]}


def write(mission: OffboardMission) -> bytes:
    """The mission as JSON in UTF-8; `reader.read_json` returns an equal mission."""
    unused = None if mission.roles else {"roles"}
    return mission.model_dump_json(indent=1, exclude_none=True, exclude=unused).encode()


def check_calls(mission: OffboardMission) -> None:
    """Checks the calls of all step lists.

    Raises:
        PlanError: A call of an unknown list, a circular call, or calls nested too deeply.
    """
    depths: dict[str, int] = {}
    for name in mission.missions:
        _depth(mission, name, depths, ())
    for role, steps in mission.steps_by_role.items():
        for name in calls_of(steps):
            _check_exists(mission, "the steps" if role is None else f"role {role!r}", name)


def _check_exists(mission: OffboardMission, place: str, name: str) -> None:
    if name not in mission.missions:
        fix = "Add the list below `missions`, or correct the name."
        raise PlanError(f"{place}, call of {name!r}", "there is no list with this name", fix)


def _depth(mission: OffboardMission, name: str, depths: dict[str, int], callers: tuple[str, ...]) -> int:
    """Depth of nested calls, starting from this list."""
    if name in callers:
        loop = " → ".join((*callers[callers.index(name) :], name))
        raise PlanError(f"list {name!r}", f"the calls form a loop ({loop})", "Remove one of these calls.")
    if name not in depths:
        deepest = 0
        for called in dict.fromkeys(calls_of(mission.missions[name])):
            _check_exists(mission, f"list {name!r}", called)
            deepest = max(deepest, _depth(mission, called, depths, (*callers, name)))
        depths[name] = deepest + 1
    if depths[name] > MAX_CALL_DEPTH:
        reason = f"its calls are nested deeper than {MAX_CALL_DEPTH}"
        raise PlanError(f"list {name!r}", reason, "Replace some calls with their steps.")
    return depths[name]


def calls_of(steps: Iterable[Any]) -> Iterator[str]:
    """Names of the lists that these steps call, also inside repeats and branches."""
    for step in steps:
        if isinstance(step, Call):
            yield step.mission
        elif isinstance(step, Repeat):
            yield from calls_of(step.steps)
        elif isinstance(step, Branch):
            yield from calls_of((*step.then, *step.otherwise))
