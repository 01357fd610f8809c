"""`python -m vehicle_sim` as a process: its output, used ports, and shutdown."""

import socket
import subprocess
import sys

import pytest

from vehicle_sim.mavlink.framing import FrameParser


def start_simulator(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "vehicle_sim", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_the_process_streams_and_ends_on_sigterm() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(30)
        port = station.getsockname()[1]
        process = start_simulator(
            "--gcs-local-port", "0", "--gcs-remote-port", str(port), "--no-api", "--tcp-port", "0"
        )
        try:
            parser = FrameParser()
            names: set[str] = set()
            while "HEARTBEAT" not in names:
                names |= {m.name for m in parser.feed(station.recv(65536))}
        finally:
            process.terminate()
            out, _ = process.communicate(timeout=30)
        assert process.returncode == 0
        assert out.startswith("vehicle 1 ready (instance 0): gcs UDP ")


@pytest.mark.story
def test_the_process_names_a_port_in_use_and_ends_if_no_other_port_is_open() -> None:
    with socket.socket() as other_socket:
        other_socket.bind(("127.0.0.1", 0))
        other_socket.listen(1)
        port = other_socket.getsockname()[1]
        process = start_simulator("--gcs-remote-port", "0", "--no-api", "--tcp-port", str(port))
        _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert f"TCP port {port} on 127.0.0.1" in err
