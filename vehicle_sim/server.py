"""Main loop of a fleet: reads the sockets, advances simulated time at the requested speed, and writes the
sockets."""

from __future__ import annotations

import math
import selectors
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.context import GCS_TIMEOUT_S
from vehicle_sim.mavlink.framing import FrameParser
from vehicle_sim.mavlink.transports import PortUnavailable, TcpServer, UdpTransport

CYCLE_S = 0.008
"""Real-time period of the loop: two simulation steps at speed 1."""
MAX_CYCLE_S = 0.02
"""Simulated time of one cycle at high speed: the period of the fastest streams."""
LOCKSTEP_WAIT_S = 0.05
"""Longest real time to wait for a message while no client requests a time."""
MAX_CATCH_UP_S = 0.1
"""Longest delay that one cycle makes up, in simulated time; at a speed above 1, multiplied by the speed. The
rest of a longer delay is skipped, so simulated time falls behind real time on a slow machine."""
LAST_OWN_API_PORT = 9


@dataclass(frozen=True, slots=True)
class TimeRequest:
    """The time up to which the simulation may advance, and the client that requested this time."""

    time_s: float
    row: int
    link: str


class Lockstep:
    """Lets a client control how far simulated time advances, so that flights are reproducible bit for bit.

    The client sends SYSTEM_TIME on a link; its `time_boot_ms` is the time to advance to. The simulator
    handles the earlier messages on this link, advances all vehicles to the time, and then sends SYSTEM_TIME
    on the link.
    """

    def __init__(self) -> None:
        self._parsers: dict[tuple[int, str], FrameParser] = {}
        self._request: TimeRequest | None = None

    def feed(self, row: int, link: str, data: bytes) -> None:
        """Parses bytes received on one link."""
        for message in self._parsers.setdefault((row, link), FrameParser()).feed(data):
            if message.name == "SYSTEM_TIME":
                self._request = TimeRequest(message.time_boot_ms / 1000.0, row, link)

    def take(self) -> TimeRequest | None:
        """The newest request since the last call; None: no request."""
        request, self._request = self._request, None
        return request


@dataclass(frozen=True, slots=True)
class Ports:
    """Ports of instance 0; instance N adds N to each port except `gcs_remote`.

    Remote port or TCP port 0: no such link. Local port 0: any free port.
    """

    gcs_local: int = 18570
    gcs_remote: int = 14550
    api_local: int = 14580
    api_remote: int = 14540
    tcp: int = 5760

    def api_remote_of(self, instance: int) -> int:
        """The port of an onboard computer; as in PX4, instances from 10 on share one port, because the next
        ports are those of ground station (14550) and vehicles (14580)."""
        return self.api_remote + min(instance, LAST_OWN_API_PORT)


@dataclass(slots=True)
class VehiclePorts:
    """The transports of one vehicle, and the ports that could not be opened."""

    transports: dict[str, UdpTransport | TcpServer] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


class SimServer:
    """A fleet with its sockets; the server adds the links, so `fleet` must have no links."""

    def __init__(
        self, fleet: SimulatedFleet, *, first_instance: int, ports: Ports, bind: str, gcs_host: str
    ) -> None:
        self.fleet = fleet
        self._selector = selectors.DefaultSelector()
        """Returns the sockets that have data, so that a cycle does not read every socket of a large fleet."""
        self._registered_sockets: dict[UdpTransport | TcpServer, socket.socket] = {}
        self.vehicles = [
            self._open_ports(row, first_instance + row, ports, bind, gcs_host)
            for row in range(len(fleet.nodes))
        ]
        self._stopping = False
        self._end_s = math.inf
        self.behind_s = 0.0
        """Total real time by which the simulation has fallen behind."""

    def _open_ports(self, row: int, instance: int, ports: Ports, bind: str, gcs_host: str) -> VehiclePorts:
        opened = VehiclePorts()

        def open_port(name: str, create: Callable[[], UdpTransport | TcpServer]) -> None:
            try:
                opened.transports[name] = create()
            except PortUnavailable as problem:
                opened.problems.append(str(problem))
                return
            self._register(row, name, opened.transports[name])
            if name != "tcp":
                remote = ports.gcs_remote if name == "gcs" else ports.api_remote_of(instance)
                self.fleet.add_link(row, name, name).ports = (opened.transports[name].port, remote)

        if ports.gcs_remote:
            local_gcs = ports.gcs_local + instance if ports.gcs_local else 0
            open_port("gcs", lambda: UdpTransport(bind, local_gcs, (gcs_host, ports.gcs_remote)))
        if ports.api_remote:
            api_remote = ports.api_remote_of(instance)
            local_api = ports.api_local + instance if ports.api_local else 0
            open_port("api", lambda: UdpTransport(bind, local_api, (gcs_host, api_remote)))
        if ports.tcp:
            open_port(
                "tcp",
                lambda: TcpServer(
                    bind,
                    ports.tcp + instance,
                    lambda: self._on_tcp_connect(row, opened),
                    lambda: self._on_tcp_disconnect(row, opened),
                ),
            )
        return opened

    def _register(self, row: int, name: str, transport: UdpTransport | TcpServer) -> None:
        registered_socket = self._registered_sockets.get(transport)
        if registered_socket is not None:
            self._selector.unregister(registered_socket)
        self._registered_sockets[transport] = transport.readable
        self._selector.register(transport.readable, selectors.EVENT_READ, (row, name, transport))

    def _on_tcp_connect(self, row: int, vehicle_ports: VehiclePorts) -> None:
        tcp = vehicle_ports.transports["tcp"]
        self.fleet.add_link(row, "tcp", "gcs").ports = (tcp.port, None)
        self._register(row, "tcp", tcp)

    def _on_tcp_disconnect(self, row: int, vehicle_ports: VehiclePorts) -> None:
        self.fleet.remove_link(row, "tcp")
        self._register(row, "tcp", vehicle_ports.transports["tcp"])

    def stop_when_readable(self, descriptor: int) -> None:
        """Makes `run` return when this descriptor becomes readable, because the parent process has ended."""
        self._selector.register(descriptor, selectors.EVENT_READ, None)

    def stop(self) -> None:
        """Makes `run` return."""
        self._stopping = True

    def run(self, speed: float, duration_s: float = math.inf) -> None:
        """Simulates until `stop`, or for `duration_s` of simulated time; `speed` 1 is real time, inf is full
        speed."""
        self._end_s = self.fleet.time_s + duration_s
        for node in self.fleet.nodes:  # a ground station times out in real time
            node.context.gcs_timeout_s = GCS_TIMEOUT_S * max(1.0, speed)
        if math.isinf(speed):
            self._run_full_speed()
        else:
            self._run_at(speed)

    def run_in_lockstep(self, duration_s: float = math.inf) -> None:
        """Advances time only to the time that a client requests, and then notifies the client."""
        self._end_s = self.fleet.time_s + duration_s
        lockstep: Lockstep = Lockstep()
        wait_s = 0.0
        while not self._is_over:
            self._receive(wait_s, lockstep)
            request = lockstep.take()
            if request is not None:
                steps = math.ceil(
                    max(0.0, request.time_s - self.fleet.time_s) / self.fleet.simulation.dt_s - 1e-6
                )
                for _ in range(steps):
                    if self._is_over:
                        break
                    self.fleet.step(self.fleet.simulation.dt_s)
                self.fleet.send_time(request.row, request.link)
            self._send()
            wait_s = LOCKSTEP_WAIT_S if request is None else 0.0

    @property
    def _is_over(self) -> bool:
        return self._stopping or self.fleet.time_s >= self._end_s - 1e-9

    def _run_full_speed(self) -> None:
        while not self._is_over:
            self._receive(0.0)
            self.fleet.step(MAX_CYCLE_S)
            self._send()

    def _run_at(self, speed: float) -> None:
        real_start_s = time.monotonic()
        simulated_start_s = self.fleet.time_s
        wait_s = 0.0
        while not self._is_over:
            self._receive(wait_s)
            target_s = simulated_start_s + (time.monotonic() - real_start_s) * speed
            backlog_s = target_s - self.fleet.time_s
            if backlog_s > MAX_CATCH_UP_S * max(1.0, speed):
                skipped_s = backlog_s - MAX_CATCH_UP_S * max(1.0, speed)
                self.behind_s += skipped_s / speed
                simulated_start_s -= skipped_s
                backlog_s -= skipped_s
            steps = int(backlog_s / self.fleet.simulation.dt_s)
            if steps > 0:
                self.fleet.step(steps * self.fleet.simulation.dt_s)
            self._send()
            next_cycle_s = self.fleet.time_s + min(CYCLE_S * speed, MAX_CYCLE_S)
            elapsed_s = time.monotonic() - real_start_s
            until_next_cycle_s = (next_cycle_s - simulated_start_s) / speed - elapsed_s
            wait_s = max(0.0, min(CYCLE_S, until_next_cycle_s))

    def exchange(self) -> None:
        """Receives and sends what is waiting, for a caller that advances the time itself."""
        self._receive(0.0)
        self._send()

    def close(self) -> None:
        """Closes all sockets."""
        for vehicle_ports in self.vehicles:
            for transport in vehicle_ports.transports.values():
                transport.close()
        self._selector.close()

    def _receive(self, wait_s: float, lockstep: Lockstep | None = None) -> None:
        """Passes received data to the fleet; waits up to `wait_s` for data."""
        for key, _ in self._selector.select(wait_s):
            if key.data is None:  # the descriptor of `stop_when_readable`
                self._stopping = True
                continue
            row, name, transport = key.data
            data = transport.receive()
            if data and (isinstance(transport, UdpTransport) or transport.connected):
                self.fleet.feed(row, name, data)
                if lockstep is not None:
                    lockstep.feed(row, name, data)

    def _send(self) -> None:
        for row, vehicle_ports in enumerate(self.vehicles):
            for name, transport in vehicle_ports.transports.items():
                if isinstance(transport, UdpTransport) or transport.connected:
                    frames = self.fleet.frames(row, name)
                    if frames:
                        transport.send(frames)
