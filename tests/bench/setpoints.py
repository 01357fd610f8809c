"""Time from a client's setpoint to its datagram to the vehicle: over REST and over a WebSocket.

The client is a program of its own (`python -m tests.bench.setpoints URL`), because the relay in the bench's
process would delay it. It calls health, REST and the WebSocket in turn: after a pause of 20 ms the same call
takes several times as long as without a pause, so only calls at the same pace can be compared.
"""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Protocol

import httpx
from websockets.sync.client import connect

from gcs_server.client import SyncGcs
from tests.station import free_port, running_server, running_vehicles

from .process import load_average, quantiles_ms
from .relay import Relay

SETPOINTS = 400
PERIOD_S = 0.02
LOST_AFTER_S = 1.0
CLIENT_HEADERS = {"X-Client": "bench", "X-Client-Id": "bench"}
Send = Callable[[dict[str, object]], None]
ALONE = "REST alone (health), until the answer"


class SetpointRecorder(Protocol):
    """Records the setpoints on their way to a vehicle."""

    def sent_at_s(self, north_m: float) -> float | None:
        """Time of the first setpoint with this position. None: not found."""
        ...

    def clear(self) -> None:
        """Deletes the recorded setpoints."""
        ...


def send_setpoints(url: str) -> list[tuple[str, float, float, float]]:
    """Calls each API `SETPOINTS` times; returns API, north of the setpoint [m], start and end of each call
    [s, monotonic]."""
    path = "/api/v1/vehicles/101/offboard"
    with (
        httpx.Client(base_url=url, headers=CLIENT_HEADERS, timeout=10) as http,
        connect(url.replace("http", "ws") + path + "/stream", additional_headers=CLIENT_HEADERS) as socket,
    ):

        def post(body: dict[str, object]) -> None:
            http.post(f"{path}/setpoint", json=body).raise_for_status()

        def send(body: dict[str, object]) -> None:
            socket.send(json.dumps(body))
            assert "applied" in json.loads(socket.recv(timeout=LOST_AFTER_S))

        def health(_: dict[str, object]) -> None:
            http.get("/api/v1/health").raise_for_status()

        apis: dict[str, Callable[[dict[str, object]], None]] = {
            ALONE: health,
            "REST": post,
            "WebSocket": send,
        }
        calls: list[tuple[str, float, float, float]] = []
        for index in range(1, 3 * SETPOINTS + 1):
            api = list(apis)[index % 3]
            north_m = struct.unpack("<f", struct.pack("<f", index / 1000.0))[0]  # as a 32-bit float
            setpoint = {"type": "position", "position_ned_m": [north_m, 0, -5], "yaw_ned_rad": 0}
            began_s = time.monotonic()
            apis[api]({"setpoint": setpoint, "valid_for_s": 60})
            calls.append((api, north_m, began_s, time.monotonic()))
            time.sleep(max(0.0, began_s + PERIOD_S - time.monotonic()))
        return calls


def latencies_s(recorder: SetpointRecorder, url: str) -> dict[str, list[float]]:
    """Latencies of the setpoints by API, and durations of the health requests between them; vehicle 101 has a
    stream."""
    recorder.clear()
    command = [sys.executable, "-m", "tests.bench.setpoints", url]
    calls = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    time.sleep(LOST_AFTER_S)
    latencies: dict[str, list[float]] = {}
    for api, north_m, began_s, ended_s in calls:
        until_s = ended_s if api == ALONE else recorder.sent_at_s(north_m)
        if until_s is not None:
            latencies.setdefault(api, []).append(until_s - began_s)
    return latencies


def measure() -> dict[str, list[float]]:
    """Latencies by API (REST or WebSocket), and of REST alone."""
    link_port = free_port()
    with (
        Relay(link_port) as relay,
        running_server([f"udpin://127.0.0.1:{link_port}"]) as (url, _),
        running_vehicles(relay.vehicle_port),
        SyncGcs(url, client="bench", client_id="bench") as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True)
        with drone.offboard(position_ned_m=(0.0, 0.0, -5.0), valid_for_s=60):
            return latencies_s(relay, url)


def table() -> Iterator[str]:
    """Rows of Markdown."""
    yield "| API | load average | calls | ms to the datagram: p50 / p99 / max | p50 / p50 of REST alone |"
    yield "|---|---|---|---|---|"
    measured = {api: sorted(each) for api, each in measure().items()}
    alone_s = measured[ALONE][len(measured[ALONE]) // 2]
    for api, latencies in measured.items():
        ratio = latencies[len(latencies) // 2] / alone_s
        cells = f"{len(latencies)} of {SETPOINTS} | {quantiles_ms(latencies)} | {ratio:.2f}"
        yield f"| {api} | {load_average()} | {cells} |"


if __name__ == "__main__":
    print(json.dumps(send_setpoints(sys.argv[1])))
