"""The command `gcs doctor ros2`: who publishes what on which DDS domain, which layouts each PX4 confirms,
and why topics are empty or setpoints do nothing."""

from __future__ import annotations

import argparse
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from gcs_server.errors import LinkError
from gcs_server.ros2.diagnosis import report
from gcs_server.ros2.formats import REQUEST, AnnouncedTopics, VehicleFormats
from gcs_server.ros2.inspection import Announcement
from gcs_server.ros2.message_types import MESSAGES, MalformedMessage
from gcs_server.ros2.topics import status_namespace
from gcs_server.ros2.url import INSTALL, MAX_DOMAIN

if TYPE_CHECKING:
    from gcs_server.ros2.dds import DdsPort, VehiclePort

STEP_S: Final = 0.02
NOTHING: Final = (
    "No vehicle. Start PX4's agent (MicroXRCEAgent udp4 -p 8888) and its client (uxrce_dds_client; "
    "UXRCE_DDS_DOM_ID is its domain); for another computer name the network interface (--interface)."
)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Adds the flags of the command."""
    parser.description = (
        "Shows the vehicles and programs on DDS domains, which layouts each PX4 confirms, and topics that do "
        "not meet: another domain, namespace, version or type."
    )
    parser.add_argument("subject", choices=("ros2",))
    parser.add_argument(
        "--domain", type=int, action="append", metavar="N", help="DDS domain; default: 0 to 9"
    )
    parser.add_argument("--interface", metavar="NAME", help="network interface; default: loopback")
    parser.add_argument("--seconds", type=float, default=8.0, help="how long to listen (default: 8)")


def run(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code: 0 if there is a vehicle and no problem.

    Raises:
        LinkError: Cyclone DDS is not installed, or a domain cannot be opened.
    """
    domains = options.domain or list(range(10))
    if not all(0 <= domain <= MAX_DOMAIN for domain in domains):
        raise LinkError(f"A DDS domain is a number from 0 to {MAX_DOMAIN}.")
    try:
        from gcs_server.ros2.agent_port import agent_problems, local_sockets
        from gcs_server.ros2.dds import DdsPort, DdsUnavailable
    except ImportError:
        raise LinkError("gcs doctor ros2 needs Cyclone DDS.", remedy=f"{INSTALL}.") from None
    try:
        probes = [DomainProbe(domain, DdsPort(domain, options.interface)) for domain in domains]
    except DdsUnavailable as problem:
        raise LinkError(str(problem)) from None
    end_s = time.monotonic() + options.seconds
    while time.monotonic() < end_s:
        for probe in probes:
            probe.step(time.monotonic())
        time.sleep(STEP_S)
    found = [probe for probe in probes if probe.endpoints]
    problems = 0
    for probe in found:
        facts, problem_texts = report(probe.endpoints.values(), probe.formats)
        problems += len(problem_texts)
        print(f"DDS domain {probe.domain_id}")
        print("\n".join([f"  {text}" for text in facts] + [f"  PROBLEM: {text}" for text in problem_texts]))
    if not any(probe.formats for probe in found):
        where = options.interface or "loopback"
        print(f"PROBLEM: domains {', '.join(map(str, domains))} on {where}: {NOTHING}")
        for text in agent_problems(local_sockets()):
            print(f"PROBLEM: {text}")
        return 1
    return 1 if problems else 0


class DomainProbe:
    """The writers and readers of one domain, and the layouts that its vehicles confirm."""

    def __init__(self, domain_id: int, port: DdsPort) -> None:
        self.domain_id, self._port = domain_id, port
        self._own = str(port.participant.get_guid())
        self._announced = AnnouncedTopics()
        self._vehicles: dict[str, VehiclePort] = {}
        self.endpoints: dict[str, Announcement] = {}
        """By key, without those of this program."""
        self.formats: dict[str, VehicleFormats] = {}
        """By namespace."""

    def step(self, now_s: float) -> None:
        """Reads what has been announced and answered, and sends the questions that are due."""
        for each in self._port.announcements():
            self.endpoints.pop(each.key, None)
            if each.participant == self._own:
                continue
            self._announced.apply(each)
            if each.topic is None:
                continue
            self.endpoints[each.key] = each
            namespace = status_namespace(each.topic.name) if each.publishes else None
            if namespace is not None and namespace not in self._vehicles:
                self._vehicles[namespace] = self._port.vehicle(namespace)
                self.formats[namespace] = VehicleFormats(namespace)
        for namespace, vehicle in self._vehicles.items():
            formats, source = self.formats[namespace], vehicle.source
            samples = vehicle.take(now_s)
            if vehicle.source != source:
                formats.reset()
            formats.announce(self._announced.of(namespace, vehicle.source))
            for _, data in samples:
                with suppress(MalformedMessage):
                    formats.on_response(MESSAGES["MessageFormatResponse"].decode(data))
            if (request := formats.request(now_s, now_s)) is not None:
                with suppress(OSError):
                    vehicle.writers.send(REQUEST, request)
