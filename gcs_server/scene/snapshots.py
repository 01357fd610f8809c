"""Encodes the server's vehicles for the process of the 3D view: one snapshot for each picture.

A snapshot contains the order of all vehicles. For each vehicle that is due, it contains the changes since the
vehicle's last update. It is encoded with msgspec, which takes a tenth of the time of pickle.
"""

from __future__ import annotations

import logging
import weakref
from collections.abc import Sequence, Set

import msgspec

from gcs_server.clock import Clock
from gcs_server.faults import Isolation
from gcs_server.scene.ports import OffboardTargets, SceneFleet, SceneVehicle
from gcs_server.vehicle.samples import Sample
from missions.frames import Vector3

log = logging.getLogger(__name__)

DRAWN_TOPICS = (
    "status",
    "attitude",
    "local_position",
    "global_position",
    "home",
    "gimbal",
    "motors",
    "target_local",
    "distance_sensors",
    "obstacle_distance",
)
MAX_ALL_UPDATED = 3
"""Number of vehicles up to which all are updated in each snapshot."""
UPDATE_DIVISOR = 3
"""With more vehicles, each vehicle that no view follows is updated only at every n-th snapshot, because
drawing is expensive."""

_encode = msgspec.msgpack.Encoder().encode

TargetData = tuple[Vector3 | None, Vector3 | None, float | None]
"""Position and velocity in local NED, yaw: the fields of `OffboardTarget`."""


class SampleData(msgspec.Struct, array_like=True, frozen=True):
    """A topic's newest sample."""

    topic: str
    received_unix_s: float
    received_monotonic_s: float
    value: msgspec.Raw
    """The topic's dataclass, encoded."""


class VehicleData(msgspec.Struct, array_like=True, frozen=True):
    """The changes of one vehicle."""

    number: int
    """Number of the vehicle. A new vehicle with the id of a removed vehicle gets a new number."""
    id: str
    simulated: bool | None
    replayed: bool
    monotonic_s: float
    """Time of the vehicle's clock; for a replayed vehicle, the recording's clock."""
    unix_s: float
    target: TargetData | None
    """Setpoint that this server streams to the vehicle."""
    samples: list[SampleData]
    missing_topics: list[str]
    """Topics that no longer have a usable value."""


class SnapshotData(msgspec.Struct, array_like=True, frozen=True):
    """One snapshot."""

    order: list[int]
    """Numbers of all vehicles; their order determines the colours."""
    changed: list[VehicleData]
    stalled: list[str]
    """Bridges of the browsers that do not read now."""


class _SentSamples:
    """The samples of one vehicle that the process has."""

    def __init__(self, vehicle: SceneVehicle, number: int) -> None:
        self.vehicle = weakref.ref(vehicle)
        self.number = number
        self.received_s: dict[str, float] = {}
        """Reception time of the sent sample, by topic."""


class SnapshotBuilder:
    """Builds the snapshots for one run of the process.

    Args:
        fleet: the vehicles; read only.
        offboard: returns the setpoint that this server streams to a vehicle; None: no target is sent.
        clock: clock that limits how often errors are logged.
    """

    def __init__(self, fleet: SceneFleet, offboard: OffboardTargets | None, clock: Clock) -> None:
        self._fleet, self._offboard = fleet, offboard
        self._isolation = Isolation(clock, log, "The 3D view")
        self._sent: dict[str, _SentSamples] = {}
        self._last_number = 0
        self._due_remainder = 0
        """A vehicle is due if its index modulo `UPDATE_DIVISOR` has this value."""

    @property
    def faults(self) -> list[str]:
        """Texts about vehicles that could not be read."""
        return self._isolation.faults

    def history(self, number: int, topics: tuple[str, ...], since_unix_s: float) -> bytes:
        """The history of the vehicle with this number, encoded; empty if it was removed."""
        vehicle = next((sent.vehicle() for sent in self._sent.values() if sent.number == number), None)
        samples: list[Sample] | None = None
        if vehicle is not None:
            work_name = f"the trail of vehicle {vehicle.id}"
            samples = self._isolation.run(work_name, vehicle.history, topics, since_unix_s)
        return _encode([_sample_data(sample) for sample in samples or ()])

    def snapshot(self, followed: Set[str], stalled: Sequence[str]) -> bytes:
        """The next snapshot, encoded.

        Args:
            followed: vehicles that views follow, which are in every snapshot.
            stalled: bridges of the browsers that do not read now.
        """
        vehicles = self._fleet.all()
        self._forget_removed(vehicles)
        self._due_remainder = (self._due_remainder + 1) % UPDATE_DIVISOR
        order: list[int] = []
        changed: list[VehicleData] = []
        for index, vehicle in enumerate(vehicles):
            sent = self._sent.get(vehicle.id)
            is_new = sent is None
            if sent is None:
                self._last_number += 1
                sent = self._sent[vehicle.id] = _SentSamples(vehicle, self._last_number)
            order.append(sent.number)
            if (
                is_new
                or len(vehicles) <= MAX_ALL_UPDATED
                or vehicle.id in followed
                or index % UPDATE_DIVISOR == self._due_remainder
            ):
                data = self._isolation.run(f"reading vehicle {vehicle.id}", self._changes, vehicle, sent)
                changed += [] if data is None else [data]
        return _encode(SnapshotData(order, changed, list(stalled)))

    def _changes(self, vehicle: SceneVehicle, sent: _SentSamples) -> VehicleData:
        samples: list[SampleData] = []
        missing_topics: list[str] = []
        for topic in DRAWN_TOPICS:
            received_s = vehicle.topic_received_s(topic)
            if received_s == sent.received_s.get(topic):
                continue
            sample = vehicle.topic(topic)
            if sample is None or received_s is None:
                sent.received_s.pop(topic, None)
                missing_topics.append(topic)
            else:
                sent.received_s[topic] = received_s
                samples.append(_sample_data(sample))
        target = self._offboard(vehicle.id) if self._offboard is not None else None
        return VehicleData(
            sent.number,
            vehicle.id,
            vehicle.identity.simulated,
            vehicle.identity.replayed,
            vehicle.clock.monotonic_s(),
            vehicle.clock.unix_s(),
            target,
            samples,
            missing_topics,
        )

    def _forget_removed(self, vehicles: Sequence[SceneVehicle]) -> None:
        current = {vehicle.id: vehicle for vehicle in vehicles}
        for vehicle_id, sent in list(self._sent.items()):
            vehicle = sent.vehicle()
            # Another vehicle may have got the same id.
            if vehicle is None or current.get(vehicle_id) is not vehicle:
                del self._sent[vehicle_id]


def _sample_data(sample: Sample) -> SampleData:
    times = (sample.received_unix_s, sample.received_monotonic_s)
    return SampleData(sample.topic, *times, msgspec.Raw(_encode(sample.value)))
