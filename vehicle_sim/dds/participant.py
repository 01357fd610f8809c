"""ROS 2 topics of vehicles over Cyclone DDS: one participant for each vehicle. No call blocks.

Cyclone's threads discover other programs and receive their messages. The simulation's thread sends (best
effort: directly to the socket) and reads received messages.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import quoteattr

from cyclonedds.core import DDSException, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from vehicle_sim.dds.types import Sample, idl_type
from vehicle_sim.px4_version import DEFAULT, Px4Version
from vehicle_sim.ros2.topics import SERVICE_REPLY, SERVICE_REQUEST, Topics, dds_name, topics_of

LOOPBACK = "lo"
MAX_PARTICIPANTS = 99
"""Limit on the loopback interface, where discovery without multicast uses one port for each participant."""
REPLY_QUEUE_DEPTH = 10
SERVICE_TYPE = "px4_msgs.srv.dds_.VehicleCommand_{}_"


class DdsUnavailable(Exception):
    """The DDS domain cannot be opened on this network interface."""


def configuration(interface: str | None) -> str:
    """Cyclone's settings: loopback with unicast only, or one interface with multicast.

    Without an interface no message leaves the machine, whatever `CYCLONEDDS_URI` contains.
    """
    if interface is None:
        general = "<AllowMulticast>false</AllowMulticast>"
        discovery = (
            f"<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{MAX_PARTICIPANTS}"
            '</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers>'
        )
    else:
        general = discovery = ""
    network = f"<Interfaces><NetworkInterface name={quoteattr(interface or LOOPBACK)}/></Interfaces>"
    return (
        f"<CycloneDDS><Domain><General>{network}{general}</General>"
        f"<Discovery>{discovery}</Discovery></Domain></CycloneDDS>"
    )


def _writer_qos(reliable: bool = False) -> Qos:
    return Qos(
        Policy.Reliability.Reliable(duration()) if reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal,
        Policy.History.KeepLast(REPLY_QUEUE_DEPTH if reliable else 1),
    )


def _reader_qos(depth: int, reliable: bool = False) -> Qos:
    return Qos(
        Policy.Reliability.Reliable(duration()) if reliable else Policy.Reliability.BestEffort,
        Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
    )


@dataclass(frozen=True, slots=True)
class _Reader:
    topic: str
    reader: Any
    depth: int


class DdsPort:
    """One vehicle's participant, with a writer or reader for each topic."""

    def __init__(self, domain: DdsDomain, domain_id: int, namespace: str, topics: Topics) -> None:
        self._domain = domain
        """Keeps the domain alive: Cyclone deletes a domain and its entities after the last reference."""
        self._participant = DomainParticipant(domain_id)
        self._namespace = namespace
        self._writers: dict[str, tuple[type[Sample], Any]] = {}
        self._readers: list[_Reader] = []
        self._waitset = WaitSet(self._participant)
        for output in topics.outputs:
            self._add_writer(output.name, idl_type(output.message), _writer_qos())
        reply = idl_type(topics.messages["VehicleCommandAck"], SERVICE_TYPE.format("Response"))
        self._add_writer(SERVICE_REPLY, reply, _writer_qos(reliable=True))
        for topic in topics.inputs:
            self._add_reader(topic.name, idl_type(topic.message), topic.depth, _reader_qos(topic.depth))
        command = topics.messages["VehicleCommand"]
        depth = 2 * command.constants["ORB_QUEUE_LENGTH"]
        request = idl_type(command, SERVICE_TYPE.format("Request"))
        self._add_reader(SERVICE_REQUEST, request, depth, _reader_qos(depth, reliable=True))

    def _topic(self, name: str, sample_type: type[Sample]) -> Any:
        return Topic(self._participant, dds_name(name, self._namespace), sample_type)

    def _add_writer(self, name: str, sample_type: type[Sample], qos: Qos) -> None:
        self._writers[name] = (
            sample_type,
            DataWriter(self._participant, self._topic(name, sample_type), qos=qos),
        )

    def _add_reader(self, name: str, sample_type: type[Sample], depth: int, qos: Qos) -> None:
        reader: Any = DataReader(self._participant, self._topic(name, sample_type), qos=qos)
        self._readers.append(_Reader(name, reader, depth))
        mask = SampleState.Any | ViewState.Any | InstanceState.Any
        self._waitset.attach(ReadCondition(reader, mask))

    def publish(self, topic: str, data: bytes) -> None:
        """Sends a message; drops a message that DDS rejects."""
        sample_type, writer = self._writers[topic]
        try:
            writer.write(sample_type.from_bytes(data))
        except DDSException:
            return

    def take(self) -> Iterable[tuple[str, bytes]]:
        """The received messages as (topic, bytes); for each topic at most its queue depth."""
        if not self._waitset.wait(0):
            return []
        received: list[tuple[str, bytes]] = []
        for each in self._readers:
            try:
                samples = each.reader.take(each.depth)
            except DDSException:
                continue
            # When a writer ends, Cyclone delivers an `InvalidSample`.
            received += [(each.topic, sample.cdr) for sample in samples if isinstance(sample, Sample)]
        return received


class DdsDomain:
    """A DDS domain of this process.

    Args:
        domain_id: number of the domain.
        interface: network interface; None: loopback.

    Raises:
        DdsUnavailable: the interface does not exist, or the domain is already open.
    """

    def __init__(self, domain_id: int, interface: str | None = None) -> None:
        self._domain_id, self._interface = domain_id, interface
        try:
            self._domain = Domain(domain_id, configuration(interface))
        except DDSException as problem:
            raise self._unavailable(problem) from None

    def open(self, namespace: str = "", px4: Px4Version = DEFAULT) -> DdsPort:
        """Creates the participant of a vehicle.

        Args:
            namespace: prefix of the names of its topics.
            px4: the vehicle's version of PX4.

        Raises:
            DdsUnavailable: DDS cannot create the participant.
        """
        try:
            return DdsPort(self, self._domain_id, namespace, topics_of(px4))
        except DDSException as problem:
            raise self._unavailable(problem) from None

    def _unavailable(self, problem: DDSException) -> DdsUnavailable:
        where = self._interface or f"the loopback interface {LOOPBACK}"
        return DdsUnavailable(
            f"DDS domain {self._domain_id} could not be opened on {where} ({problem}). "
            "Check the interface's name and that no more than a hundred participants share the domain."
        )
