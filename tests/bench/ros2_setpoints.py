"""A stream of 100 Hz over ROS 2 and over MAVLink: latency, lateness, and the CPU time of both sides."""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from typing import Protocol

from gcs_server.client import SyncGcs
from tests.station import FIRST_TEST_INSTANCE, free_port, running_server, running_vehicles

from .process import load_average, quantiles_ms, tree_cpu_s
from .relay import Relay
from .ros2_tap import Ros2Tap
from .setpoints import SETPOINTS, SetpointRecorder, latencies_s
from .stream import lateness_s

RATE_HZ = 100.0
WINDOW_S = 12.0
FLEET_SIZES = (1, 10)
DOMAIN = 80 + os.getpid() % 20
"""A DDS domain that no other process uses."""


class Tap(SetpointRecorder, Protocol):
    """Records the setpoints of all vehicles."""

    def streams_s(self) -> list[list[float]]:
        """Times of the setpoints of each vehicle."""
        ...


@dataclass(frozen=True, slots=True)
class CpuShares:
    """Share of one core of a server and its simulator (1 = one core)."""

    server: float
    simulator: float


@dataclass(slots=True)
class Measurement:
    """One protocol with a number of vehicles."""

    idle: CpuShares
    """Telemetry without streams."""
    streaming: CpuShares
    load: str
    streams_s: list[list[float]]
    latency_s: dict[str, list[float]] = field(default_factory=dict[str, list[float]])
    """Latencies from the client's call, by API, of one vehicle."""


@dataclass(frozen=True, slots=True)
class Station:
    """A server, its vehicles, and a tap between them."""

    url: str
    processes: tuple[int, int]
    """Process ids of the server and of the simulator."""
    tap: Callable[[], contextlib.AbstractContextManager[Tap]]


@contextlib.contextmanager
def over_mavlink(vehicles: int) -> Generator[Station]:
    """Vehicles on a UDP link. The relay between them and the server, in this process, is the tap."""
    port = free_port()
    with (
        Relay(port) as relay,
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, process),
        running_vehicles(relay.vehicle_port, instances=vehicles) as simulator,
    ):
        yield Station(url, (process.pid, simulator.pid), lambda: contextlib.nullcontext(relay))


@contextlib.contextmanager
def over_ros2(vehicles: int) -> Generator[Station]:
    """Vehicles on ROS 2 topics only. The tap is one more subscriber, so it exists only while it is used."""
    instances = range(FIRST_TEST_INSTANCE, FIRST_TEST_INSTANCE + vehicles)
    tcp_port = free_port(socket.SOCK_STREAM)  # unused, but a simulator without any port does not start
    with (
        running_server([f"ros2://{DOMAIN}"]) as (url, process),
        running_vehicles(
            0, instances=vehicles, tcp_port=tcp_port, arguments=["--ros2", str(DOMAIN)]
        ) as simulator,
    ):
        names = [f"px4_{each}" for each in instances]
        yield Station(url, (process.pid, simulator.pid), lambda: Ros2Tap(DOMAIN, names))


STATIONS = {"MAVLink": over_mavlink, "ROS 2": over_ros2}


def measure_cpu(station: Station) -> CpuShares:
    """CPU shares over a window that begins now."""
    cpu_before_s, began_s = [tree_cpu_s(pid) for pid in station.processes], time.monotonic()
    time.sleep(WINDOW_S)
    elapsed_s = time.monotonic() - began_s
    used_s = [
        tree_cpu_s(pid) - before_s for pid, before_s in zip(station.processes, cpu_before_s, strict=True)
    ]
    return CpuShares(*(each / elapsed_s for each in used_s))


def measure(station: Station, vehicles: int) -> Measurement:
    """Measures with vehicles that stand on the ground, disarmed, in Offboard while they receive setpoints."""
    names = [str(FIRST_TEST_INSTANCE + number) for number in range(1, vehicles + 1)]
    with SyncGcs(station.url, client="bench", client_id="bench") as gcs, contextlib.ExitStack() as running:
        drones = [gcs.wait_for_vehicle(name, ready=True) for name in names]
        time.sleep(2)
        idle = measure_cpu(station)
        for drone in drones:
            stream = drone.offboard(position_ned_m=(0.0, 0.0, -5.0), rate_hz=RATE_HZ, valid_for_s=300)
            running.enter_context(stream)
            drone.until(lambda v: v["status"]["mode"] == "offboard", what="Offboard")
        time.sleep(2)
        streaming = measure_cpu(station)
        tap = running.enter_context(station.tap())
        time.sleep(2)
        tap.clear()
        time.sleep(WINDOW_S)
        measurement = Measurement(idle, streaming, load_average(), [list(each) for each in tap.streams_s()])
        if vehicles == 1:
            measurement.latency_s = latencies_s(tap, station.url)
        return measurement


def percent(before: float, after: float, vehicles: int) -> str:
    """Share of one core per vehicle, without and with streams."""
    return f"{before / vehicles:.1%} → {after / vehicles:.1%}"


def rows(results: dict[tuple[str, int], Measurement]) -> Iterator[str]:
    """The three tables."""
    yield "| protocol | load average | API | setpoints | ms from the call: p50 / p99 / max |"
    yield "|---|---|---|---|---|"
    for (protocol, _), measurement in results.items():
        for api, durations_s in measurement.latency_s.items():
            cells = f"{len(durations_s)} of {SETPOINTS} | {quantiles_ms(durations_s)}"
            yield f"| {protocol} | {measurement.load} | {api} | {cells} |"
    yield "\n| protocol | vehicles | load average | setpoints | skipped | lateness ms: p50 / p99 / max |"
    yield "|---|---|---|---|---|---|"
    for (protocol, vehicles), measurement in results.items():
        measured = [lateness_s(each, RATE_HZ) for each in measurement.streams_s]
        late = [each_s for stream_s, _ in measured for each_s in stream_s]
        skipped = sum(missed for _, missed in measured)
        cells = f"{len(late)} | {skipped} | {quantiles_ms(late)}"
        yield f"| {protocol} | {vehicles} | {measurement.load} | {cells} |"
    yield "\n| protocol | vehicles | load average | server, a vehicle | simulator, a vehicle |"
    yield "|---|---|---|---|---|"
    for (protocol, vehicles), measurement in results.items():
        idle, streaming = measurement.idle, measurement.streaming
        sides = [(idle.server, streaming.server), (idle.simulator, streaming.simulator)]
        shares = " | ".join(percent(*each, vehicles) for each in sides)
        yield f"| {protocol} | {vehicles} | {measurement.load} | {shares} |"


def table() -> Iterator[str]:
    """Rows of Markdown; the protocols take turns."""
    results: dict[tuple[str, int], Measurement] = {}
    for vehicles in FLEET_SIZES:
        for protocol, open_station in STATIONS.items():
            with open_station(vehicles) as station:
                results[protocol, vehicles] = measure(station, vehicles)
    yield from rows(results)
