"""Which topics a guarded ROS 2 link offers, as the vehicle's become known."""

import asyncio
from dataclasses import replace

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.formats import known_formats
from gcs_server.ros2.guard_link import SETTLED_S, Ros2GuardLink, _Run
from gcs_server.ros2.topics import COMMAND_ACK, STATUS

HOME = "/fmu/out/home_position"
FORMATS = known_formats("1.17")


class Port:
    """One end; see `dds_relay.RelayPort`."""

    def __init__(self):
        self.read_topics, self.written = [], []

    def read(self, topic, _depth):
        self.read_topics.append(topic.topic)

    def write(self, topic):
        self.written.append(topic.topic)

    def wait(self, _timeout_s):
        return []

    def participants(self):
        return set()


def address(formats, namespace="px4_1"):
    return DdsAddress(0, None, namespace, tuple(formats.values()))


def link_and_ends(monkeypatch):
    programs, vehicle = Port(), Port()
    monkeypatch.setattr(_Run, "start", _Run.open)
    link = Ros2GuardLink("guard", "ros2://3", 3, "", None, lambda *_: (programs, vehicle))
    link.start(lambda *_: None, lambda *_: None, lambda: None)
    return link, programs, vehicle


def in_loop(test):
    async def run():
        test()

    asyncio.run(run())


def test_a_topic_that_the_vehicle_first_publishes_in_flight_is_added_without_a_break(monkeypatch):
    """PX4's agent announces each topic with its first message: home, or the answer to the first command."""

    def test():
        link, programs, vehicle = link_and_ends(monkeypatch)
        now_s = 0.0
        link.now_s = lambda: now_s
        early = {topic: each for topic, each in FORMATS.items() if topic not in (HOME, COMMAND_ACK)}
        link.serve(address(early), 1)
        assert "being confirmed" in link.info().detail
        now_s += SETTLED_S
        link.serve(address(early), 1)
        run = link._run
        assert link.info().detail == ""
        run.pass_telemetry(0.0)
        run.read_programs(0.0)
        assert COMMAND_ACK in programs.written, "the first answer is often the first message of its topic"
        assert HOME not in programs.written
        assert set(vehicle.read_topics) == set(programs.written)
        link.serve(address(FORMATS), 1)
        run.pass_telemetry(0.0)
        assert link._run is run
        assert programs.written.count(HOME) == vehicle.read_topics.count(HOME) == 1
        assert "/fmu/in/vehicle_command" in programs.read_topics
        assert "/fmu/in/vehicle_command" not in vehicle.written, "commands pass the guard"

    in_loop(test)


def test_another_firmware_namespace_or_vehicle_begins_anew(monkeypatch):
    def test():
        link, _, _ = link_and_ends(monkeypatch)
        now_s = 10.0
        link.now_s = lambda: now_s

        def serving(vehicle, system_id=1):
            link.serve(vehicle, system_id)
            return link._run

        home = FORMATS[HOME]
        others = [
            (address({**FORMATS, HOME: home._replace(message_hash=home.message_hash + 1)}), 1),
            (address(FORMATS, "px4_2"), 1),
            (address(FORMATS), 2),
            (address({topic: each for topic, each in FORMATS.items() if topic != STATUS}), 1),
            (None, 1),
        ]
        for other, system_id in others:
            serving(address(FORMATS))
            now_s += SETTLED_S
            assert serving(address(FORMATS)) is not None
            assert serving(other, system_id) is None

    in_loop(test)


def test_what_cannot_be_offered_is_said(monkeypatch):
    def test():
        link, _, _ = link_and_ends(monkeypatch)
        link.serve(None, 1)
        assert "add a ros2:// link" in link.info().detail
        link.serve(replace(address(FORMATS), domain_id=3, namespace=""), 1)
        assert "the vehicle's own topics" in link.info().detail
        link.serve(replace(address(FORMATS), formats=()), 1)
        assert "being confirmed" in link.info().detail

    in_loop(test)
