"""Whether several vehicles can fly as a group: each by itself, the instant, and all apart."""

from __future__ import annotations

import asyncio
from collections.abc import Container, Generator, Mapping
from dataclasses import dataclass

from gcs_server.clock import Clock
from gcs_server.errors import InvalidRequest, NotTogether, Refused
from gcs_server.streamer.groups.member import Member
from gcs_server.streamer.groups.plan import LONGEST_PLAN_S, Conflict, Planned, first_conflict, too_near_now
from gcs_server.streamer.schedule.streams import Streams
from gcs_server.streamer.values.order import OnExpiry, Order
from missions.runner.script import Script
from missions.setpoints import Path, PositionBody, Setpoint

SOONEST_S, LATEST_S = 3.0, 300.0
"""A start that is asked for is so far ahead: the pre-stream and the switch come before it."""
SLOWER = "Place their targets farther apart, let them fly one after the other, or lower minimum_separation_m."


@dataclass(frozen=True, slots=True)
class GroupOrder:
    """What a group is to fly."""

    setpoints: Mapping[str, Setpoint]
    """By vehicle."""
    minimum_separation_m: float
    valid_for_s: float
    """Of all, from the end of the longest path."""
    on_expiry: OnExpiry
    client: str
    rate_hz: float = 50.0
    client_key: str = ""
    start_at_unix_s: float | None = None
    others_go_on: bool = False


class GroupChecks:
    """Asks each vehicle and its stream.

    Args:
        clock: the server's.
        streams: what sends.
    """

    def __init__(self, clock: Clock, streams: Streams) -> None:
        self._clock = clock
        self._streams = streams
        self._piece = asyncio.Lock()
        """Held for a piece of a plan: of several made at once, one piece is worked a round of the loop."""

    def check_instant(self, order: GroupOrder, soonest_s: float) -> None:
        """Raises InvalidRequest where the common start is not so far ahead."""
        at = order.start_at_unix_s
        if at is None:
            return
        ahead_s = at - self._clock.unix_s()
        if not soonest_s <= ahead_s <= LATEST_S:
            raise InvalidRequest(
                "start_at_unix_s",
                f"start_at_unix_s is {ahead_s:.1f} s ahead; it must be {SOONEST_S:g} to {LATEST_S:g} s ahead "
                "when it is asked for, and still ahead when all are in Offboard.",
            )

    def check_member(self, member: Member, index: int, order: GroupOrder) -> None:
        """Raises NotTogether (or whatever refuses a single vehicle) where it cannot join now."""
        vehicle = member.vehicle
        vehicle.require_commandable()
        if self._streams.state(vehicle.id).phase != "idle":
            raise NotTogether(
                f"Vehicle {vehicle.id} is streamed to already.",
                vehicles=(vehicle.id,),
                remedy="Stop its stream (offboard/stop) first.",
            )
        status = vehicle.status
        if not status.armed or status.landed_state != "in_air":
            raise NotTogether(
                f"Vehicle {vehicle.id} is not in the air: a group starts in flight.",
                vehicles=(vehicle.id,),
                remedy="Take off first.",
            )
        self.check_setpoint(member, index, self.orders(order, order.setpoints)[vehicle.id])

    @staticmethod
    def check_setpoint(member: Member, index: int, order: Order, where: str = "members") -> None:
        """Raises NotTogether where the setpoint cannot be flown now, InvalidRequest where it never can."""
        vehicle_id = member.vehicle.id
        try:
            member.check(order)
        except InvalidRequest as error:
            field_ = f"{where}.{index}.setpoint"
            raise InvalidRequest(
                field_, f"Vehicle {vehicle_id}: {error.message}", remedy=error.remedy
            ) from error
        except Refused as error:
            message = f"Vehicle {vehicle_id}: {error.message}"
            raise NotTogether(message, vehicles=(vehicle_id,), remedy=error.remedy) from error

    def check_setpoints(self, members: Mapping[str, Member], orders: Mapping[str, Order]) -> None:
        """Raises what `check_setpoint` does, or whatever refuses a vehicle any command."""
        for index, (vehicle_id, order) in enumerate(orders.items()):
            members[vehicle_id].vehicle.require_commandable()
            self.check_setpoint(members[vehicle_id], index, order, "setpoints")

    async def check_apart(
        self,
        minimum_m: float,
        members: Mapping[str, Member],
        orders: Mapping[str, Order],
        held: Container[str] = (),
        lasts_s: float | None = None,
    ) -> None:
        """Whether all would stay apart, by where they are and what they are to fly.

        Everybody else has turns meanwhile, and the vehicles fly on: what was checked before is to be checked
        again afterwards, and `check_apart_now` asked.

        Args:
            minimum_m: to be kept.
            members: all of the group.
            orders: what is to be taken; the others fly on as they do.
            held: who follows the group no more, and may be anywhere.
            lasts_s: until all expire, where it is not their own validity that says it.

        Raises:
            NotTogether: naming the two, or the one whose place is not known.
        """
        now_s = self._clock.monotonic_s()
        planned = self._planned(now_s, members, orders, held, lasts_s)
        _refuse(await self._in_pieces(first_conflict(planned, now_s, minimum_m)), minimum_m)

    def check_apart_now(
        self,
        minimum_m: float,
        members: Mapping[str, Member],
        orders: Mapping[str, Order],
        held: Container[str] = (),
    ) -> None:
        """Whether all are far enough apart where they are now, the way of braking included.

        Args:
            minimum_m: to be kept.
            members: all of the group.
            orders: what is to be taken.
            held: who follows the group no more, and may be anywhere.

        Raises:
            NotTogether: as `check_apart`.
        """
        now_s = self._clock.monotonic_s()
        _refuse(too_near_now(self._planned(now_s, members, orders, held), now_s, minimum_m), minimum_m)

    async def _in_pieces(self, plan: Generator[None, None, Conflict | None]) -> Conflict | None:
        """What a plan finds; everybody has a turn after each piece of it."""
        while True:
            async with self._piece:
                try:
                    next(plan)
                except StopIteration as done:
                    return done.value
                await asyncio.sleep(0)

    def _planned(
        self,
        now_s: float,
        members: Mapping[str, Member],
        orders: Mapping[str, Order],
        held: Container[str],
        lasts_s: float | None = None,
    ) -> list[Planned]:
        planned: list[Planned] = []
        for vehicle_id, member in members.items():
            order, elapsed_s = orders.get(vehicle_id), 0.0
            setpoint = None if order is None or isinstance(order.setpoint, Script) else order.setpoint
            snapshot = member.snapshot(order)
            here, origin = snapshot.position_at(now_s), snapshot.bounds.origin
            if here is None or origin is None:
                if vehicle_id in held:
                    continue
                raise NotTogether(
                    f"Vehicle {vehicle_id} does not know where on the earth it is, so it cannot be kept "
                    "apart from the others.",
                    vehicles=(vehicle_id,),
                    remedy="Wait for GPS, home and the estimator.",
                )
            if order is None:
                state = self._streams.state(vehicle_id)
                order, elapsed_s = state.order, state.age_s or 0.0
                if order is not None and state.phase == "streaming":
                    ordered = order.setpoint  # an offset was worked out when it was taken
                    setpoint = state.sent if isinstance(ordered, PositionBody | Script) else ordered
            expires_s = lasts_s if lasts_s is not None or order is None else order.lasts_s
            planned.append(Planned(vehicle_id, setpoint, snapshot, expires_s or 0.0, elapsed_s))
        return planned

    def orders(self, order: GroupOrder, setpoints: Mapping[str, Setpoint]) -> dict[str, Order]:
        """Each with the validity that lets all expire at one instant."""
        longest_s = max((_duration_s(s) for s in order.setpoints.values()), default=0.0)
        if longest_s > LONGEST_PLAN_S:
            raise InvalidRequest(
                "members", f"A path of a group lasts {LONGEST_PLAN_S:g} s at most, not {longest_s:g} s."
            )
        return {
            vehicle_id: Order(
                setpoint,
                order.valid_for_s + longest_s - _duration_s(setpoint),
                order.on_expiry,
                order.client,
                order.client_key,
                "group",
            )
            for vehicle_id, setpoint in setpoints.items()
        }

    def left_s(self, flown: Mapping[str, Setpoint], changed: Mapping[str, Setpoint]) -> float:
        """Until the last path has come to its end."""
        left_s = [_duration_s(setpoint) for setpoint in changed.values()]
        for vehicle_id, setpoint in flown.items():
            if vehicle_id not in changed:
                age_s = self._streams.state(vehicle_id).age_s
                left_s.append(max(0.0, _duration_s(setpoint) - (age_s or 0.0)))
        return max(left_s, default=0.0)


def _refuse(conflict: Conflict | None, minimum_m: float) -> None:
    if conflict is not None:
        raise NotTogether(
            conflict.words(minimum_m),
            vehicles=conflict.vehicles,
            distance_m=conflict.distance_m,
            remedy=SLOWER,
        )


def _duration_s(setpoint: Setpoint) -> float:
    return setpoint.duration_s if isinstance(setpoint, Path) else 0.0
