"""Programs of users with MAVSDK 3 and MAVSDK 4, each in a separate process with its own vehicle."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tests.clients.mavsdk_programs import PROGRAMS
from tests.station import free_port, running_process, wait_until

ROOT = Path(__file__).resolve().parents[2]
MAVSDK_4 = Path(sys.prefix) / "mavsdk4"
"""The folder where `make test-clients` installs MAVSDK 4, a package of the same name."""
SPEED = 3
"""Speed of the simulation as a multiple of real time; MAVSDK's timeouts use the real clock."""


def _listens(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


def _vehicle_command(program: str, port: int) -> list[str]:
    if program == "accelerometer_calibrated_on_all_sides":
        return ["tests.clients.turned_vehicle", str(port), str(SPEED)]
    command = ["vehicle_sim", "--no-api", "--no-log", "--gcs-local-port", "0", "--speed", str(SPEED)]
    return [*command, "--gcs-remote-port", str(free_port()), "--tcp-port", str(port)]


@pytest.mark.timeout(300)
@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("program", PROGRAMS)
def test_a_users_program_runs_to_its_end(version: int, program: str, tmp_path: Path) -> None:
    python_path = [str(ROOT)]
    if version == 4:
        if not MAVSDK_4.is_dir():
            pytest.skip("MAVSDK 4 is not installed: run make test-clients")
        python_path.insert(0, str(MAVSDK_4))
    port = free_port(socket.SOCK_STREAM)
    with running_process([sys.executable, "-m", *_vehicle_command(program, port)], cwd=ROOT):
        wait_until(lambda: _listens(port), "the simulator's start", 60)
        result = subprocess.run(
            [sys.executable, "-m", "tests.clients.mavsdk_programs", program, str(port), str(tmp_path)],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(python_path)},
            cwd=ROOT, capture_output=True, text=True, timeout=270, check=False,
        )  # fmt: skip
    assert result.returncode == 0, result.stderr[-2000:]
