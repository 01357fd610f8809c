"""Request and response bodies of the routes of groups, for the OpenAPI description."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Literal

from pydantic import Field, model_validator

from gcs_server.api.offboard_models import LimitsModel
from gcs_server.api.reflect import model_of
from gcs_server.api.setpoints import AnySetpoint, Validity, setpoint_arguments
from gcs_server.api.strict_body import ResponseBody, StrictBody, example
from gcs_server.control.principal import Principal
from gcs_server.flights import group as status
from gcs_server.flights.group import GroupRequest

MAX_MEMBERS = 10
VehicleId = Annotated[str, Field(min_length=1, max_length=32, description="A vehicle's id.")]


class MemberBody(StrictBody):
    """One vehicle of the group and its setpoint, in the vehicle's local frame."""

    vehicle: VehicleId
    setpoint: AnySetpoint

    def arguments(self) -> dict[str, object]:
        """The member for the journal."""
        return {"vehicle": self.vehicle, "setpoint": setpoint_arguments(self.setpoint)}


class _GroupValidity(Validity):
    valid_for_s: float = Field(default=1.0, allow_inf_nan=False, ge=0.05, le=600)
    """How long all setpoints are valid without being renewed [s]; then `on_expiry` applies to all members at
    the same time. The time starts when the last member has finished its path setpoint, or immediately if no
    member has one."""


class StartGroup(_GroupValidity):
    """A group of flying vehicles that start together and keep a minimum separation."""

    model_config = example(
        members=[
            {"vehicle": "1", "setpoint": {"type": "velocity", "velocity_ned_m_s": [2, 0, 0]}},
            {"vehicle": "2", "setpoint": {"type": "velocity", "velocity_ned_m_s": [2, 0, 0]}},
        ],
        minimum_separation_m=3,
        valid_for_s=5,
    )

    members: Annotated[tuple[MemberBody, ...], Field(min_length=2, max_length=MAX_MEMBERS)]
    """Members of the group; each vehicle only once."""
    minimum_separation_m: float = Field(default=5.0, allow_inf_nan=False, ge=1, le=100)
    """Minimum distance of any two members, also while they brake to a stop [m]."""
    start_at_unix_s: float | None = Field(default=None, allow_inf_nan=False)
    """Time of the common start [s since 1970 UTC], 3 to 300 s from now; null: as soon as all members are in
    Offboard."""
    rate_hz: float = Field(default=50.0, allow_inf_nan=False, ge=2, le=100)
    """Setpoints per second to each member [Hz]."""
    others_go_on: bool = False
    """Whether the other members continue if a member leaves Offboard, the position of a member is not known
    for 1 s, or two members come too close to each other (only these two then hold); false: all members
    hold."""

    @model_validator(mode="after")
    def _check_unique(self) -> StartGroup:
        require_unique([member.vehicle for member in self.members], "members")
        return self

    def to_group_request(self, principal: Principal) -> GroupRequest:
        """Converts to the streamer's type."""
        return GroupRequest(
            setpoints={member.vehicle: member.setpoint for member in self.members},
            minimum_separation_m=self.minimum_separation_m,
            valid_for_s=self.valid_for_s,
            on_expiry=self.expiry(),
            client=principal.name,
            client_key=principal.key,
            rate_hz=self.rate_hz,
            start_at_unix_s=self.start_at_unix_s,
            others_go_on=self.others_go_on,
        )


class GroupSetpoints(_GroupValidity):
    """New setpoints for some or all members, sent together; an empty list renews all setpoints."""

    model_config = example(
        setpoints=[{"vehicle": "1", "setpoint": {"type": "velocity", "velocity_ned_m_s": [0, 0, 0]}}],
        valid_for_s=5,
    )

    setpoints: Annotated[tuple[MemberBody, ...], Field(max_length=MAX_MEMBERS)]
    """Each vehicle at most once; the other members continue with their current setpoints."""

    @model_validator(mode="after")
    def _check_unique(self) -> GroupSetpoints:
        require_unique([member.vehicle for member in self.setpoints], "setpoints")
        return self


def require_unique(vehicles: list[str], field: str) -> None:
    """Raises ValueError if a vehicle is named twice."""
    twice = [vehicle for vehicle, count in Counter(vehicles).items() if count > 1]
    if twice:
        raise ValueError(f"{field}: vehicle {twice[0]} is named twice")


GroupModel = model_of(
    status.GroupStatus,
    "Group",
    state=Literal["starting", "waiting", "flying", "holding", "ended"],
    members=tuple[model_of(status.GroupMember), ...],
    nearest=model_of(status.ClosestPair) | None,
    findings=tuple[model_of(status.GroupFinding), ...],
)


class GroupStarted(GroupModel):  # type: ignore[misc,valid-type]
    """The started group and the limits of its members."""

    limits: dict[str, LimitsModel] = Field(  # type: ignore[valid-type]
        description="Limits by vehicle; `origin` says whether the operator's limits were set since the "
        "server started, or restored from the data folder."
    )


class GroupList(ResponseBody):
    """All groups."""

    groups: list[GroupModel]  # type: ignore[valid-type]
    """All groups, including groups that ended recently; oldest first."""
