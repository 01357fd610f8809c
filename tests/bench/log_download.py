"""Rate of a log's download from a simulated vehicle, which sends FTP bursts as fast as the recorded PX4: this
server (without loss, at 20 % loss each way, and over a slow link), MAVSDK and MAVProxy, one after
the other."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from gcs_server.client import SyncGcs
from tests.station import (
    FIRST_TEST_INSTANCE,
    free_port,
    running_process,
    running_server,
    running_vehicles,
    wait_until,
)
from tests.support.lossy_relay import SlowLink, lossy_relay

from .process import load_average

LOG_BYTES = 3_000_000
VEHICLE_BYTES_S = 1250 * 239
"""What the simulated vehicle sends of a file in a second: 5 messages in each of 250 steps."""
SLOW_BYTES_S = 100_000
"""A link slower than the vehicle's bursts [byte/s]."""
FILE_TRANSFER_PROTOCOL, LOG_DATA = 110, 120
DATA_SHARE = 239 / 266
"""Share of a file's bytes in a message of FTP."""
PATH = "log/2026-01-01/10_00_00.ulg"
ROOT = Path(__file__).resolve().parents[2]
MAVSDK = {"MAVSDK 3": None, "MAVSDK 4": Path(sys.prefix) / "mavsdk4"}
PROGRAM = """
import asyncio, sys, time
from tests.clients.any_mavsdk import connected
async def main():
    async with connected(int(sys.argv[1])) as drone:
        began_s = time.monotonic()
        download = drone.ftp.download(sys.argv[2], sys.argv[3], True)
        async for _ in (await download if asyncio.iscoroutine(download) else download):
            pass
        print(time.monotonic() - began_s)
asyncio.run(main())
"""


def _row(who: str, bytes_s: float, note: str = "", possible_bytes_s: float = VEHICLE_BYTES_S) -> str:
    return f"| {who} | {bytes_s / 1e3:.0f} kB/s{note} | {bytes_s / possible_bytes_s:.0%} |"


def _server(data: Path, content: bytes, loss: float, link: SlowLink | None = None) -> str:
    server_port = free_port()
    with contextlib.ExitStack() as stack:
        port = stack.enter_context(lossy_relay(server_port, loss, 1, link)) if loss or link else server_port
        url, _ = stack.enter_context(running_server([f"udpin://127.0.0.1:{server_port}"]))
        stack.enter_context(running_vehicles(port, arguments=["--no-log", "--data-dir", str(data)]))
        gcs = stack.enter_context(SyncGcs(url, client="bench", timeout_s=60))
        drone = gcs.wait_for_vehicle("101", timeout_s=120)
        (log,) = drone.request("GET", "/logs")["logs"]
        if link is not None:
            link.sent_bytes.clear()
        operation = drone.request("POST", f"/logs/{log['number']}/download")["id"]
        result = gcs.operations().wait(operation, timeout_s=300)["result"]
        ways = ", ".join(f"{way} {rate / 1e3:.0f} kB/s" for way, rate in result["rates_bytes_s"].items())
        assert result["size_bytes"] == len(content)
        rate = result["rates_bytes_s"]["FTP"]
        if link is None:
            return _row(f"this server, {loss:.0%} loss", rate, f" ({ways}; {result['verified']})")
        files = link.sent_bytes[FILE_TRANSFER_PROTOCOL] + link.sent_bytes[LOG_DATA]
        telemetry = 1 - files / link.sent_bytes.total()
        return _row(
            f"this server, a link of {SLOW_BYTES_S / 1e3:.0f} kB/s",
            rate,
            f" ({ways}; {result['verified']}; {telemetry:.0%} of the link's bytes were telemetry)",
            SLOW_BYTES_S * (1 - telemetry) * DATA_SHARE,
        )


def _mavsdk(name: str, data: Path, content: bytes) -> str:
    folder, tcp_port = MAVSDK[name], free_port(socket.SOCK_STREAM)
    python_path = [str(each) for each in (folder, ROOT) if each is not None]
    with (
        running_vehicles(free_port(), tcp_port=tcp_port, arguments=["--no-log", "--data-dir", str(data)]),
        tempfile.TemporaryDirectory() as target,
    ):
        time.sleep(5.0)
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", PROGRAM, str(tcp_port), f"/{PATH}", target],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(python_path)},
            capture_output=True,
            text=True,
            timeout=240,
        )
        if done.returncode:
            return f"| {name} | not measured: {done.stderr.strip().splitlines()[-1][:120]} | |"
        assert (Path(target) / Path(PATH).name).read_bytes() == content
        return _row(name, len(content) / float(done.stdout.split()[-1]))


def _mavproxy(data: Path, content: bytes) -> str:
    """By LOG_DATA: MAVProxy's `ftp get` numbers its sessions as ArduPilot does, and drops PX4's replies."""
    program, tcp_port = Path(sys.executable).parent / "mavproxy.py", free_port(socket.SOCK_STREAM)
    if not program.exists():
        return "| MAVProxy | not installed | |"
    command = [sys.executable, "-u", str(program), f"--master=tcp:127.0.0.1:{tcp_port}"]
    with (
        running_vehicles(free_port(), tcp_port=tcp_port, arguments=["--no-log", "--data-dir", str(data)]),
        tempfile.TemporaryDirectory() as folder,
        (Path(folder) / "output.txt").open("wb") as output,
        running_process(
            [*command, f"--state-basedir={folder}", "--default-modules=log", "--source-system=250"],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            cwd=folder,
        ) as process,
    ):
        stdin = process.stdin
        assert stdin is not None
        for typed, answer in (
            ("", b"online system"),
            ("log list\n", b"numLogs"),
            ("log download 0 copy.ulg\n", b"Finished downloading"),
        ):
            stdin.write(typed.encode())
            stdin.flush()
            wait_until(lambda text=answer: text in Path(output.name).read_bytes(), answer.decode(), 240)
        (rate_kb_s,) = re.findall(rb"([\d.]+) kbyte/sec", Path(output.name).read_bytes())
        assert (Path(folder) / "copy.ulg").read_bytes() == content
        return f"| MAVProxy, by LOG_DATA | {float(rate_kb_s):.0f} kB/s | – |"


def table() -> Iterator[str]:
    """Rows of the table."""
    content = os.urandom(LOG_BYTES)
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / f"files-{FIRST_TEST_INSTANCE}" / PATH
        file.parent.mkdir(parents=True)
        file.write_bytes(content)
        yield f"{LOG_BYTES / 1e6:.0f} MB, load average {load_average()}\n"
        yield "| who | rate by FTP | of what is possible |"
        yield "|---|---|---|"
        for loss in (0.0, 0.2):
            yield _server(Path(name), content, loss)
        yield _server(Path(name), content, 0.0, SlowLink(SLOW_BYTES_S))
        yield _mavproxy(Path(name), content)
        for who, folder in MAVSDK.items():
            if folder is None or folder.is_dir():
                yield _mavsdk(who, Path(name), content)
            else:
                yield f"| {who} | not installed | |"
