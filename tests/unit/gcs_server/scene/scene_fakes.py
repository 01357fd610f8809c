"""A fake fleet whose topics are set by the test."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from gcs_server.clock import Clock, SystemClock
from gcs_server.errors import UnknownVehicle
from gcs_server.vehicle.samples import (
    Attitude,
    Gimbal,
    GlobalPosition,
    Home,
    LocalPosition,
    Motors,
    Sample,
    Status,
)
from missions.frames import Quaternion


@dataclass
class StillClock:
    """A clock that advances only when the test sets it or code sleeps."""

    now_s: float = 1000.0

    def monotonic_s(self) -> float:
        return self.now_s

    def unix_s(self) -> float:
        return 1_700_000_000.0 + self.now_s

    async def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@dataclass
class FakeIdentity:
    simulated: bool = False
    replayed: bool = False


@dataclass(eq=False)
class FakeVehicle:
    """A vehicle whose topic values and history are set by the test."""

    id: str = "1"
    identity: FakeIdentity = field(default_factory=FakeIdentity)
    values: dict[str, object] = field(default_factory=dict)
    received_monotonic_s: float = 0.0
    clock: Clock = field(default_factory=SystemClock)
    stored_samples: list[Sample] = field(default_factory=list)
    """The samples that `history` returns."""
    history_requests: int = 0
    topic_reads: int = 0

    def topic(self, name: str) -> Sample | None:
        self.topic_reads += 1
        value = self.values.get(name)
        return None if value is None else Sample(name, None, 0.0, self.received_monotonic_s, value)

    def topic_received_s(self, name: str) -> float | None:
        return None if self.values.get(name) is None else self.received_monotonic_s

    def history(self, topics: tuple[str, ...], since_unix_s: float) -> list[Sample]:
        self.history_requests += 1
        return [s for s in self.stored_samples if s.topic in topics and s.received_unix_s >= since_unix_s]


@dataclass
class FakeFleet:
    vehicles: list[FakeVehicle] = field(default_factory=list)

    def all(self) -> list[FakeVehicle]:
        return list(self.vehicles)

    def get(self, vehicle_id: str) -> FakeVehicle:
        for vehicle in self.vehicles:
            if vehicle.id == vehicle_id:
                return vehicle
        raise UnknownVehicle(vehicle_id, [v.id for v in self.vehicles])


def q_from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Quaternion from roll, pitch and yaw [rad], independent of the tested code."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def status(*, armed: bool = True, lost: bool = False, landed: str = "in_air") -> Status:
    return Status(armed, "hold", "Hold", 0, None, landed, 4, lost, 5.0 if lost else 0.1)


def attitude(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Attitude:
    return Attitude(roll, pitch, yaw, q_from_euler(roll, pitch, yaw), (0.0, 0.0, 0.0))


def local_position(n: float, e: float, d: float) -> LocalPosition:
    return LocalPosition((n, e, d), (0.0, 0.0, 0.0))


def global_position(lat: float, lon: float, alt_amsl_m: float) -> GlobalPosition:
    return GlobalPosition(lat, lon, alt_amsl_m, 0.0, (0.0, 0.0, 0.0), None)


def home(lat: float, lon: float, alt_amsl_m: float, ned: tuple[float, float, float] | None = None) -> Home:
    return Home(lat, lon, alt_amsl_m, ned)


def gimbal(q: Quaternion, *, yaw_in_earth_frame: bool) -> Gimbal:
    earth = yaw_in_earth_frame
    return Gimbal(1, 0, 0, None, None, q, earth, earth, None, None, 0, None, None, None, None, 1)


def motors(*pwm: int) -> Motors:
    return Motors(pwm)


def flying_vehicle(vehicle_id: str = "1") -> FakeVehicle:
    """An armed vehicle 10 m above its home, with a gimbal."""
    return FakeVehicle(
        vehicle_id,
        FakeIdentity(simulated=True),
        {
            "status": status(),
            "attitude": attitude(),
            "local_position": local_position(0.0, 0.0, -10.0),
            "global_position": global_position(47.397742, 8.545594, 498.0),
            "home": home(47.397742, 8.545594, 488.0, (0.0, 0.0, 0.0)),
            "gimbal": gimbal(q_from_euler(0.0, -0.5, 0.0), yaw_in_earth_frame=False),
            "motors": motors(1500, 1500, 1500, 1500),
        },
    )
