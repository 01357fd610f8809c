"""One end of a guarded ROS 2 link: the topics of programs, or those of the vehicle, read by a thread."""

from __future__ import annotations

from typing import Any

from cyclonedds.core import DDSException, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy
from cyclonedds.util import duration

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.dds import (
    DdsUnavailable,
    Participants,
    Writers,
    open_domain,
    open_error,
    open_reader,
    types_lock,
)
from gcs_server.ros2.dds_types import Sample
from gcs_server.ros2.formats import TopicFormat


class RelayPort:
    """Reads and writes topics.

    Args:
        address: domain and namespace.
        as_vehicle: whether the topics are offered and read as PX4's agent does, to programs; otherwise as a
            program does, to the vehicle.

    Raises:
        DdsUnavailable: DDS cannot create the participant.
    """

    def __init__(self, address: DdsAddress, *, as_vehicle: bool) -> None:
        self._address = address
        local, volatile = Policy.Durability.TransientLocal, Policy.Durability.Volatile
        offered, self._wanted = (local, volatile) if as_vehicle else (volatile, local)
        domain = open_domain(address.domain_id, address.interface)
        self._readers: list[tuple[str, int, Any, Participants]] = []
        try:
            with types_lock:
                self._participant = DomainParticipant(address.domain_id)
                self._waitset = WaitSet(self._participant)
                self._writers = Writers(self._participant, address.namespace, domain, offered)
        except DDSException as problem:
            raise self._unavailable(problem) from None

    def _unavailable(self, problem: DDSException) -> DdsUnavailable:
        return DdsUnavailable(open_error(self._address.domain_id, self._address.interface, problem))

    def write(self, topic: TopicFormat) -> None:
        """Prepares a topic that is written. Raises DdsUnavailable."""
        try:
            with types_lock:
                self._writers.prepare(topic.topic, topic.message, topic.name)
        except DDSException as problem:
            raise self._unavailable(problem) from None

    def read(self, topic: TopicFormat, depth: int) -> None:
        """Reads a topic, too; called by the thread that waits.

        Args:
            topic: the topic.
            depth: number of messages that are kept until the next reading.

        Raises:
            DdsUnavailable: DDS cannot create the reader.
        """
        address = self._address
        try:
            with types_lock:
                reader: Any = open_reader(
                    self._participant, topic.name, topic.message, depth, address.namespace, self._wanted
                )
                self._readers.append((topic.topic, depth, reader, Participants(reader)))
                mask = SampleState.Any | ViewState.Any | InstanceState.Any
                self._waitset.attach(ReadCondition(reader, mask))
        except DDSException as problem:
            raise self._unavailable(problem) from None

    def wait(self, timeout_s: float) -> list[tuple[str, str, bytes]]:
        """The messages since the last call, each with its topic and the participant that sent it; waits for
        the first one, at most for the timeout."""
        if not self._waitset.wait(duration(seconds=timeout_s)):
            return []
        taken: list[tuple[str, str, bytes]] = []
        for topic, depth, reader, participants in self._readers:
            try:
                samples = reader.take(depth)
            except DDSException:
                continue
            # When a writer ends, Cyclone delivers an `InvalidSample`.
            taken += [
                (topic, participants.of(each), each.cdr) for each in samples if isinstance(each, Sample)
            ]
        return taken

    def send(self, topic: str, data: bytes) -> None:
        """Sends a message of a topic that is written. Raises OSError if DDS cannot send it."""
        self._writers.send(topic, data)

    def participants(self) -> set[str]:
        """The participants that write to topics which are read."""
        found: set[str] = set()
        for *_, participants in self._readers:
            found |= participants.connected()
        return found
