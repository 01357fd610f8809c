"""The inspector of ROS 2 topics, without DDS and with a fake clock."""

from __future__ import annotations

import pytest

from gcs_server.links.base import UnusableTopic
from gcs_server.ros2 import inspection
from gcs_server.ros2.formats import TopicFormat
from gcs_server.ros2.inspection import Announcement, DomainTopics, MessageRate, TopicKey, TopicView
from gcs_server.ros2.inspector import DISCOVERY_S, READ_EVERY_S, Session, with_layouts
from gcs_server.ros2.message_types import HEADER, MESSAGES, MessageType
from gcs_server.ros2.topics import wire_name, wire_type
from tests.support.dds_samples import recorded_samples
from tests.support.px4_formats import address_formats

STATUS = "/fmu/out/vehicle_status_v1"
STATUS_TYPE = "px4_msgs::msg::dds_::VehicleStatus_"


def status_key(namespace: str = "px4_1") -> TopicKey:
    return TopicKey(f"rt/{namespace}{STATUS}" if namespace else f"rt{STATUS}", STATUS_TYPE)


class FakePort:
    """A fake DDS domain: the test sets its announcements and messages."""

    def __init__(self) -> None:
        self.announced: list[Announcement] = []
        self.messages: dict[TopicKey, list[bytes]] = {}
        self.overflowed = False
        self.refusal_reason: str | None = None
        self.open_topics: set[TopicKey] = set()

    def announce(self, *keys: TopicKey, publishes: bool = True) -> None:
        for key in keys:
            self.announced.append(Announcement(f"{key} {publishes}", publishes, key))

    def announcements(self) -> list[Announcement]:
        announced, self.announced = self.announced, []
        return announced

    def open(self, key: TopicKey, message: MessageType) -> str | None:
        self.open_topics.add(key)
        return self.refusal_reason

    def close(self, key: TopicKey) -> None:
        self.open_topics.discard(key)

    def take(self, key: TopicKey) -> tuple[list[bytes], bool]:
        return self.messages.pop(key, []), self.overflowed


class InspectionSetup:
    """A session with its port and time."""

    def __init__(self) -> None:
        self.port, self.now_s = FakePort(), 100.0
        self.session = Session(self.port, 0, self.now_s)

    def read(self, *namespaces: str, messages: dict[TopicKey, list[bytes]] | None = None) -> None:
        self.now_s += READ_EVERY_S
        self.port.messages |= messages or {}
        confirmed = {
            namespace: {wire_name(each.name, namespace): each.message for each in address_formats("1.16")}
            for namespace in namespaces
        }
        self.session.read(confirmed, self.now_s)

    def topics(self, namespace: str = "px4_1") -> dict[str, TopicView]:
        views = self.session.inspection(namespace, self.now_s).topics
        return {topic.name: topic for topic in views}


def test_why_topics_are_empty_is_said_with_vehicles_programs_layouts_and_what_is_lost(
    setup: InspectionSetup,
) -> None:
    setpoint, home = "/fmu/in/trajectory_setpoint", "/fmu/out/home_position"
    setup.port.announce(status_key(), TopicKey(f"rt{setpoint}", wire_type(MESSAGES["TrajectorySetpoint"])))
    setup.port.announce(TopicKey(f"rt/px4_1{home}", wire_type(MESSAGES["HomePosition"])))
    setup.port.announce(
        TopicKey(f"rt/px4_1{setpoint}", wire_type(MESSAGES["TrajectorySetpoint"])), publishes=False
    )
    setup.read("px4_1")
    assert setup.session.inspection("px4_1", setup.now_s).problems == ()  # before all have been discovered
    setup.now_s += DISCOVERY_S
    found = setup.session.inspection("px4_1", setup.now_s)
    assert (found.programs, found.vehicles) == (1, ("/px4_1",))
    assert found.problems == (
        f"A program publishes {setpoint}, but no vehicle subscribes to it; use /px4_1{setpoint}. "
        "Namespaces of vehicles in this domain: /px4_1.",
    )
    formats = [each for each in map(TopicFormat._make, address_formats("1.16")) if each.topic != home]
    unusable = {
        home: UnusableTopic("PX4 names 1, this server knows 2. Not available: home position"),
        "/fmu/out/airspeed": UnusableTopic("The vehicle has no topic x. Not available: y", awaited=True),
    }
    shown = with_layouts(found, formats, unusable)
    assert shown.versions == "v1.16"
    assert shown.problems == (f"{unusable[home].text}.", *found.problems)
    by_name = {each.name: each for each in shown.topics}
    status = next(each for each in formats if each.name == STATUS)
    assert by_name[f"/px4_1{STATUS}"].layout == f"{status.message_hash:08x}"
    assert by_name[f"/px4_1{home}"].layout is None
    assert by_name[f"/px4_1{home}"].unusable == f"{unusable[home].text}."
    assert (by_name[setpoint].layout, by_name[setpoint].unusable) == (None, None)


@pytest.fixture
def setup() -> InspectionSetup:
    return InspectionSetup()


def test_a_topic_has_type_rate_age_and_the_fields_of_its_last_message(setup: InspectionSetup) -> None:
    key = status_key()
    setup.port.announce(key)
    setup.port.announce(key, publishes=False)
    for _ in range(50):
        setup.read("px4_1", messages={key: [recorded_samples()[STATUS]] * 2})
    setup.read("px4_1")
    topic = setup.topics()[f"/px4_1{STATUS}"]
    assert (topic.type, topic.publishers, topic.subscribers) == ("px4_msgs/msg/VehicleStatus", 1, 1)
    assert topic.rate_hz == pytest.approx(20.0, rel=0.02)
    assert topic.age_s == pytest.approx(READ_EVERY_S)
    assert topic.value is not None
    assert topic.value["system_id"] == 1
    assert topic.size_bytes == len(recorded_samples()[STATUS])
    assert topic.problem is None


def test_a_topic_of_unknown_type_is_listed_without_being_read(setup: InspectionSetup) -> None:
    key = TopicKey("rt/camera/image", "sensor_msgs::msg::dds_::Image_")
    setup.port.announce(key)
    setup.read("px4_1")
    topic = setup.topics()["/camera/image"]
    assert (topic.type, topic.type_known, topic.rate_hz) == ("sensor_msgs/msg/Image", False, None)
    assert setup.port.open_topics == set()


def test_one_topic_with_two_types_is_shown_twice(setup: InspectionSetup) -> None:
    key_of_another_type = TopicKey(status_key().name, "px4_msgs::msg::dds_::VehicleAttitude_")
    setup.port.announce(status_key(), key_of_another_type)
    setup.read("px4_1")
    views = setup.session.inspection("px4_1", setup.now_s).topics
    assert [topic.type for topic in views] == ["px4_msgs/msg/VehicleAttitude", "px4_msgs/msg/VehicleStatus"]


def test_a_malformed_message_is_reported_until_a_valid_message_arrives(setup: InspectionSetup) -> None:
    key = status_key()
    setup.port.announce(key)
    setup.read("px4_1", messages={key: [HEADER + bytes(5)]})
    topic = setup.topics()[f"/px4_1{STATUS}"]
    assert topic.value is None
    assert topic.problem == "The last message is malformed: 9 bytes instead of the 84 of VehicleStatus."
    setup.read("px4_1", messages={key: [recorded_samples()[STATUS]]})
    assert setup.topics()[f"/px4_1{STATUS}"].problem is None


def test_topics_of_other_vehicles_are_neither_read_nor_shown(setup: InspectionSetup) -> None:
    vehicle_topic, other_vehicle_topic, common_topic = (
        status_key(),
        status_key("px4_2"),
        TopicKey("rt/clock", "x::msg::dds_::Clock_"),
    )
    setup.port.announce(other_vehicle_topic, vehicle_topic, common_topic)
    setup.read("px4_1")
    assert list(setup.topics()) == [f"/px4_1{STATUS}", "/clock"]
    assert setup.port.open_topics == {vehicle_topic}


def test_a_vehicle_without_a_namespace_owns_the_topics_under_fmu(setup: InspectionSetup) -> None:
    setup.port.announce(status_key(""), status_key("px4_1"), TopicKey("rt/fmu/in/x", "x"))
    setup.read("")
    assert list(setup.topics("")) == ["/fmu/in/x", STATUS]
    assert list(setup.topics("px4_1")) == [f"/px4_1{STATUS}"]


def test_reading_ends_when_no_client_inspects_the_vehicle_or_the_topic_ends(setup: InspectionSetup) -> None:
    first, second = status_key(), status_key("px4_2")
    setup.port.announce(first, second)
    setup.read("px4_1", "px4_2")
    assert setup.port.open_topics == {first, second}
    setup.read("px4_2")
    assert setup.port.open_topics == {second}
    setup.port.announced = [Announcement(f"{second} True", True, None)]
    setup.read("px4_2")
    assert setup.port.open_topics == set()
    assert setup.topics("px4_2") == {}


def test_a_topic_that_dds_cannot_read_states_the_reason(setup: InspectionSetup) -> None:
    setup.port.refusal_reason = "DDS cannot read this topic (out of resources)."
    setup.port.announce(status_key())
    setup.read("px4_1")
    assert setup.topics()[f"/px4_1{STATUS}"].problem == "DDS cannot read this topic (out of resources)."


def test_if_messages_were_dropped_the_rate_is_a_lower_bound(setup: InspectionSetup) -> None:
    key = status_key()
    setup.port.announce(key)
    setup.port.overflowed = True
    for _ in range(5):
        setup.read("px4_1", messages={key: [recorded_samples()[STATUS]] * 128})
    topic = setup.topics()[f"/px4_1{STATUS}"]
    assert topic.rate_is_minimum
    assert topic.rate_hz == pytest.approx(1280, rel=0.05)


def test_endpoints_topics_and_names_are_limited(
    monkeypatch: pytest.MonkeyPatch, setup: InspectionSetup
) -> None:
    monkeypatch.setattr(inspection, "MAX_ENDPOINTS", 300)
    setup.port.announce(TopicKey("rt/" + "x" * 300, "y"))
    setup.port.announce(*(TopicKey(f"rt/hostile_{n:03}", STATUS_TYPE) for n in range(400)))
    setup.read("px4_1")
    shown = setup.session.inspection("px4_1", setup.now_s)
    assert (len(shown.topics), shown.left_out) == (200, 100)
    assert len(setup.port.open_topics) == 200


def test_the_rate_falls_when_a_topic_stops() -> None:
    rate = MessageRate()
    assert rate.hz(0.0) is None
    for n in range(11):
        rate.add(1, n * 0.5)
    assert rate.hz(5.0) == pytest.approx(2.0)
    assert rate.hz(9.0) == pytest.approx(10 / 9.0)
    assert rate.hz(30.0) is None


def test_announcements_change_the_counts_of_publishers_and_subscribers() -> None:
    domain, key = DomainTopics(), status_key()
    domain.apply([Announcement("a", True, key), Announcement("b", False, key), Announcement("a", True, key)])
    assert domain.count(key) == (1, 1)
    domain.apply([Announcement("a", True, None), Announcement("unknown", True, None)])
    assert domain.count(key) == (0, 1)
