"""Copies of the server's vehicles in the process of the 3D view, updated from snapshots."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec

from gcs_server.clock import SystemClock
from gcs_server.errors import UnknownVehicle
from gcs_server.faults import Isolation
from gcs_server.scene.ports import OffboardTarget
from gcs_server.scene.snapshots import SampleData, SnapshotData, TargetData, VehicleData
from gcs_server.vehicle.samples import TOPICS, Sample

log = logging.getLogger(__name__)

MAX_SNAPSHOT_GAP_S = 1.0
"""If the time between two snapshots is longer than this [s], a history requested before is not used."""
_value_decoders = {topic: msgspec.msgpack.Decoder(value_type) for topic, value_type in TOPICS.items()}
_snapshot_decoder = msgspec.msgpack.Decoder(SnapshotData)
_history_decoder = msgspec.msgpack.Decoder(list[SampleData])


class VehicleClock:
    """The vehicle's clock, which shows the time of the newest snapshot."""

    def __init__(self) -> None:
        self._monotonic_s = self._unix_s = 0.0

    def set(self, monotonic_s: float, unix_s: float) -> None:
        """Sets the clock to the times of a snapshot."""
        self._monotonic_s, self._unix_s = monotonic_s, unix_s

    def monotonic_s(self) -> float:
        """Monotonic time of the newest snapshot [s]."""
        return self._monotonic_s

    def unix_s(self) -> float:
        """Unix time of the newest snapshot [s]."""
        return self._unix_s


@dataclass(frozen=True, slots=True)
class MirrorIdentity:
    """The identity fields that the 3D view shows."""

    simulated: bool | None
    replayed: bool


class MirrorVehicle:
    """One vehicle; see `SceneVehicle`.

    Args:
        number: number of the vehicle in snapshots.
        request_history: called with number, topics and start time; `store_history` gets the history.
    """

    def __init__(
        self, number: int, vehicle_id: str, request_history: Callable[[int, tuple[str, ...], float], None]
    ) -> None:
        self.id = vehicle_id
        self.clock = VehicleClock()
        self.target: OffboardTarget | None = None
        self._number = number
        self._identity = MirrorIdentity(None, False)
        self._samples: dict[str, Sample] = {}
        self._request_history = request_history
        self._requested_topics: tuple[str, ...] | None = None
        """Topics of the history that was requested and not yet used."""
        self._history: list[Sample] | None = None

    @property
    def identity(self) -> MirrorIdentity:
        """Identity as of the newest snapshot."""
        return self._identity

    def topic(self, name: str) -> Sample | None:
        """The topic's newest sample."""
        return self._samples.get(name)

    def topic_received_s(self, name: str) -> float | None:
        """Reception time of the topic's newest sample [s, monotonic]."""
        sample = self._samples.get(name)
        return None if sample is None else sample.received_monotonic_s

    def history(self, topics: tuple[str, ...], since_unix_s: float) -> list[Sample] | None:
        """The history; None until the server has sent it. The first call requests it."""
        if self._requested_topics != topics:
            self._requested_topics, self._history = topics, None
            self._request_history(self._number, topics, since_unix_s)
        if self._history is not None:
            self._requested_topics = None
        history, self._history = self._history, None
        return history

    def store_history(self, samples: list[Sample]) -> None:
        """Stores the history that was requested."""
        self._history = samples

    def update(self, data: VehicleData) -> None:
        """Applies the changes of a snapshot."""
        if data.monotonic_s - self.clock.monotonic_s() > MAX_SNAPSHOT_GAP_S:
            self._requested_topics = self._history = None
        self.clock.set(data.monotonic_s, data.unix_s)
        if (data.simulated, data.replayed) != (self._identity.simulated, self._identity.replayed):
            self._identity = MirrorIdentity(data.simulated, data.replayed)
        self.target = None if data.target is None else OffboardTarget(*data.target)
        for sample in data.samples:
            self._samples[sample.topic] = _sample(sample)
        for topic in data.missing_topics:
            self._samples.pop(topic, None)


class MirrorFleet:
    """All vehicles; see `SceneFleet`.

    Args:
        request_history: see `MirrorVehicle`.
    """

    def __init__(self, request_history: Callable[[int, tuple[str, ...], float], None]) -> None:
        self._request_history = request_history
        self._isolation = Isolation(SystemClock(), log, "The 3D view")
        self._by_number: dict[int, MirrorVehicle] = {}
        self.stalled: frozenset[str] = frozenset()
        """Bridges (connections to viser) of the browsers that do not read now."""

    @property
    def faults(self) -> list[str]:
        """Messages about vehicles whose snapshot could not be read."""
        return self._isolation.faults

    def all(self) -> Sequence[MirrorVehicle]:
        """All vehicles, in the order of the server's fleet."""
        return list(self._by_number.values())

    def get(self, vehicle_id: str) -> MirrorVehicle:
        """A vehicle by its id. Raises UnknownVehicle."""
        for vehicle in self._by_number.values():
            if vehicle.id == vehicle_id:
                return vehicle
        raise UnknownVehicle(vehicle_id, [v.id for v in self._by_number.values()])

    def target(self, vehicle_id: str) -> TargetData | None:
        """The setpoint that the server streams to a vehicle."""
        return self.get(vehicle_id).target

    def apply(self, snapshot: bytes) -> None:
        """Applies a snapshot."""
        data = _snapshot_decoder.decode(snapshot)
        for vehicle_data in data.changed:
            vehicle = self._by_number.get(vehicle_data.number)
            if vehicle is None:
                vehicle = MirrorVehicle(vehicle_data.number, vehicle_data.id, self._request_history)
                self._by_number[vehicle_data.number] = vehicle
            self._isolation.run(f"reading vehicle {vehicle_data.id}", vehicle.update, vehicle_data)
        vehicles = self._by_number
        self._by_number = {number: vehicles[number] for number in data.order if number in vehicles}
        self.stalled = frozenset(data.stalled)

    def store_history(self, number: int, samples: bytes) -> None:
        """Stores the history of a vehicle, unless the vehicle was removed meanwhile."""
        vehicle = self._by_number.get(number)
        if vehicle is not None:
            vehicle.store_history([_sample(data) for data in _history_decoder.decode(samples)])


def _sample(data: SampleData) -> Sample:
    value = _value_decoders[data.topic].decode(data.value)
    return Sample(data.topic, None, data.received_unix_s, data.received_monotonic_s, value)
