"""MAVSDK 4, whose Python package is another one than MAVSDK 3's, in a folder of its own beside it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tests.station import free_port, running, wait_until

PROGRAM = Path(__file__).resolve().parent / "mavsdk4_program.py"
FOLDER = Path(sys.prefix) / "mavsdk4"
"""Where `make test-clients` installs it."""


def _listens(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


@pytest.mark.timeout(300)
@pytest.mark.skipif(not FOLDER.is_dir(), reason="MAVSDK 4 is not installed: make test-clients does it")
def test_mavsdk_4_flies_a_hasty_program_to_its_end() -> None:
    port = free_port(socket.SOCK_STREAM)
    command = [sys.executable, "-m", "vehicle_sim", "--no-api", "--gcs-local-port", "0", "--no-log"]
    command += ["--gcs-remote-port", str(free_port()), "--tcp-port", str(port), "--speed", "3"]
    with running(command):
        wait_until(lambda: _listens(port), "the simulator's start", 60)
        done = subprocess.run(
            [sys.executable, str(PROGRAM), str(port)],
            env={**os.environ, "PYTHONPATH": str(FOLDER)},
            capture_output=True, text=True, timeout=270, check=False,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
