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
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from gcs_server.links.base import DdsAddress, Link, Peer, UnusableTopic
from gcs_server.links.writer import LinkWriter
from gcs_server.ros2.formats import MAX_NAMED, REQUEST, SILENT_S, AnnouncedTopics
from gcs_server.ros2.topics import STATUS, status_namespace
from gcs_server.ros2.vehicle_link import VehicleLink

if TYPE_CHECKING:
    from gcs_server.ros2.dds import DdsPort, VehiclePort

READ_EVERY_S: Final = 0.02
DISCOVER_EVERY_S: Final = 0.25
REPORT_EVERY_S: Final = 1.0
FIRST_REPORT_S: Final = 5.0
"""Time after opening the link, or after finding a vehicle, before missing messages are reported [s]."""
MAX_VEHICLES: Final = 64
"""Maximum number of namespaces read by one link."""
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

    def unusable_topics(self, peer: Peer) -> Mapping[str, UnusableTopic]:
        """Topics whose layout the vehicle has not confirmed or the server does not know, each with a text."""
        vehicle = None if self._run is None else self._run.vehicles.get(peer.name)
        return {} if vehicle is None else vehicle.formats.unusable

    def dds_address(self, peer: Peer) -> DdsAddress | None:
        """The peer's address, with the formats of its topics."""
        vehicle = None if self._run is None else self._run.vehicles.get(peer.name)
        if vehicle is None or peer.dds is None:
            return peer.dds
        return replace(peer.dds, formats=tuple(vehicle.formats.usable.values()))

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
        self._too_many = ""
        """Why a vehicle is not read, if there are too many."""
        self._announced = AnnouncedTopics()
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
            self._discover(port, now_s)
        batch: list[tuple[str, bytes]] = []
        for name, vehicle_port in self._ports.items():
            try:  # a fault affects this vehicle only
                data = self._read(self.vehicles[name], vehicle_port, now_s)
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

    def _discover(self, port: DdsPort, now_s: float) -> None:
        for each in port.announcements():
            self._announced.apply(each)
            namespace = status_namespace(each.topic.name) if each.topic and each.publishes else None
            if namespace is not None and self._link.namespace in (None, namespace):
                self._add_vehicle(port, namespace, now_s)
        for name, vehicle_port in self._ports.items():
            vehicle = self.vehicles[name]
            vehicle.formats.announce(self._announced.of(vehicle.namespace, vehicle_port.source))

    def _read(self, vehicle: VehicleLink, port: VehiclePort, now_s: float) -> bytes:
        """The MAVLink frames of a vehicle's new messages; asks for the layouts of its topics."""
        source, formats = port.source, vehicle.formats
        samples = port.take(now_s)
        if port.source != source:
            formats.reset()
            formats.announce(self._announced.of(vehicle.namespace, port.source))
        data = vehicle.to_frames(samples, now_s)
        if (request := formats.request(now_s, port.status_s)) is not None:
            with contextlib.suppress(OSError):  # it is repeated
                port.writers.send(REQUEST, request)
        port.open(formats.usable)
        return data

    def _add_vehicle(self, port: DdsPort, namespace: str, now_s: float) -> None:
        name = peer_name(namespace)
        if name in self._ports:
            return
        if len(self._ports) >= MAX_VEHICLES:
            self._too_many = f"{name} is not read: the link already has {MAX_VEHICLES} vehicles."[:300]
            return
        vehicle_port = port.vehicle(namespace)
        self.vehicles[name] = VehicleLink(namespace, vehicle_port.writers, self._link.own_system_id)
        self._ports[name], self._found_s[name] = vehicle_port, now_s

    def _detail(self, now_s: float) -> str:
        texts = [self._too_many] if self._too_many else []
        for name, port in self._ports.items():
            vehicle = self.vehicles[name]
            texts += vehicle.formats.problems()
            texts += vehicle.problems(now_s)
            if port.status_s == float("-inf"):
                is_read = STATUS in vehicle.formats.usable
                if is_read and now_s - self._found_s[name] > FIRST_REPORT_S:
                    texts.append(f"{name} has confirmed the layout of {STATUS}, but sends no message on it.")
            elif now_s - port.status_s > SILENT_S:
                texts.append(f"{name} sends nothing more. Check the agent and PX4's uxrce_dds_client.")
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
                f"{self._others()}Check the agent, the domain and the interface; `gcs doctor ros2` "
                "searches the domains 0 to 9."
            )
        return " ".join(texts[:4])

    def _others(self) -> str:
        """A sentence about the vehicles of the domain that the link does not read; empty: none."""
        names = ", ".join(f"/{each}" for each in self._announced.vehicles()[:MAX_NAMED])
        return f"Vehicles in this domain: {names}. " if names else ""

    def _post(self, call: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the event loop is closed, so the server has ended
            self._loop.call_soon_threadsafe(call, self, *arguments)
