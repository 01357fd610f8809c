"""The simulator's process on DDS, flown in real time by a program in another process."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from tests.clients import ros2_offboard_node
from tests.clients.px4_dds import Node, VehicleLocalPosition, VehicleStatus
from vehicle_sim.dds.participant import DdsDomain

DOMAIN = 46
NAMESPACE = f"real_{os.getpid()}"


@pytest.fixture(params=ros2_offboard_node.POSITION_TOPICS)
def px4(request: pytest.FixtureRequest) -> Iterator[str]:
    """The version of PX4 that the simulator's process runs as."""
    command = [sys.executable, "-m", "vehicle_sim", "--px4", request.param, "--ros2", str(DOMAIN)]
    command += ["--ros2-namespace", NAMESPACE]
    ports = ["--gcs-remote-port", "0", "--no-api", "--tcp-port", str(20_000 + os.getpid() % 20_000)]
    process = subprocess.Popen([*command, *ports, "--no-log"], stdout=subprocess.DEVNULL)
    yield request.param
    process.terminate()
    assert process.wait(20.0) == 0


def test_a_program_in_another_process_flies_the_simulator(px4):
    position_topic = ros2_offboard_node.POSITION_TOPICS[px4]
    domain = DdsDomain(DOMAIN)
    node = Node(DOMAIN, NAMESPACE)
    status = node.subscription(VehicleStatus, "/fmu/out/vehicle_status_v1")
    position = node.subscription(VehicleLocalPosition, position_topic)
    deadline_s = time.monotonic() + 90.0
    while status.latest is None or not status.latest.pre_flight_checks_pass:
        assert time.monotonic() < deadline_s, "the vehicle cannot be armed"
        time.sleep(0.1)

    def sleep(seconds: float) -> None:
        assert time.monotonic() < deadline_s + 90.0, "the program does not end"
        time.sleep(seconds)

    ros2_offboard_node.main(DOMAIN, NAMESPACE, sleep, position_topic)
    assert position.latest.z == pytest.approx(-5.0, abs=1.0)
    assert domain  # keeps the DDS domain open until here
