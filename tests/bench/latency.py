"""Time added by the server: REST round trip compared with the vehicle's own, and UDP datagram → WebSocket
sample."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator

import httpx
from pymavlink.dialects.v20 import common as mavlink
from websockets.sync.client import connect

from tests.station import free_port, running_server, running_vehicles, wait_until

from .process import quantiles_ms

ROUNDS = 300
PARAMETER = "MPC_XY_CRUISE"


def vehicle_round_trips_s(tcp_port: int, system_id: int, pause_s: float = 0.0) -> list[float]:
    """PARAM_REQUEST_READ → PARAM_VALUE on a direct link, without the server; with a pause after each."""
    mav = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    durations_s: list[float] = []
    with socket.create_connection(("127.0.0.1", tcp_port), timeout=5) as link:
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for _ in range(ROUNDS):
            request = mav.param_request_read_encode(system_id, 1, PARAMETER.encode(), -1)
            began = time.monotonic()
            link.sendall(request.pack(mav))
            while not _has_parameter(parser.parse_buffer(link.recv(65536))):
                pass
            durations_s.append(time.monotonic() - began)
            time.sleep(pause_s)
    return durations_s


def _has_parameter(messages: list[mavlink.MAVLink_message] | None) -> bool:
    return any(m.get_msgId() == mavlink.MAVLINK_MSG_ID_PARAM_VALUE for m in messages or [])


def rest_round_trips_s(url: str, path: str) -> list[float]:
    """The same request through the server."""
    durations_s: list[float] = []
    with httpx.Client(base_url=url, timeout=10) as client:
        client.get(path).raise_for_status()
        for _ in range(ROUNDS):
            began = time.monotonic()
            client.get(path).raise_for_status()
            durations_s.append(time.monotonic() - began)
    return durations_s


def udp_to_websocket_s(url: str, udp_port: int) -> list[float]:
    """From sending a datagram to the arrival of the sample at a WebSocket client, at 50 messages per
    second."""
    mav = mavlink.MAVLink(None, srcSystem=77, srcComponent=1)
    target = ("127.0.0.1", udp_port)
    sent_at: dict[int, float] = {}
    durations_s: list[float] = []
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        connect(url.replace("http", "ws") + "/api/v1/telemetry") as listener,
    ):
        request = {"type": "subscribe", "vehicles": ["77"], "topics": ["attitude"], "rate_hz": 100}
        listener.send(json.dumps(request))
        for index in range(ROUNDS):
            if index % 50 == 0:
                heartbeat = mav.heartbeat_encode(2, mavlink.MAV_AUTOPILOT_PX4, 157, 50593792, 4)
                sender.sendto(heartbeat.pack(mav), target)
            boot_ms = 1000 + index * 20
            attitude = mav.attitude_quaternion_encode(boot_ms, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            sent_at[boot_ms] = time.monotonic()
            sender.sendto(attitude.pack(mav), target)
            deadline = sent_at[boot_ms] + 0.02
            while (remaining_s := deadline - time.monotonic()) > 0:
                try:
                    frame = json.loads(listener.recv(timeout=remaining_s))
                except TimeoutError:
                    break
                now = time.monotonic()
                for sample in frame.get("samples", ()):
                    sample_boot_ms = round(sample["vehicle_time_boot_s"] * 1000)
                    if sample_boot_ms in sent_at:
                        durations_s.append(now - sent_at.pop(sample_boot_ms))
    return durations_s


def vehicle_is_connected(url: str) -> bool:
    """Whether the server knows vehicle 101."""
    return httpx.get(f"{url}/api/v1/vehicles/101").status_code == 200


def table() -> Iterator[str]:
    """Rows of Markdown."""
    yield "| what | samples | ms: p50 / p99 / max |"
    yield "|---|---|---|"
    link_port, tcp_port = free_port(), free_port(socket.SOCK_STREAM)
    with running_server([f"udpin://127.0.0.1:{link_port}"]) as (url, _):
        with running_vehicles(link_port, tcp_port=tcp_port):
            wait_until(lambda: vehicle_is_connected(url), "the vehicle")
            direct_s = vehicle_round_trips_s(tcp_port, 101)
            yield f"| parameter read from the vehicle (TCP) | {len(direct_s)} | {quantiles_ms(direct_s)} |"
            rest_s = rest_round_trips_s(url, f"/api/v1/vehicles/101/params/{PARAMETER}")
            yield f"| parameter read through REST | {len(rest_s)} | {quantiles_ms(rest_s)} |"
        health_s = rest_round_trips_s(url, "/api/v1/health")
        yield f"| REST alone (health) | {len(health_s)} | {quantiles_ms(health_s)} |"
        added_s = udp_to_websocket_s(url, link_port)
        yield f"| UDP datagram → WebSocket sample | {len(added_s)} of {ROUNDS} | {quantiles_ms(added_s)} |"
