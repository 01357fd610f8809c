"""Starts a ground station for tests and benches: server and simulated vehicles as separate processes.

Ports are free loopback ports. The processes end with the block that started them.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import httpx

FIRST_TEST_INSTANCE = 100
"""First instance of simulated vehicles in tests: their system ids differ from a developer's simulator."""

WAIT_TIMEOUT_S = 90.0
"""Longest wait for something that an idle machine does within a few seconds."""


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """A loopback port that is currently free."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


ENDS_WITH_PARENT = ["setpriv", "--pdeathsig", "TERM"] if shutil.which("setpriv") else []
"""Starts a program that also ends if the test is killed."""


@contextlib.contextmanager
def running_process(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """Runs a command as a process group that ends with the block, or with this process."""
    settings: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL} | options
    process = subprocess.Popen([*ENDS_WITH_PARENT, *command], start_new_session=True, **settings)
    try:
        yield process
    finally:
        end_process(process, signal.SIGTERM)


def end_process(process: subprocess.Popen[bytes], first_signal: signal.Signals) -> None:
    """Sends a signal to the process group and waits for the process; kills it after five seconds."""
    for signal_number in (first_signal, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal_number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(5)
            return


def wait_until(ready: Callable[[], object], what: str, timeout_s: float = WAIT_TIMEOUT_S) -> None:
    """Polls until `ready` returns a true value.

    Raises:
        TimeoutError: `ready` returned no true value in time.
    """
    end_s = time.monotonic() + timeout_s
    while time.monotonic() < end_s:
        if ready():
            return
        time.sleep(0.1)
    raise TimeoutError(f"{what} did not happen within {timeout_s:.0f} s")


def vehicle_command(
    gcs_port: int, *, instances: int = 1, tcp_port: int = 0, arguments: Sequence[str] = ()
) -> list[str]:
    """The command line of simulated vehicles with system ids from 101, which send to `gcs_port`."""
    command = [sys.executable, "-m", "vehicle_sim", "--instances", str(instances), "--no-api"]
    command += ["--first-instance", str(FIRST_TEST_INSTANCE), "--gcs-local-port", "0"]
    # The simulator counts TCP ports from instance 0.
    tcp_of_instance_0 = tcp_port - FIRST_TEST_INSTANCE if tcp_port else 0
    return [*command, "--gcs-remote-port", str(gcs_port), "--tcp-port", str(tcp_of_instance_0), *arguments]


@contextlib.contextmanager
def running_vehicles(gcs_port: int, **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """Runs simulated vehicles in real time; `options` are those of `vehicle_command`."""
    with running_process(vehicle_command(gcs_port, **options)) as process:
        yield process


def server_command(http_port: int, links: Sequence[str], data: str | Path) -> list[str]:
    """The command line of the server without a simulator."""
    command = [sys.executable, "-m", "gcs_server", "serve", "--no-sim", "--port", str(http_port)]
    for link in links:
        command += ["--link", link]
    return [*command, "--data", str(data)]


def is_up(url: str) -> bool:
    """Whether the server responds to a request."""
    try:
        return httpx.get(f"{url}/api/v1/health", timeout=5).status_code == 200
    except httpx.TransportError:
        return False


def wait_for_start(process: subprocess.Popen[bytes], ready: Callable[[], object], output: Path) -> None:
    """Waits until a server is ready.

    Raises:
        TimeoutError: the server was not ready in time, or its process ended. The message contains `output`.
    """
    try:
        wait_until(lambda: process.poll() is not None or ready(), "the server's start")
    except TimeoutError as error:
        raise TimeoutError(f"{error}; it wrote:\n{output.read_text()}") from None
    if process.poll() is not None:
        raise TimeoutError(f"the server ended with {process.poll()}; it wrote:\n{output.read_text()}")


@contextlib.contextmanager
def running_server(
    links: Sequence[str], *, port: int | None = None, log: Path | None = None
) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Runs a server; yields its address and its process."""
    http_port = port or free_port(socket.SOCK_STREAM)
    url = f"http://127.0.0.1:{http_port}"
    with contextlib.ExitStack() as stack:
        data = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        output = log or Path(stack.enter_context(tempfile.TemporaryDirectory())) / "server.log"
        output_file = stack.enter_context(output.open("wb"))
        process = stack.enter_context(
            running_process(
                server_command(http_port, links, data), stdout=output_file, stderr=subprocess.STDOUT
            )
        )
        wait_for_start(process, lambda: is_up(url), output)
        yield url, process
