"""Publishes a vehicle's ROS 2 topics on real DDS. Needs `cyclonedds`."""

from __future__ import annotations

from typing import Any

from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic

from gcs_server.ros2.dds_types import Sample, idl_type
from gcs_server.ros2.message_types import SHOWN
from gcs_server.ros2.topics import wire_name
from tests.support.dds_samples import recorded_samples

VEHICLE_STATUS = "/fmu/out/vehicle_status_v1"
PX4_QOS = Qos(Policy.Reliability.BestEffort, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
"""Quality of service with which PX4 publishes its topics."""


def status_bytes(**changes: object) -> bytes:
    """Bytes of a recorded VehicleStatus with these fields changed."""
    message_type = SHOWN["VehicleStatus"]
    return message_type.encode(message_type.decode(recorded_samples()[VEHICLE_STATUS]) | changes)


class Publisher:
    """A DDS participant that publishes a vehicle's topics in a namespace."""

    def __init__(self, domain_id: int, namespace: str) -> None:
        self._namespace = namespace
        self.participant = DomainParticipant(domain_id)
        self._writers: dict[str, tuple[type[Sample], Any]] = {}

    def prepare(self, topic: str, message: str = "VehicleStatus") -> tuple[type[Sample], Any]:
        """The type and the writer of a topic; the first call creates them."""
        if topic not in self._writers:
            sample_type = idl_type(SHOWN[message])
            dds_topic = Topic(self.participant, wire_name(topic, self._namespace), sample_type)
            self._writers[topic] = sample_type, DataWriter(self.participant, dds_topic, qos=PX4_QOS)
        return self._writers[topic]

    def send(self, topic: str, data: bytes, message: str = "VehicleStatus") -> None:
        """Publishes these bytes of a message."""
        sample_type, writer = self.prepare(topic, message)
        writer.write(sample_type.from_cdr(data))
