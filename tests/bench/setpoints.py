"""Time from a client's setpoint to its datagram to the vehicle: over REST and over a WebSocket."""

from __future__ import annotations

import contextlib
import json
import struct
import time
from collections.abc import Callable, Generator, Iterator, Sequence
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


def setpoint_request(north_m: float) -> dict[str, object]:
    """A position setpoint; `north_m` is different for each setpoint of the run."""
    setpoint = {"type": "position", "position_ned_m": [north_m, 0, -5], "yaw_ned_rad": 0}
    return {"setpoint": setpoint, "valid_for_s": 60}


class SetpointRecorder(Protocol):
    """Records the setpoints on their way to a vehicle."""

    @property
    def setpoints(self) -> Sequence[object]:
        """The setpoints recorded so far."""
        ...

    def sent_at_s(self, north_m: float, skip: int) -> float | None:
        """Time of a setpoint with this position; ignores the first `skip` setpoints. None: not found."""
        ...


Send = Callable[[dict[str, object]], None]


def wait_for_setpoint(recorder: SetpointRecorder, skip: int, north_m: float) -> float | None:
    """Time of a setpoint with that position; None if none was sent in time."""
    end_s = time.monotonic() + LOST_AFTER_S
    while time.monotonic() < end_s:
        at_s = recorder.sent_at_s(north_m, skip)
        if at_s is not None:
            return at_s
        time.sleep(0.0005)
    return None


def latencies_s(recorder: SetpointRecorder, send: Send, first_index: int) -> list[float]:
    """Latencies of `SETPOINTS` setpoints, 50 per second."""
    latencies: list[float] = []
    for index in range(first_index, first_index + SETPOINTS):
        north_m = struct.unpack("<f", struct.pack("<f", index / 1000.0))[0]  # as a 32-bit float
        skip, sent_s = len(recorder.setpoints), time.monotonic()
        send(setpoint_request(north_m))
        recorded_s = wait_for_setpoint(recorder, skip, north_m)
        if recorded_s is not None:
            latencies.append(recorded_s - sent_s)
        time.sleep(max(0.0, sent_s + PERIOD_S - time.monotonic()))
    return latencies


@contextlib.contextmanager
def rest_and_websocket(url: str) -> Generator[dict[str, Send]]:
    """Functions that send a setpoint over REST and over a WebSocket, to a stream of vehicle 101."""
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

        post(setpoint_request(0.0))
        yield {"REST": post, "WebSocket": send}


def measure() -> dict[str, list[float]]:
    """Latencies by API (REST or WebSocket)."""
    link_port = free_port()
    with (
        Relay(link_port) as relay,
        running_server([f"udpin://127.0.0.1:{link_port}"]) as (url, _),
        running_vehicles(relay.vehicle_port),
        SyncGcs(url, client="bench", client_id="bench") as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True)
        with (
            drone.offboard(position_ned_m=(0.0, 0.0, -5.0), valid_for_s=60),
            rest_and_websocket(url) as apis,
        ):
            return {
                api: latencies_s(relay, send, 1 + 10_000 * number)
                for number, (api, send) in enumerate(apis.items())
            }


def table() -> Iterator[str]:
    """Rows of Markdown."""
    yield "| API | load average | setpoints | ms to the datagram: p50 / p99 / max |"
    yield "|---|---|---|---|"
    for api, latencies in measure().items():
        yield f"| {api} | {load_average()} | {len(latencies)} of {SETPOINTS} | {quantiles_ms(latencies)} |"
