"""The `ros2://` link: PX4's topics over DDS, read by a separate thread.

The thread finds vehicles and converts their messages; the event loop only receives MAVLink frames. While
the loop is busy the thread reads nothing, and DDS keeps only the newest samples.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

from gcs_server.links.base import DdsAddress, Link, Peer
from gcs_server.links.writer import LinkWriter
from gcs_server.ros2.topics import STATUS, STATUS_VERSION, find_subscription, parse_status_topic, wire_type
from gcs_server.ros2.vehicle_link import VehicleLink
from gcs_server.ros2.versions import TopicVersions

if TYPE_CHECKING:
    from gcs_server.ros2.dds import DdsPort, Discovered, VehiclePort

READ_EVERY_S: Final = 0.02
DISCOVER_EVERY_S: Final = 0.25
REPORT_EVERY_S: Final = 1.0
FIRST_REPORT_S: Final = 5.0
"""Time after opening the link, or after finding a vehicle, before missing messages are reported [s]."""
MAX_VEHICLES: Final = 64
"""Maximum number of namespaces read by one link."""
MAX_UNREADABLE: Final = 16
"""Maximum number of unreadable topics that are reported."""
NO_NAMESPACE: Final = "/"
"""Peer name of a vehicle without a namespace."""
SAME_NAMESPACE_S: Final = 10.0
"""Time for which a second vehicle with the same namespace is reported after its last status [s]."""
OpenPort = Callable[[int, "str | None"], "DdsPort"]


def peer_name(namespace: str) -> str:
    """Name of the peer of a namespace."""
    return namespace or NO_NAMESPACE


class Ros2Link(Link):
    """The vehicles of a DDS domain, each a peer.

    Args:
        domain_id: number of the DDS domain.
        namespace: the only namespace that is read; None: all vehicles of the domain.
        interface: network interface; None: loopback.
        own_system_id: the server's system id.
        open_port: opens DDS.
    """

    protocol = "ROS 2"

    def __init__(
        self,
        name: str,
        url: str,
        domain_id: int,
        namespace: str | None,
        interface: str | None,
        open_port: OpenPort,
        own_system_id: int = 255,
    ) -> None:
        super().__init__(name, url)
        self.domain_id, self.namespace, self.interface = domain_id, namespace, interface
        self.own_system_id = own_system_id
        self._open_port = open_port
        self._sender = LinkWriter(None, self._write, self._counts, self.faults, lambda: self.now_s())
        self._run: _Run | None = None

    def _open(self) -> None:
        self._run = _Run(self, asyncio.get_running_loop(), self._open_port)
        self._run.thread.start()

    def _close(self) -> None:
        if self._run is not None:
            self._run.stop.set()
            self._run = None

    async def close(self) -> None:
        """Closes the link; returns when DDS has released its sockets."""
        run = self._run
        await super().close()
        if run is not None:
            await asyncio.to_thread(run.thread.join, 5.0)

    def _writer(self, peer: Peer) -> LinkWriter | None:
        return self._sender

    def _write(self, data: bytes, peer: Peer) -> int:
        run = self._run
        vehicle = None if run is None else run.vehicles.get(peer.name)
        if vehicle is None:
            raise OSError(f"{peer.name} is not connected")
        vehicle.send(data, time.time_ns() // 1000)
        return len(data)

    def unusable_topics(self, peer: Peer) -> Mapping[str, str]:
        """Topics that the vehicle has only in versions that the server does not know, each with a text."""
        return {} if self._run is None else self._run.unusable.get(peer.name, {})

    # --- in the event loop, called by the thread --------------------------------------------------------

    def on_open(self, run: _Run) -> None:
        """Marks the link as open; called when DDS is open."""
        if run is self._run:
            self._opened()

    def on_failure(self, run: _Run, why: str) -> None:
        """Closes the link and schedules a retry; called when DDS cannot be used."""
        if run is self._run:
            self._lost(why)

    def show_problems(self, run: _Run, detail: str) -> None:
        """Shows the current problems in the link's state; `detail` is empty if there are none."""
        if run is self._run:
            self._set_state("open", detail)

    def on_frames(self, run: _Run, batch: list[tuple[str, bytes]], taken_s: float) -> None:
        """Receives the MAVLink frames of vehicles, by peer name."""
        run.delivered.set()
        if run is not self._run:
            return
        for name, data in batch:
            peer = self._peers.get(name)
            if peer is None:
                peer = self._peers[name] = self._peer(name)
                self._changed()
            self._received(data, peer, taken_s)

    def _peer(self, name: str) -> Peer:
        namespace = "" if name == NO_NAMESPACE else name
        return Peer(name, dds=DdsAddress(self.domain_id, self.interface, namespace))


class _Run:
    """One run of a link, from opening to closing: the thread that reads DDS."""

    def __init__(self, link: Ros2Link, loop: asyncio.AbstractEventLoop, open_port: OpenPort) -> None:
        self._link, self._loop, self._open_port = link, loop, open_port
        self.stop = threading.Event()
        self.delivered = threading.Event()
        """Set while the event loop has no unread batch."""
        self.delivered.set()
        self.vehicles: dict[str, VehicleLink] = {}
        """By peer name; only the thread adds vehicles."""
        self._ports: dict[str, VehiclePort] = {}
        self._found_s: dict[str, float] = {}
        """Time at which each vehicle was found, by peer name [s, monotonic]."""
        self._unreadable: dict[str, str] = {}
        """Topics that cannot be read, each with the reason."""
        self._versions = TopicVersions()
        self.unusable: dict[str, dict[str, str]] = {}
        """Topics in unknown versions by peer name; the thread replaces the dictionary and never changes
        it."""
        self._start_s = loop.time()
        self._discover_s = self._report_s = 0.0
        self.thread = threading.Thread(target=self._main, name=f"link {link.name}", daemon=True)

    def _main(self) -> None:
        try:
            port = self._open_port(self._link.domain_id, self._link.interface)
            self._post(self._link.on_open)
            while not self.stop.wait(READ_EVERY_S):
                if self.delivered.is_set():
                    self._step(port, self._loop.time())
        except Exception as problem:
            self._post(self._link.on_failure, str(problem))
        finally:
            self.vehicles.clear()
            self._ports.clear()  # Cyclone's entities end with the last reference

    def _step(self, port: DdsPort, now_s: float) -> None:
        if now_s >= self._discover_s:
            self._discover_s = now_s + DISCOVER_EVERY_S
            for each in port.discovered():
                self._versions.add_topic(each.topic, publishes=each.publishes)
                if each.publishes:
                    self._add_vehicle(port, each, now_s)
            vehicles = [vehicle.namespace for vehicle in self.vehicles.values()]
            self.unusable = {peer_name(each): self._versions.unusable(each) for each in vehicles}
        batch: list[tuple[str, bytes]] = []
        for name, vehicle_port in self._ports.items():
            try:  # a fault affects this vehicle only
                data = self.vehicles[name].to_frames(vehicle_port.take(now_s), now_s)
            except Exception as error:
                self._link.faults.add(error, f"reading {name}")
                continue
            if data:
                batch.append((name, data))
        if batch:
            self.delivered.clear()
            self._post(self._link.on_frames, batch, now_s)
        if now_s >= self._report_s:
            self._report_s = now_s + REPORT_EVERY_S
            self._post(self._link.show_problems, self._detail(now_s))

    def _add_vehicle(self, port: DdsPort, publication: Discovered, now_s: float) -> None:
        topic = publication.topic.removeprefix("rt")
        found = find_subscription(publication.topic)
        if found is not None:
            namespace, subscription = found
            expected = wire_type(subscription.message)
            if self._link.namespace in (None, namespace) and publication.type != expected:
                self._add_unreadable(topic, f"{topic} has the type {publication.type} instead of {expected}")
                return
        status_topic = parse_status_topic(publication.topic)
        if status_topic is None:
            return
        namespace, version = status_topic
        if self._link.namespace not in (None, namespace):
            return
        if version == STATUS_VERSION and peer_name(namespace) not in self._ports:
            if len(self._ports) >= MAX_VEHICLES:
                self._add_unreadable(
                    topic, f"{topic} is not read: the link already has {MAX_VEHICLES} vehicles"
                )
                return
            vehicle_port = port.vehicle(namespace)
            name = peer_name(namespace)
            self.vehicles[name] = VehicleLink(namespace, vehicle_port.writers, self._link.own_system_id)
            self._ports[name], self._found_s[name] = vehicle_port, now_s

    def _add_unreadable(self, topic: str, why: str) -> None:
        if len(self._unreadable) < MAX_UNREADABLE:
            self._unreadable[topic] = why[:300]

    def _detail(self, now_s: float) -> str:
        texts = [f"{why}." for why in self._unreadable.values()]
        texts += self._versions.problems(self._link.namespace)
        for name, port in self._ports.items():
            texts += self.vehicles[name].problems(now_s)
            if not port.has_status and now_s - self._found_s[name] > FIRST_REPORT_S:
                texts.append(f"{name} has a writer of {STATUS}, but sends no message of PX4 v1.16's type.")
            if now_s - port.other_status_s < SAME_NAMESPACE_S:
                texts.append(
                    f"Several vehicles publish the topics of {name}; only the first is read. Give each "
                    "vehicle its own namespace (uxrce_dds_client start -n NAME)."
                )
        if not self._ports and not texts and now_s - self._start_s > FIRST_REPORT_S:
            interface = self._link.interface or "loopback"
            topic = f"/{self._link.namespace}{STATUS}" if self._link.namespace else STATUS
            texts.append(
                f"No vehicle publishes {topic} in DDS domain {self._link.domain_id} on {interface}. "
                "Check the agent, the domain and the interface."
            )
        return " ".join(texts[:4])

    def _post(self, call: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the event loop is closed, so the server has ended
            self._loop.call_soon_threadsafe(call, self, *arguments)
