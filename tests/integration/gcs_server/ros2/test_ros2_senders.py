"""The stream process on real DDS: its messages reach a vehicle's topics."""

from __future__ import annotations

import contextlib
import gc
import os
import time
from typing import Any

import pytest

pytest.importorskip("cyclonedds")

from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.dds import DdsPort, open_domain
from gcs_server.ros2.dds_types import Sample, idl_type
from gcs_server.ros2.external_mode import CHECK_REPLY, CHECK_REQUEST, REGISTER, REGISTER_REPLY
from gcs_server.ros2.message_types import MESSAGES, VERSIONS
from gcs_server.ros2.topics import wire_name
from gcs_server.streamer.process.ros2_senders import ModeTopics, Ros2Senders
from gcs_server.streamer.transport.ros2 import CONTROL_MODE, SETPOINT_TOPICS
from tests.support.dds_publisher import Publisher
from tests.support.dds_samples import recorded_samples
from tests.support.px4_formats import address_formats

DOMAIN, MODES_DOMAIN, ENDED_WRITER_DOMAIN = 51, 54, 55
NAMESPACE = f"senders_{os.getpid()}"


def test_a_sender_sends_when_a_vehicle_subscribes_and_is_closed_when_unused() -> None:
    domain = open_domain(DOMAIN, None)
    # Created before the sender's thread starts: two threads cannot register a Cyclone type at the same time.
    participant = DomainParticipant(DOMAIN)
    topic = Topic(participant, wire_name(CONTROL_MODE, NAMESPACE), idl_type(MESSAGES["OffboardControlMode"]))
    address, senders = DdsAddress(DOMAIN, None, NAMESPACE, address_formats("1.16")), Ros2Senders()
    sender = senders.sender_for(address)
    assert senders.sender_for(address) is sender
    data = MESSAGES["OffboardControlMode"].encode({"position": True})
    with pytest.raises(OSError, match=r"not open yet|no vehicle subscribes"):
        sender.send([(CONTROL_MODE, data)])
    reader = DataReader(participant, topic, qos=Qos(Policy.Reliability.BestEffort))

    def send_until_received() -> dict[str, Any]:
        """Sends until the vehicle has received a message; returns its fields."""
        end_s = time.monotonic() + 10.0
        while True:
            with contextlib.suppress(OSError):
                sender.send([(CONTROL_MODE, data)])
            for sample in reader.take(1):
                if isinstance(sample, Sample):
                    return MESSAGES["OffboardControlMode"].decode(sample.cdr)
            assert time.monotonic() < end_s
            time.sleep(0.02)

    assert send_until_received()["position"] is True
    # The sender sends nothing if one topic has no subscriber: OffboardControlMode alone would keep Offboard
    # active without a setpoint.
    reader.take(100)
    trajectory = SETPOINT_TOPICS["TrajectorySetpoint"]
    for messages, needed in (
        ([(CONTROL_MODE, data), (trajectory, b"")], ()),
        ([(CONTROL_MODE, data)], (trajectory,)),
    ):
        with pytest.raises(OSError, match=f"no vehicle subscribes to {trajectory}"):
            sender.send(messages, needed)
    data = MESSAGES["OffboardControlMode"].encode({"attitude": True})
    assert send_until_received()["attitude"] is True
    senders.close_unused(())
    assert senders.sender_for(address) is not sender
    assert domain  # this reference keeps the domain open


def test_modes_are_registered_over_their_own_topics() -> None:
    namespace = f"modes_{os.getpid()}"
    domain = open_domain(MODES_DOMAIN, None)
    vehicle = Publisher(MODES_DOMAIN, namespace)
    vehicle.prepare(REGISTER_REPLY, "RegisterExtComponentReply")
    request_type = idl_type(MESSAGES["RegisterExtComponentRequest"])
    topic = Topic(vehicle.participant, wire_name(REGISTER, namespace), request_type)
    reader = DataReader(vehicle.participant, topic, qos=Qos(Policy.Reliability.BestEffort))
    topics = ModeTopics(DdsAddress(MODES_DOMAIN, None, namespace, address_formats("1.16")))
    requests: list[Sample] = []
    replies: list[tuple[str, bytes]] = []
    assert not topics.connected()
    end_s = time.monotonic() + 10.0
    while not (requests and replies):
        assert time.monotonic() < end_s, (len(requests), len(replies))
        with contextlib.suppress(OSError):  # DDS is not open yet
            topics.send(REGISTER, recorded_samples()[REGISTER])
        vehicle.send(REGISTER_REPLY, recorded_samples()[REGISTER_REPLY], "RegisterExtComponentReply")
        time.sleep(0.02)
        requests += [sample for sample in reader.take(10) if isinstance(sample, Sample)]
        replies += topics.take()
    request = MESSAGES["RegisterExtComponentRequest"]
    assert request.decode(requests[0].cdr) == request.decode(recorded_samples()[REGISTER])
    assert replies[0][0] == REGISTER_REPLY
    assert MESSAGES["RegisterExtComponentReply"].decode(replies[0][1])["mode_id"] == 23  # as recorded
    assert not topics.connected(), "nobody publishes or reads the arming checks yet"
    vehicle.prepare(CHECK_REQUEST, "ArmingCheckRequest")
    topic = Topic(
        vehicle.participant, wire_name(CHECK_REPLY, namespace), idl_type(VERSIONS["1.16"]["ArmingCheckReply"])
    )
    checks = DataReader(vehicle.participant, topic, qos=Qos(Policy.Reliability.BestEffort))
    while not topics.connected():
        assert time.monotonic() < end_s
        time.sleep(0.02)
    assert checks
    assert domain  # this reference keeps the domain open


def test_a_writer_that_ends_is_not_announced_as_a_publication() -> None:
    port, topic = DdsPort(ENDED_WRITER_DOMAIN, None), "/fmu/out/mode_completed"
    vehicle = Publisher(ENDED_WRITER_DOMAIN, f"ends_{os.getpid()}")
    vehicle.prepare(topic, "ModeCompleted")
    discovered: list[str] = []
    end_s = time.monotonic() + 10.0
    while not any(each.endswith(topic) for each in discovered):
        assert time.monotonic() < end_s
        discovered += [each.topic.name for each in port.announcements() if each.topic is not None]
    del vehicle
    gc.collect()
    end_s = time.monotonic() + 1.0
    while time.monotonic() < end_s:
        assert all(
            each.topic is None or (each.topic.name and each.topic.type) for each in port.announcements()
        )
        time.sleep(0.02)
