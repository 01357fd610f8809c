"""The simulator's process on DDS, flown in real time by a program in another process."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest

from gcs_server.client import SyncGcs
from tests.clients import ros2_offboard_node
from tests.clients.px4_dds import Node, VehicleLocalPosition, VehicleStatus
from tests.station import running_server, wait_until
from vehicle_sim.dds.participant import DdsDomain

DOMAIN, GUARDED = 46, 47
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


@pytest.mark.parametrize("px4", ["1.17"], indirect=True)
def test_a_program_flies_through_a_guard_until_its_command_to_land(px4: str) -> None:
    position_topic = ros2_offboard_node.POSITION_TOPICS[px4]
    links = [f"ros2://{DOMAIN}/{NAMESPACE}", f"ros2://{GUARDED}?guard=free&client=node"]
    domain = DdsDomain(GUARDED)
    with running_server(links) as (url, _), SyncGcs(url, client="observer") as gcs:
        drone = gcs.wait_for_vehicle("1", ready=True)
        wait_until(lambda: guard(gcs)["problem"] is None, "the vehicle's topics")
        deadline_s = time.monotonic() + 90.0

        def sleep(seconds: float) -> None:
            assert time.monotonic() < deadline_s, "the program does not end"
            time.sleep(seconds)

        ros2_offboard_node.main(GUARDED, "", sleep, position_topic)
        wait_until(lambda: drone.status()["mode"] == "land", "its command to land")
        wait_until(lambda: not guard(gcs)["flying"], "the end of its setpoints")
        entries = gcs.request("GET", "/journal")["entries"]
        assert "offboard/start" in [each["command"] for each in entries if each["client"] == "node"]
    assert domain  # keeps the DDS domain open until here


def guard(gcs: SyncGcs) -> dict[str, Any]:
    (found,) = gcs.request("GET", "/guards")["guards"]
    return found


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
