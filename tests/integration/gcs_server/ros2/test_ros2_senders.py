"""The streams' process on real DDS: its messages reach a vehicle's topics."""

from __future__ import annotations

import os
import time

import pytest

pytest.importorskip("cyclonedds")

from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.dds import open_domain
from gcs_server.ros2.dds_types import Sample, idl_type
from gcs_server.ros2.message_types import MESSAGES
from gcs_server.ros2.topics import wire_name
from gcs_server.streamer.process.ros2_senders import Ros2Senders
from gcs_server.streamer.transport.ros2 import CONTROL_MODE

DOMAIN = 51
NAMESPACE = f"senders_{os.getpid()}"


def test_a_sender_sends_once_a_vehicle_subscribes_and_closes_when_it_is_not_used() -> None:
    domain = open_domain(DOMAIN, None)
    address, senders = DdsAddress(DOMAIN, None, NAMESPACE), Ros2Senders()
    sender = senders.at(address)
    assert senders.at(address) is sender
    data = MESSAGES["OffboardControlMode"].encode({"position": True})
    with pytest.raises(OSError, match=r"not open yet|no vehicle subscribes"):
        sender.send(CONTROL_MODE, data)
    participant = DomainParticipant(DOMAIN)
    kind = idl_type(MESSAGES["OffboardControlMode"])
    topic = Topic(participant, wire_name(CONTROL_MODE, NAMESPACE), kind)
    reader = DataReader(participant, topic, qos=Qos(Policy.Reliability.BestEffort))
    received: list[Sample] = []
    end_s = time.monotonic() + 10.0
    while not received:
        assert time.monotonic() < end_s
        try:
            sender.send(CONTROL_MODE, data)
        except OSError:
            time.sleep(0.02)
        received += [sample for sample in reader.take(10) if isinstance(sample, Sample)]
    assert MESSAGES["OffboardControlMode"].decode(received[0].cdr)["position"] is True
    senders.keep(())
    assert senders.at(address) is not sender
    assert domain
