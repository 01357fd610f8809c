"""One group of vehicles: its data and status, and whether the vehicles can fly setpoints as a group: each
vehicle, the common start, and the separation."""

from __future__ import annotations

import asyncio
from collections.abc import Container, Generator, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gcs_server.clock import Clock
from gcs_server.errors import InvalidRequest, NotTogether, Refused
from gcs_server.flights.prediction import (
    MAX_PREDICTION_S,
    Conflict,
    PredictedMember,
    first_conflict,
    too_near_now,
)
from gcs_server.streamer.offboard.control import OffboardControl
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.schedule.scheduler import StreamState
from gcs_server.streamer.separation import FOLLOWING_PHASES, GuardState
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from missions.runner.script import Script
from missions.setpoints import Path, PositionBody, Setpoint

if TYPE_CHECKING:
    from gcs_server.flights.group_mission import GroupMission


@dataclass(frozen=True, slots=True)
class GroupMember:
    """One vehicle of a group; the vehicle's topic `offboard` has more about its stream."""

    vehicle: str
    """Id of the vehicle."""
    role: str | None
    """Role of the vehicle in the group's mission; null: the group flies setpoints."""
    ordered_type: str
    """Type of the vehicle's setpoint in the group; mission: the vehicle flies its role of a mission."""
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
    mission: str | None
    """Name of the mission that the group flies; the group ends with the mission. null: the group flies
    setpoints."""
    client: str
    """Client that sent the setpoints, or started the mission."""
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
    """Time until the setpoints of all members expire [s]; null: no setpoints, or a mission."""
    members: tuple[GroupMember, ...]
    """Members, in the order of the request, or of the mission's roles."""
    nearest: ClosestPair | None
    """The closest members; null before the first check, and if fewer than two positions are known."""
    findings: tuple[GroupFinding, ...]
    """Problems, oldest first."""
    ended: str | None
    """Reason for the group's end; null while the group exists."""


@dataclass(frozen=True, slots=True)
class GroupRequest:
    """The request to start a group."""

    setpoints: Mapping[str, Setpoint]
    """By vehicle id."""
    minimum_separation_m: float
    valid_for_s: float
    """Validity of the setpoints of all vehicles, counted from the end of the longest path [s]."""
    on_expiry: OnExpiry
    client: str
    rate_hz: float = 50.0
    client_key: str = ""
    start_at_unix_s: float | None = None
    others_go_on: bool = False


@dataclass(slots=True)
class Group:
    """One group: its request, members, state and findings."""

    id: str
    request: GroupRequest
    setpoints: dict[str, Setpoint]
    """Current setpoints; none in a mission."""
    members: dict[str, OffboardControl]
    """By vehicle id."""
    created_unix_s: float
    mission: GroupMission | None = None
    """What the members fly; None: setpoints."""
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
        """Phase of the group's stream to a member; idle if the vehicle has another stream. In a mission the
        vehicle's stream is the mission's."""
        is_own = self.mission is not None or stream.number == self.stream_numbers.get(vehicle_id)
        return stream.phase if is_own else "idle"

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
        if self.mission is not None:
            raise Refused(
                f"Group {self.id} flies the mission {self.mission.name!r}: it accepts no setpoints.",
                remedy="Pause or abort the mission (offboard_mission/pause, /abort), or hold the group.",
            )
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
        roles = {} if self.mission is None else {f.vehicle_id: r for r, f in self.mission.flights.items()}
        return GroupStatus(
            id=self.id,
            state=self.state,
            mission=None if self.mission is None else self.mission.name,
            client=self.request.client,
            client_key=self.request.client_key,
            minimum_separation_m=self.request.minimum_separation_m,
            margin_m=None if margin_m is None else round(margin_m, 2),
            others_go_on=self.request.others_go_on,
            created_unix_s=self.created_unix_s,
            start_unix_s=self.start_unix_s,
            valid_left_s=valid_left_s if self.state == "flying" and self.mission is None else None,
            members=tuple(
                GroupMember(
                    vehicle=vehicle_id,
                    role=roles.get(vehicle_id),
                    ordered_type="mission" if self.mission is not None else self.setpoints[vehicle_id].type,
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


MIN_LEAD_S, MAX_LEAD_S = 3.0, 300.0
"""Minimum and maximum time from the request to the requested start [s]. Pre-streaming and the switch to
Offboard need the minimum.
"""
SEPARATION_REMEDY = (
    "Move their targets farther apart, fly them one after the other, or lower minimum_separation_m."
)


class GroupChecks:
    """The checks of a group before its start, and before each change of its setpoints.

    Args:
        clock: the server's clock.
        streams: sends the setpoints.
    """

    def __init__(self, clock: Clock, streams: Streams) -> None:
        self._clock = clock
        self._streams = streams
        self._piece_lock = asyncio.Lock()
        """Locked while one piece of a prediction is computed. So concurrent predictions together compute only
        one piece per iteration of the event loop.
        """

    def check_start_time(self, request: GroupRequest, min_lead_s: float) -> None:
        """Raises InvalidRequest unless the common start is `min_lead_s` to `MAX_LEAD_S` ahead."""
        at = request.start_at_unix_s
        if at is None:
            return
        ahead_s = at - self._clock.unix_s()
        if not min_lead_s <= ahead_s <= MAX_LEAD_S:
            raise InvalidRequest(
                "start_at_unix_s",
                f"start_at_unix_s is {ahead_s:.1f} s ahead; it must be {MIN_LEAD_S:g} to {MAX_LEAD_S:g} s "
                "ahead of the request, and still ahead when all vehicles are in Offboard.",
            )

    def check_member(self, member: OffboardControl, index: int, request: GroupRequest) -> None:
        """Raises NotTogether, or the error of `require_commandable`, if the vehicle cannot join now."""
        vehicle = member.vehicle
        vehicle.require_commandable()
        if self._streams.state(vehicle.id).phase != "idle":
            raise NotTogether(
                f"Vehicle {vehicle.id} already has a setpoint stream.",
                vehicles=(vehicle.id,),
                remedy="Stop its stream (offboard/stop) first.",
            )
        status = vehicle.status
        if not status.armed or status.landed_state != "in_air":
            raise NotTogether(
                f"Vehicle {vehicle.id} is not flying: a group starts in flight.",
                vehicles=(vehicle.id,),
                remedy="Take off first.",
            )
        self.check_setpoint(member, index, self.stream_requests(request, request.setpoints)[vehicle.id])

    @staticmethod
    def check_setpoint(
        member: OffboardControl, index: int, request: StreamRequest, field: str = "members"
    ) -> None:
        """Raises NotTogether if the setpoint cannot be flown now, InvalidRequest if it can never be flown."""
        vehicle_id = member.vehicle.id
        try:
            member.check(request)
        except InvalidRequest as error:
            field_name = f"{field}.{index}.setpoint"
            raise InvalidRequest(
                field_name, f"Vehicle {vehicle_id}: {error.message}", remedy=error.remedy
            ) from error
        except Refused as error:
            message = f"Vehicle {vehicle_id}: {error.message}"
            raise NotTogether(message, vehicles=(vehicle_id,), remedy=error.remedy) from error

    def check_setpoints(
        self, members: Mapping[str, OffboardControl], requests: Mapping[str, StreamRequest]
    ) -> None:
        """Raises the errors of `check_setpoint`, or of `require_commandable`."""
        for index, (vehicle_id, request) in enumerate(requests.items()):
            members[vehicle_id].vehicle.require_commandable()
            self.check_setpoint(members[vehicle_id], index, request, "setpoints")

    async def check_separation(
        self,
        minimum_m: float,
        members: Mapping[str, OffboardControl],
        requests: Mapping[str, StreamRequest],
        held: Container[str] = (),
        duration_s: float | None = None,
    ) -> None:
        """Predicts the flights from positions and setpoints, and checks that all vehicles stay apart.

        During the prediction the event loop does other work and the vehicles continue to fly. Therefore the
        caller repeats the earlier checks afterwards, and calls `check_separation_now`.

        Args:
            minimum_m: the minimum separation.
            members: all members of the group.
            requests: the new requests; the other members keep their setpoints.
            held: members that no longer follow the group and may be anywhere.
            duration_s: time until all setpoints expire [s]; None: each setpoint expires after its own
                validity.

        Raises:
            NotTogether: two vehicles would come too close, or a position is unknown; the error names the
                vehicles.
        """
        now_s = self._clock.monotonic_s()
        predicted = self._predicted_members(now_s, members, requests, held, duration_s)
        _raise_conflict(await self._in_pieces(first_conflict(predicted, now_s, minimum_m)), minimum_m)

    def check_separation_now(
        self,
        minimum_m: float,
        members: Mapping[str, OffboardControl],
        requests: Mapping[str, StreamRequest],
        held: Container[str] = (),
    ) -> None:
        """Checks that all vehicles are far enough apart now, braking distance included.

        Args:
            minimum_m: the minimum separation.
            members: all members of the group.
            requests: the new requests.
            held: members that no longer follow the group and may be anywhere.

        Raises:
            NotTogether: two vehicles are too close, or a position is unknown.
        """
        now_s = self._clock.monotonic_s()
        _raise_conflict(
            too_near_now(self._predicted_members(now_s, members, requests, held), now_s, minimum_m), minimum_m
        )

    async def _in_pieces(self, search: Generator[None, None, Conflict | None]) -> Conflict | None:
        """Computes a prediction piece by piece; the event loop does other work after each piece."""
        while True:
            async with self._piece_lock:
                try:
                    next(search)
                except StopIteration as end:
                    return end.value
                await asyncio.sleep(0)

    def _predicted_members(
        self,
        now_s: float,
        members: Mapping[str, OffboardControl],
        requests: Mapping[str, StreamRequest],
        held: Container[str],
        duration_s: float | None = None,
    ) -> list[PredictedMember]:
        predicted: list[PredictedMember] = []
        for vehicle_id, member in members.items():
            request, elapsed_s = requests.get(vehicle_id), 0.0
            setpoint = None if request is None or isinstance(request.setpoint, Script) else request.setpoint
            snapshot = member.snapshot(request)
            position, origin = snapshot.position_at(now_s), snapshot.bounds.origin
            if position is None or origin is None:
                if vehicle_id in held:
                    continue
                raise NotTogether(
                    f"Vehicle {vehicle_id} has no global position, so it cannot be kept "
                    "apart from the others.",
                    vehicles=(vehicle_id,),
                    remedy="Wait for GPS, home position and estimator.",
                )
            if request is None:
                state = self._streams.state(vehicle_id)
                request, elapsed_s = state.request, state.age_s or 0.0
                if request is not None and state.phase == "streaming":
                    accepted = request.setpoint  # a body offset was resolved when the request was accepted
                    setpoint = state.sent if isinstance(accepted, PositionBody | Script) else accepted
            expires_s = duration_s if duration_s is not None or request is None else request.duration_s
            predicted.append(PredictedMember(vehicle_id, setpoint, snapshot, expires_s or 0.0, elapsed_s))
        return predicted

    def stream_requests(
        self, request: GroupRequest, setpoints: Mapping[str, Setpoint]
    ) -> dict[str, StreamRequest]:
        """The stream requests for these setpoints. All members' setpoints expire at the same time.

        Raises:
            InvalidRequest: a path lasts longer than `MAX_PREDICTION_S`.
        """
        longest_s = max((_duration_s(s) for s in request.setpoints.values()), default=0.0)
        if longest_s > MAX_PREDICTION_S:
            raise InvalidRequest(
                "members", f"A path of a group may last {MAX_PREDICTION_S:g} s at most, not {longest_s:g} s."
            )
        return {
            vehicle_id: StreamRequest(
                setpoint,
                request.valid_for_s + longest_s - _duration_s(setpoint),
                request.on_expiry,
                request.client,
                request.client_key,
                "group",
            )
            for vehicle_id, setpoint in setpoints.items()
        }

    def remaining_path_s(self, current: Mapping[str, Setpoint], changed: Mapping[str, Setpoint]) -> float:
        """Time until the last path ends [s].

        Args:
            current: the current setpoints of all members.
            changed: the new setpoints that replace some of them.
        """
        remaining_s = [_duration_s(setpoint) for setpoint in changed.values()]
        for vehicle_id, setpoint in current.items():
            if vehicle_id not in changed:
                age_s = self._streams.state(vehicle_id).age_s
                remaining_s.append(max(0.0, _duration_s(setpoint) - (age_s or 0.0)))
        return max(remaining_s, default=0.0)


def _raise_conflict(conflict: Conflict | None, minimum_m: float) -> None:
    if conflict is not None:
        raise NotTogether(
            conflict.text(minimum_m),
            vehicles=conflict.vehicles,
            distance_m=conflict.distance_m,
            remedy=SEPARATION_REMEDY,
        )


def _duration_s(setpoint: Setpoint) -> float:
    return setpoint.duration_s if isinstance(setpoint, Path) else 0.0
