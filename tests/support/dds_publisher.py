"""Publishes a vehicle's ROS 2 topics on real DDS. Needs `cyclonedds`."""

from __future__ import annotations

from typing import Any

from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from gcs_server.ros2.dds_types import Sample, idl_type
from gcs_server.ros2.formats import REQUEST, RESPONSE
from gcs_server.ros2.message_types import VERSIONS
from gcs_server.ros2.topics import wire_name
from tests.support.dds_samples import recorded_samples
from tests.support.px4_formats import answer, px4_hashes

PX4_VERSION = "1.16"
"""The version of the recorded messages."""
TYPES = VERSIONS[PX4_VERSION]
VEHICLE_STATUS = "/fmu/out/vehicle_status_v1"
PX4_QOS = Qos(Policy.Reliability.BestEffort, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
"""Quality of service with which PX4 publishes its topics."""


def status_bytes(**changes: object) -> bytes:
    """Bytes of a recorded VehicleStatus with these fields changed."""
    message_type = TYPES["VehicleStatus"]
    return message_type.encode(message_type.decode(recorded_samples()[VEHICLE_STATUS]) | changes)


class Publisher:
    """A participant that publishes a vehicle's topics in a namespace, and answers which layouts they have.

    Args:
        hashes: the layouts that it names, by topic inside PX4; empty: it does not answer.
        version: the version of PX4.
    """

    def __init__(
        self,
        domain_id: int,
        namespace: str,
        hashes: dict[str, int] | None = None,
        version: str = PX4_VERSION,
    ) -> None:
        self._namespace, self._types = namespace, VERSIONS[version]
        self.participant = DomainParticipant(domain_id)
        self._writers: dict[str, tuple[type[Sample], Any]] = {}
        self.hashes = px4_hashes(version) if hashes is None else hashes
        request = idl_type(TYPES["MessageFormatRequest"])
        topic = Topic(self.participant, wire_name(REQUEST, namespace), request)
        qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(8))
        self._requests = DataReader(self.participant, topic, qos=qos)
        self.prepare(RESPONSE, "MessageFormatResponse")

    def answer(self) -> None:
        """Answers the requests since the last call."""
        for sample in self._requests.take(8):
            if isinstance(sample, Sample) and self.hashes:
                sample_type, writer = self._writers[RESPONSE]
                writer.write(sample_type.from_cdr(answer(sample.cdr, self.hashes)))

    def prepare(self, topic: str, message: str = "VehicleStatus") -> tuple[type[Sample], Any]:
        """The type and the writer of a topic; the first call creates them."""
        if topic not in self._writers:
            sample_type = idl_type(self._types[message])
            dds_topic = Topic(self.participant, wire_name(topic, self._namespace), sample_type)
            self._writers[topic] = sample_type, DataWriter(self.participant, dds_topic, qos=PX4_QOS)
        return self._writers[topic]

    def send(self, topic: str, data: bytes, message: str = "VehicleStatus") -> None:
        """Publishes these bytes of a message, and answers requests."""
        self.answer()
        sample_type, writer = self.prepare(topic, message)
        writer.write(sample_type.from_cdr(data))
