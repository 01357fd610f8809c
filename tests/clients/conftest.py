"""A vehicle in real time with a TCP port for the outside client, and our server watching it."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from gcs_server.client import SyncGcs, SyncVehicle
from tests.station import free_port, server, vehicle


@dataclass(frozen=True)
class Watched:
    """Where the client connects, and what the server sees meanwhile."""

    tcp_port: int
    drone: SyncVehicle

    def history(self, topic: str) -> list[dict[str, object]]:
        """Every value of a topic that the server remembers, oldest first."""
        samples = self.drone.request("GET", f"/history?topics={topic}&since_unix_s=0")["samples"]
        return [sample["value"] for sample in samples]


@pytest.fixture
def watched() -> Iterator[Watched]:
    """Ready to arm, with nobody in command."""
    udp_port, tcp_port = free_port(), free_port(socket.SOCK_STREAM)
    with (
        server([f"udpin://127.0.0.1:{udp_port}"]) as (url, _),
        vehicle(udp_port, tcp_port=tcp_port),
        SyncGcs(url, client="watcher") as gcs,
    ):
        yield Watched(tcp_port, gcs.wait_for_vehicle("101", ready=True))
