"""Messages between the server and the stream process, one frozen class each; `mode_messages.py` contains
the messages about modes in PX4. The server sends a `Post` (no answer) or a `Request` (a coroutine awaits the
answer). Each message class calls the method of the process that executes it, so that a type checker checks
every call. Messages are handled in the order in which they were sent. The process sends tuples of
`WorkerStarted`, `Update` and `Answer`.
"""

from __future__ import annotations

import logging
import pickle
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import Registration
from gcs_server.streamer.process.message_pipe import pickled
from gcs_server.streamer.schedule.scheduler import StreamScheduler
from gcs_server.streamer.schedule.streams import StreamState
from gcs_server.streamer.separation.guard import Finding, GroupGuard, GuardState
from gcs_server.streamer.values.events import StreamEvent
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest
from missions.runner.script import ScriptChange

log = logging.getLogger(__name__)

Address = tuple[str, int]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class RouteSigning:
    """Data with which the process signs frames as the server does; sent only over the message pipe."""

    key: bytes = field(repr=False)
    link_id: int
    ahead_ticks: int
    """Time by which the server's signing timestamps are ahead of the system clock [ticks], a whole number of
    seconds."""


@dataclass(frozen=True, slots=True)
class Route:
    """Socket and address for a vehicle's datagrams."""

    socket_number: int
    address: Address
    signing: RouteSigning | None = None
    """None: frames are sent unsigned."""


AnyRoute = Route | DdsAddress
"""How the process reaches a vehicle: by MAVLink datagrams, or by ROS 2 topics."""


class WorkerInterface(Protocol):
    """The interface of the process, which the messages call."""

    @property
    def scheduler(self) -> StreamScheduler: ...

    def attach(self, vehicle_id: str, target: tuple[int, int], number: int) -> None:
        """See `Attach`."""
        ...

    def set_routes(self, routes: Mapping[str, AnyRoute | None]) -> None:
        """See `Routes`."""
        ...


class Message:
    """A message from the server."""

    __slots__ = ()


class Post(Message, ABC):
    """A message without an answer."""

    __slots__ = ()

    @abstractmethod
    def apply(self, worker: WorkerInterface) -> None:
        """Executes the message, in the process."""


class Request(Message, ABC, Generic[T]):
    """A message whose answer a coroutine of the server awaits."""

    __slots__ = ()

    @abstractmethod
    def apply(self, worker: WorkerInterface) -> T:
        """Executes the message, in the process."""

    def vehicles(self) -> tuple[str, ...]:
        """Vehicles whose state the server must receive before the answer."""
        return ()


# --- posts ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Attach(Post):
    """Adds a vehicle with its (system, component) id; `number` is the number of its last stream."""

    vehicle_id: str
    target: tuple[int, int]
    number: int

    def apply(self, worker: WorkerInterface) -> None:
        worker.attach(self.vehicle_id, self.target, self.number)


@dataclass(frozen=True, slots=True)
class Routes(Post):
    """Routes of all streamed vehicles (None: the server sends); all other sockets are closed."""

    routes: Mapping[str, AnyRoute | None]

    def apply(self, worker: WorkerInterface) -> None:
        worker.set_routes(self.routes)


@dataclass(frozen=True, slots=True)
class SnapshotUpdate(Post):
    """The vehicles' snapshots, sent periodically while the event loop runs. Each snapshot is pickled
    separately, so that an invalid snapshot does not affect the others."""

    snapshots: Mapping[str, bytes]

    @staticmethod
    def pickled(snapshots: Mapping[str, Snapshot]) -> SnapshotUpdate:
        """Pickles snapshots; a snapshot that cannot be pickled is logged and omitted."""
        packed: dict[str, bytes] = {}
        for vehicle_id, snapshot in snapshots.items():
            try:
                packed[vehicle_id] = pickled(snapshot)
            except Exception:
                log.exception("the snapshot of vehicle %s cannot be sent", vehicle_id)
        return SnapshotUpdate(packed)

    def apply(self, worker: WorkerInterface) -> None:
        snapshots: dict[str, Snapshot] = {}
        for vehicle_id, packed in self.snapshots.items():
            try:
                snapshots[vehicle_id] = pickle.loads(packed)
            except Exception:
                log.exception("the snapshot of vehicle %s cannot be read", vehicle_id)
        worker.scheduler.update_snapshots(snapshots)


@dataclass(frozen=True, slots=True)
class CancelStart(Post):
    """See `Streams.cancel_start`."""

    vehicle_id: str
    snapshot: Snapshot
    number: int

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.cancel_start(self.vehicle_id, self.snapshot, self.number)


@dataclass(frozen=True, slots=True)
class ChangeScript(Post):
    """See `Streams.change_script`."""

    vehicle_id: str
    change: ScriptChange

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.change_script(self.vehicle_id, self.change)


@dataclass(frozen=True, slots=True)
class RequestStop(Post):
    """See `Streams.request_stop`."""

    vehicle_id: str
    snapshot: Snapshot

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.request_stop(self.vehicle_id, self.snapshot)


@dataclass(frozen=True, slots=True)
class InhibitModeRequests(Post):
    """See `Streams.inhibit_mode_requests`."""

    vehicle_id: str

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.inhibit_mode_requests(self.vehicle_id)


@dataclass(frozen=True, slots=True)
class ForceHold(Post):
    """See `Streams.force_hold`."""

    vehicle_id: str
    why: str

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.force_hold(self.vehicle_id, self.why)


@dataclass(frozen=True, slots=True)
class EndStream(Post):
    """See `Streams.end`."""

    vehicle_id: str
    code: str
    text: str
    number: int | None

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.end(self.vehicle_id, self.code, self.text, self.number)


@dataclass(frozen=True, slots=True)
class WatchGroup(Post):
    """See `Streams.watch`."""

    guard: GroupGuard

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.watch(self.guard)


@dataclass(frozen=True, slots=True)
class UnwatchGroup(Post):
    """See `Streams.unwatch`."""

    name: str

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.unwatch(self.name)


@dataclass(frozen=True, slots=True)
class DisableGuard(Post):
    """See `Streams.disable_guard`."""

    name: str

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.disable_guard(self.name)


# --- requests -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class BeginStream(Request[int]):
    """See `Streams.begin`."""

    vehicle_id: str
    request: StreamRequest
    rate_hz: float
    snapshot: Snapshot

    def apply(self, worker: WorkerInterface) -> int:
        return worker.scheduler.begin(self.vehicle_id, self.request, self.rate_hz, self.snapshot)

    def vehicles(self) -> tuple[str, ...]:
        return (self.vehicle_id,)


@dataclass(frozen=True, slots=True)
class EngageStream(Request[bool]):
    """See `Streams.engage`."""

    vehicle_id: str
    snapshot: Snapshot
    number: int | None

    def apply(self, worker: WorkerInterface) -> bool:
        return worker.scheduler.engage(self.vehicle_id, self.snapshot, self.number)

    def vehicles(self) -> tuple[str, ...]:
        return (self.vehicle_id,)


@dataclass(frozen=True, slots=True)
class ChangeSetpoint(Request[bool]):
    """See `Streams.change`."""

    vehicle_id: str
    request: StreamRequest
    snapshot: Snapshot

    def apply(self, worker: WorkerInterface) -> bool:
        return worker.scheduler.change(self.vehicle_id, self.request, self.snapshot)

    def vehicles(self) -> tuple[str, ...]:
        return (self.vehicle_id,)


@dataclass(frozen=True, slots=True)
class ChangeSetpoints(Request[bool]):
    """See `Streams.change_together`."""

    name: str
    requests: Mapping[str, StreamRequest]
    snapshots: Mapping[str, Snapshot]
    until_s: float
    members: tuple[str, ...]
    """All members of the group; the setpoints of members without a new setpoint are renewed."""

    def apply(self, worker: WorkerInterface) -> bool:
        return worker.scheduler.change_together(self.name, self.requests, self.snapshots, self.until_s)

    def vehicles(self) -> tuple[str, ...]:
        return self.members


# --- envelope, and messages from the process ------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Numbered:
    """A message of the server with its number, as it is sent."""

    number: int
    message: Post | Request[object]


@dataclass(frozen=True, slots=True)
class WorkerStarted:
    """The process has started."""

    real_time: bool
    """Whether the system granted real-time priority."""


@dataclass(frozen=True, slots=True)
class Update:
    """State of streams and groups, and the events since the last update."""

    last_handled: int
    """Number of the last handled message."""
    at_s: float
    """Time of the states [s, monotonic]."""
    states: Mapping[str, StreamState]
    """States of running streams, and of streams that have just ended."""
    unchanged_requests: frozenset[str]
    """Vehicles whose request is omitted in `states`, because it has not changed since the last update."""
    guards: Mapping[str, GuardState]
    """States of all watched groups."""
    reports: tuple[tuple[str, StreamEvent], ...] = ()
    findings: tuple[tuple[str, Finding], ...] = ()
    modes: Mapping[str, tuple[Registration, ...]] = field(default_factory=dict[str, tuple[Registration, ...]])
    """All modes registered with PX4."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to the request with this number; `error` is the class name and text of an error."""

    number: int
    result: object
    error: tuple[str, str] | None = None
