"""A vehicle's topics in versions that the server does not know."""

from __future__ import annotations

import pytest

from gcs_server.ros2.external_mode import SENT_TYPES
from gcs_server.ros2.topics import COMMAND, SUBSCRIPTIONS, wire_name
from gcs_server.ros2.versions import MAX_TOPICS, REMEDY, USE_OF_TOPIC, TopicVersions
from gcs_server.streamer.schedule.external_modes import READ_TYPES
from gcs_server.streamer.transport.ros2 import TOPIC_TYPES

READ_TOPICS = {topic.name for topic in SUBSCRIPTIONS} | set(READ_TYPES)
SENT_TOPICS = {COMMAND} | set(SENT_TYPES) | set(TOPIC_TYPES)


def announce(versions: TopicVersions, *names: str, namespace: str = "px4_1") -> None:
    for name in names:
        versions.add_topic(wire_name(name, namespace), publishes="/out/" in name)


def test_the_use_of_every_read_and_sent_topic_is_described() -> None:
    assert set(USE_OF_TOPIC) == READ_TOPICS | SENT_TOPICS


def test_topics_of_the_known_versions_cause_no_problem() -> None:
    versions = TopicVersions()
    announce(versions, *USE_OF_TOPIC)
    assert versions.problems() == []


@pytest.mark.parametrize("topic", sorted(USE_OF_TOPIC))
def test_an_unknown_version_of_any_topic_is_reported_with_the_missing_function(topic: str) -> None:
    versions = TopicVersions()
    known_version = 1 if topic.endswith("_v1") else 0
    unknown_topic = f"{topic.removesuffix('_v1')}_v7"
    announce(versions, *(name for name in USE_OF_TOPIC if name != topic), unknown_topic)
    (text,) = versions.problems()
    assert text == (
        f"/px4_1{unknown_topic} has version 7, but this server knows version {known_version}. "
        f"Not available: {USE_OF_TOPIC[topic]}. {REMEDY}"
    )


def test_a_known_version_beside_another_version_causes_no_problem() -> None:
    versions = TopicVersions()
    announce(versions, "/fmu/out/vehicle_status", "/fmu/out/vehicle_status_v1", "/fmu/in/vehicle_command_v1")
    announce(versions, COMMAND)
    assert versions.problems() == []


def test_topics_that_other_programs_subscribe_or_publish_are_ignored() -> None:
    versions = TopicVersions()
    versions.add_topic("rt/fmu/out/vehicle_attitude_v9", publishes=False)
    versions.add_topic("rt/fmu/in/vehicle_command_v9", publishes=True)
    versions.add_topic("rt/fmu/out/battery_voltage_v9", publishes=True)
    assert versions.problems() == []


def test_each_vehicle_has_one_problem_which_states_the_number_of_further_topics() -> None:
    versions = TopicVersions()
    announce(versions, "/fmu/out/vehicle_attitude_v1", namespace="")
    announce(versions, *(f"{topic}_v9" for topic in sorted(SENT_TOPICS)[:5]))
    first, second = versions.problems()
    assert first.startswith("/fmu/out/vehicle_attitude_v1 has version 1, but")
    assert ". Further topics with unknown versions: 2. " in second
    assert versions.problems("px4_1") == [second]
    assert versions.problems("px4_2") == []


def test_the_number_of_problems_is_limited() -> None:
    versions = TopicVersions()
    for number in range(MAX_TOPICS + 100):
        announce(versions, "/fmu/out/vehicle_attitude_v1", namespace=f"v{number}")
    assert len(versions.problems()) == MAX_TOPICS
