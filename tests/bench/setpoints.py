"""Time from a client's setpoint to its datagram to the vehicle: over REST and over a WebSocket."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Callable, Iterator

import httpx
from websockets.sync.client import connect

from gcs_server.client import SyncGcs
from tests.station import free_port, server, vehicle

from .process import load_average, quantiles_ms
from .relay import LOCAL_NED, Relay

ROUNDS = 400
PERIOD_S = 0.02
LOST_AFTER_S = 1.0
CLIENT = {"X-Client": "bench", "X-Client-Id": "bench"}


def request(north_m: float) -> dict[str, object]:
    """A position setpoint; `north_m` is different for each setpoint of the run."""
    place = {"type": "position", "position_ned_m": [north_m, 0, -5], "yaw_ned_rad": 0}
    return {"setpoint": place, "valid_for_s": 60}


def wait_for_setpoint(relay: Relay, since: int, north_m: float) -> float | None:
    """Arrival time of the datagram with that position; None: there was none in time."""
    end_s = time.monotonic() + LOST_AFTER_S
    wanted = struct.pack("<f", north_m)
    while time.monotonic() < end_s:
        for arrival_s, frame in relay.setpoints[since:]:
            if int.from_bytes(frame[7:10], "little") == LOCAL_NED and frame[14:18] == wanted:
                return arrival_s
        time.sleep(0.0005)
    return None


def latencies_s(relay: Relay, send: Callable[[dict[str, object]], None], first: int) -> list[float]:
    """Latencies of `ROUNDS` setpoints, 50 per second."""
    latencies: list[float] = []
    for index in range(first, first + ROUNDS):
        north_m = struct.unpack("<f", struct.pack("<f", index / 1000.0))[0]
        since, sent_s = len(relay.setpoints), time.monotonic()
        send(request(north_m))
        passed_s = wait_for_setpoint(relay, since, north_m)
        if passed_s is not None:
            latencies.append(passed_s - sent_s)
        time.sleep(max(0.0, sent_s + PERIOD_S - time.monotonic()))
    return latencies


def measure() -> dict[str, list[float]]:
    """Latencies by protocol."""
    link_port = free_port()
    with (
        Relay(link_port) as relay,
        server([f"udpin://127.0.0.1:{link_port}"]) as (url, _),
        vehicle(relay.vehicle_port),
        SyncGcs(url, client="bench", client_id="bench") as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True)
        path = "/api/v1/vehicles/101/offboard"
        with (
            drone.offboard(position_ned_m=(0.0, 0.0, -5.0), valid_for_s=60),
            httpx.Client(base_url=url, headers=CLIENT, timeout=10) as http,
            connect(url.replace("http", "ws") + path + "/stream", additional_headers=CLIENT) as socket,
        ):

            def post(body: dict[str, object]) -> None:
                http.post(f"{path}/setpoint", json=body).raise_for_status()

            def send(body: dict[str, object]) -> None:
                socket.send(json.dumps(body))
                assert "applied" in json.loads(socket.recv(timeout=LOST_AFTER_S))

            post(request(0.0))
            return {
                "REST": latencies_s(relay, post, 1),
                "WebSocket": latencies_s(relay, send, 10_000),
            }


def table() -> Iterator[str]:
    """Rows of Markdown."""
    yield "| way in | load average | setpoints | ms to the datagram: p50 / p99 / max |"
    yield "|---|---|---|---|"
    for way, latencies in measure().items():
        yield f"| {way} | {load_average()} | {len(latencies)} of {ROUNDS} | {quantiles_ms(latencies)} |"
