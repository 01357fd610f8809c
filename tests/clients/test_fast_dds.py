"""Interoperation with another DDS implementation: programs with eProsima Fast DDS and Fast CDR, which PX4's
agent and the default middleware of ROS 2 use, too. The tests need Debian's `libfastrtps-dev` and `g++`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests import station

pytest.importorskip("cyclonedds")

SOURCES = Path(__file__).parent / "fast_dds"
HEADER = Path("/usr/include/fastdds/dds/domain/DomainParticipant.hpp")
DOMAIN = str(60 + os.getpid() % 10)
NAMESPACE = f"fast_{os.getpid()}"
STEPS = ["ready", "offboard", "armed", "airborne", "landing", "landed"]
ATTITUDE = {"type": "attitude", "q_ned_frd": [0.8, 0.0, 0.0, 0.6], "thrust": 0.4}
EXPECTED_OUTPUT = ["armed", "offboard", "setpoint 0.80 0.00 0.00 0.60, thrust -0.40", "hold"]
"""What the vehicle of `vehicle.cpp` prints when the server arms it, streams `ATTITUDE` and selects Hold."""
Build = Callable[[str], str]


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Compiles a program of `fast_dds/`; returns its path."""
    if not HEADER.is_file() or shutil.which("g++") is None:
        pytest.skip("Fast DDS is not installed: sudo apt-get install libfastrtps-dev g++")
    folder = tmp_path_factory.mktemp("fast_dds")

    def compile_program(name: str) -> str:
        command = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", str(SOURCES / f"{name}.cpp")]
        program = str(folder / name)
        subprocess.run([*command, "-o", program, "-lfastrtps", "-lfastcdr"], check=True, timeout=300)
        return program

    return compile_program


def test_a_fast_dds_program_flies_the_simulator_offboard(build: Build) -> None:
    program = build("offboard")
    command = [sys.executable, "-m", "vehicle_sim", "--ros2", DOMAIN, "--ros2-namespace", NAMESPACE]
    command += ["--px4", "1.16"]  # whose message types the program has
    command += ["--gcs-remote-port", "0", "--no-api", "--no-log", "--tcp-port", str(station.free_port())]
    with station.running_process(command):
        result = subprocess.run(
            [program, DOMAIN, NAMESPACE], capture_output=True, text=True, timeout=240, check=False
        )
    assert result.returncode == 0, result.stdout + result.stderr
    assert [line.partition(":")[0] for line in result.stdout.splitlines()] == STEPS


@pytest.mark.story
def test_a_fast_dds_program_flies_through_a_guard(build: Build) -> None:
    """The server is the vehicle in another namespace of the domain."""
    program, guarded = build("offboard"), f"guarded_{os.getpid()}"
    command = [sys.executable, "-m", "vehicle_sim", "--ros2", DOMAIN, "--ros2-namespace", NAMESPACE]
    command += ["--px4", "1.16"]  # whose message types the program has
    command += ["--gcs-remote-port", "0", "--no-api", "--no-log", "--tcp-port", str(station.free_port())]
    links = [f"ros2://{DOMAIN}/{NAMESPACE}", f"ros2://{DOMAIN}/{guarded}?guard=free&client=program"]
    with station.running_process(command), station.running_server(links) as (url, _):
        result = subprocess.run(
            [program, DOMAIN, guarded], capture_output=True, text=True, timeout=240, check=False
        )
        journal = httpx.get(f"{url}/api/v1/journal", timeout=10).json()["entries"]
    assert result.returncode == 0, result.stdout + result.stderr
    assert [line.partition(":")[0] for line in result.stdout.splitlines()] == STEPS
    assert "offboard/start" in [each["command"] for each in journal if each["client"] == "program"]


def test_the_server_reads_telemetry_and_sends_commands_and_setpoints_over_fast_dds(
    build: Build, tmp_path: Path
) -> None:
    command, output = [build("vehicle"), DOMAIN, NAMESPACE], tmp_path / "printed"
    with (
        station.running_server([f"ros2://{DOMAIN}/{NAMESPACE}"]) as (url, _),
        output.open("wb") as output_file,
        station.running_process(command, stdout=output_file),
        httpx.Client(base_url=f"{url}/api/v1", headers={"X-Client": "test"}, timeout=30) as http,
    ):

        def vehicle_state() -> Any:
            return next(iter(http.get("/vehicles").json()), {"topics": {}})

        def post(name: str, body: dict[str, Any]) -> None:
            response = http.post(f"/vehicles/1/{name}", json=body)
            assert response.status_code == 200, response.text

        station.wait_until(lambda: "attitude" in vehicle_state()["topics"], "the vehicle's attitude")
        post("arm", {})
        post("offboard/start", {"setpoint": ATTITUDE, "valid_for_s": 30, "on_expiry": {"action": "hold"}})
        station.wait_until(lambda: b"setpoint" in output.read_bytes(), "the setpoint")
        post("mode", {"mode": "hold"})
        status = vehicle_state()["status"]
        assert (status["armed"], status["mode"]) == (True, "hold")
    assert output.read_text().splitlines() == EXPECTED_OUTPUT


def test_the_link_of_the_server_reports_a_fast_dds_program_that_sends_malformed_messages(
    build: Build,
) -> None:
    program = build("malformed")
    with station.running_server([f"ros2://{DOMAIN}/{NAMESPACE}"]) as (url, server):

        def is_reported() -> bool:
            (link,) = httpx.get(f"{url}/api/v1/links").json()["links"]
            text = f"{NAMESPACE} has confirmed the layout of /fmu/out/vehicle_status, but sends no message"
            return text in link["detail"]  # DDS drops messages that are too short

        with station.running_process([program, DOMAIN, NAMESPACE]):
            station.wait_until(is_reported, "the report of the malformed messages")
        assert server.poll() is None
        assert httpx.get(f"{url}/api/v1/vehicles").json() == []
