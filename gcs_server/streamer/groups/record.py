"""What the server keeps of one group of vehicles, and how it is told."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from gcs_server.errors import InvalidRequest, NotTogether, Refused
from gcs_server.streamer.groups.checks import GroupOrder
from gcs_server.streamer.groups.member import Member
from gcs_server.streamer.groups.status import GroupFinding, GroupMember, GroupStatus, Nearest
from gcs_server.streamer.schedule.streams import StreamState
from gcs_server.streamer.separation.guard import FOLLOWS_ORDER, GuardState
from missions.setpoints import Setpoint


@dataclass(slots=True)
class Group:
    """One group: what was ordered, who flies it, and what became of it."""

    id: str
    order: GroupOrder
    setpoints: dict[str, Setpoint]
    """As flown now."""
    members: dict[str, Member]
    """By the vehicle's id."""
    created_unix_s: float
    state: str = "starting"
    guard: GuardState | None = None
    """As it was last read; None before all are confirmed."""
    start_unix_s: float | None = None
    findings: list[GroupFinding] = field(default_factory=list[GroupFinding])
    numbers: dict[str, int] = field(default_factory=dict[str, int])
    """Of the streams that are this group's: a member that left may be flown by one of its own later."""
    changing: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held while new setpoints are checked and taken."""
    ending: str | None = None
    ended: str | None = None

    def phase(self, vehicle_id: str, stream: StreamState) -> str:
        """Of the group's own stream to a member; idle where the vehicle is flown by another."""
        return stream.phase if stream.number == self.numbers.get(vehicle_id) else "idle"

    def require_gathered(self, streams: Mapping[str, StreamState]) -> None:
        """Raises NotTogether where one that was confirmed has left before the start.

        Args:
            streams: each member's, newest.
        """
        gone = [v for v in self.members if self.phase(v, streams[v]) not in FOLLOWS_ORDER]
        if gone:
            ends = [(v, streams[v].last_end) for v in gone]
            said = " ".join(f"Vehicle {v}: {end.text}" for v, end in ends if end is not None)
            raise NotTogether(
                f"{listed(gone)} left before the common start, so none moves. {said}".rstrip(),
                vehicles=tuple(gone),
                remedy="Look at what it does, then start the group anew.",
            )

    def require_changeable(self, changed: Iterable[str], guard: GuardState | None) -> GuardState:
        """The guard of a group that takes new setpoints of these members now.

        Raises:
            Refused: it takes none, or a member is held.
            InvalidRequest: one is not in it.
        """
        if guard is None or self.state not in ("flying", "holding") or guard.phase != "flying":
            raise Refused(
                f"Group {self.id} is {self.state}: it takes no setpoints.",
                remedy="Start a group anew." if self.state == "ended" else "Wait for its start.",
            )
        for vehicle_id in changed:
            if vehicle_id not in self.members:
                raise InvalidRequest("setpoints", f"Vehicle {vehicle_id} is not in group {self.id}.")
            if vehicle_id in guard.held:
                raise Refused(
                    f"Vehicle {vehicle_id} is held and follows group {self.id} no more.",
                    remedy="Command it by itself, or hold the group and start it anew.",
                )
        return guard

    def status(self, streams: Mapping[str, StreamState]) -> GroupStatus:
        """As people are told.

        Args:
            streams: each member's, newest.
        """
        guard, ended = self.guard, self.state == "ended"
        nearest = guard.nearest if guard is not None and not ended else None
        margin_m = guard.margin_m if guard is not None and not ended else None
        valid = [s.valid_left_s for s in streams.values() if s.phase == "streaming"]
        valid_left_s = min((left_s for left_s in valid if left_s is not None), default=None)
        return GroupStatus(
            id=self.id,
            state=self.state,
            client=self.order.client,
            client_key=self.order.client_key,
            minimum_separation_m=self.order.minimum_separation_m,
            margin_m=None if margin_m is None else round(margin_m, 2),
            others_go_on=self.order.others_go_on,
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
            nearest=None if nearest is None else Nearest(nearest[:2], round(nearest[2], 2)),
            findings=tuple(self.findings),
            ended=self.ended,
        )


def listed(vehicles: Iterable[str]) -> str:
    """Their names in a sentence."""
    ids = list(vehicles)
    if len(ids) == 1:
        return f"Vehicle {ids[0]}"
    return f"Vehicles {', '.join(ids[:-1])} and {ids[-1]}"
