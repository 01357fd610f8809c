"""What the scene needs of the rest of the server, and nothing more: so it can be tested with fakes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, TypeVar

from gcs_server.clock import Clock
from gcs_server.vehicle.samples import Sample
from missions.frames import Vector3

T = TypeVar("T")


class IdentityFacts(Protocol):
    """The two facts of an identity that must be seen wherever the vehicle is."""

    @property
    def simulated(self) -> bool | None: ...
    @property
    def replayed(self) -> bool: ...


class SceneVehicle(Protocol):
    """A vehicle as far as it can be drawn; `gcs_server.vehicle.vehicle.Vehicle` is one."""

    id: str
    clock: Clock
    """Of its samples: the recording's own where it is replayed."""

    @property
    def identity(self) -> IdentityFacts: ...
    def topic(self, name: str) -> Sample | None: ...
    def history(self, topics: tuple[str, ...], since_unix_s: float) -> list[Sample]: ...


class SceneFleet(Protocol):
    """All vehicles, in the order that gives them their identity colours."""

    def all(self) -> Sequence[SceneVehicle]: ...
    def get(self, vehicle_id: str) -> SceneVehicle: ...


class OffboardTarget(NamedTuple):
    """What our own stream asks of a vehicle now; the vehicle's local NED frame."""

    position_ned_m: Vector3 | None = None
    velocity_ned_m_s: Vector3 | None = None
    yaw_ned_rad: float | None = None


OffboardTargets = Callable[[str], tuple[Vector3 | None, Vector3 | None, float | None] | None]
"""From a vehicle's id to what we stream to it (an OffboardTarget); None while we stream nothing."""


def value_of(vehicle: SceneVehicle, topic: str, kind: type[T]) -> T | None:
    """The newest value of a topic; None where there is none (or it is no such thing)."""
    sample = vehicle.topic(topic)
    return sample.value if sample is not None and isinstance(sample.value, kind) else None
