"""Forwards frames between vehicles and other ground stations.

Loops are impossible: frames are never sent back to their source or from one station to another, and frames
that a station sends with a vehicle's id are dropped. If a vehicle is connected over two links, only the
frames of one link are forwarded.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from gcs_server.links.base import Peer
from gcs_server.mavlink.codec import Frame
from gcs_server.mavlink.connection import Connection
from gcs_server.mavlink.tables import TARGET_SYSTEM_OFFSET

CHANGE_ROUTE_AFTER_S = 2.0
"""If a vehicle sends nothing on the link whose frames are forwarded for this time, its frames from another
link are forwarded [s]."""


@dataclass(slots=True)
class _Route:
    connection: Connection
    peer: Peer
    last_received_s: float


class Forwarder:
    """Forwards frames, and tracks over which connection each system is reached."""

    def __init__(self, own_system_id: int) -> None:
        self.stations: tuple[Connection, ...] = ()
        """Connections to other ground stations; without any, `forward` does nothing."""
        self._own_system_id = own_system_id
        self._routes: dict[int, _Route] = {}

    def set_connections(self, connections: Iterable[Connection]) -> None:
        """Sets all connections; call after each change."""
        self.stations = tuple(c for c in connections if c.link.forward)
        if not self.stations:
            self._routes.clear()

    def forward(self, frame: Frame, connection: Connection, peer: Peer) -> None:
        """Forwards a received frame."""
        link = connection.link
        if link.replay or not self.stations:
            return
        if link.forward:
            self._forward_to_vehicles(frame)
            return
        route = self._routes.get(frame.system_id)
        if route is None or frame.received_monotonic_s - route.last_received_s > CHANGE_ROUTE_AFTER_S:
            route = self._routes[frame.system_id] = _Route(connection, peer, frame.received_monotonic_s)
        elif route.connection is not connection or route.peer is not peer:
            return
        route.last_received_s = frame.received_monotonic_s
        for station in self.stations:
            for station_peer in station.link.peers():
                station.forward(frame, station_peer)

    def peer_gone(self, connection: Connection, peer: Peer) -> None:
        """Deletes the routes over this peer."""
        for system_id, route in list(self._routes.items()):
            if route.connection is connection and route.peer is peer:
                del self._routes[system_id]

    def _forward_to_vehicles(self, frame: Frame) -> None:
        if frame.system_id in self._routes:
            return
        offset = TARGET_SYSTEM_OFFSET.get(frame.msg_id)
        target = frame.payload[offset] if offset is not None and offset < len(frame.payload) else 0
        if target == self._own_system_id:
            return
        for system_id, route in self._routes.items():
            if target in (0, system_id):
                route.connection.forward(frame, route.peer)
