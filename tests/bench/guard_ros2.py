"""Time that a guarded ROS 2 link adds: to the vehicle's telemetry beside its own topics, and to a program's
setpoints until they are published to the vehicle, with the gaps between these."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from gcs_server.client import SyncGcs
from tests.clients.px4_dds import (
    Node,
    OffboardControlMode,
    TrajectorySetpoint,
    VehicleCommand,
    VehicleOdometry,
    new_message,
)
from tests.station import free_port, running_server, wait_until
from vehicle_sim.dds.participant import DdsDomain

from .process import gaps_s, row

DIRECT, GUARDED = 62, 63
PERIOD_S, SETPOINTS, ODOMETRY_S = 0.02, 1000, 20.0
QOS = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(8))
VOLATILE_TOPIC = "/fmu/in/trajectory_setpoint"


class Arrivals:
    """When each message of a topic arrived, by a value of it; a thread of its own waits for them."""

    def __init__(self, domain: int, kind: Any, topic: str, key: Callable[[Any], Any]) -> None:
        participant = DomainParticipant(domain)
        reader: Any = DataReader(participant, Topic(participant, f"rt{topic}", kind), qos=QOS)
        waitset = WaitSet(participant)
        waitset.attach(ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any))
        self.at_s: dict[Any, float] = {}
        self._stop = False

        def run() -> None:
            while not self._stop:
                if waitset.wait(duration(seconds=0.2)):
                    now_s = time.monotonic()
                    for sample in reader.take(8):
                        if isinstance(sample, kind):
                            self.at_s.setdefault(key(sample), now_s)

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop = True
        self._thread.join()


def rows() -> Iterator[str]:
    """Rows of Markdown."""
    domains = DdsDomain(DIRECT), DdsDomain(GUARDED)
    command = [sys.executable, "-m", "vehicle_sim", "--ros2", str(DIRECT), "--gcs-remote-port", "0"]
    command += ["--no-api", "--tcp-port", str(free_port(socket.SOCK_STREAM)), "--no-log"]
    vehicle = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        links = [f"ros2://{DIRECT}", f"ros2://{GUARDED}?guard=free"]
        with running_server(links) as (url, _), SyncGcs(url, client="bench") as gcs:
            gcs.wait_for_vehicle("1", ready=True)
            wait_until(lambda: gcs.request("GET", "/guards")["guards"][0]["problem"] is None, "the topics")
            yield from _telemetry()
            yield from _setpoints()
    finally:
        vehicle.terminate()
        vehicle.wait(20.0)
        del domains


def _telemetry() -> Iterator[str]:
    ends = [
        Arrivals(domain, VehicleOdometry, "/fmu/out/vehicle_odometry", lambda each: each.timestamp)
        for domain in (DIRECT, GUARDED)
    ]
    time.sleep(ODOMETRY_S)
    for each in ends:
        each.close()
    direct, guarded = (each.at_s for each in ends)
    later = [at - direct[t] for t, at in guarded.items() if t in direct]
    yield row("ROS 2 odometry after the vehicle's own", later)
    yield row("gap between its messages, the vehicle's own", gaps_s(sorted(direct.values())))
    yield row("gap between its messages, guarded", gaps_s(sorted(guarded.values())))


def _setpoints() -> Iterator[str]:
    arrivals = Arrivals(DIRECT, TrajectorySetpoint, VOLATILE_TOPIC, lambda each: each.position[0])
    node = Node(GUARDED)
    mode = node.publisher(OffboardControlMode, "/fmu/in/offboard_control_mode")
    setpoint = node.publisher(TrajectorySetpoint, VOLATILE_TOPIC)
    commands = node.publisher(VehicleCommand, "/fmu/in/vehicle_command")
    sent: dict[float, float] = {}
    for index in range(SETPOINTS + 300):
        began_s, north_m = time.monotonic(), index / 1024.0  # a 32-bit float has it exactly
        mode.write(new_message(OffboardControlMode, position=True))
        sent[north_m] = time.monotonic()
        setpoint.write(new_message(TrajectorySetpoint, position=[north_m, 0.0, -5.0]))
        if index == 100:
            commands.write(
                new_message(
                    VehicleCommand, command=176, param1=1.0, param2=6.0, target_system=1, target_component=1,
                    source_system=1, source_component=1, from_external=True,
                )
            )  # fmt: skip
        time.sleep(max(0.0, began_s + PERIOD_S - time.monotonic()))
    arrivals.close()
    counted = {north_m: at_s for north_m, at_s in sent.items() if north_m > 300 / 1024.0}
    delays = [arrivals.at_s[north_m] - at_s for north_m, at_s in counted.items() if north_m in arrivals.at_s]
    first_s = min(counted.values())
    yield row("ROS 2 setpoint to the vehicle's topic", delays)
    later = sorted(at_s for at_s in arrivals.at_s.values() if at_s > first_s)
    yield row("gap between setpoints to the vehicle", gaps_s(later))
    yield row("gap between the program's own", gaps_s(list(counted.values())))
