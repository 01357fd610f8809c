"""Manages connections, heartbeats, forwarding and recording, and passes frames to the fleet."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.errors import InvalidRequest, Refused, UnknownLink
from gcs_server.links.base import Link, LinkInfo, Peer
from gcs_server.links.url import NO_OTHER_KINDS, LinkMaker, make_link
from gcs_server.mavlink import dialect
from gcs_server.mavlink.codec import Frame, encode_payload
from gcs_server.mavlink.connection import Connection
from gcs_server.mavlink.key_store import KeyStore
from gcs_server.mavlink.link_signing import STORE_INTERVAL_S, Signing
from gcs_server.mavlink.tables import TARGET_SYSTEM_OFFSET
from gcs_server.mavlink.tlog_writer import TlogRecorder
from gcs_server.supervise import Supervisor

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


HEARTBEAT_INTERVAL_S = 1.0
MAX_LINKS = 64
"""Maximum number of links and replays; each has a socket or a thread, and is supervised."""
WARNED_STATES = ("waiting", "open")
"""Link states whose detail is shown as a warning."""


@dataclass(frozen=True, slots=True)
class RouterSettings:
    """Settings of the router."""

    system_id: int = 255
    component_id: int = 190
    signing_dir: Path | None = None
    """Folder with the signing keys; None: signing is not available."""
    recording_dir: Path | None = None
    """Folder for the tlogs; None: no recording."""
    recording_max_bytes: int = 200_000_000
    """Size at which a tlog is closed and the next one begins."""
    recording_keep_free_bytes: int = 500_000_000
    """Recording stops while the disk has less free space than this."""


class FrameSink:
    """Receiver of frames. This default, which does nothing, is replaced by the fleet and by the guards."""

    def on_frame(self, frame: Frame, connection: Connection, peer: Peer) -> None:
        """Handles a frame from a vehicle or a program (not from a forwarding link)."""

    def on_peer_gone(self, connection: Connection, peer: Peer) -> None:
        """Handles the loss of a peer or of its link."""


class Router:
    """All links of the server.

    Args:
        other_kinds: functions that create links of other protocols than MAVLink, by URL scheme.
    """

    def __init__(
        self,
        clock: Clock,
        supervisor: Supervisor,
        settings: RouterSettings,
        other_kinds: Mapping[str, LinkMaker] = NO_OTHER_KINDS,
    ) -> None:
        self.settings = settings
        self._other_kinds = other_kinds
        self._own_system_id = settings.system_id
        self.sink = FrameSink()
        """Receives the frames of vehicles."""
        self.programs = FrameSink()
        """Receives the frames of programs on guarded links."""
        self._clock = clock
        self._supervisor = supervisor
        self._connections: dict[str, Connection] = {}
        self._on_change: list[Callable[[LinkInfo], None]] = []
        self._forwarder = Forwarder(settings.system_id)
        self.signing = Signing(clock, KeyStore(settings.signing_dir) if settings.signing_dir else None)
        self._recorder = (
            TlogRecorder(
                settings.recording_dir,
                max_bytes=settings.recording_max_bytes,
                keep_free_bytes=settings.recording_keep_free_bytes,
            )
            if settings.recording_dir is not None
            else None
        )
        self._heartbeat = encode_payload(
            dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_GCS,
                dialect.MAV_AUTOPILOT_INVALID,
                0,
                0,
                dialect.MAV_STATE_ACTIVE,
                3,
            )
        )

    def start(self) -> None:
        """Starts recording, and heartbeats at 1 Hz to each peer of each link that is neither a replay nor a
        forwarding link."""
        if self._recorder is not None:
            self._recorder.start()
        self._supervisor.start("heartbeats", self._send_heartbeats)
        self._supervisor.start("signing", self._store_signing_time)

    def add_link(self, url: str, name: str | None = None) -> LinkInfo:
        """Creates and opens the link of a URL.

        Raises:
            InvalidRequest: the URL is not valid, or the name is in use.
            Refused: the limit of links is reached.
            LinkError: the recording to replay does not exist, or software that the link needs is missing.
        """
        return self.add(self.make_link(url, name))

    def make_link(self, url: str, name: str | None = None) -> Link:
        """Creates the link of a URL without opening it: a kind in `links/url.py`, or one of `other_kinds`.

        Raises:
            InvalidRequest, LinkError: see `add_link`.
        """
        return make_link(url, name, self._other_kinds)

    def add(self, link: Link) -> LinkInfo:
        """Adds and opens a link.

        Raises:
            InvalidRequest: the name or the URL is in use.
            Refused: the limit of links is reached.
        """
        if link.name in self._connections:
            raise InvalidRequest(
                "name",
                f"A link {link.name!r} already exists.",
                remedy="Remove it first, or give another name.",
            )
        if len(self._connections) >= MAX_LINKS:
            raise Refused(
                f"{MAX_LINKS} links and replays are open, which is the limit.",
                remedy="Remove one that is not needed (DELETE /links/{name}).",
            )
        self._refuse_loop(link)
        signing = None if link.signing is None else self.signing.open(link.name, link.signing)
        recording = self._recorder.channel(link.name) if self._recorder and not link.replay else None
        connection = Connection(
            link,
            self._clock,
            system_id=self.settings.system_id,
            component_id=self.settings.component_id,
            recording=recording,
            signing=signing,
            on_frame=self._frame,
            on_new_peer=self._new_peer,
            on_peer_gone=self._peer_gone,
            on_state=self._changed,
        )
        self._connections[link.name] = connection
        self._forwarder.set_connections(self._connections.values())
        try:
            connection.start()
        except BaseException:  # undo the steps so far
            del self._connections[link.name]
            self._forwarder.set_connections(self._connections.values())
            if recording is not None:
                recording.closing = True
            if signing is not None:
                self.signing.release(signing)
            raise
        return connection.info()

    async def remove_link(self, name: str) -> None:
        """Closes and removes a link.

        Raises:
            UnknownLink: no link has this name.
        """
        connection = self.connection(name)
        del self._connections[name]
        self._forwarder.set_connections(self._connections.values())
        await connection.close()
        if connection.signing is not None:
            self.signing.release(connection.signing)

    def links(self) -> list[LinkInfo]:
        """State and counters of all links."""
        return [connection.info() for connection in self._connections.values()]

    def connections(self) -> tuple[Connection, ...]:
        """The connections of all links."""
        return tuple(self._connections.values())

    def connection(self, name: str) -> Connection:
        """The connection of a link.

        Raises:
            UnknownLink: no link has this name.
        """
        if name not in self._connections:
            known = ", ".join(self._connections) or "none"
            raise UnknownLink(f"There is no link {name!r}.", remedy=f"Links now: {known}.")
        return self._connections[name]

    def warnings(self) -> list[tuple[str, str, str]]:
        """Current warnings (kind, link, text): links that wait or have faults, refused frames, stopped
        recordings."""
        faults = [
            (
                "link",
                name,
                f"{c.link.faults.count} messages or events of this link could not be handled because of a "
                f"fault in this server ({c.link.faults.newest}). They were skipped; the link continues. "
                "Please report it with the server's log.",
            )
            for name, c in self._connections.items()
            if c.link.faults.recent
        ]
        waiting = [("link", i.name, i.detail) for i in self.links() if i.state in WARNED_STATES and i.detail]
        refused = [
            ("signing", name, text)
            for name, c in self._connections.items()
            if c.signing is not None
            for text in c.signing.warnings()
        ]
        problems = self._recorder.problems() if self._recorder else []
        return waiting + faults + refused + [("recording", link, why) for link, why in problems]

    def on_change(self, callback: Callable[[LinkInfo], None]) -> None:
        """Adds a function that is called when a link's state or its peers change."""
        self._on_change.append(callback)

    async def close(self) -> None:
        """Closes all links and ends the recordings."""
        for name in list(self._connections):
            await self.remove_link(name)
        if self._recorder is not None:
            self._recorder.close()
        self.signing.store_timestamp()

    def _refuse_loop(self, link: Link) -> None:
        by_address = {c.link.url.split("?")[0].split("://")[-1]: c.link for c in self._connections.values()}
        other = by_address.get(link.url.split("?")[0].split("://")[-1])
        if other is not None and other.leads_to_vehicles != link.leads_to_vehicles:
            raise InvalidRequest(
                "url",
                f"{link.url!r} would send the vehicles' messages back to this server's own link "
                f"{other.name!r}.",
                remedy="Forward to the port on which the other ground station listens.",
            )

    def _frame(self, frame: Frame, connection: Connection, peer: Peer) -> None:
        link = connection.link
        if link.guard is not None:
            self.programs.on_frame(frame, connection, peer)
            return
        if frame.system_id == self._own_system_id and not link.replay and not link.forward:
            return  # an echo of this server's own frame, or another station with the same id
        if self._forwarder.stations:
            self._forwarder.forward(frame, connection, peer)
        if not link.forward:
            self.sink.on_frame(frame, connection, peer)

    def _new_peer(self, connection: Connection, peer: Peer) -> None:
        if not connection.link.replay and connection.link.leads_to_vehicles:
            connection.sender.send(dialect.MAVLINK_MSG_ID_HEARTBEAT, self._heartbeat, peer)

    def _peer_gone(self, connection: Connection, peer: Peer) -> None:
        if connection.link.guard is not None:
            self.programs.on_peer_gone(connection, peer)
            return
        self._forwarder.peer_gone(connection, peer)
        self.sink.on_peer_gone(connection, peer)

    def _changed(self, connection: Connection) -> None:
        info = connection.link.info()
        for callback in self._on_change:
            try:  # a failing listener must not affect the others
                callback(info)
            except Exception as error:
                connection.link.faults.add(error, "reporting a change")

    async def _store_signing_time(self) -> None:
        while True:
            await self._clock.sleep(STORE_INTERVAL_S)
            if self.signing.in_use:
                await asyncio.to_thread(self.signing.store_timestamp)

    async def _send_heartbeats(self) -> None:
        next_s = self._clock.monotonic_s()
        while True:
            for connection in tuple(self._connections.values()):
                if connection.link.replay or not connection.link.leads_to_vehicles:
                    continue
                try:  # a fault of one link must not stop heartbeats on the other links
                    for peer in connection.mavlink_peers():
                        connection.sender.send(dialect.MAVLINK_MSG_ID_HEARTBEAT, self._heartbeat, peer)
                except Exception as error:
                    connection.link.faults.add(error, "sending a heartbeat")
            now_s = self._clock.monotonic_s()
            next_s = max(next_s + HEARTBEAT_INTERVAL_S, now_s)
            await self._clock.sleep(next_s - now_s)
