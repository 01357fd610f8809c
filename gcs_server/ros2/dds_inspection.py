"""The inspector's participant in a DDS domain: discovers all writers and readers, and reads chosen topics."""

from __future__ import annotations

import weakref
from typing import Any, Final

from cyclonedds.core import DDSException
from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from gcs_server.ros2.dds import DdsUnavailable, Discovery, inspector_participants, open_domain
from gcs_server.ros2.dds_types import Sample, idl_type
from gcs_server.ros2.inspection import Announcement, TopicKey
from gcs_server.ros2.message_types import MessageType

MAX_ANNOUNCEMENTS: Final = 500
"""Maximum number of announcements that are read at once, each of writers and of readers."""
DEPTH: Final = 128
"""Maximum number of messages of a topic that are kept until the next reading."""
QOS: Final = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(DEPTH))
"""With these settings the messages of every writer can be received."""


class InspectionPort:
    """A participant that only reads.

    Raises:
        DdsUnavailable: DDS cannot create the participant.
    """

    def __init__(self, domain_id: int, interface: str | None) -> None:
        self._domain = open_domain(domain_id, interface)
        try:
            self._participant = DomainParticipant(domain_id)
            self._own_key = str(self._participant.get_guid())
            inspector_participants.add(self._own_key)
            weakref.finalize(self, inspector_participants.discard, self._own_key)
            self._discovery = Discovery(self._participant)
        except DDSException as problem:
            raise DdsUnavailable(
                f"DDS domain {domain_id} cannot be inspected ({problem.msg}). Check that no more than a "
                "hundred programs use the domain."
            ) from None
        self._readers: dict[TopicKey, Any] = {}

    def announcements(self) -> list[Announcement]:
        """Announcements of writers and readers that appeared or ended since the last call, without the own
        ones; at most `MAX_ANNOUNCEMENTS` each."""
        return self._discovery.take(MAX_ANNOUNCEMENTS, {self._own_key})

    def open(self, key: TopicKey, message: MessageType) -> str | None:
        """Begins to read a topic; returns why the topic cannot be read, or None."""
        try:
            topic = Topic(self._participant, key.name, idl_type(message))
            self._readers[key] = DataReader(self._participant, topic, qos=QOS)
        except DDSException as problem:
            return f"DDS cannot read this topic ({problem.msg})."
        return None

    def close(self, key: TopicKey) -> None:
        """Stops reading a topic."""
        self._readers.pop(key, None)

    def take(self, key: TopicKey) -> tuple[list[bytes], bool]:
        """Messages since the last call, oldest first, and whether older ones may have been dropped."""
        reader = self._readers.get(key)
        if reader is None:
            return [], False
        try:
            samples = reader.take(DEPTH)
        except DDSException:
            return [], False
        # When a writer ends, Cyclone delivers an `InvalidSample`.
        return [sample.cdr for sample in samples if isinstance(sample, Sample)], len(samples) == DEPTH
