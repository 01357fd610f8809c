"""Request and response bodies of the routes for a vehicle's mission."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gcs_server.api.documents import PlanBody, SourceBody
from gcs_server.api.models import Despite
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import TOPIC_MODELS
from gcs_server.api.strict_body import ResponseBody, StrictBody, example
from gcs_server.flights.resume import ResumeOffer
from gcs_server.flights.waypoint_flight import WaypointFlightStatus
from gcs_server.vehicle.services.mission_compare import Difference
from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from missions.plan import Plan


class WhichPlan(SourceBody):
    """A plan stored on the server, or one in the request."""

    plan: PlanBody | None = None
    """A plan that is not stored on the server."""


class UploadRequest(WhichPlan):
    """The plan to upload."""

    despite: Despite = Field(default=[])
    """`flies_new_plan_at_once` accepts that a vehicle in Mission mode flies to the first item of the changed
    mission at once."""
    hold_first: bool = False
    """Puts a vehicle in Mission mode into Hold before the upload."""
    wait: bool = False
    """Answer only when the plan is uploaded and verified."""


class DownloadRequest(StrictBody):
    """Options of the download."""

    wait: bool = False
    """Answer only when the plan is downloaded."""


class ResumeRequest(StrictBody):
    """The item to continue at, and what the caller accepts."""

    model_config = example(item=3)

    item: int | None = Field(default=None, ge=0, le=10_000)
    """Index of the item to fly to, from 0: a later one skips the items before it, 0 restarts the mission in
    the air. Null: the current item."""
    despite: Despite = Field(default=[])
    """Codes as for `mission/start`."""
    mission_id: int | None = Field(default=None, ge=1, le=0xFFFF_FFFF)
    """The vehicle's checksum of the mission that `item` belongs to. Refused if the vehicle has another
    mission. Null: any mission."""


class StartRequest(StrictBody):
    """The item to start at, and the findings that the caller accepts."""

    item: int | None = Field(default=None, ge=0, le=10_000)
    """Index of the first item, from 0; null: the current item."""
    despite: Despite = Field(default=[])
    """Codes of the plan's error findings that the caller accepts; `plan_not_known` if the server does not
    know which plan is on the vehicle; `flight_from_here` for errors that only a flight from the vehicle's
    position to a later `item` and onwards has; `mission_rejected` if PX4 stated after the upload that it will
    not fly the mission; `separation` if the vehicle may come too near to another vehicle;
    `starts_at_later_item` if no `item` is given and PX4's current item is not the first."""
    dry_run: Annotated[str, Field(max_length=20)] | None = None
    """Id of a dry run of the plan on the vehicle. The server compares the flight with the path of the dry
    run, and sends a notice if the vehicle leaves the corridor of the dry run. Null: the server compares the
    flight with the plan."""
    mission_id: int | None = Field(default=None, ge=1, le=0xFFFF_FFFF)
    """The vehicle's checksum of the mission that `item` belongs to, as in `resume`. The start is refused if
    the vehicle has another mission. Null: any mission."""


MissionTopic = TOPIC_MODELS["mission"]
WaypointFlightModel = model_of(WaypointFlightStatus)
ResumeModel = model_of(ResumeOffer)
PlanNameModel = model_of(PlanReference, "HeldPlanName")
DifferenceModel = model_of(Difference, "PlanDifference")


class HeldView(ResponseBody):
    """The plan on the vehicle."""

    state: Literal["plan", "another", "not_known"]
    """plan: the vehicle has `plan`; another: the vehicle has another plan than `plan`; not_known: the server
    has not uploaded or compared the plan on the vehicle, or the vehicle reports no ids."""
    plan: PlanNameModel | None  # type: ignore[valid-type]
    """The last uploaded and verified plan, to which `state` refers."""
    known_unix_s: float | None
    """Time of the last complete, verified transfer [s since 1970 UTC]."""


class MissionView(ResponseBody):
    """The mission on a vehicle."""

    vehicle: str
    """The vehicle's id."""
    mission: MissionTopic | None  # type: ignore[valid-type]
    """As in the topic `mission`; null: not reported yet."""
    holds: HeldView
    """The plan on the vehicle."""
    transfer: str | None
    """The running transfer; null: no transfer is running."""
    flight: WaypointFlightModel | None  # type: ignore[valid-type]
    """As in the topic `waypoint_flight`; null: no flight since the server started."""
    resume: ResumeModel | None  # type: ignore[valid-type]
    """Where an interrupted flight of the plan on the vehicle can be resumed after a landing, also after a
    restart of the vehicle or the server; null: see `no_resume`."""
    no_resume: str | None
    """Why the interrupted flight cannot be resumed, as a sentence; null: it can be resumed, or no flight was
    interrupted."""
    if_link_lost: str | None
    """What the vehicle does in Mission mode if the server or its link fails, by its parameters; null: not
    known yet, or the server does not know the plan."""


class DownloadedPlan(ResponseBody):
    """The plan that was last downloaded from a vehicle."""

    vehicle: str
    """The vehicle's id."""
    plan: Plan
    """Its mission, geofence and rally points."""
    plan_name: PlanNameModel | None  # type: ignore[valid-type]
    """The stored plan with the same content, if the server uploaded it."""
    read_unix_s: float
    """Time of the download [s since 1970 UTC]."""
    still_held: bool | None
    """Whether the vehicle still reports the same mission ids; null: it reports no ids."""
    notes: list[str]
    """Content that the plan cannot represent; sentences."""


class MissionComparison(ResponseBody):
    """Differences between a plan and the last download from the vehicle."""

    vehicle: str
    """The vehicle's id."""
    equal: bool
    """True if no difference changes the flight."""
    differences: list[DifferenceModel]  # type: ignore[valid-type]
    """At most 50 each for mission, geofence and rally points."""
    read_unix_s: float
    """Time of the download [s since 1970 UTC]."""
    still_held: bool | None
    """Whether the vehicle still reports the same mission ids; null: it reports no ids."""
