"""The server's cost of an open browser that does not read; it should be zero."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import msgspec
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.station import free_port, running_process, running_server
from tests.support.viser_camera import CAMERA_MESSAGE

from .process import cpu_share, load_average, resident_mb

VEHICLES = 10
WARM_UP_S = 4.0
WINDOW_S = 20.0
CASES = (("none", 0, 0), ("one that reads", 1, 0), ("one that reads, one that does not", 1, 1))


def open_telemetry(url: str) -> ClientConnection:
    """Subscribes to all topics of all vehicles at 20 Hz."""
    base = url.replace("http://", "ws://")
    telemetry = connect(f"{base}/api/v1/telemetry", max_size=None, max_queue=1, ping_interval=None)
    telemetry.send(json.dumps({"type": "subscribe", "vehicles": "*", "topics": "*", "rate_hz": 20}))
    return telemetry


def open_scene(url: str) -> ClientConnection:
    """Opens the WebSocket of the 3D view."""
    base = url.replace("http://", "ws://")
    scene = connect(
        f"{base}/scene/",
        max_size=None,
        max_queue=1,
        ping_interval=None,
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
    )
    scene.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
    return scene


def _read_all(connection: ClientConnection) -> None:
    with contextlib.suppress(ConnectionClosed):
        for _ in connection:
            pass


def _measure(readers: int, not_reading: int) -> tuple[float, float, float]:
    """The server's CPU share, and its memory at the start and at the end of the window [MB]."""
    port = free_port()
    seconds = str(WARM_UP_S * 2 + WINDOW_S + 1)
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, process),
        contextlib.ExitStack() as connections,
    ):
        command = [sys.executable, "-m", "tests.bench.feed", str(port), str(VEHICLES), seconds]
        with running_process(command, stdout=subprocess.PIPE) as feed:
            assert feed.stdout is not None
            feed.stdout.readline()  # the feed is encoded and starts
            time.sleep(WARM_UP_S)
            for index in range(readers + not_reading):
                for stream in (open_telemetry(url), open_scene(url)):
                    # Without a close frame: a client that does not read would not receive the server's reply.
                    connections.callback(stream.socket.close)
                    if index < readers:
                        threading.Thread(target=_read_all, args=(stream,), daemon=True).start()
            time.sleep(WARM_UP_S)
            start_mb = resident_mb(process.pid)
            share = cpu_share(process.pid, WINDOW_S)
            return share, start_mb, resident_mb(process.pid)


def table() -> Iterator[str]:
    """Rows of Markdown, as they are measured."""
    yield f"{VEHICLES} × 100 msg/s; each browser has the telemetry of all at 20 Hz and the 3D view.\n"
    yield f"| open browsers | load average | server CPU | memory MB, over {WINDOW_S:.0f} s |"
    yield "|---|---|---|---|"
    for name, readers, not_reading in CASES:
        share, start_mb, end_mb = _measure(readers, not_reading)
        memory_mb = f"{start_mb:.0f} → {end_mb:.0f} ({end_mb - start_mb:+.1f})"
        yield f"| {name} | {load_average()} | {share:.1%} | {memory_mb} |"
