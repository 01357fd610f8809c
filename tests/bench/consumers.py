"""The server's CPU share on a feed, compared with other programs on the same feed in the same run."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx

from tests.station import free_port, running_process, running_server

from .feed import MESSAGES_PER_S
from .process import cpu_share, udp_drops

WARM_UP_S = 2.0
WINDOW_S = 8.0

_MAVUTIL_PROGRAM = """
import sys
from pymavlink import mavutil
link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{sys.argv[1]}", dialect="common")
while True:
    link.recv_match(blocking=True)
"""


@dataclass(frozen=True, slots=True)
class RunningConsumer:
    """A running consumer."""

    pid: int
    received_count: Callable[[], int] | None = None
    """Messages that it has counted itself; None if it does not report them."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """One cell of the table."""

    cpu_share: float
    """CPU share of one core."""
    dropped_count: int
    """Datagrams that the kernel dropped before the consumer read them."""
    received_count: int | None
    """Received messages by the consumer's own count, out of `sent_count`."""
    sent_count: int


@contextmanager
def gcs(udp_port: int) -> Generator[RunningConsumer]:
    """The whole server: recording, history and 3D scene on, without a browser."""
    with running_server([f"udpin://127.0.0.1:{udp_port}"]) as (url, process):

        def received() -> int:
            (link,) = httpx.get(f"{url}/api/v1/links").raise_for_status().json()["links"]
            return int(link["frames_received"])

        yield RunningConsumer(process.pid, received)


@contextmanager
def mavutil(udp_port: int) -> Generator[RunningConsumer]:
    """The loop of most scripts: each message becomes an object."""
    with running_process([sys.executable, "-c", _MAVUTIL_PROGRAM, str(udp_port)]) as process:
        time.sleep(1.5)  # until it has opened its port
        yield RunningConsumer(process.pid)


@contextmanager
def mavproxy(udp_port: int) -> Generator[RunningConsumer]:
    """MAVProxy without modules, console or log."""
    program = Path(sys.executable).parent / "mavproxy.py"
    with tempfile.TemporaryDirectory() as state:
        command = [sys.executable, str(program), f"--master=udpin:127.0.0.1:{udp_port}", "--daemon"]
        command += ["--non-interactive", f"--state-basedir={state}", "--default-modules="]
        with running_process(command, cwd=state, stdin=subprocess.DEVNULL) as process:
            time.sleep(3)  # until it has opened its port
            yield RunningConsumer(process.pid)


CONSUMERS = {"this server": gcs, "pymavlink.mavutil loop": mavutil, "MAVProxy": mavproxy}


def measure(name: str, vehicles: int) -> Measurement:
    """Runs one consumer on one feed."""
    port = free_port()
    with CONSUMERS[name](port) as consumer:
        seconds = str(WARM_UP_S + WINDOW_S + 1)
        command = [sys.executable, "-m", "tests.bench.feed", str(port), str(vehicles), seconds]
        with running_process(command, stdout=subprocess.PIPE) as feed:
            assert feed.stdout is not None
            feed.stdout.readline()  # the feed is encoded and starts
            time.sleep(WARM_UP_S)
            share = cpu_share(consumer.pid, WINDOW_S)
            sent = int(feed.stdout.readline())  # the feed has ended
            time.sleep(0.2)
            received = consumer.received_count() if consumer.received_count is not None else None
            return Measurement(share, udp_drops(port), received, sent)


def table() -> Iterator[str]:
    """Rows of Markdown, as they are measured."""
    yield f"| consumer | CPU at 1 × {MESSAGES_PER_S} msg/s | 10 × | 50 × | dropped at 50 × | received |"
    yield "|---|---|---|---|---|---|"
    share_at_50: dict[str, float] = {}
    for name in CONSUMERS:
        measurements = [measure(name, vehicles) for vehicles in (1, 10, 50)]
        at_50 = measurements[-1]
        share_at_50[name] = at_50.cpu_share
        shares = " | ".join(f"{measurement.cpu_share:.1%}" for measurement in measurements)
        received = (
            "not reported"
            if at_50.received_count is None
            else f"{at_50.received_count} of {at_50.sent_count}"
        )
        yield f"| {name} | {shares} | {at_50.dropped_count} | {received} |"
    (own_name, own_share), *peers = share_at_50.items()
    ratios = ", ".join(f"{own_share / share:.2f} of {name}'s" for name, share in peers if share)
    yield f"\n{own_name.capitalize()} at 50 ×: {ratios}."
