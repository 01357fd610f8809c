"""The server's CPU share on a feed, beside its peers on the same feed in the same run."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.station import free_port, running, server

from .feed import MESSAGES_PER_S
from .process import cpu_share, udp_drops

WARM_UP_S = 2.0
WINDOW_S = 8.0

_MAVUTIL_LOOP = """
import sys
from pymavlink import mavutil
link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{sys.argv[1]}", dialect="common")
while True:
    link.recv_match(blocking=True)
"""


@contextmanager
def gcs(udp_port: int) -> Iterator[int]:
    """Our server, whole: recording, history and 3D scene on, nobody looking."""
    with server([f"udpin://127.0.0.1:{udp_port}"]) as (_, process):
        yield process.pid


@contextmanager
def mavutil(udp_port: int) -> Iterator[int]:
    """The loop that most scripts are: every message made into an object."""
    with running([sys.executable, "-c", _MAVUTIL_LOOP, str(udp_port)]) as process:
        time.sleep(1.5)
        yield process.pid


@contextmanager
def mavproxy(udp_port: int) -> Iterator[int]:
    """MAVProxy without modules, console or log."""
    program = Path(sys.executable).parent / "mavproxy.py"
    with tempfile.TemporaryDirectory() as state:
        command = [sys.executable, str(program), f"--master=udpin:127.0.0.1:{udp_port}", "--daemon"]
        command += ["--non-interactive", f"--state-basedir={state}", "--default-modules="]
        with running(command, cwd=state, stdin=subprocess.DEVNULL) as process:
            time.sleep(3)
            yield process.pid


CONSUMERS = {"this server": gcs, "pymavlink.mavutil loop": mavutil, "MAVProxy": mavproxy}


def measure(name: str, vehicles: int) -> tuple[float, int]:
    """CPU share (1 = one core) and datagrams that the kernel dropped before the consumer read them."""
    port = free_port()
    with CONSUMERS[name](port) as pid:
        seconds = str(WARM_UP_S + WINDOW_S + 1)
        command = [sys.executable, "-m", "tests.bench.feed", str(port), str(vehicles), seconds]
        with running(command, stdout=subprocess.PIPE) as feed:
            assert feed.stdout is not None
            feed.stdout.readline()  # it has encoded its frames and begins
            time.sleep(WARM_UP_S)
            share = cpu_share(pid, WINDOW_S)
            return share, udp_drops(port)


def table() -> Iterator[str]:
    """Rows of Markdown, as they become known."""
    yield f"| consumer | CPU at 1 × {MESSAGES_PER_S} msg/s | 10 × | 50 × | dropped at 50 × |"
    yield "|---|---|---|---|---|"
    for name in CONSUMERS:
        cells: list[str] = []
        drops = 0
        for vehicles in (1, 10, 50):
            share, drops = measure(name, vehicles)
            cells.append(f"{share:.1%}")
        yield f"| {name} | {' | '.join(cells)} | {drops} |"
