"""A simulator in lockstep, whose time a client controls, sends the same bytes in each run."""

import hashlib
import socket
import subprocess
import sys

import pytest

from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2

ARM_DISARM = 400


class LockstepClient:
    """A client of a simulator process in lockstep, over TCP."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=20)
        self.parser = FrameParser()
        self.digest = hashlib.sha256()
        self.sequence = 0

    def send(self, name: str, **fields: float) -> None:
        layout, payload = pack(name, **fields)
        self.socket.sendall(frame_v2(layout, payload, self.sequence & 0xFF, 255, 190))
        self.sequence += 1

    def advance_to(self, time_ms: int) -> None:
        """Sets the time, and receives until the simulator has reached it."""
        self.send("SYSTEM_TIME", time_boot_ms=time_ms)
        while True:
            data = self.socket.recv(65536)
            assert data, "the simulator closed the connection"
            self.digest.update(data)
            for message in self.parser.feed(data):
                if message.name == "SYSTEM_TIME" and message.time_boot_ms >= time_ms:
                    return


def digest_of_lockstep_flight() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "vehicle_sim", "--lockstep", "--tcp-port", str(port), "--no-api"]
    command += ["--gcs-remote-port", "0", "--seed", "5", "--wind", "1,2,1", "--no-log"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert "ready" in process.stdout.readline()
            client = LockstepClient(port)
            for time_ms in range(500, 9_001, 500):
                client.send("HEARTBEAT", type=6, autopilot=8, mavlink_version=3)  # a ground station
                if time_ms == 8_000:
                    client.send(
                        "COMMAND_LONG", target_system=1, target_component=1, command=ARM_DISARM, param1=1.0
                    )
                client.advance_to(time_ms)
            return client.digest.hexdigest()
        finally:
            process.terminate()


@pytest.mark.story
def test_in_lockstep_two_runs_send_the_same_bytes() -> None:
    assert digest_of_lockstep_flight() == digest_of_lockstep_flight()
