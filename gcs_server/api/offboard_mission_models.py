"""Request and response bodies of the routes for offboard missions."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from gcs_server.api.documents import MissionBody, SourceBody
from gcs_server.api.group_models import VehicleId, require_unique
from gcs_server.api.models import Despite
from gcs_server.api.plan_models import LegModel, OriginModel
from gcs_server.api.reflect import model_of
from gcs_server.api.strict_body import ResponseBody, StrictBody
from gcs_server.flights.mission_values import MissionModeStatus, OffboardMissionStatus
from missions.offboard.document import MAX_ROLES, OffboardMission
from missions.offboard.insertion_steps import Positions
from missions.runner.flown import FlownMission, FlownSample

Role = Annotated[str, Field(min_length=1, max_length=100)]
OptionalDryRun = Annotated[
    Annotated[str, Field(max_length=20)] | None,
    Field(
        description="Id of a dry run of this mission with several flights. The server sends a notice if a "
        "vehicle leaves the corridor of the dry run.",
    ),
]


def _check_key(value: Any) -> Any:
    """Checks a key or an index, with one error message for all wrong values."""
    if type(value) is int or (isinstance(value, str) and len(value) <= 100):
        return value
    raise ValueError("give keys (texts) and indexes (whole numbers)")


PlaceKey = Annotated[int | str, BeforeValidator(_check_key)]


class MissionSource(SourceBody):
    """A mission: stored on the server, or in the request."""

    DOCUMENT = "mission"

    mission: MissionBody | None = None
    """A mission that is not stored on the server."""


class WhichMission(MissionSource):
    """A mission, and the findings that the caller accepts."""

    despite: Despite = Field(default=[])
    """Codes of the mission's error findings that the caller accepts."""


class MissionToInsert(MissionSource):
    """The mission to insert, and the mission into which it is inserted."""

    plan: MissionBody = Field(description="The mission to change (docs/missions.md).")
    at: Annotated[list[PlaceKey], Field(min_length=2, max_length=50)] = Field(
        examples=[["steps", 2], ["roles", "lead", "steps", 0], ["missions", "round", 1]]
    )
    """Place of the new step in `plan`, as keys and indexes; the index of each later step increases by one."""
    in_air: bool = False
    """Leave out the inserted mission's take-off and last landing, because the vehicle is in the air at the
    new step."""
    positions: Positions | None = None
    """Needed if the planned starts of the two missions differ. `from_start`: positions relative to start or
    home are measured from the start of `plan`. `same_places`: they are converted, so that the inserted
    mission is flown at the same places. null: refused if the two would give different missions."""


class MissionWithInserted(ResponseBody):
    """A mission with another mission inserted; nothing is saved."""

    plan: OffboardMission
    """The mission."""
    called: str
    """Name of the list in `missions` that the new `call` step calls."""
    notes: list[str]
    """Differences between the result and the two missions flown separately; sentences."""


class StartMission(WhichMission):
    """The mission to fly, and the findings that the caller accepts."""

    dry_run: OptionalDryRun = None


class StartGroupMission(WhichMission):
    """A mission with roles, and the vehicle that flies each role."""

    vehicles: Annotated[dict[Role, VehicleId], Field(min_length=2, max_length=MAX_ROLES)] = Field(
        examples=[{"lead": "1", "left": "2"}]
    )
    """A vehicle's id for each role; each vehicle once."""
    dry_run: OptionalDryRun = None

    @model_validator(mode="after")
    def _check_unique(self) -> Self:
        require_unique(list(self.vehicles.values()), "vehicles")
        return self


class AbortMission(StrictBody):
    """Action of the vehicle after the abort."""

    then: Literal["hold", "return", "land"] = "hold"
    """hold, return or land."""


OffboardMissionModel = model_of(OffboardMissionStatus)


class OffboardMissionView(ResponseBody):
    """The newest mission of a vehicle."""

    vehicle: str
    """The vehicle's id."""
    mission: OffboardMissionModel | None  # type: ignore[valid-type]
    """As in the topic `offboard_mission`; null: no mission was started since the server started."""


FlownMissionModel = model_of(
    FlownMission,
    samples=tuple[model_of(FlownSample), ...],
    planned_legs=tuple[LegModel, ...],  # type: ignore[valid-type]
    origin=OriginModel | None,  # type: ignore[operator]
)


class GroupMissionView(ResponseBody):
    """A mission of several vehicles."""

    vehicles: list[OffboardMissionView]
    """Each vehicle's mission, in the order of roles."""


class FlownMissionView(ResponseBody):
    """The flight of a vehicle's newest mission, compared with its plan."""

    vehicle: str
    """The vehicle's id."""
    flown: FlownMissionModel  # type: ignore[valid-type]
    """The flight so far."""


MAX_DEFERRAL_S = 120
MODE_NAME_PATTERN = r"^[!-~]([ -~]{0,22}[!-~])?$"


class RegisterMode(WhichMission):
    """The mission to register, and the name of its mode."""

    name: str = Field(pattern=MODE_NAME_PATTERN, max_length=24)
    """Name of the mode, which all ground stations show: 1 to 24 printable ASCII characters, without a space
    at either end."""
    defer_failsafes_s: int = Field(default=0, ge=0, le=MAX_DEFERRAL_S)
    """How long PX4 may defer a failsafe while the vehicle flies in the mode [s]; 0: never. PX4 defers its
    reaction to a lost ground station connection, lost manual control or a low battery."""


class UnregisterMode(StrictBody):
    """The mode to remove."""

    name: str = Field(max_length=24)
    """Name of the mode."""


MissionModeModel = model_of(MissionModeStatus)


class MissionModesView(ResponseBody):
    """The missions of this server that are registered with a vehicle as flight modes."""

    vehicle: str
    """The vehicle's id."""
    possible: bool
    """Whether modes can be registered: the server has a ROS 2 connection to the vehicle."""
    modes: list[MissionModeModel]  # type: ignore[valid-type]
    """The registered modes."""
