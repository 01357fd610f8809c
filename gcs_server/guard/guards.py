"""All guarded links."""

from __future__ import annotations

from gcs_server.errors import UnknownLink
from gcs_server.guard.ends import GuardedStation
from gcs_server.guard.guard import Guard, GuardView
from gcs_server.links.base import LinkInfo, Peer
from gcs_server.mavlink.codec import Frame
from gcs_server.mavlink.connection import Connection
from gcs_server.mavlink.router import FrameSink, Router
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.events import Event
from gcs_server.vehicle.fleet import Notice
from gcs_server.vehicle.vehicle import Vehicle

TICK_S = 0.1
FIRST_COMPONENT, LAST_COMPONENT = 25, 99
"""Component ids of programs: MAV_COMP_ID_USER1 and the following ones. To the vehicle, programs are
components of this server."""


class Guards(FrameSink):
    """Makes a guard for each link that was opened with `guard=`, and gives it its frames.

    Args:
        station: the parts of the server that execute commands.
        router: has the links; the guards register themselves there.
        supervisor: owns the tasks.
    """

    def __init__(self, station: GuardedStation, router: Router, supervisor: Supervisor) -> None:
        self._station, self._router, self._supervisor = station, router, supervisor
        self._guards: dict[str, Guard] = {}
        self._components = list(range(LAST_COMPONENT, FIRST_COMPONENT - 1, -1))
        router.programs = self
        router.on_change(self._links_changed)
        station.fleet.on_vehicle_added(self._vehicles_changed)
        station.fleet.on_vehicle_removed(self._vehicle_removed)
        station.fleet.subscribe(self._take_event)

    def start(self) -> None:
        """Starts the periodic look at what has become of the programs' flights."""
        self._supervisor.repeat("guards", self._tick, TICK_S)

    def all(self) -> list[GuardView]:
        """All guarded links with their programs."""
        self._links_changed()
        return [guard.view() for guard in self._guards.values()]

    def get(self, name: str) -> Guard:
        """The guard of a link. Raises UnknownLink."""
        self._links_changed()
        if name not in self._guards:
            known = ", ".join(sorted(self._guards)) or "none"
            raise UnknownLink(f"There is no guarded link {name!r}.", remedy=f"Guarded links: {known}.")
        return self._guards[name]

    def warnings(self) -> list[Notice]:
        """Guarded links without a vehicle, and programs that wait for a person."""
        notices: list[Notice] = []
        for name, guard in self._guards.items():
            if guard.paused is not None:
                text = f"{guard.paused} {guard.client} waits until it may continue."
                vehicle = None if guard.vehicle is None else guard.vehicle.id
                notices.append(Notice("guard", text, link=name, vehicle=vehicle))
            elif guard.vehicle is None and (problem := guard.problem()) is not None:
                notices.append(Notice("guard", f"Guarded link {name}: {problem}", link=name))
        return notices

    def on_frame(self, frame: Frame, connection: Connection, peer: Peer) -> None:
        guard = self._guards.get(connection.name)
        if guard is None:
            self._links_changed()
            guard = self._guards[connection.name]
        guard.from_program(frame, peer)

    def on_peer_gone(self, connection: Connection, peer: Peer) -> None:
        guard = self._guards.get(connection.name)
        if guard is not None and guard.connection is connection:
            guard.peer_gone(peer.name)

    def _links_changed(self, _info: LinkInfo | None = None) -> None:
        open_now = {c.name: c for c in self._router.connections() if c.link.guard is not None}
        for name, guard in list(self._guards.items()):
            if open_now.get(name) is not guard.connection:
                guard.close()
                del self._guards[name]
        for name, connection in open_now.items():
            if name not in self._guards:
                guard = Guard(self._station, self._supervisor, connection, self._components)
                self._guards[name] = guard
                guard.choose_vehicle()

    def _vehicles_changed(self, _vehicle: Vehicle) -> None:
        for guard in self._guards.values():
            guard.choose_vehicle()

    def _vehicle_removed(self, vehicle: Vehicle) -> None:
        for guard in self._guards.values():
            if guard.vehicle is vehicle:
                guard.release_vehicle()

    def _take_event(self, event: Event) -> None:
        for guard in self._guards.values():
            guard.take_event(event)

    def _tick(self) -> None:
        for guard in self._guards.values():
            guard.tick()
