"""The inspector of ROS 2 topics on real DDS."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator

import pytest

pytest.importorskip("cyclonedds")

from gcs_server.ros2.dds import DdsUnavailable, open_domain
from gcs_server.ros2.dds_inspection import InspectionPort
from gcs_server.ros2.formats import TopicFormat
from gcs_server.ros2.inspection import Inspection, TopicView
from gcs_server.ros2.inspector import DomainInspector
from gcs_server.ros2.message_types import MESSAGES
from tests.support.dds_publisher import VEHICLE_STATUS, Publisher, status_bytes
from tests.support.px4_formats import address_formats

DOMAIN = 53
NAMESPACE = f"inspect_{os.getpid()}"
SENSORS = "/fmu/out/sensor_combined"
FORMATS = (
    *address_formats("1.16"),
    TopicFormat(SENSORS, SENSORS, "SensorCombined", MESSAGES["SensorCombined"].hash),
)
"""The layouts that the vehicle has confirmed."""


@pytest.fixture(autouse=True)
def _domain() -> Iterator[None]:
    domain = open_domain(DOMAIN, None)
    yield
    assert domain  # this reference keeps the domain open


@pytest.fixture
def inspector() -> Iterator[DomainInspector]:
    domain_inspector = DomainInspector(DOMAIN, None, InspectionPort)
    yield domain_inspector
    domain_inspector.close()
    assert not domain_inspector.running


def until(condition: Callable[[], object], repeated_work: Callable[[], None] = lambda: None) -> None:
    end_s = time.monotonic() + 15.0
    while not condition():
        assert time.monotonic() < end_s
        repeated_work()
        time.sleep(0.02)


def topics(inspection: Inspection) -> dict[str, TopicView]:
    prefix = f"/{NAMESPACE}"
    return {
        each.name.removeprefix(prefix): each for each in inspection.topics if each.name.startswith(prefix)
    }


def test_topics_that_no_link_reads_are_shown_with_rate_and_value(inspector: DomainInspector) -> None:
    vehicles = [Publisher(DOMAIN, NAMESPACE)]
    values = {"accelerometer_m_s2": (0.0, 0.5, -9.75)}

    def publish() -> None:
        vehicles[0].send(VEHICLE_STATUS, status_bytes(system_id=7))
        vehicles[0].send(SENSORS, MESSAGES["SensorCombined"].encode(values), "SensorCombined")

    def is_shown() -> bool:
        found = topics(inspector.inspect(NAMESPACE, FORMATS))
        return all(name in found and found[name].rate_hz is not None for name in (VEHICLE_STATUS, SENSORS))

    until(is_shown, publish)
    found = topics(inspector.inspect(NAMESPACE, FORMATS))
    assert found[VEHICLE_STATUS].value is not None
    assert found[VEHICLE_STATUS].value["system_id"] == 7
    sensors = found[SENSORS]
    assert sensors.value is not None
    assert sensors.value["accelerometer_m_s2"] == values["accelerometer_m_s2"]
    assert (sensors.type, sensors.publishers, sensors.subscribers) == ("px4_msgs/msg/SensorCombined", 1, 0)
    vehicles.clear()  # deletes the publisher
    until(lambda: SENSORS not in topics(inspector.inspect(NAMESPACE, FORMATS)))


def test_a_flooded_topic_is_shown_as_flooded_and_other_topics_are_read(inspector: DomainInspector) -> None:
    vehicle, flooding_publisher = Publisher(DOMAIN, NAMESPACE), Publisher(DOMAIN, NAMESPACE)

    def publish() -> None:
        vehicle.send(VEHICLE_STATUS, status_bytes())
        for _ in range(200):
            flooding_publisher.send(SENSORS, MESSAGES["SensorCombined"].encode({}), "SensorCombined")

    def is_shown() -> bool:
        found = topics(inspector.inspect(NAMESPACE, FORMATS))
        has_both_topics = {VEHICLE_STATUS, SENSORS} <= found.keys()
        return (
            has_both_topics and found[SENSORS].rate_is_minimum and found[VEHICLE_STATUS].rate_hz is not None
        )

    until(is_shown, publish)


def test_topics_are_read_only_while_they_are_requested(
    inspector: DomainInspector, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not inspector.running
    assert inspector.inspect(NAMESPACE, FORMATS).state == "starting"
    assert inspector.running
    monkeypatch.setattr("gcs_server.ros2.inspector.KEEP_READING_S", 0.2)
    until(lambda: not inspector.running)
    assert inspector.inspect(NAMESPACE, FORMATS).state == "starting"
    assert inspector.running


def test_a_domain_that_cannot_be_opened_is_reported_and_opened_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("gcs_server.ros2.inspector.RETRY_S", 0.1)
    errors = ["DDS domain 53 cannot be inspected (Out of resources)."]

    def open_port(domain_id: int, interface: str | None) -> InspectionPort:
        if errors:
            raise DdsUnavailable(errors[0])
        return InspectionPort(domain_id, interface)

    inspector = DomainInspector(DOMAIN, None, open_port)
    until(lambda: inspector.inspect(NAMESPACE, FORMATS).problem == errors[0])
    assert inspector.inspect(NAMESPACE, FORMATS).state == "failed"
    errors.clear()
    until(lambda: inspector.inspect(NAMESPACE, FORMATS).state == "open")
    inspector.close()
