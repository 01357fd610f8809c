"""A vehicle's own mission over HTTP: bodies in, models of the answers out."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from gcs_server.api.plan_models import PlanBody
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import TOPIC_MODELS
from gcs_server.api.strict_body import AnswerBody, StrictBody
from gcs_server.vehicle.services.mission_compare import Difference
from gcs_server.vehicle.services.mission_held import PlanName
from missions.plan import Plan


class WhichPlan(StrictBody):
    """A plan that the server keeps, or one that is sent."""

    plan_id: str | None = Field(default=None, max_length=40, description="Of a plan that the server keeps.")
    version: int | None = Field(default=None, ge=1, description="Of that plan; the newest unless named.")
    plan: PlanBody | None = Field(default=None, description="A plan that is not kept on the server.")

    @model_validator(mode="after")
    def _one(self) -> WhichPlan:
        if (self.plan_id is None) == (self.plan is None):
            raise ValueError("give exactly one of plan_id and plan")
        if self.version is not None and self.plan_id is None:
            raise ValueError("version belongs to plan_id")
        return self


class UploadRequest(WhichPlan):
    """What to upload."""

    confirm: str | None = Field(
        default=None,
        max_length=100,
        description="While the vehicle flies Mission: `vehicle {id} flies the new mission at once`.",
    )
    wait: bool = Field(default=False, description="Answer once it is there and verified.")


class DownloadRequest(StrictBody):
    """How to download."""

    wait: bool = Field(default=False, description="Answer once it is there.")


class StartRequest(StrictBody):
    """Where to begin, and what the caller knows to be wrong."""

    item: int | None = Field(
        default=None, ge=0, le=10_000, description="Index of the item to begin at, from 0; null: the current."
    )
    despite: Annotated[list[Annotated[str, Field(max_length=40)]], Field(max_length=50)] = Field(
        default=[],
        description="Codes of the plan's error findings that the caller accepts; `plan_not_known` where the "
        "server does not know what the vehicle holds.",
    )


MissionTopic = TOPIC_MODELS["mission"]
PlanNameModel = model_of(PlanName, "HeldPlanName")
DifferenceModel = model_of(Difference, "PlanDifference")


class HeldView(AnswerBody):
    """Which plan the vehicle holds."""

    state: Literal["plan", "another", "not_known"] = Field(
        description="plan: the one named here; another: not the one that was uploaded last; not_known: the "
        "server has not uploaded or compared one, or the vehicle does not report what it holds."
    )
    plan: PlanNameModel | None = Field(  # type: ignore[valid-type]
        description="The plan that was uploaded last and verified; what `state` is about."
    )
    known_unix_s: float | None = Field(
        description="When it was last transferred, whole and verified [s since 1970 UTC]."
    )


class MissionView(AnswerBody):
    """What a vehicle flies by itself."""

    vehicle: str = Field(description="The vehicle's id.")
    mission: MissionTopic | None = Field(  # type: ignore[valid-type]
        description="As the topic `mission`; null: the vehicle has not reported."
    )
    holds: HeldView = Field(description="Which plan it holds.")
    transfer: str | None = Field(description="What transfer is under way; null: none.")


class DownloadedPlan(AnswerBody):
    """What a vehicle held when it was last read."""

    vehicle: str = Field(description="The vehicle's id.")
    plan: Plan = Field(description="Its mission, geofence and rally points.")
    plan_name: PlanNameModel | None = Field(  # type: ignore[valid-type]
        description="The plan that it is, where it was uploaded from here."
    )
    read_unix_s: float = Field(description="When it was read [s since 1970 UTC].")
    still_held: bool | None = Field(
        description="Whether the vehicle still reports the same ids; null: it reports none."
    )
    notes: list[str] = Field(description="What could not be put into the plan; sentences.")


class MissionComparison(AnswerBody):
    """What differs between a plan and what the vehicle held when it was last read."""

    vehicle: str = Field(description="The vehicle's id.")
    equal: bool = Field(description="No difference that changes the flight.")
    differences: list[DifferenceModel] = Field(  # type: ignore[valid-type]
        description="At most 50 of each part."
    )
    read_unix_s: float = Field(description="When the vehicle's plan was read [s since 1970 UTC].")
    still_held: bool | None = Field(description="Whether the vehicle still reports the same ids.")
