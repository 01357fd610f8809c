"""The server's data of one group of vehicles, and the group's status for the API."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from gcs_server.errors import InvalidRequest, NotTogether, Refused
from gcs_server.flights.group_checks import GroupRequest, Member
from gcs_server.streamer.schedule.scheduler import StreamState
from gcs_server.streamer.separation.guard import FOLLOWING_PHASES, GuardState
from missions.setpoints import Setpoint


@dataclass(frozen=True, slots=True)
class GroupMember:
    """One vehicle of a group; the vehicle's topic `offboard` has more about its stream."""

    vehicle: str
    """Id of the vehicle."""
    ordered_type: str
    """Type of the vehicle's setpoint in the group."""
    stream: str
    """State of the stream, as in the topic `offboard`. Before the start, the vehicle's current position is
    streamed."""
    mode: str
    """The vehicle's flight mode."""
    held: bool
    """Whether the vehicle was stopped or has left, so that it no longer follows the group."""


@dataclass(frozen=True, slots=True)
class ClosestPair:
    """The two members that are closest to each other."""

    vehicles: tuple[str, str]
    """Ids of the vehicles."""
    distance_m: float
    """Distance between the vehicles' estimated global positions [m]."""


@dataclass(frozen=True, slots=True)
class GroupFinding:
    """A problem in a group, and the vehicles that were stopped because of it."""

    unix_s: float
    """Time of the finding [s since 1970 UTC]."""
    code: str
    """separation, place_unknown, left (a member no longer follows its setpoints), late (the common start was
    missed), fault (the guard failed)."""
    vehicles: tuple[str, ...]
    """Vehicles concerned."""
    held: tuple[str, ...]
    """Vehicles that were stopped because of the problem."""
    text: str
    """Message for the operator."""
    distance_m: float | None
    """For the code separation: distance between the two vehicles at that time [m]."""


@dataclass(frozen=True, slots=True)
class GroupStatus:
    """Status of a group: the response of the routes below `/groups`, and the content of each `group`
    event."""

    id: str
    """Id of the group in the API."""
    state: str
    """starting (being brought into Offboard), waiting (for the common start), flying, holding, ended."""
    client: str
    """Client that sent the setpoints."""
    client_key: str
    """Distinguishes clients with the same name."""
    minimum_separation_m: float
    """Minimum true distance between members, braking distance included; see `margin_m` [m]."""
    margin_m: float | None
    """Largest current margin of the guard, for the accuracy and age of the positions and for wind [m]. The
    guard stops two vehicles that would come closer than minimum plus margin. Null before the first check."""
    others_go_on: bool
    """Whether members without a problem continue if one has a problem; false: all hold."""
    created_unix_s: float
    """Time of the request [s since 1970 UTC]."""
    start_unix_s: float | None
    """Common start [s since 1970 UTC]; null until all members have confirmed Offboard."""
    valid_left_s: float | None
    """Time until the setpoints of all members expire [s]."""
    members: tuple[GroupMember, ...]
    """Members, in the order of the request."""
    nearest: ClosestPair | None
    """The closest members; null before the first check, and if fewer than two positions are known."""
    findings: tuple[GroupFinding, ...]
    """Problems, oldest first."""
    ended: str | None
    """Reason for the group's end; null while the group exists."""


@dataclass(slots=True)
class Group:
    """One group: its request, members, state and findings."""

    id: str
    request: GroupRequest
    setpoints: dict[str, Setpoint]
    """Current setpoints."""
    members: dict[str, Member]
    """By vehicle id."""
    created_unix_s: float
    state: str = "starting"
    guard: GuardState | None = None
    """The guard's state at the last reading; None before all members have confirmed."""
    start_unix_s: float | None = None
    findings: list[GroupFinding] = field(default_factory=list[GroupFinding])
    stream_numbers: dict[str, int] = field(default_factory=dict[str, int])
    """Number of the group's stream to each member. A member that has left may later have another stream."""
    change_lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Locked while new setpoints are checked and applied."""
    requested_end: str | None = None
    """Which command ends the group, as a sentence; None: the group ends without a command."""
    end_reason: str | None = None
    """Reason for the end; None while the group exists."""

    def phase(self, vehicle_id: str, stream: StreamState) -> str:
        """Phase of the group's stream to a member; idle if the vehicle has another stream."""
        return stream.phase if stream.number == self.stream_numbers.get(vehicle_id) else "idle"

    def require_following(self, streams: Mapping[str, StreamState]) -> None:
        """Raises NotTogether if a member that had confirmed has left before the start.

        Args:
            streams: newest state of each member's stream.
        """
        leaving = [v for v in self.members if self.phase(v, streams[v]) not in FOLLOWING_PHASES]
        if leaving:
            ended_streams = [(v, streams[v].last_end) for v in leaving]
            reasons = " ".join(f"Vehicle {v}: {end.text}" for v, end in ended_streams if end is not None)
            raise NotTogether(
                f"{listed(leaving)} left before the common start, so none moves. {reasons}".rstrip(),
                vehicles=tuple(leaving),
                remedy="Check that vehicle, then start the group again.",
            )

    def require_changeable(self, changed: Iterable[str], guard: GuardState | None) -> GuardState:
        """Checks that the group accepts new setpoints for these members now; returns the state of its guard.

        Raises:
            Refused: the group accepts no setpoints, or a member is held.
            InvalidRequest: a vehicle is not in the group.
        """
        if guard is None or self.state not in ("flying", "holding") or guard.phase != "flying":
            raise Refused(
                f"Group {self.id} is {self.state}: it accepts no setpoints.",
                remedy="Start a new group." if self.state == "ended" else "Wait for its start.",
            )
        for vehicle_id in changed:
            if vehicle_id not in self.members:
                raise InvalidRequest("setpoints", f"Vehicle {vehicle_id} is not in group {self.id}.")
            if vehicle_id in guard.held:
                raise Refused(
                    f"Vehicle {vehicle_id} is held and no longer follows group {self.id}.",
                    remedy="Command this vehicle alone, or hold the group and start a new one.",
                )
        return guard

    def status(self, streams: Mapping[str, StreamState]) -> GroupStatus:
        """Status for the API and events.

        Args:
            streams: newest state of each member's stream.
        """
        guard, has_ended = self.guard, self.state == "ended"
        nearest = guard.nearest if guard is not None and not has_ended else None
        margin_m = guard.margin_m if guard is not None and not has_ended else None
        valid = [s.valid_left_s for s in streams.values() if s.phase == "streaming"]
        valid_left_s = min((left_s for left_s in valid if left_s is not None), default=None)
        return GroupStatus(
            id=self.id,
            state=self.state,
            client=self.request.client,
            client_key=self.request.client_key,
            minimum_separation_m=self.request.minimum_separation_m,
            margin_m=None if margin_m is None else round(margin_m, 2),
            others_go_on=self.request.others_go_on,
            created_unix_s=self.created_unix_s,
            start_unix_s=self.start_unix_s,
            valid_left_s=valid_left_s if self.state == "flying" else None,
            members=tuple(
                GroupMember(
                    vehicle=vehicle_id,
                    ordered_type=self.setpoints[vehicle_id].type,
                    stream=self.phase(vehicle_id, streams[vehicle_id]),
                    mode=member.vehicle.status.mode,
                    held=guard is not None and vehicle_id in guard.held,
                )
                for vehicle_id, member in self.members.items()
            ),
            nearest=None if nearest is None else ClosestPair(nearest[:2], round(nearest[2], 2)),
            findings=tuple(self.findings),
            ended=self.end_reason,
        )


def listed(vehicles: Iterable[str]) -> str:
    """Vehicle ids as text: "Vehicles 1, 2 and 3"."""
    ids = list(vehicles)
    if len(ids) == 1:
        return f"Vehicle {ids[0]}"
    return f"Vehicles {', '.join(ids[:-1])} and {ids[-1]}"
