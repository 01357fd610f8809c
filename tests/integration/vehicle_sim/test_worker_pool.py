"""A fleet in several simulator processes: all processes end together."""

import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bench.process import process_tree
from vehicle_sim.mavlink.framing import FrameParser


@contextlib.contextmanager
def fleet_in_two_processes(*options: str) -> Iterator[tuple[subprocess.Popen[str], socket.socket]]:
    """Three vehicles in two processes; yields after a message of each vehicle."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(20)
        command = [sys.executable, "-m", "vehicle_sim", "--instances", "3", "--processes", "2", "--no-log"]
        command += ["--no-api", "--tcp-port", "0", "--gcs-local-port", "0", *options]
        command += ["--gcs-remote-port", str(station.getsockname()[1])]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            parser, received = FrameParser(), set[int]()
            while received != {1, 2, 3}:
                received |= {message.system_id for message in parser.feed(station.recv(65536))}
            yield process, station
        finally:
            process.kill()
            process.communicate(timeout=10)


class ProcessTree:
    """A process and its descendants, which need not be children of this process."""

    def __init__(self, root_pid: int) -> None:
        self.pids = process_tree(root_pid)
        self._pidfds = [os.pidfd_open(pid) for pid in self.pids]

    def all_end(self) -> bool:
        """Whether each process ends within ten seconds."""
        results = [bool(select.select([pidfd], [], [], 10.0)[0]) for pidfd in self._pidfds]
        for pidfd in self._pidfds:
            os.close(pidfd)
        return all(results)


@pytest.mark.story
def test_sigterm_ends_all_processes() -> None:
    with fleet_in_two_processes() as (process, _):
        processes = ProcessTree(process.pid)
        assert len(processes.pids) >= 3
        process.terminate()
        out, _ = process.communicate(timeout=10)
        assert process.returncode == 0
        assert sorted(line.split()[1] for line in out.splitlines()) == ["1", "2", "3"]
        assert processes.all_end()


def test_killing_the_first_process_ends_its_workers() -> None:
    with fleet_in_two_processes() as (process, _):
        processes = ProcessTree(process.pid)
        process.kill()
        assert processes.all_end()


@pytest.mark.story
def test_a_killed_worker_is_reported_and_ends_all_other_processes() -> None:
    with fleet_in_two_processes() as (process, _):
        processes = ProcessTree(process.pid)
        workers = [p for p in processes.pids if b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes()]
        os.kill(workers[0], signal.SIGKILL)
        _, err = process.communicate(timeout=10)
        assert process.returncode == 1
        assert "has ended (SIGKILL); the other processes are terminated" in err
        assert processes.all_end()
