"""The server with simulated vehicles on ROS 2, on simulated time, without DDS."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from gcs_server.links.base import DdsAddress, Peer, UnusableTopic
from gcs_server.ros2.external_mode import Message
from gcs_server.ros2.formats import REQUEST, RESPONSE, AnnouncedTopic, formats_of
from gcs_server.ros2.topics import STATUS, SUBSCRIPTIONS
from gcs_server.ros2.vehicle_link import VehicleLink
from gcs_server.scenarios.in_loop_scheduler import InLoopScheduler
from gcs_server.scenarios.memory_link import MemoryLink
from gcs_server.streamer.offboard.streamer import SNAPSHOT_PERIOD_S, Streamer
from gcs_server.streamer.schedule.external_modes import CONNECTED_FROM, CONNECTED_TO, READ_TYPES
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from gcs_server.vehicle.endpoint import ROS2
from gcs_server.vehicle.vehicle import Vehicle
from missions.setpoints import Setpoint
from tests.protocol.simulated_testbed import TICK_S, SimulatedVehicles, until
from tests.support.dds_samples import base_name
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import DEFAULT, Px4Version
from vehicle_sim.ros2.topics import topics_of

NO_TIME_SYNC = {"UXRCE_DDS_SYNCT": 0}
"""Without time synchronization, the vehicle publishes on ROS 2 from 1.3 s after its boot instead of 6.4 s."""


class VehicleTopics:
    """The topics of one vehicle, in both directions; the server reads each topic as often as it reads DDS.

    Args:
        namespace: the vehicle's namespace.
        px4: the vehicle's version of PX4.
    """

    def __init__(self, namespace: str, px4: Px4Version = DEFAULT) -> None:
        self.link = VehicleLink(namespace, self, 255)
        topics = topics_of(px4)
        announced = [
            AnnouncedTopic(base_name(each.name), each.name, each.type)
            for each in (*topics.outputs, *topics.inputs)
        ]
        self.link.formats.announce(announced)
        self._names = {each.base: each.name for each in announced}
        self._status_s = 0.0
        self.sent_messages: list[tuple[str, bytes]] = []
        """Every message to the vehicle but the questions about layouts, in the server's layout."""
        self._to_vehicle: list[tuple[str, bytes]] = []
        self.is_carried = True
        """Whether messages pass, in both directions: PX4's agent runs."""
        self._unread = {each.name: deque[bytes](maxlen=each.depth) for each in SUBSCRIPTIONS}
        self._unread[RESPONSE] = deque(maxlen=8)
        self.mode_messages = deque[tuple[str, bytes]](maxlen=32)
        """Messages about modes that the process of the setpoint streams has not read yet."""
        self._next_s = dict.fromkeys(self._unread, 0.0)

    def publish(self, topic: str, data: bytes) -> None:
        """Publishes a message of the vehicle."""
        if not self.is_carried:
            return
        base = base_name(topic)
        if base in self._unread:
            self._unread[base].append(data)
        if base in READ_TYPES and base in self.link.formats.usable:
            self.mode_messages.append((base, self.link.formats.usable[base].to_server(data)))

    def take(self) -> Iterable[tuple[str, bytes]]:
        """The messages that the server has sent and the vehicle has not taken yet."""
        messages, self._to_vehicle = self._to_vehicle, []
        return messages

    def send(self, topic: str, data: bytes) -> None:
        """Sends a message in the vehicle's layout to the vehicle."""
        if topic in self.link.formats.usable:
            self.sent_messages.append((topic, self.link.formats.usable[topic].to_server(data)))
        if self.is_carried:
            self._to_vehicle.append((self._names[topic], data))

    def send_setpoint(self, topic: str, data: bytes) -> None:
        """Sends a message in the server's layout to the vehicle."""
        topic_format = self.link.formats.usable.get(topic)
        if topic_format is None:
            raise OSError(f"the layout of {topic} is not confirmed")
        self.send(topic, topic_format.to_vehicle(data))

    def frames(self, now_s: float) -> bytes:
        """The MAVLink frames of the vehicle's messages that the server reads now; asks for layouts."""
        messages = self.read_messages(now_s)
        if any(topic == STATUS for topic, _ in messages):
            self._status_s = now_s
        data = self.link.to_frames(messages, now_s)
        if (request := self.link.formats.request(now_s, self._status_s)) is not None:
            self.send(REQUEST, request)
        return data

    def read_messages(self, now_s: float) -> list[tuple[str, bytes]]:
        """The vehicle's messages that the server reads now."""
        messages = [(RESPONSE, self._unread[RESPONSE].popleft()) for _ in range(len(self._unread[RESPONSE]))]
        for each in SUBSCRIPTIONS:
            if now_s >= self._next_s[each.name]:
                self._next_s[each.name] = now_s + each.every_s * 0.9
                unread = self._unread[each.name]
                messages += [(each.name, unread.popleft()) for _ in range(len(unread))]
        return messages


class SetpointTopics:
    """A `TopicSender` that writes to `VehicleTopics`."""

    def __init__(self, topics: VehicleTopics) -> None:
        self._topics = topics

    def send(self, messages: Sequence[Message], needed: Iterable[str] = ()) -> None:
        for topic, data in messages:
            self._topics.send_setpoint(topic, data)


class ModeTopics:
    """A `ModePort` on `VehicleTopics`, which has only the topics whose formats are in the address. If not
    `is_working`, the process that replies to PX4 has ended."""

    def __init__(self, topics: VehicleTopics, address: DdsAddress) -> None:
        self._topics, self.is_working = topics, True
        self._formats = formats_of(address, {*CONNECTED_TO, *CONNECTED_FROM})

    def send(self, topic: str, data: bytes) -> None:
        if self.is_working:
            self._topics.send_setpoint(topic, data)

    def connected(self) -> bool:
        return self.is_working and self._formats.keys() == {*CONNECTED_TO, *CONNECTED_FROM}

    def take(self) -> list[tuple[str, bytes]]:
        unread = self._topics.mode_messages
        messages = list(unread) if self.is_working else []
        unread.clear()
        return messages


class Ros2Streams(InLoopScheduler):
    """Sends over the topics of the vehicles that are connected over ROS 2."""

    def __init__(self, clock: Any, topics_at: Callable[[DdsAddress], VehicleTopics]) -> None:
        super().__init__(clock, open_mode_port=self._open_mode_port)
        self._topics_at = topics_at
        self.mode_ports: list[ModeTopics] = []
        """The topics of modes, newest last."""

    def _open_mode_port(self, address: DdsAddress) -> ModeTopics:
        self.mode_ports.append(ModeTopics(self._topics_at(address), address))
        return self.mode_ports[-1]

    def attach(self, vehicle_id: str, sender: Any, target: tuple[int, int], *_: Any) -> None:
        def topics() -> SetpointTopics | None:
            path = sender.send_path()
            dds = None if path is None else path.peer.dds
            return None if dds is None else SetpointTopics(self._topics_at(dds))

        super().attach(vehicle_id, sender, target, 0, topics)


class MemoryRos2Link(MemoryLink):
    """A `ros2://` link without DDS."""

    protocol = ROS2

    def __init__(self, outgoing: Callable[[bytes, Peer], None], topics: Sequence[VehicleTopics]) -> None:
        super().__init__("ros2", outgoing=outgoing)
        self._topics = {each.link.namespace: each for each in topics}

    def unusable_topics(self, peer: Peer) -> Mapping[str, UnusableTopic]:
        return self._topics[peer.name].link.formats.unusable

    def dds_address(self, peer: Peer) -> DdsAddress | None:
        formats = self._topics[peer.name].link.formats.usable.values()
        return None if peer.dds is None else replace(peer.dds, formats=tuple(formats))


class Ros2Testbed(SimulatedVehicles):
    """Vehicles "1", "2", … in a row to the east, 3 m apart, on one `ros2://` link.

    Args:
        count: number of vehicles.
        mavlink: whether vehicle 1 also has a MAVLink link.
        px4: the version of PX4 of all vehicles, or of each vehicle.
    """

    def __init__(
        self, count: int = 1, *, mavlink: bool = False, px4: Px4Version | Sequence[Px4Version] = DEFAULT
    ) -> None:
        super().__init__()
        self._links = (("gcs", "gcs"),) if mavlink else ()
        self._versions = [px4] * count if isinstance(px4, Px4Version) else list(px4)
        self.topics = [VehicleTopics(f"px4_{row}", each) for row, each in enumerate(self._versions)]
        self.restart_vehicle()
        self.ros2 = MemoryRos2Link(self._command, self.topics)
        self.router.add(self.ros2)
        self.mavlink = MemoryLink("mavlink", outgoing=lambda data, _: self.sim.feed(0, "gcs", data))
        self.mavlink_on = mavlink
        """Whether the server receives the frames of the MAVLink link."""
        self.ros2_on = True
        """Whether PX4's agent runs; without it nothing passes, in either direction."""
        if mavlink:
            self.router.add(self.mavlink)
        streams = Ros2Streams(self.clock, lambda dds: self.topics[int(dds.namespace.removeprefix("px4_"))])
        self.streamer = Streamer(self.clock, streams)
        self.fleet.on_vehicle_added(self.streamer.attach)
        self.supervisor.repeat("offboard-beat", lambda: self.streamer.update_once(), SNAPSHOT_PERIOD_S)
        self.supervisor.start("simulator", self._simulate)

    def restart_vehicle(self) -> None:
        """Boots the vehicles, on the ground at their places."""
        stores = [Parameters(NO_TIME_SYNC, px4=each) for each in self._versions]
        self.sim = SimulatedFleet(len(stores), links=self._links, stores=stores, seed=3)
        for row, topics in enumerate(self.topics):
            self.sim.open_ros2(row, topics, lambda _: None)

    async def wait_for_vehicle_ready_to_arm(self, vehicle_id: str = "1") -> Vehicle:
        """The vehicle, once it can be armed, its layouts are confirmed and each topic has been read."""
        vehicle = await super().wait_for_vehicle_ready_to_arm(vehicle_id)
        await until(lambda: not any(topics.link.formats.unusable for topics in self.topics), 10.0)
        await asyncio.sleep(1.0)
        return vehicle

    def _command(self, data: bytes, peer: Peer) -> None:
        assert peer.dds is not None
        row = int(peer.dds.namespace.removeprefix("px4_"))
        self.topics[row].link.send(data, int(self.clock.unix_s() * 1e6))

    async def _simulate(self) -> None:
        while True:
            self.sim.step(TICK_S)
            now_s = self.clock.monotonic_s()
            for row, topics in enumerate(self.topics):
                topics.is_carried = self.ros2_on
                if data := topics.frames(now_s):
                    self.ros2.inject(data, Peer(f"px4_{row}", dds=DdsAddress(0, None, f"px4_{row}")))
            if self.mavlink_on and (data := self.sim.drain(0, "gcs")):
                self.mavlink.inject(data, "vehicle")
            self.streamer._streams.step()
            await self.clock.sleep(TICK_S)


def stream_request_for(setpoint: Setpoint) -> StreamRequest:
    """A stream request with a setpoint that is valid for a minute."""
    return StreamRequest(setpoint, 60.0, OnExpiry(), "test")


def newest_value(vehicle: Vehicle, topic: str) -> Any:
    """The newest value of a topic."""
    sample = vehicle.topic(topic)
    assert sample is not None, topic
    return sample.value
