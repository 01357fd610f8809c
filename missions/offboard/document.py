"""The document of an offboard mission, its JSON Schema, and the checks between its parts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from missions.errors import PlanError
from missions.offboard.places import Ned
from missions.offboard.steps import MAX_STEPS, Action, Branch, Call, MissionStep, Name, Repeat, Speed
from missions.values import FenceZone, HomePosition, Model

MAX_CALL_DEPTH = 8
MAX_ROLES = 10
MINIMUM_SEPARATION_M = 5.0
"""As groups have it."""
Steps = Annotated[tuple[MissionStep, ...], Field(min_length=1, max_length=MAX_STEPS)]
TableText = Annotated[str, Field(max_length=1_000_000)]


class Actions(Model):
    """What the runner does when something goes wrong; the vehicle's own failsafes stay above it."""

    failure: Action = "hold"
    """A step cannot be flown."""
    low_battery: Action = "return"
    link_loss: Action = "hold"
    """The server loses the link to the vehicle and finds it again."""
    control_lost: Action = "hold"
    """Control of the vehicle has expired: the browser or program that had it has disconnected."""


class Bounds(Model):
    """Limits of this mission, lower than the vehicle's own."""

    speed_m_s: Speed | None = None
    climb_m_s: Speed | None = None
    descent_m_s: Speed | None = None
    acceleration_m_s2: Annotated[float, Field(ge=0.1, le=50.0, allow_inf_nan=False)] | None = None
    jerk_m_s3: Annotated[float, Field(ge=0.1, le=500.0, allow_inf_nan=False)] | None = None
    tilt_rad: Annotated[float, Field(ge=0.05, le=1.55, allow_inf_nan=False)] | None = None
    yaw_rate_rad_s: Annotated[float, Field(ge=0.05, le=10.0, allow_inf_nan=False)] | None = None


class Role(Model):
    """What one of several vehicles flies."""

    start_ned_m: Ned | None = None
    """Where its vehicle is planned to stand, from `home`; for planning without vehicles."""
    steps: Steps


class OffboardMission(Model):
    """A mission that the server flies by offboard setpoints: `steps` of one vehicle or `roles` of several."""

    format: Literal["offboard-gcs-mission"] = "offboard-gcs-mission"
    version: Literal[1] = 1
    name: Name
    description: Annotated[str, Field(max_length=5000)] = ""
    home: HomePosition | None = None
    """Where it is planned to start, for planning without a vehicle."""
    limits: Bounds = Bounds()
    actions: Actions = Actions()
    avoidance: bool = False
    """Lead the vehicle past obstacles that its sensors measure, on all steps that do not say otherwise."""
    fence: Annotated[tuple[FenceZone, ...], Field(max_length=100)] = ()
    steps: Annotated[tuple[MissionStep, ...], Field(max_length=MAX_STEPS)] = ()
    """What one vehicle flies; empty with `roles`."""
    roles: dict[Name, Role] = Field(max_length=MAX_ROLES, default_factory=dict[str, Role])
    """What several vehicles fly together, by the role's name; everything else here is common to all."""
    minimum_separation_m: Annotated[float, Field(ge=1.0, le=100.0, allow_inf_nan=False)] | None = None
    """Of any two of the vehicles, braking distance included; None: 5 m."""
    missions: Annotated[dict[Name, Steps], Field(max_length=100, default_factory=dict)]
    """Lists of steps that `call` names."""
    tables: dict[Name, TableText] = Field(max_length=20, default_factory=dict[str, str])
    """Trajectories that `table` steps name, as the text of their CSV files."""

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
    def flown(self) -> dict[str | None, tuple[MissionStep, ...]]:
        """The steps by role; of a mission without roles by None."""
        return {name: role.steps for name, role in self.roles.items()} or {None: self.steps}

    @property
    def separation_m(self) -> float:
        """The minimum separation of any two vehicles."""
        return self.minimum_separation_m or MINIMUM_SEPARATION_M


def schema() -> dict[str, Any]:
    """The JSON Schema of the document."""
    found = OffboardMission.model_json_schema()
    return found | {"oneOf": [{"required": ["steps"]}, {"required": ["roles"]}]}


def write(mission: OffboardMission) -> bytes:
    """The mission as JSON, UTF-8; reading it gives the same mission."""
    unused = None if mission.roles else {"roles"}
    return mission.model_dump_json(indent=1, exclude_none=True, exclude=unused).encode()


def check_calls(mission: OffboardMission) -> None:
    """Refuses calls of unknown missions, circular calls and calls nested too deeply.

    Raises:
        PlanError: There is one; names the call.
    """
    depths: dict[str, int] = {}
    for name in mission.missions:
        _depth(mission, name, depths, ())
    for role, steps in mission.flown.items():
        for name in _calls(steps):
            _known(mission, "the steps" if role is None else f"role {role!r}", name)


def _known(mission: OffboardMission, place: str, name: str) -> None:
    if name not in mission.missions:
        fix = "Add it below `missions`, or correct the name."
        raise PlanError(f"{place}, call of {name!r}", "there is no such mission", fix)


def _depth(mission: OffboardMission, name: str, depths: dict[str, int], above: tuple[str, ...]) -> int:
    """Depth of nested calls from this mission downwards."""
    if name in above:
        circle = " → ".join((*above[above.index(name) :], name))
        raise PlanError(f"mission {name!r}", f"the calls form a loop ({circle})", "Remove one of them.")
    if name not in depths:
        deepest = 0
        for called in dict.fromkeys(_calls(mission.missions[name])):
            _known(mission, f"mission {name!r}", called)
            deepest = max(deepest, _depth(mission, called, depths, (*above, name)))
        depths[name] = deepest + 1
    if depths[name] > MAX_CALL_DEPTH:
        reason = f"its calls are nested deeper than {MAX_CALL_DEPTH}"
        raise PlanError(f"mission {name!r}", reason, "Write some of the steps out.")
    return depths[name]


def _calls(steps: Iterable[Any]) -> Iterator[str]:
    for step in steps:
        if isinstance(step, Call):
            yield step.mission
        elif isinstance(step, Repeat):
            yield from _calls(step.steps)
        elif isinstance(step, Branch):
            yield from _calls((*step.then, *step.otherwise))
