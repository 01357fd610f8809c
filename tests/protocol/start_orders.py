"""A server, PX4's agent, a vehicle with MAVLink and DDS, and a ROS 2 program that start and end in any order,
on simulated time. DDS is a table of writers and readers; what reads it is the server's own code."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from gcs_server.ros2 import dds
from gcs_server.ros2.dds_types import Sample
from gcs_server.ros2.inspection import Announcement, TopicKey
from gcs_server.ros2.link import Ros2Link, _Run
from gcs_server.ros2.topics import STATUS, wire_name
from gcs_server.scenarios.memory_link import MemoryLink
from gcs_server.vehicle.vehicle import Vehicle
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.simulated_testbed import TICK_S
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.px4_version import DEFAULT, Px4Version
from vehicle_sim.ros2.topics import topics_of

NO_TIME_SYNC = {"UXRCE_DDS_SYNCT": 0}
"""Without time synchronization, PX4 publishes from 1.3 s after its boot instead of 6.4 s."""


class Domain:
    """The writers and readers of one DDS domain."""

    def __init__(self) -> None:
        self._count = itertools.count(1)
        self._alive: dict[str, Announcement] = {}
        self._history: list[Announcement] = []
        self._readers: list[Reader] = []
        self._newest: dict[tuple[str, str], bytes] = {}
        """The newest message of each participant and topic, for readers that come later."""

    def join(self) -> str:
        """A new participant."""
        return f"participant {next(self._count)}"

    def announce(self, participant: str, publishes: bool, name: str, kind: str) -> None:
        """Adds a writer or reader."""
        topic = TopicKey(name, f"px4_msgs::msg::dds_::{kind}_")
        each = Announcement(f"endpoint {next(self._count)}", publishes, topic, participant)
        self._alive[each.key] = each
        self._history.append(each)

    def leave(self, participant: str) -> None:
        """Ends a participant."""
        for each in [each for each in self._alive.values() if each.participant == participant]:
            del self._alive[each.key]
            self._history.append(replace(each, topic=None))
        self._readers = [each for each in self._readers if each.participant != participant]
        self._newest = {key: data for key, data in self._newest.items() if key[0] != participant}

    def send(self, participant: str, name: str, data: bytes) -> None:
        """Delivers a message to all readers of a topic."""
        self._newest[participant, name] = data
        for reader in self._readers:
            if reader.name == name:
                reader.add(participant, data)

    def open_reader(self, participant: str, name: str, depth: int) -> Reader:
        """A reader, which receives the newest message of each writer at once."""
        reader = Reader(participant, name, depth)
        self._readers.append(reader)
        for (writer, topic), data in self._newest.items():
            if topic == name:
                reader.add(writer, data)
        return reader

    def port(self) -> Port:
        """The server's participant."""
        return Port(self, list(self._alive.values()), len(self._history))

    def history(self, since: int) -> list[Announcement]:
        """The announcements after the first `since`."""
        return self._history[since:]


class Reader:
    """A reader as Cyclone's: it keeps the newest messages, and knows the participant of each."""

    def __init__(self, participant: str, name: str, depth: int) -> None:
        self.participant, self.name = participant, name
        self._unread = deque[Sample](maxlen=depth)

    def add(self, participant: str, data: bytes) -> None:
        sample = Sample.__new__(Sample)
        sample.cdr = data
        sample.sample_info = SimpleNamespace(publication_handle=participant)  # type: ignore[attr-defined]
        self._unread.append(sample)

    def take(self, maximum: int) -> list[Sample]:
        return [self._unread.popleft() for _ in range(min(maximum, len(self._unread)))]

    def get_matched_publication_data(self, handle: str) -> Any:
        return SimpleNamespace(participant_key=handle)


class Writers:
    """The server's writers in a domain; see `dds.Writers`."""

    def __init__(self, port: Port, namespace: str) -> None:
        self._port, self._namespace = port, namespace
        self._names: dict[str, str] = {}

    def prepare(self, topic: str, _message: Any, name: str | None = None) -> None:
        self._names[topic] = wire_name(name or topic, self._namespace)

    def send(self, topic: str, data: bytes) -> None:
        self._port.domain.send(self._port.participant, self._names[topic], data)


class Port:
    """The server's participant; see `dds.DdsPort`."""

    def __init__(self, domain: Domain, alive: list[Announcement], since: int) -> None:
        self.domain, self._alive, self._since = domain, alive, since
        self.participant = domain.join()

    def announcements(self) -> list[Announcement]:
        found = [*self._alive, *self.domain.history(self._since)]
        self._alive, self._since = [], self._since + len(self.domain.history(self._since))
        return found

    def vehicle(self, namespace: str) -> dds.VehiclePort:
        return dds.VehiclePort(self, namespace)  # type: ignore[arg-type]


def use_domain_table(monkeypatch: Any) -> None:
    """Replaces Cyclone's readers and writers by those of `Domain`; the rest of `dds.py` stays."""

    def open_reader(port: Port, name: str, _message: Any, depth: int, namespace: str) -> Reader:
        return port.domain.open_reader(port.participant, wire_name(name, namespace), depth)

    monkeypatch.setattr(dds, "open_reader", open_reader)
    monkeypatch.setattr(dds, "Writers", Writers)


class SteppedRos2Link(Ros2Link):
    """A `ros2://` link that the test steps instead of a thread."""

    port: Any = None

    def _open(self) -> None:
        self._run = _Run(self, self._loop, self._open_port)
        self.port = self._open_port(self.domain_id, self.interface)
        self._run._post(self.on_open)

    async def close(self) -> None:
        self._run = None
        await super().close()

    def step(self, now_s: float) -> None:
        """Reads DDS once, as the thread does."""
        if self._run is not None and self._run.delivered.is_set():
            self._run._step(self.port, now_s)


class Agent:
    """PX4's agent: carries a vehicle's messages as one participant for each start."""

    def __init__(self, domain: Domain, namespace: str, px4: Px4Version) -> None:
        self._domain, self._namespace = domain, namespace
        topics = topics_of(px4)
        self._topics = [(True, each) for each in topics.outputs] + [(False, each) for each in topics.inputs]
        self._participant: str | None = None
        self._readers: list[tuple[str, Reader]] = []

    def start(self) -> None:
        self._participant = self._domain.join()

    def stop(self) -> None:
        if self._participant is not None:
            self._domain.leave(self._participant)
        self._participant, self._readers = None, []

    def client_ended(self) -> None:
        """PX4 has ended: the agent removes its writers and readers."""
        if self._participant is not None:
            self.stop()
            self.start()

    def publish(self, topic: str, data: bytes) -> None:
        """A message of the vehicle; with the first one the agent creates its writers and readers."""
        if self._participant is None:
            return
        if not self._readers:
            for publishes, each in self._topics:
                name = wire_name(each.name, self._namespace)
                self._domain.announce(self._participant, publishes, name, each.type)
                if not publishes:
                    self._readers.append((each.name, self._domain.open_reader(self._participant, name, 8)))
        self._domain.send(self._participant, wire_name(topic, self._namespace), data)

    def take(self) -> Iterable[tuple[str, bytes]]:
        """The messages to the vehicle."""
        return [(name, sample.cdr) for name, reader in self._readers for sample in reader.take(8)]


class World:
    """The four, each of which `start` and `stop` by name: server, agent, vehicle, program.

    Args:
        namespace: the vehicle's namespace.
        read: the only namespace that the server reads; None: all.
        px4: the vehicle's version.
        server_domain: the domain that the server reads, if it is another one than the vehicle's.
        parameters: parameters of the vehicle.
    """

    def __init__(
        self,
        namespace: str = "px4_1",
        *,
        read: str | None = None,
        px4: Px4Version = DEFAULT,
        server_domain: Domain | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self._parameters = NO_TIME_SYNC | dict(parameters or {})
        self.domain = Domain()
        self._server_domain, self._read, self._px4 = server_domain or self.domain, read, px4
        self._status_topic = wire_name(
            next(each.name for each in topics_of(px4).outputs if each.base == STATUS), namespace
        )
        self._agent = Agent(self.domain, namespace, px4)
        self._sim: SimulatedFleet | None = None
        self.server: MemoryTestbed | None = None
        self.link: SteppedRos2Link | None = None
        self._mavlink: MemoryLink | None = None
        self._program: Reader | None = None
        self.heard_by_program = 0

    # --- starting and ending ------------------------------------------------------------------------

    def start(self, name: str) -> None:
        getattr(self, f"_start_{name}")()

    async def stop(self, name: str) -> None:
        if name == "server":
            assert self.server is not None
            await self.server.close()
            self.domain.leave(self.link.port.participant)  # type: ignore[union-attr]
            self.server = self.link = self._mavlink = None
        elif name == "agent":
            self._agent.stop()
        elif name == "vehicle":
            self._sim = None
            self._agent.client_ended()
        else:
            assert self._program is not None
            self.domain.leave(self._program.participant)
            self._program = None

    async def close(self) -> None:
        if self.server is not None:
            await self.stop("server")

    def _start_server(self) -> None:
        self.server = MemoryTestbed()
        self.link = SteppedRos2Link(
            "ros2", "ros2://0", 0, self._read, None, lambda *_: self._server_domain.port()  # type: ignore
        )  # fmt: skip
        self._mavlink = MemoryLink("mavlink", outgoing=self._to_vehicle)
        self.server.router.add(self.link)
        self.server.router.add(self._mavlink)

    def _start_agent(self) -> None:
        self._agent.start()

    def _start_vehicle(self) -> None:
        self._sim = SimulatedFleet(1, links=(("gcs", "gcs"),), parameters=self._parameters, px4=self._px4)
        self._sim.open_ros2(0, self._agent, lambda _: None)

    def _start_program(self) -> None:
        participant = self.domain.join()
        self._program = self.domain.open_reader(participant, self._status_topic, 8)
        self.domain.announce(participant, False, self._status_topic, "VehicleStatus")
        offboard = self._status_topic.partition("/fmu/")[0] + "/fmu/in/offboard_control_mode"
        self.domain.announce(participant, True, offboard, "OffboardControlMode")
        self.heard_by_program = 0

    # --- time ---------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """One tick of everything that runs."""
        if self._sim is not None:
            self._sim.step(TICK_S)
            data = self._sim.drain(0, "gcs")
            if self._mavlink is not None and data:
                self._mavlink.inject(data, "vehicle")
        if self.link is not None:
            self.link.step(now_s)
        if self._program is not None:
            self.heard_by_program += len(self._program.take(8))

    def _to_vehicle(self, data: bytes, _peer: Any) -> None:
        if self._sim is not None:
            self._sim.feed(0, "gcs", data)

    # --- what the operator has ----------------------------------------------------------------------

    def vehicles(self) -> list[Vehicle]:
        return [] if self.server is None else self.server.fleet.all()

    def is_found(self) -> bool:
        """Whether there is one vehicle, connected over both protocols, every topic of it is usable, and the
        program hears it."""
        vehicles = self.vehicles()
        if len(vehicles) != 1 or vehicles[0].status.link_lost or self.link is None or self.server is None:
            return False
        now_s = self.server.loop.time()
        fresh = {e.connection.protocol for e in vehicles[0].endpoints if now_s - e.received_s < 1.0}
        run = self.link._run
        unusable = (
            [each for vehicle in run.vehicles.values() for each in vehicle.formats.unusable] if run else []
        )
        return fresh == {"MAVLink", "ROS 2"} and not unusable and self.heard_by_program > 0

    def link_text(self) -> str:
        """What the page says about the ROS 2 link."""
        return "" if self.link is None else self.link.info().detail
