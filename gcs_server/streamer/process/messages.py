"""What the server and the stream process send each other.

The server sends a `Call` of a method with its arguments: a method of the scheduler, of the modes that are
registered with PX4, or of the process itself (`WorkerMethods`). Calls are executed in the order in which they
were sent. The process sends tuples of `WorkerStarted`, `Update` and `Answer`. On the side channel it sends
`Relay` and `SentFrames`, encoded by msgspec.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import Registration
from gcs_server.streamer.schedule.scheduler import StreamState
from gcs_server.streamer.separation import Finding, GuardState
from gcs_server.streamer.values.stream_request import StreamEvent

Address = tuple[str, int]


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


class WorkerMethods(ABC):
    """The methods of the process itself that the server calls."""

    @abstractmethod
    def attach(self, vehicle_id: str, target: tuple[int, int], number: int) -> None:
        """Adds a vehicle with its (system, component) id; `number` is the number of its last stream."""

    @abstractmethod
    def set_routes(self, routes: Mapping[str, AnyRoute | None]) -> None:
        """Sets the routes of all streamed vehicles (None: the server sends); all other sockets are closed."""

    @abstractmethod
    def update_snapshots(self, pickled_snapshots: Mapping[str, bytes]) -> None:
        """Takes the vehicles' snapshots, periodically while the event loop runs. Each is pickled separately,
        so that an invalid snapshot does not affect the others."""


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a method in the process."""

    number: int
    method: str
    """Class and method."""
    arguments: tuple[object, ...]
    named: Mapping[str, object]
    states_of: tuple[str, ...] | None
    """Vehicles whose state the server must receive before the answer; None: the call has no answer."""


@dataclass(frozen=True, slots=True)
class WorkerStarted:
    """The process has started."""

    real_time: bool
    """Whether the system granted real-time priority."""


@dataclass(frozen=True, slots=True)
class Update:
    """State of streams and groups, and the events since the last update."""

    last_handled: int
    """Number of the last executed call."""
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
    """Answer to the call with this number; `error` is the class name and text of an error."""

    number: int
    result: object
    error: tuple[str, str] | None = None


class Relay(msgspec.Struct, frozen=True, array_like=True, tag=True):
    """A setpoint for a link that the process cannot use; the server sends it."""

    vehicle_id: str
    msg_id: int
    payload: bytes
    created_s: float
    """Time of its creation [s, monotonic]."""


class SentFrames(msgspec.Struct, frozen=True, array_like=True, tag=True):
    """Sent frames, for the recordings."""

    frames: list[tuple[int, int, bytes]]
    """Socket number, time since 1970 [µs], frame."""
