"""A vehicle in real time with a TCP port for the external client, and the server connected to it. The port is
the vehicle's own, or with `GUARDED` a guarded link of the server."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from gcs_server.client import SyncGcs
from tests.clients.mavsdk_drone import GUARDED
from tests.clients.observed_vehicle import ObservedVehicle
from tests.station import free_port, running_server, running_vehicles


@pytest.fixture
def observed_vehicle() -> Iterator[ObservedVehicle]:
    """A vehicle that can be armed; no client has control."""
    udp_port, tcp_port = free_port(), free_port(socket.SOCK_STREAM)
    guards = [f"tcpin://127.0.0.1:{tcp_port}?guard=free"] if GUARDED else []
    with (
        running_server([f"udpin://127.0.0.1:{udp_port}", *guards]) as (url, _),
        running_vehicles(udp_port, tcp_port=0 if GUARDED else tcp_port),
        SyncGcs(url, client="observer") as gcs,
    ):
        yield ObservedVehicle(tcp_port, gcs.wait_for_vehicle("101", ready=True))
