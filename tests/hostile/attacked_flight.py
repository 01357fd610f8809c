"""A flight in Offboard while hostile clients or vehicles attack the server, and the limits for their
effects."""

from __future__ import annotations

import contextlib
import itertools
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from gcs_server.client import SyncGcs, SyncVehicle
from tests.bench.process import process_tree, resident_mb
from tests.bench.relay import Relay
from tests.hostile.wake_ups import WAKE_UP_PERIOD_S, WakeUpMeter
from tests.station import free_port, running_process, running_vehicles, server_command, wait_until

MAX_DELAY_S = 0.02
"""How much a gap between setpoints may exceed their period, or the longest gap of an idle process."""
MAX_HOLD_S = 0.1
"""How long a Hold may take, in addition to the delays that the machine itself causes."""
HOLD_PROCESSES = 4
"""A Hold passes client, server, vehicle and server again, and each may wait for the machine."""
MAX_GROWTH_MB = 100.0
CHECK_PERIOD_S = 0.2
VALID_FOR_S = 600
"""Longer than all attacks, so that no setpoint expires."""


@dataclass
class AttackedFlight:
    """A flight in Offboard, and its measurements during the attacks."""

    url: str
    process: subprocess.Popen[bytes]
    data_folder: Path
    log_path: Path
    hostile_port: int
    relay: Relay
    flying_vehicle: SyncVehicle
    statuses: set[int] = field(default_factory=set)
    """HTTP statuses of the responses to this flight's own client during the attack."""
    growth_mb: float = 0.0
    holds_s: list[float] = field(default_factory=list)
    """How long the pilot of vehicle 102 waited for each Hold during the attack [s]."""

    @contextlib.contextmanager
    def under_attack(self) -> Generator[None]:
        """Measures during the block, which runs an attack; checks the measurements at its end."""
        before_mb, self.growth_mb = self._memory_mb(), 0.0
        log_size_before = self.log_path.stat().st_size
        self.relay.setpoints.clear()
        self.holds_s.clear()
        block_ended = threading.Event()
        threads = [
            threading.Thread(target=self._measure, args=(block_ended, before_mb)),
            threading.Thread(target=self._hold, args=(block_ended,)),
        ]
        for thread in threads:
            thread.start()
        meter, usual_meter = WakeUpMeter(), WakeUpMeter("usual")
        try:
            yield
        finally:
            block_ended.set()
            for thread in threads:
                thread.join()
            idle_gap_s, usual_gap_s = meter.stop(), usual_meter.stop()
        self._check(log_size_before, idle_gap_s, usual_gap_s)

    def _measure(self, block_ended: threading.Event, before_mb: float) -> None:
        with httpx.Client(base_url=self.url, timeout=10, headers={"X-Client-Id": "pilot"}) as client:
            while not block_ended.wait(CHECK_PERIOD_S):
                for path in ("/api/v1/vehicles/101", "/api/v1/vehicles", "/api/v1/vehicles/101/offboard"):
                    self.statuses.add(client.get(path).status_code)
                self.growth_mb = max(self.growth_mb, self._memory_mb() - before_mb)

    def _hold(self, block_ended: threading.Event) -> None:
        """Commands Hold for the second vehicle again and again, as its pilot."""
        with httpx.Client(base_url=self.url, timeout=60, headers={"X-Client-Id": "pilot 2"}) as client:
            while not block_ended.wait(CHECK_PERIOD_S):
                begin_s = time.monotonic()
                self.statuses.add(client.post("/api/v1/vehicles/102/hold").status_code)
                self.holds_s.append(time.monotonic() - begin_s)

    def _memory_mb(self) -> float:
        """Memory of the server and of its stream process."""
        pids = [pid for pid in process_tree(self.process.pid) if _is_server_or_stream_process(pid)]
        return sum(resident_mb(pid) for pid in pids)

    def _check(self, log_size_before: int, idle_gap_s: float, usual_gap_s: float) -> None:
        arrival_times_s = self.relay.arrivals_s().get(101, [])
        assert len(arrival_times_s) > 100, self._failure_details()
        gaps = [later - earlier for earlier, later in itertools.pairwise(arrival_times_s)]
        summary = f"largest gap {max(gaps) * 1e3:.1f} ms, of an idle process {idle_gap_s * 1e3:.1f} ms"
        holds_s = sorted(self.holds_s)
        hold_p99_s = holds_s[int(0.99 * (len(holds_s) - 1))]
        summary += f"; of {len(holds_s)} Holds the slowest hundredth took {hold_p99_s * 1e3:.0f} ms"
        summary += f" (median {holds_s[len(holds_s) // 2] * 1e3:.0f})"
        summary += f"; an idle process of the server's priority waited {usual_gap_s * 1e3:.0f} ms"
        print(f"{summary}; memory grew by {self.growth_mb:.1f} MB")
        assert hold_p99_s <= MAX_HOLD_S + HOLD_PROCESSES * (usual_gap_s - WAKE_UP_PERIOD_S), summary
        assert max(gaps) <= max(WAKE_UP_PERIOD_S, idle_gap_s) + MAX_DELAY_S, summary
        assert self.statuses == {200}
        assert self.growth_mb < MAX_GROWTH_MB, f"the memory of the server grew by {self.growth_mb:.0f} MB"
        status = self.flying_vehicle.show()["status"]
        assert (status["mode"], status["armed"]) == ("offboard", True), self._failure_details()
        new_log = self.log_path.read_bytes()[log_size_before:]
        assert b"Traceback" not in new_log, new_log[-4000:].decode("utf-8", "replace")
        assert len(new_log) < 100_000, "the attack filled the log"

    def _failure_details(self) -> str:
        """The flight's events and the state of its stream, for the message of a failed test."""
        messages = self.flying_vehicle.request("GET", "/messages")["messages"][-12:]
        stream = self.flying_vehicle.request("GET", "/offboard")
        return "\n".join(
            [
                *(str(message["text"]) for message in messages),
                str(stream.get("ended")),
                self.log_path.read_text(errors="replace")[-3000:],
            ]
        )


def _is_server_or_stream_process(pid: int) -> bool:
    command = Path(f"/proc/{pid}/cmdline").read_bytes()
    return b"\0serve\0" in command or b"streamer.process.worker" in command


@contextlib.contextmanager
def attacked_flight(folder: Path) -> Generator[AttackedFlight]:
    """Starts a server with two UDP links, and two vehicles on the first link: one hovers in Offboard, the
    other is held by another pilot."""
    flight_port, hostile_port, http_port = free_port(), free_port(), free_port(socket.SOCK_STREAM)
    url, log_path, data_folder = f"http://127.0.0.1:{http_port}", folder / "server.log", folder / "data"
    links = [f"udpin://127.0.0.1:{port}" for port in (flight_port, hostile_port)]
    with contextlib.ExitStack() as stack:
        output = stack.enter_context(log_path.open("wb"))
        process = stack.enter_context(
            running_process(
                server_command(http_port, links, data_folder), stdout=output, stderr=subprocess.STDOUT
            )
        )
        wait_until(lambda: _server_responds(url), "the server")
        relay = stack.enter_context(Relay(flight_port))
        stack.enter_context(running_vehicles(relay.vehicle_port, instances=2, arguments=["--no-log"]))
        gcs = stack.enter_context(SyncGcs(url, client="pilot", client_id="pilot"))
        flying_vehicle = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        stack.enter_context(flying_vehicle.offboard(position_ned_m=(0, 0, -5), valid_for_s=VALID_FOR_S))
        flying_vehicle.arm()
        flying_vehicle.until(
            lambda v: v["topics"]["local_position"]["value"]["position_ned_m"][2] < -4.5, what="the hover"
        )
        second_vehicle = stack.enter_context(
            SyncGcs(url, client="pilot 2", client_id="pilot 2")
        ).wait_for_vehicle("102", ready=True, timeout_s=120)
        second_vehicle.takeoff(10)
        yield AttackedFlight(url, process, data_folder, log_path, hostile_port, relay, flying_vehicle)


def attack(module: str, *arguments: object, timeout_s: float = 240.0) -> str:
    """Runs an attack in a separate process; returns its output.

    Raises:
        AssertionError: the attack program has failed.
    """
    command = [sys.executable, "-m", f"tests.hostile.{module}", *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False)
    assert result.returncode == 0, result.stderr[-4000:]
    return result.stdout


def _server_responds(url: str) -> bool:
    with contextlib.suppress(httpx.TransportError):
        return httpx.get(f"{url}/api/v1/health", timeout=1).status_code == 200
    return False


def wait_for_effects(seconds: float) -> None:
    """Waits in real time for delayed effects of the attack."""
    time.sleep(seconds)


def write_recording(path: Path, count: int) -> None:
    """Writes a telemetry log in which each record has another sender or message."""
    first_unix_us = 1_752_220_800_000_000
    with path.open("wb") as file:
        for n in range(count):
            sender = bytes((1 + n % 250, n // 250 % 255)) + (500 + n // 63_750).to_bytes(3, "little")
            file.write(struct.pack(">Q", first_unix_us + 100 * n) + b"\xfd\x01\0\0\0" + sender + bytes(3))
