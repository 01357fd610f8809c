"""`gcs doctor ros2` on real DDS: a vehicle is found and its layouts are confirmed."""

from __future__ import annotations

import os
import socket
import threading

import pytest

pytest.importorskip("cyclonedds")

from gcs_server.cli import main
from gcs_server.ros2.agent_port import local_sockets
from gcs_server.ros2.dds import open_domain
from tests.support.dds_publisher import VEHICLE_STATUS, Publisher, status_bytes

DOMAIN = 201 + os.getpid() % 20
"""The command reads every vehicle of its domain: no other test may use the same domain."""


def test_the_doctor_names_the_vehicle_its_version_and_a_setpoint_in_the_wrong_namespace(
    capsys: pytest.CaptureFixture[str],
) -> None:
    domain, stop = open_domain(DOMAIN, None), threading.Event()
    vehicle, program = Publisher(DOMAIN, "px4_1"), Publisher(DOMAIN, "", {})
    program.prepare("/fmu/in/trajectory_setpoint", "TrajectorySetpoint")

    def publish() -> None:
        while not stop.wait(0.02):
            vehicle.send(VEHICLE_STATUS, status_bytes())

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        code = main(["doctor", "ros2", "--domain", str(DOMAIN), "--seconds", "4"])
    finally:
        stop.set()
        thread.join()
    output = capsys.readouterr().out
    assert code == 1
    assert "vehicle /px4_1: 3 topics with confirmed layouts, those of PX4 v1.16 or v1.17" in output
    assert "PROBLEM: a program publishes /fmu/in/trajectory_setpoint, but no vehicle subscribes" in output
    assert domain  # this reference keeps the domain open


def test_sockets_of_this_computer_are_listed_with_their_ports() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        port = server.getsockname()[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.connect(("127.0.0.1", port))
            own, found = client.getsockname()[1], local_sockets()
            by_port = {each.port: each for each in found}
            assert by_port[port].remote_port == 0
            assert (by_port[own].remote_port, by_port[own].remote_is_local) == (port, True)
            assert by_port[own].program != ""
