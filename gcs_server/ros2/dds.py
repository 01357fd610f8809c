"""DDS for the `ros2://` links, with the optional package Cyclone DDS.

Cyclone's own threads discover vehicles and receive their messages. `VehiclePort.take` only fetches the
received messages, and `Writers.send` passes a message to the socket (best effort); neither waits.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final
from xml.sax.saxutils import quoteattr

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.dds_types import Sample, idl_type
from gcs_server.ros2.message_types import MESSAGES, MessageType
from gcs_server.ros2.topics import STATUS, SUBSCRIPTIONS, Subscription, wire_name

LOOPBACK: Final = "lo"
MAX_PARTICIPANT_INDEX: Final = 99
"""Highest index of a participant on loopback. Without multicast, each index has its own discovery port."""
ANNOUNCE_EVERY_S: Final = 2.0
"""Period at which this process announces its participants [s]."""
MAX_ANNOUNCEMENTS: Final = 200
"""Maximum number of announcements that are read at once, each of writers and of readers."""
MAX_WRITERS: Final = 64
"""Maximum number of writers of one topic whose participant is stored."""
SOURCE_TIMEOUT_S: Final = 3.5
"""If the participant whose topics are read sends no vehicle status for this time, another participant's
topics are read [s]."""

BEST_EFFORT: Final = Policy.Reliability.BestEffort


class DdsUnavailable(Exception):
    """DDS is not available in this domain or on this interface."""


def configuration(interface: str | None) -> str:
    """Cyclone's settings: loopback with unicast only, or one interface with multicast.

    Without an interface no message leaves the machine, whatever `CYCLONEDDS_URI` contains.

    A program may start at any time after this one. On loopback a Fast DDS program (PX4's agent) does not
    announce itself to this one, so this one must do it for as long as it runs: Cyclone would stop after 30 s,
    and repeat it only every 30 s.
    """
    general = ""
    discovery = f"<SPDPInterval>{ANNOUNCE_EVERY_S:g} s</SPDPInterval>"
    if interface is None:
        general = "<AllowMulticast>false</AllowMulticast>"
        discovery += (
            "<InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"
            "<DiscoveredLocatorPruneDelay>inf</DiscoveredLocatorPruneDelay>"
            f"<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{MAX_PARTICIPANT_INDEX}"
            '</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers>'
        )
    network = f"<Interfaces><NetworkInterface name={quoteattr(interface or LOOPBACK)}/></Interfaces>"
    return (
        f"<CycloneDDS><Domain><General>{network}{general}</General>"
        f"<Discovery>{discovery}</Discovery></Domain></CycloneDDS>"
    )


class SharedDomain:
    """An open DDS domain. All links with the same domain number share one `SharedDomain`, because Cyclone
    allows each number only once in a process."""

    def __init__(self, domain_id: int, interface: str | None) -> None:
        self.domain_id, self.interface = domain_id, interface
        self._domain = Domain(domain_id, configuration(interface))


_domains: weakref.WeakValueDictionary[int, SharedDomain] = weakref.WeakValueDictionary()
_domains_lock = threading.Lock()
_types_lock = threading.Lock()
"""Held while types are registered, because Cyclone cannot do this in two threads at the same time."""


def open_domain(domain_id: int, interface: str | None) -> SharedDomain:
    """The domain with this number; the domain closes when its last reference is dropped.

    Raises:
        DdsUnavailable: there is no such interface, or the domain is open on another interface.
    """
    with _domains_lock:
        shared = _domains.get(domain_id)
        if shared is not None and shared.interface != interface:
            raise DdsUnavailable(
                f"DDS domain {domain_id} is already used on {_interface_text(shared.interface)}. "
                "Use the same interface for all links of a domain."
            )
        if shared is None:
            try:
                shared = _domains[domain_id] = SharedDomain(domain_id, interface)
            except DDSException as problem:
                raise DdsUnavailable(_open_error(domain_id, interface, problem)) from None
        return shared


def _interface_text(interface: str | None) -> str:
    return f"interface {interface}" if interface else f"the loopback interface {LOOPBACK}"


def _open_error(domain_id: int, interface: str | None, problem: DDSException) -> str:
    return (
        f"DDS domain {domain_id} could not be opened on {_interface_text(interface)} ({problem.msg}). Check "
        "the interface's name and that no more than a hundred programs use the domain."
    )


def _is_alive(endpoint: object) -> bool:
    return bool(getattr(endpoint, "topic_name", None) and getattr(endpoint, "type_name", None))


inspector_participants: Final[set[str]] = set()
"""Keys of this process's participants that read topics only for the inspector."""


@dataclass(frozen=True, slots=True)
class Discovered:
    """A writer or a reader that DDS discovered."""

    topic: str
    type: str
    publishes: bool
    """Whether it is a writer."""


class DdsPort:
    """This server's participant in a domain.

    Raises:
        DdsUnavailable: DDS cannot create the participant.
    """

    def __init__(self, domain_id: int, interface: str | None) -> None:
        self._domain = open_domain(domain_id, interface)
        try:
            self.participant = DomainParticipant(domain_id)
            self._builtin = (
                (True, BuiltinDataReader(self.participant, BuiltinTopicDcpsPublication)),
                (False, BuiltinDataReader(self.participant, BuiltinTopicDcpsSubscription)),
            )
        except DDSException as problem:
            raise DdsUnavailable(_open_error(domain_id, interface, problem)) from None

    def discovered(self) -> list[Discovered]:
        """Writers and readers that appeared or changed since the last call; at most
        `MAX_ANNOUNCEMENTS` each."""
        endpoints: list[Discovered] = []
        for publishes, reader in self._builtin:
            try:
                announced = reader.take(MAX_ANNOUNCEMENTS)
            except DDSException:
                continue
            endpoints += [
                Discovered(each.topic_name, each.type_name, publishes)
                for each in announced
                # an ended writer or reader is announced without names
                if _is_alive(each) and str(each.participant_key) not in inspector_participants
            ]
        return endpoints

    def vehicle(self, namespace: str) -> VehiclePort:
        """Subscribes to the topics of a vehicle.

        Raises:
            DdsUnavailable: DDS cannot create a reader or a writer.
        """
        try:
            return VehiclePort(self.participant, namespace)
        except DDSException as problem:
            raise DdsUnavailable(
                f"The topics of {namespace or 'the vehicle'} cannot be opened ({problem.msg})."
            ) from None


class Writers:
    """Writers for topics that a vehicle subscribes to; `prepare` creates them.

    Args:
        participant: the participant of this process.
        namespace: namespace of the vehicle; may be empty.
        domain: the domain, which stays open as long as these writers exist; None: the caller keeps it open.
    """

    def __init__(
        self, participant: DomainParticipant, namespace: str, domain: SharedDomain | None = None
    ) -> None:
        self._participant, self._namespace, self._domain = participant, namespace, domain
        self._writers: dict[str, tuple[type[Sample], Any]] = {}

    def prepare(self, topic: str, message: MessageType) -> None:
        """Creates the writer of a topic, so that DDS connects the writer before the first message.

        Raises:
            DDSException: DDS cannot create the writer.
        """
        if topic not in self._writers:
            sample_class = idl_type(message)
            qos = Qos(BEST_EFFORT, Policy.Durability.Volatile, Policy.History.KeepLast(1))
            dds_topic = Topic(self._participant, wire_name(topic, self._namespace), sample_class)
            self._writers[topic] = sample_class, DataWriter(self._participant, dds_topic, qos=qos)

    def send(self, topic: str, data: bytes) -> None:
        """Sends a message to a prepared topic.

        Raises:
            OSError: DDS cannot send the message.
        """
        sample_class, writer = self._writers[topic]
        try:
            writer.write(sample_class.from_cdr(data))
        except DDSException as problem:
            raise OSError(f"DDS cannot send: {problem.msg}") from None

    def connected(self, topic: str) -> bool:
        """Whether a program subscribes to a prepared topic."""
        return bool(self._writers[topic][1].get_matched_subscriptions())


def open_writers(address: DdsAddress, topics: Mapping[str, MessageType]) -> Writers:
    """Writers for a vehicle's topics, in a new participant.

    Raises:
        DdsUnavailable: DDS cannot create the participant, a writer or a reader.
    """
    return open_topics(address, topics, ())[0]


def open_topics(
    address: DdsAddress, sent: Mapping[str, MessageType], subscriptions: Iterable[Subscription]
) -> tuple[Writers, Readers]:
    """Writers and readers for a vehicle's topics, in a new participant.

    Raises:
        DdsUnavailable: DDS cannot create the participant, a writer or a reader.
    """
    domain = open_domain(address.domain_id, address.interface)
    try:
        with _types_lock:
            participant = DomainParticipant(address.domain_id)
            writers = Writers(participant, address.namespace, domain)
            for topic, message in sent.items():
                writers.prepare(topic, message)
            return writers, Readers(participant, address.namespace, subscriptions)
    except DDSException as problem:
        raise DdsUnavailable(_open_error(address.domain_id, address.interface, problem)) from None


class Readers:
    """Reads topics of one vehicle, without waiting.

    Args:
        participant: the participant of this process.
        namespace: namespace of the vehicle; may be empty.
        subscriptions: the topics to read; `every_s` has no effect.
    """

    def __init__(
        self, participant: DomainParticipant, namespace: str, subscriptions: Iterable[Subscription]
    ) -> None:
        self._readers = [(each, _open_reader(participant, each, namespace)) for each in subscriptions]

    def connected(self, topic: str) -> bool:
        """Whether a program publishes a topic that is read."""
        return any(reader.get_matched_publications() for each, reader in self._readers if each.name == topic)

    def take(self) -> list[tuple[str, bytes]]:
        """The newest messages since the last call, at most `Subscription.depth` of each topic."""
        taken: list[tuple[str, bytes]] = []
        for each, reader in self._readers:
            try:
                samples = reader.take(each.depth)
            except DDSException:
                continue
            taken += [(each.name, sample.cdr) for sample in samples if isinstance(sample, Sample)]
        return taken


@dataclass(slots=True)
class _Reader:
    subscription: Subscription
    reader: Any
    next_s: float = 0.0
    """Time from which the topic is read again [s, monotonic]."""
    participants: dict[int, str] = field(default_factory=dict)
    """Participant of each writer, by the writer's handle."""

    def participant_of(self, sample: Any) -> str:
        """The participant that sent a sample; empty if DDS has already removed it."""
        handle = sample.sample_info.publication_handle
        known = self.participants.get(handle)
        if known is None:
            data = self.reader.get_matched_publication_data(handle)
            if data is None:
                return ""
            if len(self.participants) >= MAX_WRITERS:
                self.participants.clear()
            known = self.participants[handle] = str(data.participant_key)
        return known


class VehiclePort:
    """The topics of one namespace.

    A vehicle is one participant. If several participants publish the same topics (vehicles with the same
    namespace), only one participant is read, so that the states of two vehicles never mix.
    """

    def __init__(self, participant: DomainParticipant, namespace: str) -> None:
        self._readers = [_Reader(each, _open_reader(participant, each, namespace)) for each in SUBSCRIPTIONS]
        self.writers = Writers(participant, namespace)
        self.writers.prepare("/fmu/in/vehicle_command", MESSAGES["VehicleCommand"])
        self._source: str | None = None
        """The participant whose topics are read."""
        self._source_s = 0.0
        """Time of the last vehicle status of `_source`."""
        self.other_status_s = float("-inf")
        """When another participant's vehicle status was last ignored."""

    def take(self, now_s: float) -> Iterable[tuple[str, bytes]]:
        """The newest messages of each topic that is due, at most `Subscription.depth` of each."""
        taken: list[tuple[str, bytes]] = []
        for each in self._readers:
            subscription = each.subscription
            if now_s < each.next_s:
                continue
            each.next_s = now_s + subscription.every_s * 0.9  # so that a slightly early call still reads
            try:
                samples = each.reader.take(subscription.depth)
            except DDSException:
                continue
            # When a writer ends, Cyclone delivers an `InvalidSample`.
            for sample in samples:
                if isinstance(sample, Sample) and self._is_from_vehicle(each, sample, now_s):
                    taken.append((subscription.name, sample.cdr))
        return taken

    @property
    def has_status(self) -> bool:
        """Whether a vehicle status has arrived."""
        return self._source is not None

    def _is_from_vehicle(self, reader: _Reader, sample: Sample, now_s: float) -> bool:
        """Whether the sample comes from the participant that is read; a vehicle status may select this
        participant."""
        participant = reader.participant_of(sample)
        is_status = reader.subscription.name == STATUS
        if is_status and (self._source is None or now_s - self._source_s > SOURCE_TIMEOUT_S):
            self._source = participant
        if participant != self._source:
            if is_status:
                self.other_status_s = now_s
            return False
        if is_status:
            self._source_s = now_s
        return True


def _open_reader(participant: DomainParticipant, subscription: Subscription, namespace: str) -> Any:
    topic = Topic(participant, wire_name(subscription.name, namespace), idl_type(subscription.message))
    qos = Qos(BEST_EFFORT, Policy.Durability.TransientLocal, Policy.History.KeepLast(subscription.depth))
    return DataReader(participant, topic, qos=qos)
