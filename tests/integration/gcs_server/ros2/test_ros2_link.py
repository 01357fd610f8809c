"""The ROS 2 link on real DDS: publishers in this process act as vehicles."""

from __future__ import annotations

import asyncio
import functools
import os
import subprocess
import sys
import time
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

import pytest

pytest.importorskip("cyclonedds")

from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from gcs_server.links.base import DdsAddress, Peer
from gcs_server.mavlink.codec import FrameParser
from gcs_server.mavlink.tables import NAMES
from gcs_server.ros2.dds import DdsPort, DdsUnavailable, configuration, open_domain
from gcs_server.ros2.dds_types import idl_type
from gcs_server.ros2.formats import USED, TopicFormat, formats_of
from gcs_server.ros2.link import Ros2Link
from gcs_server.ros2.message_types import MESSAGES, VERSIONS
from gcs_server.ros2.topics import STATUS, wire_name
from tests.support.dds_publisher import VEHICLE_STATUS, Publisher, status_bytes
from tests.support.dds_samples import recorded_samples
from tests.support.px4_formats import px4_hashes

DOMAIN = 49
NAMESPACE = f"link_{os.getpid()}"
"""Unique: tests that run at the same time share the loopback interface."""


def in_event_loop(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Runs a test in an event loop of its own."""

    @functools.wraps(test)
    def run(**parameters: Any) -> None:
        asyncio.run(test(**parameters))

    return run


def _ignore(*_arguments: object) -> None:
    """A callback that does nothing."""


class LinkFrames:
    """A running link, and the system id and message name of each frame that it received, by peer."""

    def __init__(self, namespace: str | None = NAMESPACE) -> None:
        self.frames: dict[str, list[tuple[int, str]]] = {}
        self.link = Ros2Link("ros2", f"ros2://{DOMAIN}", DOMAIN, namespace, None, DdsPort)
        self._parsers: dict[str, FrameParser] = {}
        self.link.start(self._on_data, lambda _peer: None, lambda: None)

    def _on_data(self, data: bytes, peer: Peer, now_s: float) -> None:
        parser = self._parsers.setdefault(peer.name, FrameParser())
        frames = [(frame.system_id, NAMES[frame.msg_id]) for frame in parser.feed(data, now_s)]
        self.frames.setdefault(peer.name, []).extend(frames)

    def formats(self) -> dict[str, TopicFormat]:
        """The topics whose layout the vehicle has confirmed."""
        peer = Peer(NAMESPACE, dds=DdsAddress(DOMAIN, None, NAMESPACE))
        address = self.link.dds_address(peer)
        assert address is not None
        return formats_of(address, USED)

    def names(self, peer: str = NAMESPACE) -> set[str]:
        return {name for _, name in self.frames.get(peer, ())}

    async def until(
        self, condition: Callable[[], object], repeated_work: Callable[[], None] = lambda: None
    ) -> None:
        end_s = time.monotonic() + 10.0
        while not condition():
            assert time.monotonic() < end_s, (self.frames, self.link.info())
            repeated_work()
            await asyncio.sleep(0.02)


@pytest.fixture(autouse=True)
def _domain() -> Iterator[None]:
    domain = open_domain(DOMAIN, None)
    yield
    assert domain  # this reference keeps the domain open


@in_event_loop
async def test_a_vehicle_is_found_by_its_status_and_its_messages_become_frames() -> None:
    link_frames, vehicle = LinkFrames(), Publisher(DOMAIN, NAMESPACE)

    def publish() -> None:
        vehicle.send(VEHICLE_STATUS, status_bytes(system_id=7))
        topic = "/fmu/out/vehicle_land_detected"
        vehicle.send(topic, recorded_samples()[topic], "VehicleLandDetected")

    await link_frames.until(lambda: "EXTENDED_SYS_STATE" in link_frames.names(), publish)
    assert {system for system, _ in link_frames.frames[NAMESPACE]} == {7}
    assert link_frames.link.info().state == "open"
    assert link_frames.link.info().peers == (NAMESPACE,)
    await link_frames.link.close()
    assert link_frames.link.info().state == "closed"


@in_event_loop
async def test_each_vehicle_of_the_domain_is_a_separate_peer() -> None:
    namespaces = [f"{NAMESPACE}_a", f"{NAMESPACE}_b"]
    link_frames, vehicles = LinkFrames(None), [Publisher(DOMAIN, name) for name in namespaces]

    def publish() -> None:
        for number, vehicle in enumerate(vehicles, 1):
            vehicle.send(VEHICLE_STATUS, status_bytes(system_id=number))

    await link_frames.until(lambda: set(namespaces) <= link_frames.frames.keys(), publish)
    for number, name in enumerate(namespaces, 1):
        assert {system for system, _ in link_frames.frames[name]} == {number}
    await link_frames.link.close()


@in_event_loop
async def test_malformed_and_flooding_samples_affect_only_their_vehicle() -> None:
    bad_namespace, good_namespace = f"{NAMESPACE}_bad", f"{NAMESPACE}_good"
    link_frames, flooding_publisher, vehicle = (
        LinkFrames(None),
        Publisher(DOMAIN, bad_namespace),
        Publisher(DOMAIN, good_namespace),
    )

    def publish() -> None:
        for _ in range(200):
            flooding_publisher.send(VEHICLE_STATUS, status_bytes(system_id=0))
        vehicle.send(VEHICLE_STATUS, status_bytes())

    def is_reported() -> bool:
        return f"/{bad_namespace}{VEHICLE_STATUS} cannot be used" in link_frames.link.info().detail

    await link_frames.until(
        lambda: "HEARTBEAT" in link_frames.names(good_namespace) and is_reported(), publish
    )
    assert not link_frames.names(bad_namespace)
    assert link_frames.link.faults.count == 0
    await link_frames.link.close()


@in_event_loop
async def test_a_layout_that_the_server_does_not_know_is_reported_and_not_read() -> None:
    hashes = px4_hashes("1.16") | {"vehicle_status": 0x0BADF00D}
    link_frames, vehicle = LinkFrames(), Publisher(DOMAIN, NAMESPACE, hashes)

    def is_reported() -> bool:
        return "PX4 names it 0badf00d, this server knows f779fa65" in link_frames.link.info().detail

    await link_frames.until(is_reported, lambda: vehicle.send(VEHICLE_STATUS, status_bytes()))
    assert not link_frames.frames
    await link_frames.link.close()


@in_event_loop
async def test_a_vehicle_that_does_not_answer_is_reported_and_read_once_it_answers() -> None:
    link_frames, vehicle = LinkFrames(), Publisher(DOMAIN, NAMESPACE, {})

    def publish() -> None:
        vehicle.send(VEHICLE_STATUS, status_bytes())

    await link_frames.until(lambda: "PX4 v1.14 and older" in link_frames.link.info().detail, publish)
    assert not link_frames.frames
    vehicle.hashes = px4_hashes("1.16")
    await link_frames.until(lambda: "HEARTBEAT" in link_frames.names(), publish)
    await link_frames.link.close()


@in_event_loop
async def test_after_a_change_of_the_firmware_the_topics_are_read_in_their_new_layouts() -> None:
    link_frames, flags = LinkFrames(), "/fmu/out/failsafe_flags"
    vehicles = [Publisher(DOMAIN, NAMESPACE)]

    def publish(version: str) -> None:
        vehicles[0].send(VEHICLE_STATUS, status_bytes())
        sent = {"attitude_invalid": True}
        vehicles[0].send(flags, VERSIONS[version]["FailsafeFlags"].encode(sent), "FailsafeFlags")

    await link_frames.until(lambda: "SYS_STATUS" in link_frames.names(), lambda: publish("1.16"))
    await link_frames.until(lambda: flags in link_frames.formats(), lambda: publish("1.16"))
    assert link_frames.formats()[flags].message is VERSIONS["1.16"]["FailsafeFlags"]
    vehicles.clear()
    vehicles.append(Publisher(DOMAIN, NAMESPACE, version="1.17"))

    def is_read_anew() -> bool:
        formats = link_frames.formats()
        return flags in formats and formats[flags].message is VERSIONS["1.17"]["FailsafeFlags"]

    await link_frames.until(is_read_anew, lambda: publish("1.17"))
    assert link_frames.link.faults.count == 0
    await link_frames.link.close()


@in_event_loop
async def test_only_the_first_of_two_vehicles_in_one_namespace_is_read() -> None:
    link_frames, first_vehicle, second_vehicle = (
        LinkFrames(),
        Publisher(DOMAIN, NAMESPACE),
        Publisher(DOMAIN, NAMESPACE),
    )
    await link_frames.until(
        lambda: "HEARTBEAT" in link_frames.names(),
        lambda: first_vehicle.send(VEHICLE_STATUS, status_bytes(system_id=1)),
    )

    def publish() -> None:
        first_vehicle.send(VEHICLE_STATUS, status_bytes(system_id=1))
        second_vehicle.send(VEHICLE_STATUS, status_bytes(system_id=2))

    await link_frames.until(lambda: "Several vehicles publish" in link_frames.link.info().detail, publish)
    assert {system for system, _ in link_frames.frames[NAMESPACE]} == {1}
    await link_frames.link.close()


@pytest.mark.parametrize(
    ("topic", "message", "text"),
    [
        (VEHICLE_STATUS, "HomePosition", "has the type HomePosition instead of VehicleStatus"),
        ("/fmu/out/vehicle_attitude", "HomePosition", "has the type HomePosition instead of VehicleAttitude"),
    ],
)
@in_event_loop
async def test_a_topic_of_another_type_is_reported_and_not_read(topic: str, message: str, text: str) -> None:
    link_frames, vehicle = LinkFrames(), Publisher(DOMAIN, NAMESPACE)

    def publish() -> None:
        vehicle.send(topic, bytes(100), message)
        if topic != VEHICLE_STATUS:
            vehicle.send(VEHICLE_STATUS, status_bytes())

    def is_reported() -> bool:
        is_read = topic == VEHICLE_STATUS or bool(link_frames.frames)
        return is_read and text in link_frames.link.info().detail

    await link_frames.until(is_reported, publish)  # the type is known before the other topics are read
    assert bool(link_frames.frames) is (topic != VEHICLE_STATUS)
    await link_frames.link.close()


@in_event_loop
async def test_a_command_topic_of_an_unknown_layout_is_reported_and_the_vehicle_is_still_read() -> None:
    hashes = px4_hashes("1.16") | {"vehicle_command": 0x0BADF00D}
    link_frames, vehicle = LinkFrames(), Publisher(DOMAIN, NAMESPACE, hashes)
    topic = wire_name("/fmu/in/vehicle_command_v7", NAMESPACE)
    command_topic = Topic(vehicle.participant, topic, idl_type(MESSAGES["VehicleCommand"]))
    reader = DataReader(vehicle.participant, command_topic)

    def is_reported() -> bool:
        text = "/fmu/in/vehicle_command_v7 has a layout that this server does not know: PX4 names it 0badf00d"
        return text in link_frames.link.info().detail

    await link_frames.until(
        lambda: is_reported() and "HEARTBEAT" in link_frames.names(),
        lambda: vehicle.send(VEHICLE_STATUS, status_bytes()),
    )
    assert reader
    await link_frames.link.close()


@in_event_loop
async def test_without_a_vehicle_the_link_reports_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_server.ros2.link.FIRST_REPORT_S", 0.0)
    link_frames = LinkFrames("nobody")
    await link_frames.until(lambda: link_frames.link.info().detail)
    assert f"No vehicle publishes /nobody{STATUS} in DDS domain {DOMAIN}" in link_frames.link.info().detail
    await link_frames.link.close()


@in_event_loop
async def test_a_link_with_a_missing_interface_waits_and_names_the_interface() -> None:
    link = Ros2Link("ros2", "ros2://50", 50, None, "eth-none", DdsPort)
    link.start(_ignore, _ignore, _ignore)
    end_s = time.monotonic() + 10.0
    while link.info().state != "waiting":
        assert time.monotonic() < end_s
        await asyncio.sleep(0.02)
    assert "interface eth-none" in link.info().detail
    await link.close()


def test_a_domain_cannot_be_opened_on_a_second_interface() -> None:
    with pytest.raises(DdsUnavailable, match="already used on the loopback interface"):
        DdsPort(DOMAIN, "eth0")


def test_without_an_interface_dds_uses_only_the_loopback_interface() -> None:
    assert '<NetworkInterface name="lo"/>' in configuration(None)
    assert "<AllowMulticast>false</AllowMulticast>" in configuration(None)
    assert '<NetworkInterface name="eth0"/>' in configuration("eth0")


LATE_PROGRAM = """
import sys, time
from cyclonedds.domain import Domain, DomainParticipant
from gcs_server.ros2.dds import Writers
from gcs_server.ros2.message_types import MESSAGES
domain = Domain(int(sys.argv[1]), '''<CycloneDDS><Domain>
  <General>
    <Interfaces><NetworkInterface name="lo"/></Interfaces><AllowMulticast>false</AllowMulticast>
  </General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex><Peers AddLocalhost="false"/></Discovery>
</Domain></CycloneDDS>''')
writers = Writers(DomainParticipant(int(sys.argv[1])), "")
writers.prepare("/fmu/in/vehicle_command", MESSAGES["VehicleCommand"])
time.sleep(60)
"""
"""A program that, like PX4's agent, does not announce itself to unknown programs on loopback."""


@pytest.mark.parametrize("wait_s", [0.0, pytest.param(33.0, marks=pytest.mark.realtime)])
def test_a_program_that_starts_later_is_found_although_it_does_not_announce_itself(wait_s: float) -> None:
    """Cyclone's default announcements end after 30 s."""
    domain_id = 51 if wait_s else 52
    port = DdsPort(domain_id, None)
    time.sleep(wait_s)
    program = subprocess.Popen([sys.executable, "-c", LATE_PROGRAM, str(domain_id)])
    try:
        end_s = time.monotonic() + 20.0
        while not any(
            each.topic is not None and each.topic.name == "rt/fmu/in/vehicle_command"
            for each in port.announcements()
        ):
            assert time.monotonic() < end_s, "not found"
            assert program.poll() is None
            time.sleep(0.1)
    finally:
        program.kill()
        program.wait()


def test_this_process_announces_itself_for_as_long_as_it_runs() -> None:
    for delay in ("InitialLocatorPruneDelay", "DiscoveredLocatorPruneDelay"):
        assert f"<{delay}>inf</{delay}>" in configuration(None)
    assert all("<SPDPInterval>2 s</SPDPInterval>" in configuration(each) for each in (None, "eth0"))
