"""All that the server and the process of the streams say to each other, one frozen class a message.

The server's are `Post` (nobody waits for an answer) or `Request` (a coroutine awaits it); each says itself
which method of the process it means, so that a type checker sees every call. They are taken in the order in
which they were sent. The process sends tuples of `Hello`, `Update` and `Answer`.
"""

from __future__ import annotations

import logging
import pickle
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from gcs_server.streamer.schedule.scheduler import StreamScheduler
from gcs_server.streamer.schedule.streams import StreamState
from gcs_server.streamer.separation.guard import Finding, GroupGuard, GuardState
from gcs_server.streamer.values.events import StreamEvent
from gcs_server.streamer.values.order import Order
from gcs_server.streamer.values.snapshot import Snapshot
from missions.runner.script import Steering

log = logging.getLogger(__name__)

Address = tuple[str, int]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class RouteSigning:
    """What the process needs to sign as the server does; it comes by the server's socket only."""

    key: bytes = field(repr=False)
    link_id: int
    ahead_ticks: int
    """How far the server's timestamps run before the machine's clock, in whole seconds."""


@dataclass(frozen=True, slots=True)
class Route:
    """Where a vehicle's datagrams go."""

    socket_number: int
    address: Address
    signing: RouteSigning | None = None
    """None: frames leave unsigned."""


class WorkerSide(Protocol):
    """What the messages find in the process."""

    @property
    def scheduler(self) -> StreamScheduler: ...

    def attach(self, vehicle_id: str, target: tuple[int, int], number: int) -> None:
        """See `Attach`."""
        ...

    def set_routes(self, routes: Mapping[str, Route | None]) -> None:
        """See `Routes`."""
        ...


class Message:
    """From the server."""

    __slots__ = ()


class Post(Message, ABC):
    """Nobody waits for an answer."""

    __slots__ = ()

    @abstractmethod
    def apply(self, worker: WorkerSide) -> None:
        """Carries the message out, in the process."""


class Request(Message, ABC, Generic[T]):
    """A coroutine of the server's awaits the answer."""

    __slots__ = ()

    @abstractmethod
    def apply(self, worker: WorkerSide) -> T:
        """Carries the message out, in the process."""

    def vehicles(self) -> tuple[str, ...]:
        """Whose state the server shall know before it has the answer."""
        return ()


# --- posts ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Attach(Post):
    """A vehicle becomes known by its (system, component) id; `number` is that of its last stream."""

    vehicle_id: str
    target: tuple[int, int]
    number: int

    def apply(self, worker: WorkerSide) -> None:
        worker.attach(self.vehicle_id, self.target, self.number)


@dataclass(frozen=True, slots=True)
class Routes(Post):
    """Where the datagrams of all streamed vehicles go (None: by the server); no other socket is kept."""

    routes: Mapping[str, Route | None]

    def apply(self, worker: WorkerSide) -> None:
        worker.set_routes(self.routes)


@dataclass(frozen=True, slots=True)
class Beat(Post):
    """The event loop lives; the snapshots are pickled each by itself, so that a bad one costs itself only."""

    snapshots: Mapping[str, bytes]

    @staticmethod
    def of(snapshots: Mapping[str, Snapshot]) -> Beat:
        """Leaves out, with a word in the log, what cannot be pickled."""
        packed: dict[str, bytes] = {}
        for vehicle_id, snapshot in snapshots.items():
            try:
                packed[vehicle_id] = pickle.dumps(snapshot, pickle.HIGHEST_PROTOCOL)
            except Exception:
                log.exception("the snapshot of vehicle %s cannot be handed over", vehicle_id)
        return Beat(packed)

    def apply(self, worker: WorkerSide) -> None:
        snapshots: dict[str, Snapshot] = {}
        for vehicle_id, packed in self.snapshots.items():
            try:
                snapshots[vehicle_id] = pickle.loads(packed)
            except Exception:
                log.exception("the snapshot of vehicle %s cannot be read", vehicle_id)
        worker.scheduler.beat(snapshots)


@dataclass(frozen=True, slots=True)
class CancelStart(Post):
    """See `Streams.cancel_start`."""

    vehicle_id: str
    snapshot: Snapshot
    number: int

    def apply(self, worker: WorkerSide) -> None:
        worker.scheduler.cancel_start(self.vehicle_id, self.snapshot, self.number)


@dataclass(frozen=True, slots=True)
class Steer(Post):
    """See `Streams.steer`."""

    vehicle_id: str
    steering: Steering

    def apply(self, worker: WorkerSide) -> None:
        worker.scheduler.steer(self.vehicle_id, self.steering)


@dataclass(frozen=True, slots=True)
class RequestStop(Post):
    """See `Streams.request_stop`."""

    vehicle_id: str
    snapshot: Snapshot

    def apply(self, worker: WorkerSide) -> None:
        worker.scheduler.request_stop(self.vehicle_id, self.snapshot)


@dataclass(frozen=True, slots=True)
class InhibitModeRequests(Post):
    """See `Streams.inhibit_mode_requests`."""

    vehicle_id: str

    def apply(self, worker: WorkerSide) -> None:
        worker.scheduler.inhibit_mode_requests(self.vehicle_id)


@dataclass(frozen=True, slots=True)
class ForceHold(Post):
    """See `Streams.force_hold`."""

    vehicle_id: str
    why: str

    def apply(self, worker: WorkerSide) -> None:
        worker.scheduler.force_hold(self.vehicle_id, self.why)


@dataclass(frozen=True, slots=True)
class End(Post):
    """See `Streams.end`."""

    vehicle_id: str
    code: str
    text: str
    number: int | None

    def apply(self, worker: WorkerSide) -> None:
        worker.scheduler.end(self.vehicle_id, self.code, self.text, self.number)


@dataclass(frozen=True, slots=True)
class Watch(Post):
    """See `Streams.watch`."""

    guard: GroupGuard

    def apply(self, worker: WorkerSide) -> None:
        worker.scheduler.watch(self.guard)


@dataclass(frozen=True, slots=True)
class Unwatch(Post):
    """See `Streams.unwatch`."""

    name: str

    def apply(self, worker: WorkerSide) -> None:
        worker.scheduler.unwatch(self.name)


@dataclass(frozen=True, slots=True)
class DisableGuard(Post):
    """See `Streams.disable_guard`."""

    name: str

    def apply(self, worker: WorkerSide) -> None:
        worker.scheduler.disable_guard(self.name)


# --- requests -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Begin(Request[int]):
    """See `Streams.begin`."""

    vehicle_id: str
    order: Order
    rate_hz: float
    snapshot: Snapshot

    def apply(self, worker: WorkerSide) -> int:
        return worker.scheduler.begin(self.vehicle_id, self.order, self.rate_hz, self.snapshot)

    def vehicles(self) -> tuple[str, ...]:
        return (self.vehicle_id,)


@dataclass(frozen=True, slots=True)
class Engage(Request[bool]):
    """See `Streams.engage`."""

    vehicle_id: str
    snapshot: Snapshot
    number: int | None

    def apply(self, worker: WorkerSide) -> bool:
        return worker.scheduler.engage(self.vehicle_id, self.snapshot, self.number)

    def vehicles(self) -> tuple[str, ...]:
        return (self.vehicle_id,)


@dataclass(frozen=True, slots=True)
class Change(Request[bool]):
    """See `Streams.change`."""

    vehicle_id: str
    order: Order
    snapshot: Snapshot

    def apply(self, worker: WorkerSide) -> bool:
        return worker.scheduler.change(self.vehicle_id, self.order, self.snapshot)

    def vehicles(self) -> tuple[str, ...]:
        return (self.vehicle_id,)


@dataclass(frozen=True, slots=True)
class ChangeTogether(Request[bool]):
    """See `Streams.change_together`."""

    name: str
    orders: Mapping[str, Order]
    snapshots: Mapping[str, Snapshot]
    until_s: float
    members: tuple[str, ...]
    """All of the group: those without a new setpoint are renewed."""

    def apply(self, worker: WorkerSide) -> bool:
        return worker.scheduler.change_together(self.name, self.orders, self.snapshots, self.until_s)

    def vehicles(self) -> tuple[str, ...]:
        return self.members


# --- from the process -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Numbered:
    """A message of the server's as it travels."""

    number: int
    message: Post | Request[object]


@dataclass(frozen=True, slots=True)
class Hello:
    """It has started."""

    real_time: bool
    """Whether the system granted it real-time priority."""


@dataclass(frozen=True, slots=True)
class Update:
    """How streams and groups stand, and what has happened since the last update."""

    handled: int
    """Number of the last message that was taken."""
    at_s: float
    states: Mapping[str, StreamState]
    """Of those that are streamed to or have just ended."""
    same_order: frozenset[str]
    """Of these the order, left out here, is as last told."""
    guards: Mapping[str, GuardState]
    """Of all groups that are watched."""
    reports: tuple[tuple[str, StreamEvent], ...] = ()
    findings: tuple[tuple[str, Finding], ...] = ()


@dataclass(frozen=True, slots=True)
class Answer:
    """To the request of that number; an error is its class's name and text."""

    number: int
    result: object
    error: tuple[str, str] | None = None
