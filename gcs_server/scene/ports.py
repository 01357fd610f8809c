"""The interfaces that the scene needs from the rest of the server, so that tests can use fakes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, TypeVar

from gcs_server.clock import TimeSource
from gcs_server.vehicle.samples import Sample
from missions.frames import Vector3

T = TypeVar("T")


class SceneIdentity(Protocol):
    """The identity fields that are shown with each vehicle."""

    @property
    def simulated(self) -> bool | None: ...
    @property
    def replayed(self) -> bool: ...


class SceneVehicle(Protocol):
    """The part of a vehicle that the scene uses; implemented by `gcs_server.vehicle.vehicle.Vehicle`."""

    id: str

    @property
    def clock(self) -> TimeSource:
        """The clock of the vehicle's samples; a replayed vehicle has the recording's clock."""
        ...

    @property
    def identity(self) -> SceneIdentity: ...
    def topic(self, name: str) -> Sample | None: ...
    def topic_received_s(self, name: str) -> float | None: ...
    def history(self, topics: tuple[str, ...], since_unix_s: float) -> list[Sample] | None:
        """Earlier samples of topics; None: they were requested, and a later call returns them."""
        ...


class SceneFleet(Protocol):
    """All vehicles; their order determines the identity colours."""

    def all(self) -> Sequence[SceneVehicle]: ...
    def get(self, vehicle_id: str) -> SceneVehicle: ...


class OffboardTarget(NamedTuple):
    """The setpoint that this server is streaming to a vehicle, in the vehicle's local NED frame."""

    position_ned_m: Vector3 | None = None
    velocity_ned_m_s: Vector3 | None = None
    yaw_ned_rad: float | None = None


OffboardTargets = Callable[[str], tuple[Vector3 | None, Vector3 | None, float | None] | None]
"""Returns the fields of the OffboardTarget of a vehicle id; None while this server streams no setpoint to the
vehicle."""


def value_of(vehicle: SceneVehicle, topic: str, value_type: type[T]) -> T | None:
    """The newest value of a topic; None if no value was received, or if it has another type."""
    sample = vehicle.topic(topic)
    return sample.value if sample is not None and isinstance(sample.value, value_type) else None
