"""The interface between the event loop and whatever runs the setpoint streams."""

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
    """The state of a stream at one moment."""

    phase: str = "idle"
    order: Order | None = None
    sent: DirectSetpoint | None = None
    """The sent setpoint; None while nothing is sent."""
    limited: tuple[str, ...] = ()
    """Texts of what the limits reduce now."""
    rate_hz: float = 50.0
    rate_achieved_hz: float | None = None
    age_s: float | None = None
    sent_age_s: float | None = None
    valid_left_s: float | None = None
    sends_failed: int = 0
    last_end: StreamEvent | None = None
    number: int = 0
    """Number of this stream; counts per vehicle."""
    steady_s: float = 0.0
    """How long setpoints have been sent without a pause."""
    avoiding: Avoiding | None = None
    """State of obstacle avoidance; None: it is off."""
    played: Played | None = None
    """Progress of an offboard mission; None if there is none."""


class Streams(Protocol):
    """All streams of the server.

    In a running server they run in a process of their own (`process/stream_process.py`); tests run the
    scheduler directly. Only the event loop calls this. A plain method never waits for that process; a
    coroutine waits for its answer.
    """

    def start(self) -> None:
        """Starts; nothing is sent before a `begin`."""
        ...

    def close(self) -> None:
        """Closes; nothing is sent afterwards."""
        ...

    def beat(self, snapshots: Mapping[str, Snapshot]) -> None:
        """The event loop is alive; passes on snapshots of the vehicles with a stream."""
        ...

    def links_changed(self) -> None:
        """A link was opened or closed: sockets of closed links are released."""
        ...

    def attach(self, vehicle_id: str, sender: PayloadSender, target: tuple[int, int]) -> None:
        """Makes a vehicle known by its (system, component) id; sends nothing."""
        ...

    def forget(self, vehicle_id: str) -> None:
        """The vehicle was removed and has no stream: its route is dropped."""
        ...

    def active(self) -> list[str]:
        """Ids of the vehicles with a stream."""
        ...

    def state(self, vehicle_id: str) -> StreamState:
        """State of a vehicle's stream."""
        ...

    async def ready(self) -> None:
        """Returns once a stream can begin without blocking the event loop.

        Raises:
            Refused: streams cannot run now.
        """
        ...

    async def begin(self, vehicle_id: str, order: Order, rate_hz: float, snapshot: Snapshot) -> int:
        """Starts a stream and returns its number; 0 if there is already one.

        Raises:
            Refused: the streams' process is being restarted.
            ValueError: the order cannot be flown.
        """
        ...

    def starting(self, vehicle_id: str, number: int) -> bool:
        """Whether this stream is still starting."""
        ...

    async def engage(self, vehicle_id: str, snapshot: Snapshot, number: int | None = None) -> bool:
        """The vehicle reports Offboard; False if this stream has ended meanwhile."""
        ...

    def cancel_start(self, vehicle_id: str, snapshot: Snapshot, number: int) -> None:
        """The start of this stream failed after Offboard had been requested."""
        ...

    async def change(self, vehicle_id: str, order: Order, snapshot: Snapshot) -> bool:
        """Sets a new setpoint, sent at once; False if there is no stream.

        Raises:
            ValueError: the order cannot be flown; the previous one continues.
        """
        ...

    def steer(self, vehicle_id: str, steering: Steering) -> None:
        """Controls the offboard mission being flown, and renews it."""
        ...

    def request_stop(self, vehicle_id: str, snapshot: Snapshot) -> None:
        """Holds the position until Hold is confirmed."""
        ...

    def inhibit_mode_requests(self, vehicle_id: str) -> None:
        """A mode is being commanded: the stream requests none meanwhile."""
        ...

    def force_hold(self, vehicle_id: str, why: str) -> None:
        """Stops a vehicle at its position and requests Hold, without waiting for the event loop."""
        ...

    def end(self, vehicle_id: str, code: str, text: str, number: int | None = None) -> None:
        """Stops sending now (only the stream with this number, if given); the caller reports it."""
        ...

    def take_reports(self) -> list[tuple[str, StreamEvent]]:
        """Returns the stream events since the last call."""
        ...

    def watch(self, guard: GroupGuard) -> None:
        """From now on the guard keeps a group's vehicles apart and starts them together."""
        ...

    def unwatch(self, name: str) -> None:
        """A group has ended: its guard is dropped."""
        ...

    def disable_guard(self, name: str) -> None:
        """A whole group is being stopped: its guard does not act any more."""
        ...

    def guard(self, name: str) -> GuardState | None:
        """State of a group's guard; None if it was dropped."""
        ...

    async def change_together(
        self, name: str, orders: Mapping[str, Order], snapshots: Mapping[str, Snapshot], until_s: float
    ) -> bool:
        """Sets new setpoints for members of a group, sent at once and expiring together; False if none was
        accepted."""
        ...

    def watched(self) -> dict[str, Order | None]:
        """Vehicles of groups, each with its first order."""
        ...

    def take_findings(self) -> list[tuple[str, Finding]]:
        """Returns the findings of groups since the last call."""
        ...
