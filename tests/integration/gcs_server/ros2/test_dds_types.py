"""Links have threads of their own, and each creates its topics when it discovers a vehicle."""

from __future__ import annotations

import dataclasses
import os
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("cyclonedds")

from cyclonedds.domain import DomainParticipant
from cyclonedds.topic import Topic

from gcs_server.ros2.dds import open_domain
from gcs_server.ros2.dds_types import idl_type
from gcs_server.ros2.message_types import MESSAGES, MessageType

DOMAIN = 100 + os.getpid() % 100


def create_topic(message: MessageType, delay_s: float) -> None:
    """Creates a topic of this type on a new participant, after a delay.

    Raises:
        DDSException: DDS cannot create the topic.
    """
    participant = DomainParticipant(DOMAIN)
    time.sleep(delay_s)
    Topic(participant, f"rt/{delay_s}", idl_type(message))


def test_a_second_thread_can_use_a_type_at_any_time_while_the_first_creates_it() -> None:
    domain = open_domain(DOMAIN, None)
    with ThreadPoolExecutor(2) as threads:
        for delay_ms in range(30):
            message = dataclasses.replace(MESSAGES["VehicleLocalPosition"])  # a new object has no cached type
            for created in threads.map(create_topic, [message] * 2, [0.0, delay_ms / 1000]):
                assert created is None
    assert domain  # this reference keeps the domain open
