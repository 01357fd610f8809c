"""Same seed and same stimulus, same flight: every byte on every link, every number of the truth."""

import hashlib
import socket
import subprocess
import sys

import numpy as np

from tests.unit.vehicle_sim.sim_station import NAN, Station
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.script import script_of
from vehicle_sim.world.files import load_world
from vehicle_sim.yaml_fields import parse_yaml

FAULTS = """
events:
  - {when: airborne, after_s: 1, gusts_m_s: 2}
  - {when: airborne, after_s: 4, gps_offset_ned_m: [3, 0, 0]}
"""


EARLY_S, WHOLE_S = 4.5, 9.0
"""After take-off is asked for; the second fault comes at about 7 s."""


def flight(seed: int, until_s: float = WHOLE_S, count: int = 2) -> tuple[str, np.ndarray, np.ndarray]:
    """What was heard, and where the vehicles were early and at the end."""
    station = Station(
        count=count, seed=seed, world=load_world("yard"), script=script_of(parse_yaml(FAULTS, "faults"))
    )
    digest = hashlib.sha256()
    keep = station.sim.frames

    def heard(instance: int, link: str) -> list[bytes]:
        frames = keep(instance, link)
        digest.update(b"".join(frames))
        return frames

    station.sim.frames = heard
    station.run_until(lambda: station.ready, 15)
    station.command(400, 1)
    station.run(0.1)
    station.command(22, -1, 0, 0, NAN, NAN, NAN, station.sim.autopilots[0].home.alt_amsl_m + 5.0)
    station.run(EARLY_S)
    early = station.sim.simulation.truth.position_ned_m.copy()
    station.run(until_s - EARLY_S)
    return digest.hexdigest(), early, station.sim.simulation.truth.position_ned_m.copy()


def test_two_runs_are_the_same_bit_for_bit_and_another_seed_is_another_flight() -> None:
    bytes_a, early_a, truth_a = flight(7)
    bytes_b, _, truth_b = flight(7)
    _, early_c, _ = flight(8, EARLY_S)
    assert truth_a[0, 2] < -2.0, "it flew"
    assert bytes_a == bytes_b
    assert np.array_equal(truth_a, truth_b)
    assert early_a[0, 2] < -0.2
    assert not np.array_equal(early_a, early_c)


class Steered:
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

    def until(self, time_ms: int) -> None:
        self.send("SYSTEM_TIME", time_boot_ms=time_ms)
        while True:
            data = self.socket.recv(65536)
            assert data, "the simulator has gone"
            self.digest.update(data)
            for message in self.parser.feed(data):
                if message.name == "SYSTEM_TIME" and message.time_boot_ms >= time_ms:
                    return


def steered_flight() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "vehicle_sim", "--lockstep", "--tcp-port", str(port), "--no-api"]
    command += ["--gcs-remote-port", "0", "--seed", "5", "--wind", "1,2,1", "--no-log"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert "ready" in process.stdout.readline()
            client = Steered(port)
            for time_ms in range(500, 9_001, 500):
                client.send("HEARTBEAT", type=6, autopilot=8, mavlink_version=3)
                if time_ms == 8_000:
                    client.send("COMMAND_LONG", target_system=1, target_component=1, command=400, param1=1.0)
                client.until(time_ms)
            return client.digest.hexdigest()
        finally:
            process.terminate()


def test_in_lockstep_a_client_of_another_process_hears_the_same_bytes_twice() -> None:
    assert steered_flight() == steered_flight()
