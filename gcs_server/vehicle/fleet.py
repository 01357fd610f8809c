"""All vehicles; assigns frames to them, adds and removes them."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable
from dataclasses import dataclass

from gcs_server.clock import Clock
from gcs_server.errors import Refused, UnknownVehicle
from gcs_server.faults import Isolation
from gcs_server.links.base import LinkInfo, Peer
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, full_payload
from gcs_server.mavlink.connection import Connection
from gcs_server.mavlink.router import FrameSink, Router
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.components import is_peripheral
from gcs_server.vehicle.endpoint import NO_DATA_AFTER_S, Endpoint, SameVehicle, same_vehicle
from gcs_server.vehicle.events import Event, EventFeed
from gcs_server.vehicle.identity import Identity, read_version
from gcs_server.vehicle.population import (
    MAX_ENDPOINTS_ON_LINK,
    Refusals,
    last_received_s,
    limit_reached,
    removable_vehicle,
)
from gcs_server.vehicle.same_vehicle import SameVehicleWatch
from gcs_server.vehicle.vehicle import Vehicle

log = logging.getLogger(__name__)
TICK_S = 0.25
RECHECK_PERIOD_S = 0.25
"""Period at which a full link is checked for endpoints to remove [s]."""
NUMBER_SEPARATOR = "~"
"""Separates system id and number in the id of a further vehicle with the same system id: `1~2`."""
VERSION_ID = d.MAVLINK_MSG_ID_AUTOPILOT_VERSION


@dataclass(frozen=True, slots=True)
class Notice:
    """One warning of `GET /warnings`, shown until its cause has ended."""

    kind: str
    """link, recording, journal, duplicate_id, too_many (vehicles), telemetry (values of a vehicle that cannot
    be used), untested_release (of its autopilot), ros2_settings (of a vehicle that no ROS 2 link finds),
    simulator, guard, agent (a program or an agent waits for a person), fault (of this program)."""
    text: str
    link: str | None = None
    vehicle: str | None = None


class Fleet(FrameSink):
    """Assigns frames to vehicles.

    Args:
        router: source of frames; the fleet registers itself at the router.
    """

    def __init__(self, clock: Clock, supervisor: Supervisor, router: Router) -> None:
        self.events = EventFeed()
        """Events of the whole server: vehicles and links added or removed, warnings."""
        self._clock = clock
        self._supervisor = supervisor
        self._router = router
        self._own_ids = (router.settings.system_id, router.settings.component_id)
        self._vehicles: dict[str, Vehicle] = {}
        self._full_until_s: dict[str, float] = {}
        """By link: time until which new endpoints are ignored, because the link is full."""
        self._ordered: list[Vehicle] | None = None
        """Cached result of `all`, until a vehicle is added or removed."""
        self._endpoints: dict[tuple[Connection, str, int], Endpoint] = {}
        self._subscribers: list[Callable[[Event], None]] = []
        self._on_added: list[Callable[[Vehicle], None]] = []
        self._on_removed: list[Callable[[Vehicle], None]] = []
        self._refusals = Refusals()
        self._same_vehicle = SameVehicleWatch()
        self._isolation = Isolation(clock, log, "The vehicles")
        self._link_states: dict[str, tuple[str, str]] = {}
        self.events.subscribe(self._publish)
        router.sink = self
        router.on_change(self._link_changed)

    def start(self) -> None:
        """Starts the periodic work: heartbeat ages, history, identity requests."""
        self._supervisor.repeat("fleet", self.tick, TICK_S)

    def get(self, vehicle_id: str) -> Vehicle:
        """The vehicle with this id; raises UnknownVehicle."""
        vehicle = self._vehicles.get(vehicle_id)
        if vehicle is None:
            raise UnknownVehicle(vehicle_id, sorted(self._vehicles))
        return vehicle

    def all(self) -> list[Vehicle]:
        """All vehicles, in the order of their ids."""
        if self._ordered is None:
            self._ordered = [self._vehicles[i] for i in sorted(self._vehicles, key=_sort_key)]
        return list(self._ordered)

    def subscribe(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Subscribes to events of all vehicles and of the fleet; returns a function that unsubscribes."""
        self._subscribers.append(callback)
        return lambda: self._subscribers.remove(callback) if callback in self._subscribers else None

    def on_vehicle_added(self, callback: Callable[[Vehicle], None]) -> None:
        """Adds a function that is called for each existing and each new vehicle."""
        self._on_added.append(callback)
        for vehicle in self.all():
            callback(vehicle)

    def on_vehicle_removed(self, callback: Callable[[Vehicle], None]) -> None:
        """Adds a function that is called for each removed vehicle, to drop references to it."""
        self._on_removed.append(callback)

    def remove(self, vehicle_id: str, by: str) -> None:
        """Removes a vehicle that is not connected; if it connects again, it is added again.

        Raises:
            UnknownVehicle: no vehicle has this id.
            Refused: the vehicle is connected, has a setpoint stream, or belongs to a recording.
        """
        vehicle = self.get(vehicle_id)
        if vehicle.identity.replayed:
            raise Refused(
                f"Vehicle {vehicle_id} belongs to a recording.",
                remedy="Close its replay; this removes the vehicle.",
            )
        if self._clock.monotonic_s() - last_received_s(vehicle) <= NO_DATA_AFTER_S:
            raise Refused(
                f"Vehicle {vehicle_id} is connected on {', '.join(vehicle.links)}: it would be added again.",
                remedy="Switch it off, or close the link. Only a disconnected vehicle can be removed.",
            )
        if vehicle.streaming:
            raise Refused(
                f"Setpoints are streamed to vehicle {vehicle_id}.",
                remedy="Stop the stream (offboard/stop) first.",
            )
        self._remove_with_endpoints(vehicle, f"{by} removed it")

    def warnings(self) -> list[Notice]:
        """Current warnings."""
        notices = [Notice(kind, text, link=link) for kind, link, text in self._router.warnings()]
        refusals = self._refusals.recent(self._clock.monotonic_s())
        notices += [Notice("too_many", text, link=link) for link, text in refusals]
        for vehicle in self.all():
            notices += [
                Notice("duplicate_id", text, vehicle=vehicle.id) for text in vehicle.identity.warnings
            ]
            untested = vehicle.identity.software.untested
            if untested is not None and not vehicle.identity.replayed:
                text = f"Vehicle {vehicle.id} has {untested}."
                notices.append(Notice("untested_release", text, vehicle=vehicle.id))
            notices += [
                Notice("telemetry", f"Vehicle {vehicle.id}: {topic} is not shown: {why}.", vehicle=vehicle.id)
                for topic, why in vehicle.unusable().items()
            ]
            notices += [Notice("fault", text, vehicle=vehicle.id) for text in vehicle.isolation.faults]
        notices += [Notice("fault", text) for text in self._isolation.faults]
        return notices

    async def close(self) -> None:
        """Ends all pending requests with Disconnected."""
        for vehicle in self.all():
            vehicle.disconnected("the server is shutting down")

    # --- from the router ------------------------------------------------------------------------

    def on_frame(self, frame: Frame, connection: Connection, peer: Peer) -> None:
        """Passes a frame to the vehicle of its endpoint; drops it until the endpoint has a vehicle."""
        endpoint = self._endpoints.get((connection, peer.name, frame.system_id))
        if endpoint is None:
            endpoint = self._discover(frame, connection, peer)
            if endpoint is None:
                return
        now_s = frame.received_monotonic_s
        if now_s - endpoint.received_s > NO_DATA_AFTER_S:
            endpoint.first_received_s = now_s
        endpoint.received_s = now_s
        if now_s >= endpoint.boot_next_s:
            endpoint.take_boot_time(frame)
        if frame.msg_id == VERSION_ID and frame.component_id == endpoint.component_id:
            self._apply_version(endpoint, frame)
        vehicle = endpoint.vehicle
        if vehicle is None:
            self._assign(endpoint)
            vehicle = endpoint.vehicle
            if vehicle is None:
                return
        vehicle.receive(frame, endpoint)

    def on_peer_gone(self, connection: Connection, peer: Peer) -> None:
        """Removes the peer's endpoints; a replayed vehicle is removed with its link, other vehicles stay."""
        for key, endpoint in list(self._endpoints.items()):
            if key[0] is connection and key[1] == peer.name:
                self._remove_endpoint(endpoint)
                vehicle = endpoint.vehicle
                if vehicle is not None:
                    vehicle.detach(endpoint)
                    if vehicle.identity.replayed and not vehicle.endpoints:
                        self._remove(vehicle, "its recording was closed or jumped to another time")

    def tick(self) -> None:
        """Does the periodic work; called four times a second."""
        now_s = self._clock.monotonic_s()
        for endpoint in list(self._endpoints.values()):
            if endpoint.vehicle is None:
                self._isolation.run("the assignment of a link", self._assign, endpoint)
            if endpoint.version is None and now_s >= endpoint.next_request_s:
                self._isolation.run("a request of a vehicle's version", endpoint.request_version, now_s)
        self._isolation.run("the comparison of vehicles", self._revise_vehicles)
        for vehicle in list(self._vehicles.values()):
            vehicle.isolation.run("the periodic update", vehicle.tick)

    # --- endpoints and vehicles -----------------------------------------------------------------

    def _discover(self, frame: Frame, connection: Connection, peer: Peer) -> Endpoint | None:
        if frame.msg_id != d.MAVLINK_MSG_ID_HEARTBEAT:
            return None
        payload = full_payload(frame)
        if payload[5] == d.MAV_AUTOPILOT_INVALID or not frame.system_id:
            return None
        if is_peripheral(frame.component_id, payload[4]):
            return None
        now_s = frame.received_monotonic_s
        if len(self._endpoints) >= MAX_ENDPOINTS_ON_LINK and not self._may_have_endpoint(connection, now_s):
            return None
        endpoint = Endpoint(
            connection,
            peer,
            frame.system_id,
            frame.component_id,
            payload,
            first_received_s=now_s,
            received_s=now_s,
        )
        self._endpoints[(connection, peer.name, frame.system_id)] = endpoint
        endpoint.request_version(now_s)
        return endpoint

    def _may_have_endpoint(self, connection: Connection, now_s: float) -> bool:
        """Whether a link may have one more endpoint; drops endpoints that have no vehicle and send
        nothing."""
        if now_s < self._full_until_s.get(connection.name, float("-inf")):
            return False
        on_link = [e for e in self._endpoints.values() if e.connection is connection]
        if len(on_link) < MAX_ENDPOINTS_ON_LINK:
            return True
        inactive = [e for e in on_link if e.vehicle is None and now_s - e.received_s > NO_DATA_AFTER_S]
        for endpoint in inactive:
            self._remove_endpoint(endpoint)
        if not inactive:
            self._full_until_s[connection.name] = now_s + RECHECK_PERIOD_S
        return bool(inactive)

    def _may_add_vehicle(self, endpoint: Endpoint) -> bool:
        """Whether one more vehicle may be added; may remove a vehicle that sent nothing for a long time."""
        now_s = self._clock.monotonic_s()
        limit = limit_reached(endpoint, self.all())
        if limit is None:
            return True
        why, others = limit
        to_remove = removable_vehicle(others, now_s)
        if to_remove is not None:
            self._remove_with_endpoints(
                to_remove, "it sent no message for a long time, and the maximum number of vehicles is reached"
            )
            return True
        text = self._refusals.refuse(endpoint, why, now_s)
        if text is not None:
            self.events.add("warning", self._clock.unix_s(), text, severity=d.MAV_SEVERITY_WARNING)
        return False

    def _assign(self, endpoint: Endpoint) -> None:
        if self._clock.monotonic_s() < endpoint.refused_until_s:
            return
        candidates = [
            v
            for v in self.all()
            if v.identity.system_id == endpoint.system_id and self._may_belong_to(endpoint, v)
        ]
        now_s = self._clock.monotonic_s()
        undecided = False
        for candidate in candidates:
            decision = same_vehicle(endpoint, candidate, now_s)
            if decision is SameVehicle.YES:
                # An endpoint without messages is assigned again when it sends again.
                for old in candidate.endpoints:
                    if now_s - old.received_s > NO_DATA_AFTER_S:
                        self._remove_endpoint(old)
                        candidate.detach(old)
                candidate.attach(endpoint)
                return
            undecided = undecided or decision is SameVehicle.UNDECIDED
        if not undecided and self._may_add_vehicle(endpoint):
            self._add(endpoint)

    def _may_belong_to(self, endpoint: Endpoint, vehicle: Vehicle) -> bool:
        if not endpoint.connection.link.replay:
            return not vehicle.identity.replayed
        return any(e.connection is endpoint.connection for e in vehicle.endpoints)

    def _add(self, endpoint: Endpoint) -> None:
        base = str(endpoint.system_id)
        number, vehicle_id = 1, base
        while vehicle_id in self._vehicles:
            number += 1
            vehicle_id = f"{base}{NUMBER_SEPARATOR}{number}"
        identity = Identity(
            system_id=endpoint.system_id,
            component_id=endpoint.component_id,
            autopilot=endpoint.heartbeat[5],
            vehicle_type=endpoint.heartbeat[4],
            uid=None,
            simulated=True if endpoint.heartbeat[6] & d.MAV_MODE_FLAG_HIL_ENABLED else None,
            replayed=endpoint.connection.link.replay,
            firmware=None,
            capabilities=None,
        )
        link = endpoint.connection.link
        vehicle = Vehicle(vehicle_id, identity, link.clock or self._clock, self._own_ids, self._supervisor)
        vehicle.events.subscribe(lambda event: None if link.suppresses_events else self._publish(event))
        vehicle.attach(endpoint)
        self._vehicles[vehicle_id] = vehicle
        self._ordered = None
        for callback in self._on_added:
            callback(vehicle)
        connection_text = f"{endpoint.connection.name} ({endpoint.peer.name})"
        self.events.add(
            "vehicle_added",
            self._clock.unix_s(),
            f"Vehicle {vehicle_id} on {connection_text}",
            vehicle=vehicle_id,
            data={"replayed": identity.replayed},
        )
        if not identity.replayed:
            self._warn_of_same_id(endpoint.system_id)

    def _warn_of_same_id(self, system_id: int) -> None:
        same_id = [v for v in self.all() if v.identity.system_id == system_id and not v.identity.replayed]
        for vehicle in same_id:
            others = [f"{v.id} on {', '.join(v.links)}" for v in same_id if v is not vehicle]
            if others:
                vehicle.warn(
                    f"Several vehicles use system id {system_id}: {'; '.join(others)}. "
                    "They are kept apart; give one of them another id (PX4: MAV_SYS_ID)."
                )
            else:
                vehicle.clear_warnings()

    def _apply_version(self, endpoint: Endpoint, frame: Frame) -> None:
        endpoint.version = read_version(full_payload(frame))
        vehicle = endpoint.vehicle
        if vehicle is None:
            return
        uid = endpoint.unique_uid
        if uid is None or all(e.unique_uid in (None, uid) for e in vehicle.endpoints):
            vehicle.set_version(endpoint.version)
        self._revise_vehicles()

    def _revise_vehicles(self) -> None:
        """Separates endpoints that belong to another vehicle, and merges vehicles that are one."""
        now_s = self._clock.monotonic_s()
        vehicles = [v for v in self.all() if not v.identity.replayed and v.endpoints]
        by_system: dict[int, list[Vehicle]] = {}
        for vehicle in vehicles:
            by_system.setdefault(vehicle.identity.system_id, []).append(vehicle)
        ambiguous = [group for group in by_system.values() if len(group) > 1 or len(group[0].endpoints) > 1]
        self._same_vehicle.update([e for group in ambiguous for v in group for e in v.endpoints], now_s)
        for group in ambiguous:
            for vehicle in group:
                self._separate(vehicle, now_s)
            for first, second in itertools.combinations(group, 2):
                if self._same_vehicle.are_one(first.endpoints, second.endpoints, now_s):
                    self._merge(first, second)
                    break  # the next call compares the other vehicles

    def _separate(self, vehicle: Vehicle, now_s: float) -> None:
        """Detaches endpoints of other vehicles, which are then assigned again. The vehicle keeps the one to
        which its setpoints are sent, or that has its uid."""
        uid = vehicle.identity.uid
        with_uid = (e for e in vehicle.endpoints if e.unique_uid is not None and e.unique_uid == uid)
        kept = vehicle.send_path() if vehicle.streaming else next(with_uid, vehicle.endpoints[0])
        if kept is None:
            return
        for endpoint in vehicle.endpoints:
            if endpoint is kept or self._same_vehicle.is_same(kept, endpoint, now_s) is not False:
                continue
            vehicle.detach(endpoint)
            text = (
                f"Link {endpoint.connection.name} belongs to another vehicle with system id "
                f"{endpoint.system_id} than {vehicle.id}: it is now shown as a vehicle of its own."
            )
            vehicle.events.add("warning", self._clock.unix_s(), text, severity=d.MAV_SEVERITY_WARNING)
        if kept.version is not None:
            vehicle.set_version(kept.version)

    def _merge(self, first: Vehicle, second: Vehicle) -> None:
        """Makes two vehicles one; the one in use remains. Waits and warns while a stream is sent, which a
        further link could interrupt, or both are in use."""
        used = [v for v in (first, second) if v.in_use]
        if len(used) > 1 or any(v.streaming for v in used):
            text = (
                f"Vehicles {first.id} and {second.id} are one vehicle on two links. They become one when "
                "the setpoint stream has ended and only one of them is used (mission, control)."
            )
            for vehicle in (first, second):
                vehicle.warn(text)
            return
        into, removed = (second, first) if second in used else (first, second)
        for endpoint in removed.endpoints:
            removed.detach(endpoint)
            into.attach(endpoint)
        self._remove(removed, f"it is vehicle {into.id} on another link")
        self._warn_of_same_id(into.identity.system_id)

    def _remove_with_endpoints(self, vehicle: Vehicle, why: str) -> None:
        for endpoint in vehicle.endpoints:
            self._remove_endpoint(endpoint)
            vehicle.detach(endpoint)
        self._remove(vehicle, why)
        self._warn_of_same_id(vehicle.identity.system_id)

    def _remove(self, vehicle: Vehicle, why: str) -> None:
        self._vehicles.pop(vehicle.id, None)
        self._ordered = None
        vehicle.tickets.cancel_all(f"Vehicle {vehicle.id} was removed: {why}.")
        vehicle.disconnected(why)
        for callback in self._on_removed:
            callback(vehicle)
        text = f"Vehicle {vehicle.id} was removed: {why}"
        self.events.add("vehicle_removed", self._clock.unix_s(), text, vehicle=vehicle.id)

    def _remove_endpoint(self, endpoint: Endpoint) -> None:
        self._endpoints.pop((endpoint.connection, endpoint.peer.name, endpoint.system_id), None)

    # --- events ---------------------------------------------------------------------------------

    def _publish(self, event: Event) -> None:
        for callback in tuple(self._subscribers):
            callback(event)

    def _link_changed(self, info: LinkInfo) -> None:
        state = (info.state, info.detail)
        if self._link_states.get(info.name) == state:
            return
        self._link_states[info.name] = state
        text = f"Link {info.name}: {info.state}{'. ' + info.detail if info.detail else ''}"
        severity = d.MAV_SEVERITY_WARNING if info.state == "waiting" else d.MAV_SEVERITY_INFO
        data: dict[str, object] = {"link": info.name, "state": info.state}
        self.events.add("link", self._clock.unix_s(), text, severity=severity, data=data)


def _sort_key(vehicle_id: str) -> tuple[int, int]:
    base, _, number = vehicle_id.partition(NUMBER_SEPARATOR)
    return int(base), int(number or 1)
