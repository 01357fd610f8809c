"""What the event loop asks of whatever flies the setpoint streams, and what it is told of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from gcs_server.streamer.schedule.avoidance import Avoiding
from gcs_server.streamer.separation.guard import Finding, GroupGuard, GuardState
from gcs_server.streamer.transport.sender import PayloadSender
from gcs_server.streamer.values.events import StreamEvent
from gcs_server.streamer.values.order import Order
from gcs_server.streamer.values.snapshot import Snapshot
from missions.runner.script import Played, Steering
from missions.setpoints import DirectSetpoint


@dataclass(frozen=True, slots=True)
class StreamState:
    """How a stream stands, read in one moment."""

    phase: str = "idle"
    order: Order | None = None
    sent: DirectSetpoint | None = None
    """What goes out; None while nothing does."""
    limited: tuple[str, ...] = ()
    """What the limits take away from the order now."""
    rate_hz: float = 50.0
    rate_achieved_hz: float | None = None
    age_s: float | None = None
    sent_age_s: float | None = None
    valid_left_s: float | None = None
    sends_failed: int = 0
    last_end: StreamEvent | None = None
    number: int = 0
    """Counts a vehicle's streams."""
    steady_s: float = 0.0
    """For how long setpoints have gone out without a pause."""
    avoiding: Avoiding | None = None
    """What obstacle avoidance does now; None: it is off."""
    played: Played | None = None
    """How far an offboard mission is flown; None where none is."""


class Streams(Protocol):
    """All streams of the server.

    In a running server they run in a process of their own (`process/stream_process.py`); tests run the
    scheduler themselves. Only the event loop calls this. A plain method returns at once, whatever that
    process does; a coroutine waits for its answer.
    """

    def start(self) -> None:
        """Begins; nothing is sent before a `begin`."""
        ...

    def close(self) -> None:
        """Ends; nothing is sent afterwards."""
        ...

    def beat(self, snapshots: Mapping[str, Snapshot]) -> None:
        """The loop lives, and this is what it knows of the vehicles that are streamed to."""
        ...

    def links_changed(self) -> None:
        """A link was opened or closed: no socket of a closed one is kept."""
        ...

    def attach(self, vehicle_id: str, sender: PayloadSender, target: tuple[int, int]) -> None:
        """Makes a vehicle known by its (system, component) id; sends nothing."""
        ...

    def forget(self, vehicle_id: str) -> None:
        """It has gone, and nothing is streamed to it: its way out is not kept."""
        ...

    def active(self) -> list[str]:
        """Ids of the vehicles that are streamed to."""
        ...

    def state(self, vehicle_id: str) -> StreamState:
        """How a vehicle's stream stands."""
        ...

    async def ready(self) -> None:
        """Returns once a stream can begin without making the event loop wait.

        Raises:
            Refused: that is not to be had.
        """
        ...

    async def begin(self, vehicle_id: str, order: Order, rate_hz: float, snapshot: Snapshot) -> int:
        """Starts a stream and numbers it; 0 where there is one already.

        Raises:
            Refused: what streams is just being started again.
            ValueError: the order cannot be flown.
        """
        ...

    def starting(self, vehicle_id: str, number: int) -> bool:
        """Whether that stream is still being started."""
        ...

    async def engage(self, vehicle_id: str, snapshot: Snapshot, number: int | None = None) -> bool:
        """The vehicle reports Offboard; False: that stream has ended meanwhile."""
        ...

    def cancel_start(self, vehicle_id: str, snapshot: Snapshot, number: int) -> None:
        """That stream's start failed after Offboard had been asked for."""
        ...

    async def change(self, vehicle_id: str, order: Order, snapshot: Snapshot) -> bool:
        """A new setpoint, sent at once; False where there is no stream to change.

        Raises:
            ValueError: the order cannot be flown; what was flown is flown on.
        """
        ...

    def steer(self, vehicle_id: str, steering: Steering) -> None:
        """Steers the offboard mission that is flown, and renews it."""
        ...

    def request_stop(self, vehicle_id: str, snapshot: Snapshot) -> None:
        """Holds the place until Hold is confirmed."""
        ...

    def inhibit_mode_requests(self, vehicle_id: str) -> None:
        """A mode is being commanded: the stream asks for none meanwhile."""
        ...

    def force_hold(self, vehicle_id: str, why: str) -> None:
        """Stops a vehicle at its place and asks for Hold, without waiting for the loop."""
        ...

    def end(self, vehicle_id: str, code: str, text: str, number: int | None = None) -> None:
        """Stops sending now (that stream, where it is named); the caller tells whom it concerns."""
        ...

    def take_reports(self) -> list[tuple[str, StreamEvent]]:
        """What happened since the last call, for the loop to tell."""
        ...

    def watch(self, guard: GroupGuard) -> None:
        """From now on a group's vehicles are kept apart, and begin together at their instant."""
        ...

    def unwatch(self, name: str) -> None:
        """A group is over."""
        ...

    def disable_guard(self, name: str) -> None:
        """Somebody stops a whole group."""
        ...

    def guard(self, name: str) -> GuardState | None:
        """How a group's guard stands; None where it is watched no more."""
        ...

    async def change_together(
        self, name: str, orders: Mapping[str, Order], snapshots: Mapping[str, Snapshot], until_s: float
    ) -> bool:
        """New setpoints for some of a group, sent at once and expiring with all others; False: none taken."""
        ...

    def watched(self) -> dict[str, Order | None]:
        """Vehicles of groups, each with the order that it is to begin with."""
        ...

    def take_findings(self) -> list[tuple[str, Finding]]:
        """What went wrong in groups since the last call, for the loop to tell."""
        ...
