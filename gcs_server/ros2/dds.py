"""DDS for the `ros2://` links, with the optional package Cyclone DDS.

Cyclone's own threads discover vehicles and receive their messages. `VehiclePort.take` only fetches the
received messages, and `Writers.send` passes a message to the socket (best effort); neither waits.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Collection, Iterable, Mapping
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
from gcs_server.ros2.formats import REQUEST, RESPONSE, TopicFormat
from gcs_server.ros2.inspection import Announcement, TopicKey
from gcs_server.ros2.message_types import MESSAGES, MessageType
from gcs_server.ros2.topics import COMMAND, STATUS, SUBSCRIPTIONS, Subscription, wire_name

LOOPBACK: Final = "lo"
MAX_PARTICIPANT_INDEX: Final = 99
"""Highest index of a participant on loopback. Without multicast, each index has its own discovery port."""
ANNOUNCE_EVERY_S: Final = 2.0
"""Period at which this process announces its participants [s]."""
MAX_ANNOUNCEMENTS: Final = 200
"""Maximum number of announcements that are read at once, each of writers and of readers."""
MAX_WRITERS: Final = 64
"""Maximum number of writers of one topic whose participant is stored."""
RESPONSE_DEPTH: Final = 8
"""Maximum number of answers about layouts that are kept until the next reading."""
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
types_lock = threading.Lock()
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
                raise DdsUnavailable(open_error(domain_id, interface, problem)) from None
        return shared


def _interface_text(interface: str | None) -> str:
    return f"interface {interface}" if interface else f"the loopback interface {LOOPBACK}"


def open_error(domain_id: int, interface: str | None, problem: DDSException) -> str:
    return (
        f"DDS domain {domain_id} could not be opened on {_interface_text(interface)} ({problem.msg}). Check "
        "the interface's name and that no more than a hundred programs use the domain."
    )


inspector_participants: Final[set[str]] = set()
"""Keys of this process's participants that read topics only for the inspector."""


class Discovery:
    """The writers and readers that DDS discovers.

    Args:
        participant: a participant in the domain.
    """

    def __init__(self, participant: DomainParticipant) -> None:
        self._builtin = (
            (True, BuiltinDataReader(participant, BuiltinTopicDcpsPublication)),
            (False, BuiltinDataReader(participant, BuiltinTopicDcpsSubscription)),
        )

    def take(self, maximum: int, without: Collection[str]) -> list[Announcement]:
        """Announcements of writers and readers that appeared or ended since the last call.

        Args:
            maximum: maximum number of announcements, each of writers and of readers.
            without: keys of participants that are omitted.
        """
        announcements: list[Announcement] = []
        for publishes, reader in self._builtin:
            try:
                samples = reader.take(maximum)
            except DDSException:
                continue
            for each in samples:
                participant = str(each.participant_key)
                # an ended writer or reader is announced without names
                is_alive = each.sample_info.valid_data and each.topic_name and each.type_name
                topic = TopicKey(each.topic_name, each.type_name) if is_alive else None
                if participant not in without:
                    announcements.append(Announcement(str(each.key), publishes, topic, participant))
        return announcements


class DdsPort:
    """This server's participant in a domain.

    Raises:
        DdsUnavailable: DDS cannot create the participant.
    """

    def __init__(self, domain_id: int, interface: str | None) -> None:
        self._domain = open_domain(domain_id, interface)
        try:
            self.participant = DomainParticipant(domain_id)
            self._discovery = Discovery(self.participant)
        except DDSException as problem:
            raise DdsUnavailable(open_error(domain_id, interface, problem)) from None

    def announcements(self) -> list[Announcement]:
        """Announcements since the last call, without those of the inspector; at most `MAX_ANNOUNCEMENTS` each
        of writers and of readers."""
        return self._discovery.take(MAX_ANNOUNCEMENTS, inspector_participants)

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
        durability: what is offered; a vehicle offers its newest message to programs that start later.
    """

    def __init__(
        self,
        participant: DomainParticipant,
        namespace: str,
        domain: SharedDomain | None = None,
        durability: Any = Policy.Durability.Volatile,
    ) -> None:
        self._participant, self._namespace, self._domain = participant, namespace, domain
        self._durability = durability
        self._writers: dict[str, tuple[type[Sample], Any]] = {}

    def prepare(self, topic: str, message: MessageType, name: str | None = None) -> None:
        """Creates the writer of a topic, so that DDS connects the writer before the first message. Another
        writer of the topic is replaced.

        Args:
            topic: name with which `send` finds the writer.
            message: the topic's type.
            name: the vehicle's name of the topic, if it differs.

        Raises:
            DDSException: DDS cannot create the writer.
        """
        sample_class = idl_type(message)
        qos = Qos(BEST_EFFORT, self._durability, Policy.History.KeepLast(1))
        dds_topic = Topic(self._participant, wire_name(name or topic, self._namespace), sample_class)
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


def open_topics(
    address: DdsAddress, sent: Iterable[TopicFormat], subscriptions: Iterable[tuple[TopicFormat, int]] = ()
) -> tuple[Writers, Readers]:
    """Writers and readers for a vehicle's topics, in a new participant.

    Args:
        address: the vehicle's address.
        sent: the topics to write.
        subscriptions: the topics to read, each with the number of messages that are kept until the next
            reading.

    Raises:
        DdsUnavailable: DDS cannot create the participant, a writer or a reader.
    """
    domain = open_domain(address.domain_id, address.interface)
    try:
        with types_lock:
            participant = DomainParticipant(address.domain_id)
            writers = Writers(participant, address.namespace, domain)
            for each in sent:
                writers.prepare(each.topic, each.message, each.name)
            return writers, Readers(participant, address.namespace, subscriptions)
    except DDSException as problem:
        raise DdsUnavailable(open_error(address.domain_id, address.interface, problem)) from None


class Readers:
    """Reads topics of one vehicle, without waiting.

    Args:
        participant: the participant of this process.
        namespace: namespace of the vehicle; may be empty.
        subscriptions: the topics to read, each with the number of messages that are kept.
    """

    def __init__(
        self, participant: DomainParticipant, namespace: str, subscriptions: Iterable[tuple[TopicFormat, int]]
    ) -> None:
        self._readers = [
            (each.topic, depth, open_reader(participant, each.name, each.message, depth, namespace))
            for each, depth in subscriptions
        ]

    def connected(self, topic: str) -> bool:
        """Whether a program publishes a topic that is read."""
        return any(reader.get_matched_publications() for name, _, reader in self._readers if name == topic)

    def take(self) -> list[tuple[str, bytes]]:
        """The newest messages since the last call."""
        taken: list[tuple[str, bytes]] = []
        for topic, depth, reader in self._readers:
            try:
                samples = reader.take(depth)
            except DDSException:
                continue
            taken += [(topic, sample.cdr) for sample in samples if isinstance(sample, Sample)]
        return taken


@dataclass(slots=True)
class Participants:
    """The participants that write to a reader."""

    reader: Any
    _known: dict[int, str] = field(default_factory=dict[int, str])
    """Participant of each writer, by the writer's handle."""

    def of(self, sample: Any) -> str:
        """The participant that sent a sample; empty if DDS has already removed it."""
        handle = sample.sample_info.publication_handle
        known = self._known.get(handle)
        if known is None:
            data = self.reader.get_matched_publication_data(handle)
            if data is None:
                return ""
            if len(self._known) >= MAX_WRITERS:
                self._known.clear()
            known = self._known[handle] = str(data.participant_key)
        return known

    def connected(self) -> set[str]:
        """Those that are there now."""
        handles = self.reader.get_matched_publications()
        found = (self.reader.get_matched_publication_data(handle) for handle in handles)
        return {str(data.participant_key) for data in found if data is not None}


@dataclass(slots=True)
class _Reader:
    subscription: Subscription
    format: TopicFormat
    reader: Any
    participants: Participants
    next_s: float = 0.0
    """Time from which the topic is read again [s, monotonic]."""


class VehiclePort:
    """The topics of one namespace.

    A vehicle is one participant. If several participants publish the same topics (vehicles with the same
    namespace), only one participant is read, so that the states of two vehicles never mix. It is the first
    that answers which layouts its topics have (`formats.py`); the topics are read once it has answered.
    """

    def __init__(self, participant: DomainParticipant, namespace: str) -> None:
        self._participant, self._namespace = participant, namespace
        self._responses = _open_fixed_reader(participant, RESPONSE, "MessageFormatResponse", namespace)
        self._readers: dict[str, _Reader] = {}
        self.writers = Writers(participant, namespace)
        self.writers.prepare(REQUEST, MESSAGES["MessageFormatRequest"])
        self._opened: Mapping[str, TopicFormat] = {}
        self.source: str | None = None
        """The participant whose topics are read; None: none has answered yet."""
        self._source_s = float("-inf")
        """Time of the last vehicle status or answer of `source`."""
        self.status_s = float("-inf")
        """Time of the last vehicle status [s, monotonic]."""
        self.other_status_s = float("-inf")
        """When another participant's vehicle status was last ignored."""

    def open(self, usable: Mapping[str, TopicFormat]) -> None:
        """Reads and writes the topics with these formats, and no others.

        Raises:
            DDSException: DDS cannot create a reader or a writer.
        """
        if usable is self._opened:
            return
        readers: dict[str, _Reader] = {}
        for each in SUBSCRIPTIONS:
            topic_format, reader = usable.get(each.name), self._readers.pop(each.name, None)
            if reader is not None and reader.format == topic_format:
                readers[each.name] = reader
            elif topic_format is not None:
                del reader
                dds_reader = open_reader(
                    self._participant, topic_format.name, topic_format.message, each.depth, self._namespace
                )
                readers[each.name] = _Reader(each, topic_format, dds_reader, Participants(dds_reader))
        self._readers = readers
        command = usable.get(COMMAND)
        if command is not None and command != self._opened.get(COMMAND):
            self.writers.prepare(COMMAND, command.message, command.name)
        self._opened = usable

    def take(self, now_s: float) -> Iterable[tuple[str, bytes]]:
        """The newest messages of each topic that is due, at most `Subscription.depth` of each. If `source`
        has changed, all of them are from the new one."""
        taken = self._take_responses(now_s)
        for each in self._readers.values():
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

    def _take_responses(self, now_s: float) -> list[tuple[str, bytes]]:
        taken: list[tuple[str, bytes]] = []
        try:
            samples = self._responses.reader.take(RESPONSE_DEPTH)
        except DDSException:
            return taken
        for sample in samples:
            if not isinstance(sample, Sample):
                continue
            participant = self._responses.participants.of(sample)
            if participant != self.source and now_s - self._source_s > SOURCE_TIMEOUT_S and participant:
                self.source, taken = participant, []
            if participant == self.source:
                self._source_s = now_s
                taken.append((RESPONSE, sample.cdr))
        return taken

    def _is_from_vehicle(self, reader: _Reader, sample: Sample, now_s: float) -> bool:
        """Whether the sample comes from the participant that is read."""
        is_status = reader.subscription.name == STATUS
        if reader.participants.of(sample) != self.source:
            if is_status:
                self.other_status_s = now_s
            return False
        if is_status:
            self._source_s = self.status_s = now_s
        return True


def open_reader(
    participant: DomainParticipant,
    name: str,
    message: MessageType,
    depth: int,
    namespace: str,
    durability: Any = Policy.Durability.TransientLocal,
) -> Any:
    """A reader of a topic.

    Args:
        participant: the participant of this process.
        name: name of the topic, without namespace.
        message: the topic's type.
        depth: number of messages that are kept until the next reading.
        namespace: namespace of the vehicle; may be empty.
        durability: what writers must offer; programs offer less than a vehicle.

    Raises:
        DDSException: DDS cannot create the reader.
    """
    topic = Topic(participant, wire_name(name, namespace), idl_type(message))
    qos = Qos(BEST_EFFORT, durability, Policy.History.KeepLast(depth))
    return DataReader(participant, topic, qos=qos)


def _open_fixed_reader(participant: DomainParticipant, topic: str, kind: str, namespace: str) -> _Reader:
    """A reader of a topic that is equal in all versions of PX4."""
    message = MESSAGES[kind]
    reader = open_reader(participant, topic, message, RESPONSE_DEPTH, namespace)
    topic_format = TopicFormat(topic, topic, kind, message.hash)
    return _Reader(Subscription(topic, kind, 0.0), topic_format, reader, Participants(reader))
