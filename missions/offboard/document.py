"""The document of an offboard mission, its JSON Schema, and the checks between its parts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from missions.errors import PlanError
from missions.offboard.steps import MAX_STEPS, Action, Branch, Call, MissionStep, Name, Repeat, Speed
from missions.values import FenceZone, HomePosition, Model

MAX_CALL_DEPTH = 8
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


class OffboardMission(Model):
    """A mission that the server flies by offboard setpoints."""

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
    steps: Annotated[tuple[MissionStep, ...], Field(min_length=1, max_length=MAX_STEPS)]
    missions: Annotated[
        dict[Name, Annotated[tuple[MissionStep, ...], Field(min_length=1, max_length=MAX_STEPS)]],
        Field(max_length=100, default_factory=dict),
    ]
    """Lists of steps that `call` names."""
    tables: dict[Name, TableText] = Field(max_length=20, default_factory=dict[str, str])
    """Trajectories that `table` steps name, as the text of their CSV files."""


def schema() -> dict[str, Any]:
    """The JSON Schema of the document."""
    return OffboardMission.model_json_schema()


def write(mission: OffboardMission) -> bytes:
    """The mission as JSON, UTF-8; reading it gives the same mission."""
    return mission.model_dump_json(indent=1, exclude_none=True).encode()


def check_calls(mission: OffboardMission) -> None:
    """Refuses calls of unknown missions, circular calls and calls nested too deeply.

    Raises:
        PlanError: There is one; names the call.
    """
    depths: dict[str, int] = {}
    for name in mission.missions:
        _depth(mission, name, depths, ())
    for name in _calls(mission.steps):
        _known(mission, "the steps", name)


def _known(mission: OffboardMission, place: str, name: str) -> None:
    if name not in mission.missions:
        fix = "Add it below `missions`, or correct the name."
        raise PlanError(f"{place}, call of {name!r}", "there is no such mission", fix)


def _depth(mission: OffboardMission, name: str, depths: dict[str, int], above: tuple[str, ...]) -> int:
    """Depth of nested calls from this mission downwards."""
    if name in above:
        circle = " → ".join((*above[above.index(name) :], name))
        raise PlanError(f"mission {name!r}", f"the calls run in a circle ({circle})", "Remove one of them.")
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
