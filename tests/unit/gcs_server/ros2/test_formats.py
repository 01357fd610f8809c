"""Which layout a topic has is asked of the vehicle: used, converted or refused with words."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.ros2.external_mode import SENT_TYPES
from gcs_server.ros2.formats import (
    ATTEMPTS,
    MAX_ENDPOINTS,
    MAX_NAME,
    REMEDY,
    REPEAT_S,
    REQUEST,
    SLOW_REPEAT_S,
    USED,
    AnnouncedTopic,
    AnnouncedTopics,
    VehicleFormats,
)
from gcs_server.ros2.inspection import Announcement, TopicKey
from gcs_server.ros2.message_types import LAYOUTS, MESSAGES, VERSIONS, MalformedMessage
from gcs_server.ros2.topics import COMMAND, STATUS, SUBSCRIPTIONS, wire_type
from gcs_server.ros2.vehicle_link import VehicleLink
from gcs_server.streamer.schedule.external_modes import READ_TYPES
from gcs_server.streamer.transport.ros2 import TOPIC_TYPES
from tests.support.px4_formats import (
    VERSIONED,
    answer,
    ask_everything,
    formats_of_version,
    px4_hashes,
    px4_name,
    px4_topics,
)

FLAGS, ATTITUDE_SETPOINT = "/fmu/out/failsafe_flags", "/fmu/in/vehicle_attitude_setpoint"
CHANGED = {
    "1.17": set[str](),
    "1.16": {
        FLAGS, ATTITUDE_SETPOINT, "/fmu/out/vehicle_gps_position", "/fmu/out/battery_status",
        "/fmu/out/home_position", "/fmu/out/arming_check_request", "/fmu/in/arming_check_reply",
    },
}  # fmt: skip
CHANGED["1.15"] = CHANGED["1.16"] - {ATTITUDE_SETPOINT} | {
    STATUS, "/fmu/out/vehicle_local_position", "/fmu/out/vehicle_global_position",
    "/fmu/out/position_setpoint_triplet",
}  # fmt: skip
"""Topics whose layout is converted to that inside the server."""
REFUSED = {"1.17": set[str](), "1.16": set[str](), "1.15": {ATTITUDE_SETPOINT}}
"""Topics with a layout that the server does not use: v1.15's attitude setpoint has the angles twice."""
ANSWERING = sorted(VERSIONED)


def test_every_topic_that_is_read_or_sent_has_a_type_and_a_use() -> None:
    types = {each.name: each.type for each in SUBSCRIPTIONS} | READ_TYPES | SENT_TYPES | dict(TOPIC_TYPES)
    assert types == {topic: use.type for topic, use in USED.items()}
    assert all(use.lost for use in USED.values())
    assert all(len(topic) - 1 <= MAX_NAME for topic in USED)


@pytest.mark.parametrize("topic", USED)
@pytest.mark.parametrize("version", [*ANSWERING, "1.14", "unknown"])
def test_a_topic_of_each_version_is_used_or_converted_or_refused_with_words(version: str, topic: str) -> None:
    layouts = "1.16" if version in ("1.14", "unknown") else version
    hashes = px4_hashes(layouts)
    if version == "unknown":
        hashes = {name: value ^ 0x5A5A5A5A for name, value in hashes.items()}
    formats = VehicleFormats("px4_1")
    formats.announce(px4_topics(layouts))
    ask_everything(formats, {} if version == "1.14" else hashes)
    if version in ANSWERING and topic not in REFUSED[version]:
        known = formats.usable[topic]
        assert known.name == px4_name(topic, version)
        assert topic not in formats.unusable
        is_converted = known.message is not MESSAGES[known.type]
        assert is_converted is (topic in CHANGED[version])
        data = known.to_vehicle(MESSAGES[known.type].encode({"timestamp": 7}))
        assert len(data) - 4 == VERSIONS[version][known.type].size
        assert MESSAGES[known.type].decode(known.to_server(data))["timestamp"] == 7
        return
    assert topic not in formats.usable
    text, problems = formats.unusable[topic].text, " ".join(formats.problems())
    assert text.endswith(f"Not available: {USED[topic].lost}")
    if version == "1.14":
        assert f"px4_1 does not answer {REQUEST}" in problems
    else:
        own, name = MESSAGES[USED[topic].type].hash, topic.rpartition("/")[2]
        expected = hashes[name] if version == "unknown" else 0x8FE976CB
        assert f"/px4_1{px4_name(topic, layouts)} has a layout that this server does not know" in text
        assert f"PX4 names it {expected:08x}" in text or version == "1.15"
        assert f"this server knows {own:08x} (v1." in text
        assert problems.endswith(REMEDY)


def test_a_topic_that_the_vehicle_does_not_have_or_of_another_type_is_refused() -> None:
    formats = VehicleFormats("")
    formats.announce([AnnouncedTopic(STATUS, STATUS, "HomePosition")])
    ask_everything(formats, px4_hashes("1.16"))
    assert not formats.usable
    (problem,) = formats.problems()
    assert "/fmu/out/vehicle_status has the type HomePosition instead of VehicleStatus" in problem
    assert formats.unusable[COMMAND].text == f"The vehicle has no topic {COMMAND}. Not available: commands"
    assert COMMAND not in problem, "a topic that is not there is no problem of its own"


def test_status_is_asked_first_and_each_topic_once() -> None:
    formats = VehicleFormats("px4_1")
    formats.announce(px4_topics("1.17"))
    request = formats.request(10.0, 0.0)
    assert request is not None
    name = bytes(MESSAGES["MessageFormatRequest"].decode(request)["topic_name"]).rstrip(b"\0")
    assert name == b"fmu/out/vehicle_status"
    assert formats.request(10.0 + REPEAT_S / 2, 0.0) is None
    formats.on_response(MESSAGES["MessageFormatResponse"].decode(answer(request, px4_hashes("1.17"))))
    assert STATUS in formats.usable
    # mode_completed is one topic inside PX4
    assert ask_everything(formats, px4_hashes("1.17"), 10.0) == len(USED) - 2
    assert formats.unusable == {}


def test_a_silent_vehicle_is_asked_again_until_it_answers_and_reported_after_six_requests() -> None:
    formats = VehicleFormats("px4_1")
    formats.announce(px4_topics("1.16"))
    times = [tick / 50 for tick in range(1000) if formats.request(tick / 50, float("-inf")) is not None]
    assert times[:ATTEMPTS] == pytest.approx([n * REPEAT_S for n in range(ATTEMPTS)], abs=0.02 * ATTEMPTS)
    assert len(times) == pytest.approx(ATTEMPTS + (20.0 - ATTEMPTS * REPEAT_S) / SLOW_REPEAT_S, abs=2)
    (problem,) = formats.problems()
    assert "PX4 v1.14 and older cannot answer" in problem
    ask_everything(formats, px4_hashes("1.16"), 20.0)  # DDS has connected late
    assert formats.problems() == []
    assert formats.usable.keys() == USED.keys()


def test_an_answer_that_is_lost_does_not_delay_the_other_topics() -> None:
    formats, hashes = VehicleFormats("px4_1"), px4_hashes("1.16")
    formats.announce(px4_topics("1.16"))
    command = hashes.pop("vehicle_command")  # its answer is lost
    ask_everything(formats, hashes)
    assert formats.unusable.keys() == {COMMAND}
    assert (
        f"PX4 did not answer which layout /px4_1{COMMAND} has. Not available: commands"
        in formats.problems()[0]
    )
    ask_everything(formats, {"vehicle_command": command}, 30.0)
    assert formats.unusable == {}


def test_a_topic_that_px4_does_not_know_and_another_protocol_are_reported() -> None:
    formats = VehicleFormats("")
    formats.announce(px4_topics("1.16"))
    request = formats.request(0.0, 0.0)
    assert request is not None
    response = MESSAGES["MessageFormatResponse"].decode(answer(request, {}))
    formats.on_response(response)
    assert formats.unusable[STATUS].text.startswith("PX4 does not know the topic /fmu/out/vehicle_status_v1.")
    formats.on_response({**response, "protocol_version": 2})
    assert "answers in version 2 of the message format check" in formats.problems()[0]


def test_another_px4_in_the_namespace_is_asked_anew() -> None:
    formats = formats_of_version("1.16")
    before = formats.usable[FLAGS]
    formats.reset()
    assert not formats.usable
    formats.announce(px4_topics("1.17"))
    ask_everything(formats, px4_hashes("1.17"))
    assert formats.usable[FLAGS] != before
    assert formats.usable["/fmu/out/battery_status"].name == "/fmu/out/battery_status_v1"


def test_a_vehicle_whose_status_ends_is_asked_again_once_a_second() -> None:
    formats = formats_of_version("1.16")
    assert formats.request(100.0, 99.0) is None
    assert formats.request(103.0, 99.0) is not None
    assert formats.request(103.5, 99.0) is None
    assert formats.request(104.0, 99.0) is not None


def test_only_the_topics_of_one_participant_are_a_vehicles_topics() -> None:
    topics = AnnouncedTopics()

    def announce(key: str, name: str, participant: str, *, publishes: bool = True) -> None:
        topic = TopicKey(f"rt/px4_1{name}", wire_type(MESSAGES["VehicleStatus"]))
        topics.apply(Announcement(key, publishes, topic, participant))

    announce("a", "/fmu/out/vehicle_status_v1", "px4")
    announce("b", "/fmu/out/vehicle_status", "translation node")
    announce("c", "/fmu/in/vehicle_command", "px4", publishes=False)
    announce("d", "/fmu/in/vehicle_command", "program")  # a program that also commands
    names = [each.name for each in topics.of("px4_1", "px4")]
    assert names == ["/fmu/out/vehicle_status_v1", "/fmu/in/vehicle_command"]
    assert len(topics.of("px4_1", None)) == 3
    assert topics.of("px4_2", None) == []
    topics.apply(Announcement("a", True, None))
    assert [each.name for each in topics.of("px4_1", "px4")] == ["/fmu/in/vehicle_command"]
    for number in range(MAX_ENDPOINTS + 10):
        announce(f"e{number}", f"/fmu/out/flood_{number}", "flood")
    assert len(topics.of("px4_1", None)) == MAX_ENDPOINTS


READ = [each.name for each in SUBSCRIPTIONS]


@given(st.sampled_from(ANSWERING), st.sampled_from(ANSWERING), st.sampled_from(READ), st.binary(min_size=1))
def test_a_vehicle_link_never_uses_a_message_of_another_layout_than_the_confirmed_one(
    confirmed: str, sent: str, topic: str, seed: bytes
) -> None:
    """A link whose vehicle has confirmed one version receives a message of another, as after an exchange of
    the firmware that nobody noticed: it is converted, refused or of the same layout."""
    link = VehicleLink("px4_1", _NoSender(), 255)
    link.formats = formats_of_version(confirmed)
    kind = USED[topic].type
    own, other = VERSIONS[confirmed][kind], VERSIONS[sent][kind]
    data = (seed * (other.size // len(seed) + 1))[: other.size]
    values: dict[str, Any] = other.decode(b"\0\1\0\0" + data)
    message = other.encode(values)
    link.to_frames([(topic, message)], 0.0)  # never raises
    if own.hash == other.hash or abs(own.size - other.size) < 4:
        return  # the hash, not the length, distinguishes layouts of one length
    with pytest.raises(MalformedMessage):
        link.formats.usable[topic].to_server(message)


class _NoSender:
    def send(self, topic: str, data: bytes) -> None:
        raise AssertionError("a received message sends nothing")


def test_layouts_of_one_length_are_distinguished_by_their_hash_only() -> None:
    same_length = {
        name
        for name, message_hash in LAYOUTS
        for other in LAYOUTS
        if other[0] == name
        and other[1] != message_hash
        and abs(LAYOUTS[other].size - LAYOUTS[name, message_hash].size) < 4
    }
    assert {"VehicleStatus", "BatteryStatus", "ArmingCheckReply"} <= same_length
