"""Checks whether several vehicles can fly as a group: each vehicle, the common start, and the separation."""

from __future__ import annotations

import asyncio
from collections.abc import Container, Generator, Mapping
from dataclasses import dataclass
from typing import Protocol

from gcs_server.clock import Clock
from gcs_server.errors import InvalidRequest, NotTogether, Refused
from gcs_server.flights.prediction import (
    MAX_PREDICTION_S,
    Conflict,
    PredictedMember,
    first_conflict,
    too_near_now,
)
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle
from missions.runner.script import Script
from missions.setpoints import Path, PositionBody, Setpoint

MIN_LEAD_S, MAX_LEAD_S = 3.0, 300.0
"""Minimum and maximum time from the request to the requested start [s]. Pre-streaming and the switch to
Offboard need the minimum.
"""
SEPARATION_REMEDY = (
    "Move their targets farther apart, fly them one after the other, or lower minimum_separation_m."
)


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

    def check_member(self, member: Member, index: int, request: GroupRequest) -> None:
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
    def check_setpoint(member: Member, index: int, request: StreamRequest, field: str = "members") -> None:
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

    def check_setpoints(self, members: Mapping[str, Member], requests: Mapping[str, StreamRequest]) -> None:
        """Raises the errors of `check_setpoint`, or of `require_commandable`."""
        for index, (vehicle_id, request) in enumerate(requests.items()):
            members[vehicle_id].vehicle.require_commandable()
            self.check_setpoint(members[vehicle_id], index, request, "setpoints")

    async def check_separation(
        self,
        minimum_m: float,
        members: Mapping[str, Member],
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
        members: Mapping[str, Member],
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
        members: Mapping[str, Member],
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


class Member(Protocol):
    """One vehicle of a group, and its stream."""

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle of the stream."""
        ...

    def check(self, request: StreamRequest) -> object:
        """Raises Refused if the setpoint cannot be flown now, InvalidRequest if it can never be flown."""
        ...

    def snapshot(self, request: StreamRequest | None = None) -> Snapshot:
        """Snapshot of the vehicle for its stream, or for a new request that is not accepted yet."""
        ...

    async def start(
        self, request: StreamRequest, rate_hz: float, select: None = None, ticket: Ticket | None = None
    ) -> object:
        """Starts the stream; returns once the vehicle is in Offboard. Raises GcsError if it does not
        switch."""
        ...

    async def stop(self, ticket: Ticket | None = None) -> object:
        """Puts the vehicle into Hold; raises GcsError if it does not confirm."""
        ...
