"""Programs of users with MAVSDK 3 and MAVSDK 4, each in a separate process with its own vehicle."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from tests.clients.mavsdk_drone import SPEED_FACTOR, listens, vehicle_at
from tests.clients.mavsdk_programs import PROGRAMS
from tests.station import free_port, running_process, wait_until

ROOT = Path(__file__).resolve().parents[2]
MAVSDK_4 = Path(sys.prefix) / "mavsdk4"
"""The folder where `make test-clients` installs MAVSDK 4, a package of the same name."""


def _vehicle_for(program: str, port: int) -> AbstractContextManager[object]:
    if program == "accelerometer_calibrated_on_all_sides":
        command = [sys.executable, "-m", "tests.clients.turned_vehicle", str(port), str(SPEED_FACTOR)]
        return running_process(command, cwd=ROOT)
    return vehicle_at(port, arguments=["--no-log"])


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
    with _vehicle_for(program, port):
        wait_until(lambda: listens(port), "the simulator's start", 60)
        result = subprocess.run(
            [sys.executable, "-m", "tests.clients.mavsdk_programs", program, str(port), str(tmp_path)],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(python_path)},
            cwd=ROOT, capture_output=True, text=True, timeout=270, check=False,
        )  # fmt: skip
    assert result.returncode == 0, result.stderr[-2000:]
