"""A ROS 2 program on a guarded link, and the vehicle's topics, without DDS and without threads."""

from __future__ import annotations

import asyncio
import math
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_server.guard.guards import Guards
from gcs_server.links.base import GuardOptions
from gcs_server.ros2 import guard_link
from gcs_server.ros2.guard_link import Ros2GuardLink
from gcs_server.ros2.message_types import MESSAGES
from tests.protocol.api_calls import new_station
from tests.protocol.guard_program import Streaming
from tests.protocol.ros2_testbed import Ros2Testbed, VehicleTopics
from tests.protocol.simulated_testbed import TICK_S
from vehicle_sim.px4_version import Px4Version
from vehicle_sim.ros2.topics import topics_of

NAN3 = (math.nan,) * 3
MODE, TRAJECTORY = "/fmu/in/offboard_control_mode", "/fmu/in/trajectory_setpoint"
COMMAND, ACK = "/fmu/in/vehicle_command", "/fmu/out/vehicle_command_ack"


class MemoryEnd:
    """One end of the link; see `dds_relay.RelayPort`."""

    def __init__(self) -> None:
        self.unread: list[tuple[str, str, bytes]] = []
        self.sent: list[tuple[str, bytes]] = []
        self.there: set[str] = set()
        self.opened: list[str] = []

    def wait(self, _timeout_s: float) -> list[tuple[str, str, bytes]]:
        taken, self.unread = self.unread, []
        return taken

    def send(self, topic: str, data: bytes) -> None:
        self.sent.append((topic, data))

    def read(self, topic: Any, _depth: int) -> None:
        self.opened.append(topic.topic)

    def write(self, topic: Any) -> None:
        self.opened.append(topic.topic)

    def participants(self) -> set[str]:
        return self.there


class VehicleEnd(MemoryEnd):
    """The vehicle's own topics; `topics` is set when the vehicle is there."""

    topics: VehicleTopics

    def __init__(self, monkeypatch: pytest.MonkeyPatch, px4: Px4Version) -> None:
        super().__init__()
        publish = VehicleTopics.publish
        bases = {each.name: each.base for each in topics_of(px4).outputs}

        def published(topics: VehicleTopics, topic: str, data: bytes) -> None:
            publish(topics, topic, data)
            self.unread.append((bases.get(topic, topic), "vehicle", data))

        monkeypatch.setattr(VehicleTopics, "publish", published)

    def send(self, topic: str, data: bytes) -> None:
        super().send(topic, data)
        self.topics.send(topic, data)


class Ros2Program(Streaming):
    """A program; it knows the vehicle's own layouts, as one that was built for its version of PX4."""

    def __init__(self, end: MemoryEnd, px4: Px4Version, name: str = "node") -> None:
        self._end, self._name = end, name
        topics = topics_of(px4)
        self._types = {each.base: each.message for each in (*topics.inputs, *topics.outputs)}
        end.there.add(name)

    def publish(self, topic: str, **fields: Any) -> None:
        self._end.unread.append((topic, self._name, self._types[topic].encode(fields)))

    def newest(self, topic: str) -> Any:
        """Fields of the newest message of the vehicle."""
        return next(
            self._types[topic].decode(data) for name, data in reversed(self._end.sent) if name == topic
        )

    def answers(self, command: int) -> list[tuple[int, int, int]]:
        """Result, target system and component of each answer to a command."""
        acks = [self._types[ACK].decode(data) for name, data in self._end.sent if name == ACK]
        return [
            (ack["result"], ack["target_system"], ack["target_component"])
            for ack in acks
            if ack["command"] == command
        ]

    def command(self, command: int, *params: float, **fields: Any) -> None:
        values = {f"param{n}": value for n, value in enumerate(params, 1)} | fields
        self.publish(
            COMMAND, command=command, target_system=1, target_component=1, source_system=1,
            source_component=1, from_external=True, **values,
        )  # fmt: skip

    def heartbeat(self, flag: str = "position") -> None:
        self.publish(MODE, **{flag: True})

    def trajectory(self, position: Any = NAN3, velocity: Any = NAN3) -> None:
        self.publish(
            TRAJECTORY, position=position, velocity=velocity, acceleration=NAN3, jerk=NAN3, yaw=math.nan,
            yawspeed=math.nan,
        )  # fmt: skip


async def ros2_scene(
    monkeypatch: pytest.MonkeyPatch, px4: Px4Version, control: str = "free"
) -> SimpleNamespace:
    """A vehicle over ROS 2 alone, the server's routes, and a guarded ROS 2 link with a program."""
    programs, vehicle_end = MemoryEnd(), VehicleEnd(monkeypatch, px4)
    testbed = Ros2Testbed(px4=px4)
    vehicle_end.topics = testbed.topics[0]
    vehicle = await testbed.wait_for_vehicle_ready_to_arm()
    station = new_station(testbed)
    station.authority.start()
    station.guards = Guards(station, testbed.router, testbed.supervisor)
    station.guards.start()
    monkeypatch.setattr(guard_link._Run, "start", guard_link._Run.open)
    monkeypatch.setattr(guard_link._Run, "join", lambda _run: None)
    link = Ros2GuardLink("guard", "ros2://3", 3, "", None, lambda *_: (programs, vehicle_end))  # type: ignore
    link.guard = GuardOptions(control)
    testbed.router.add(link)

    async def step() -> None:
        while True:
            if link._run is not None:
                link._run.pass_telemetry(0.0)
                link._run.read_programs(0.0)
            await testbed.clock.sleep(TICK_S)

    testbed.supervisor.start("the link's threads", step)
    program = Ros2Program(programs, px4)
    await asyncio.sleep(3.0)
    return SimpleNamespace(
        testbed=testbed, vehicle=vehicle, station=station, link=link, program=program, programs=programs,
        vehicle_end=vehicle_end, messages=MESSAGES,
    )  # fmt: skip
