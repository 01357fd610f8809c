"""One vehicle: identity, state, mailbox, and one attribute per service."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import replace
from typing import Any, TypeVar, cast

from gcs_server.clock import Clock
from gcs_server.errors import Disconnected, GcsError, NotVerified, Refused
from gcs_server.faults import Isolation
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, decode, encode_payload, full_payload
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.mavlink.mailbox import Mailbox
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.attached import AttachedControl, AttachedFlight, AttachedMission, AttachedStream
from gcs_server.vehicle.components import Components
from gcs_server.vehicle.endpoint import (
    ESTIMATE_IDS,
    ESTIMATES_WITHIN_S,
    MAVLINK,
    ROS2,
    Endpoint,
    endpoint_to_use,
    preferred_endpoints,
)
from gcs_server.vehicle.event_logger import EventLogger
from gcs_server.vehicle.events import EventFeed
from gcs_server.vehicle.external_control import ExternalControl
from gcs_server.vehicle.identity import Identity, Version, with_version
from gcs_server.vehicle.mode_cause import ModeCause
from gcs_server.vehicle.px4.events import VehicleEvent
from gcs_server.vehicle.px4.modes import BY_CUSTOM_MODE, ModeNames
from gcs_server.vehicle.reach import Feature, Reach, reach_of, require_feature
from gcs_server.vehicle.reducers import REDUCERS, FlightState
from gcs_server.vehicle.samples import Sample, Status
from gcs_server.vehicle.services.checks import VehicleFloor
from gcs_server.vehicle.services.command import CommandService
from gcs_server.vehicle.services.ftp import FtpService
from gcs_server.vehicle.services.gimbals import Gimbals
from gcs_server.vehicle.services.guided import Guided
from gcs_server.vehicle.services.health import HealthService
from gcs_server.vehicle.services.metadata import MetadataService
from gcs_server.vehicle.services.mission import MissionService
from gcs_server.vehicle.services.mode_list import ModeList
from gcs_server.vehicle.services.params import ParamService
from gcs_server.vehicle.services.table import SERVICES
from gcs_server.vehicle.state import TOPIC_MESSAGES, VehicleState
from gcs_server.vehicle.tickets import Tickets

log = logging.getLogger(__name__)

S = TypeVar("S")


class Vehicle:
    """One vehicle; only the fleet changes its state.

    Args:
        vehicle_id: "1", or "1~2" for a second vehicle with system id 1.
        own_ids: this server's (system id, component id).
        supervisor: runs the vehicle's background tasks.
    """

    # Beyond 30 attributes, instances without slots no longer share their keys, so each access is slower.
    __slots__ = (
        "__weakref__", "_endpoint_in_use", "_endpoints", "_event_logger", "_external_control",
        "_handled_ids", "_handlers", "_identity", "_known_links", "_lost", "_services", "_state",
        "_supervisor",
        "clock", "command", "components", "control", "events", "ftp", "gimbal", "gimbals", "guided",
        "health", "id", "isolation", "listeners", "mailbox", "metadata", "mission", "mode_list",
        "mode_names", "offboard", "offboard_mission", "own_ids", "params", "taps", "tickets",
        "waypoint_flight",
    )  # fmt: skip

    def __init__(
        self,
        vehicle_id: str,
        identity: Identity,
        clock: Clock,
        own_ids: tuple[int, int],
        supervisor: Supervisor,
    ) -> None:
        self.id = vehicle_id
        self._supervisor, self.clock = supervisor, clock
        self.own_ids = own_ids
        self.isolation = Isolation(clock, log, f"Vehicle {vehicle_id}")
        """Runs code that may fail because of this vehicle's data: a topic, a snapshot, a view."""
        self.mailbox = Mailbox(decode)
        self.taps: tuple[Callable[[Frame, Endpoint], None], ...] = ()
        """Called with each message before it is handled; usually empty."""
        self.listeners: set[Callable[[], None]] = set()
        """Called after each message, before other tasks run; usually empty."""
        self.events = EventFeed(vehicle_id)
        self.tickets = Tickets()
        """The accepted commands that may still send."""
        self.offboard: AttachedStream | None = None
        """The vehicle's setpoint stream; set by `Streamer.attach`."""
        self.offboard_mission: AttachedMission | None = None
        """The vehicle's offboard mission; set by `OffboardMissions`."""
        self.waypoint_flight: AttachedFlight | None = None
        """The vehicle's flight of a waypoint plan; set by `WaypointFlights`."""
        self.control: AttachedControl | None = None
        """Control of the vehicle; set by `Authority`."""
        self._identity = identity
        self.mode_names = ModeNames()
        self._state = VehicleState(identity.component_id, clock, self.mode_names)
        self._event_logger = EventLogger(self.events, clock, self.mode_names)
        self._endpoints: tuple[Endpoint, ...] = ()
        self._known_links: set[str] = set()
        self._endpoint_in_use: Endpoint | None = None
        self._lost = False
        """Whether the event "Connection lost" was added for the current loss."""
        self.mode_list = ModeList(self)
        self.command = CommandService(
            self, VehicleFloor(self, self._known_parameter), lambda: self.mission.startable_s
        )
        self.guided = Guided(
            self,
            self.command,
            self._known_parameter,
            self._read_parameter,
            self._home_in_use,
            self._state.home_was_set,
            lambda: self.mission,
        )
        self.components = Components(identity.component_id, clock, self._report_component)
        self.gimbals = Gimbals(self, self._state)
        self.gimbal = self.gimbals.first
        self._services: dict[type[object], object] = {kind: kind(self) for kind in SERVICES}
        self.mission = MissionService(self)
        self.ftp = FtpService(self)
        self.metadata = MetadataService(self, self.ftp)
        self.params = ParamService(self, self.metadata)
        self.health = HealthService(self, self._take_event, self._fetch_metadata)
        self._event_logger.describe_again = self.health.describe_again
        self._external_control = ExternalControl(
            self,
            self.command,
            lambda: None if self.offboard is None else self.offboard.requested_mode(),
            lambda: self.mission.is_at_return(),
        )
        self._handlers = self._message_handlers()
        self._handled_ids = frozenset((*REDUCERS, *self._handlers))
        """Messages that are not only stored, but also handled."""

    def _message_handlers(self) -> dict[int, Callable[[Frame, Endpoint], None]]:
        """Who handles which message, after it was stored."""
        control, events = self._external_control, self._event_logger
        handlers: dict[int, Callable[[Frame, Endpoint], None]] = {
            d.MAVLINK_MSG_ID_STATUSTEXT: lambda f, e: events.text(full_payload(f), e),
            d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: lambda f, _: control.gimbal(
                f.component_id, full_payload(f)
            ),
        }
        of_payload: dict[int, Callable[[bytes], None]] = {
            d.MAVLINK_MSG_ID_EVENT: self.health.take_event,
            d.MAVLINK_MSG_ID_CURRENT_EVENT_SEQUENCE: self.health.take_sequence,
            d.MAVLINK_MSG_ID_RESPONSE_EVENT_ERROR: self.health.take_event_error,
            d.MAVLINK_MSG_ID_PARAM_VALUE: self.params.take_value,
            d.MAVLINK_MSG_ID_AVAILABLE_MODES: self.mode_list.take,
            d.MAVLINK_MSG_ID_AVAILABLE_MODES_MONITOR: self.mode_list.changed,
            d.MAVLINK_MSG_ID_COMMAND_ACK: control.ack,
            d.MAVLINK_MSG_ID_MISSION_CURRENT: lambda _: self.mission.on_ids_reported(),
        }
        for msg_id, take in of_payload.items():
            handlers[msg_id] = lambda frame, _, take=take: take(full_payload(frame))
        return handlers

    @property
    def identity(self) -> Identity:
        """Identity of the vehicle."""
        return self._identity

    @property
    def status(self) -> Status:
        """Armed, mode, landed state, link."""
        return self._state.status()

    @property
    def flight_state(self) -> FlightState:
        """Like `status`, with the times of the messages."""
        return self._state.flight_state

    @property
    def link_lost(self) -> bool:
        """Whether the connection is lost; faster than `status`."""
        return self._state.link_lost

    @property
    def mode(self) -> str:
        """Name of the current mode; faster than `status`."""
        return self._state.mode

    @property
    def mode_cause(self) -> ModeCause | None:
        """Cause of the current mode; None before the first mode change."""
        return self._external_control.mode_cause

    @property
    def in_failsafe(self) -> bool:
        """Whether the vehicle itself has left Offboard, or a mode registered with PX4, and returns to it when
        the cause ends. False once a pilot or a station has selected another mode."""
        state, cause = self._state.flight_state, self.mode_cause
        if cause is None or cause.source != "failsafe" or state.intended_custom_mode == state.custom_mode:
            return False
        intended = state.intended_custom_mode  # None: not reported since the mode changed
        mode = BY_CUSTOM_MODE.get(intended) if intended is not None else None
        return intended is None or (mode is not None and mode.name.startswith(("offboard", "external_")))

    @property
    def streaming(self) -> bool:
        """Whether setpoints are being sent to the vehicle."""
        return self.offboard is not None and self.offboard.status().streaming

    @property
    def in_use(self) -> bool:
        """Whether the vehicle has a setpoint stream or an offboard mission, or a client controls it."""
        has_mission = self.offboard_mission is not None and self.offboard_mission.active
        return (
            self.streaming
            or has_mission
            or (self.control is not None and self.control.status().holder is not None)
        )

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links over which the vehicle is connected, most recent first."""
        ordered = sorted(self._endpoints, key=lambda e: -e.received_s)
        return tuple(dict.fromkeys(e.connection.name for e in ordered))

    @property
    def endpoints(self) -> tuple[Endpoint, ...]:
        """The endpoints over which the vehicle is connected."""
        return self._endpoints

    @property
    def reach(self) -> Reach:
        """The protocols over which the vehicle is connected, and the features that its links do not carry."""
        return reach_of(self._endpoints)

    @property
    def known_links(self) -> frozenset[str]:
        """Names of all links over which the vehicle was ever connected."""
        return frozenset(self._known_links)

    def service(self, kind: type[S]) -> S:
        """The vehicle's service of a class in `services/table.py`."""
        return cast(S, self._services[kind])

    def topic(self, name: str) -> Sample | None:
        """The newest sample of a topic, decoded now; None before the first sample."""
        return self._state.topic(name)

    def topic_received_s(self, name: str) -> float | None:
        """When the newest sample of a topic was received [s, monotonic]; None before the first sample."""
        return self._state.topic_received_s(name)

    def history(self, topics: tuple[str, ...], since_unix_s: float) -> list[Sample]:
        """Samples at up to 4 Hz of the last five minutes, oldest first."""
        return self._state.history(topics, since_unix_s)

    def unusable(self) -> dict[str, str]:
        """Topics whose newest message cannot be used, and why; decodes all topics."""
        for name in TOPIC_MESSAGES:
            self._state.topic(name)
        return dict(self._state.unusable)

    def newest_payload(
        self, msg_id: int, component_id: int | None = None, instance: int | None = None
    ) -> tuple[bytes, float] | None:
        """The newest full-length payload of a message, and its time of reception [s, monotonic]: by
        default the autopilot's."""
        frame = self._state.newest(msg_id, component_id, instance)
        return None if frame is None else (full_payload(frame), frame.received_monotonic_s)

    def require_commandable(self, *, on_lost_link: bool = False) -> None:
        """Raises Refused for a replayed vehicle, NotVerified for a vehicle that the server's commands were
        not tested with, or Disconnected while the link is lost; with `on_lost_link`, only if there is no link
        on which to send."""
        identity = self._identity
        if identity.replayed:
            raise Refused(f"Vehicle {self.id} is a recording; it cannot be commanded.")
        if not identity.commandable:
            kind = "an " if identity.software.name[0] in "Aa" else "a "
            raise NotVerified(
                f"Vehicle {self.id} is {kind}{identity.software.name} vehicle "
                f"of type {identity.vehicle_type}. "
                "Commands are verified only for multicopters with PX4, so nothing was sent.",
                remedy="Use a ground station that supports it.",
            )
        if self._state.link_lost and not (on_lost_link and self._endpoints):
            raise Disconnected(
                f"Vehicle {self.id} is not connected: {self._state.reason_lost()}.",
                remedy="Check its link; nothing was sent.",
            )

    def require(self, feature: Feature) -> None:
        """Raises the errors of `require_commandable`, and Refused if no link of the vehicle carries the
        feature."""
        self.require_commandable()
        require_feature(self.id, self._endpoints, feature)

    def send(self, message: MAVLink_message, *, until_s: float | None = None) -> bool:
        """Encodes and sends a message on the link in use, from any thread; False if nothing was sent.

        Args:
            until_s: the message is dropped if the link cannot send it by this time [s, monotonic].
        """
        return self.send_payload(message.get_msgId(), encode_payload(message), until_s=until_s)

    def send_payload(
        self,
        msg_id: int,
        payload: bytes,
        *,
        created_s: float | None = None,
        until_s: float | None = None,
        component_id: int | None = None,
    ) -> bool:
        """Like `send`, for an encoded payload.

        Args:
            created_s: when the payload was created [s, monotonic]; None: now.
            component_id: component of this server that sends; None: the server's own.
        """
        if self._identity.replayed:
            return False
        endpoint = self._choose_endpoint(preferred_endpoints(self._endpoints, MAVLINK))
        if endpoint is None:
            return False
        other_endpoints = sorted(
            (e for e in self._endpoints if e is not endpoint), key=lambda e: -e.received_s
        )
        system, own = self.own_ids
        component = own if component_id is None else component_id
        return any(
            e.connection.sender_as(system, component).send(
                msg_id, payload, e.peer, created_s=created_s, until_s=until_s
            )
            for e in (endpoint, *other_endpoints)
        )

    def send_path(self) -> Endpoint | None:
        """Link and peer to which setpoints are sent now; None if nothing may be sent to the vehicle."""
        if self._identity.replayed:
            return None
        ros2 = preferred_endpoints(self._endpoints, ROS2)
        if len(ros2) < len(self._endpoints):
            return max(ros2, key=lambda e: e.received_s)
        return self._choose_endpoint(self._endpoints)

    def in_background(self, name: str, work: Coroutine[Any, Any, Any]) -> None:
        """Starts a background task. A `GcsError` is suppressed, because the service has reported it."""

        async def without_errors() -> None:
            with contextlib.suppress(GcsError):
                await work

        task = self._supervisor.spawn(f"vehicle {self.id}: {name}", without_errors())
        task.add_done_callback(lambda _: work.close())  # if the task was cancelled before its first step

    def _take_event(self, event: VehicleEvent, late: bool) -> None:
        self._event_logger.event(event, late)
        self.mission.take_event(event)

    def _fetch_metadata(self) -> None:
        self.in_background("metadata of its events", self.health.read_definitions(self.metadata))

    # --- called by the fleet only --------------------------------------------------------------

    def receive(self, frame: Frame, endpoint: Endpoint) -> None:
        """Handles a frame of this vehicle from one of its endpoints."""
        msg_id = frame.msg_id
        for tap in self.taps:
            tap(frame, endpoint)
        if endpoint.over_ros2 and msg_id != d.MAVLINK_MSG_ID_COMMAND_ACK:
            within_s = ESTIMATES_WITHIN_S if msg_id in ESTIMATE_IDS else None
            if endpoint not in preferred_endpoints(self._endpoints, MAVLINK, within_s):
                return  # MAVLink has the same data; with different delays, each change would appear twice
        if msg_id in self._handled_ids:
            self._handle(frame, endpoint)
        else:
            self._state.take(frame)
        if msg_id in self.mailbox.awaited and frame.known:
            self.mailbox.deliver(frame)
        if self.listeners:
            for listener in tuple(self.listeners):
                listener()

    def _handle(self, frame: Frame, endpoint: Endpoint) -> None:
        """Stores a frame that also changes the flight state or belongs to a service."""
        state, msg_id = self._state, frame.msg_id
        if msg_id == d.MAVLINK_MSG_ID_HEARTBEAT:
            self.components.heartbeat(frame)
        before = state.flight_state
        if not state.take(frame):
            return
        if state.flight_state is not before:
            self.mode_list.entered(before, state.flight_state)
            self._event_logger.flight_state(
                before, state.flight_state, self._external_control.mode(before, state.flight_state)
            )
        if msg_id == d.MAVLINK_MSG_ID_HEARTBEAT:
            self._heartbeat()
        if (handler := self._handlers.get(msg_id)) is not None:
            handler(frame, endpoint)

    def attach(self, endpoint: Endpoint) -> None:
        """Adds an endpoint."""
        endpoint.vehicle = self
        if not self._endpoints:
            self.health.connected()
        self._endpoints = (*self._endpoints, endpoint)
        self._known_links.add(endpoint.connection.name)
        if endpoint.version is not None:
            self.set_version(endpoint.version)

    def detach(self, endpoint: Endpoint) -> None:
        """Removes an endpoint."""
        endpoint.vehicle = None
        self._endpoints = tuple(e for e in self._endpoints if e is not endpoint)
        if not self._endpoints:
            self.disconnected("its link was closed")

    def set_version(self, version: Version) -> None:
        """Applies AUTOPILOT_VERSION."""
        self._identity = with_version(self._identity, version)

    def warn(self, text: str) -> None:
        """Sets the warning of the identity, and adds an event if the warning is new."""
        if text not in self._identity.warnings:
            self._identity = replace(self._identity, warnings=(text,))
            self.events.add("warning", self.clock.unix_s(), text, severity=d.MAV_SEVERITY_WARNING)

    def clear_warnings(self) -> None:
        """Clears the warning of the identity."""
        self._identity = replace(self._identity, warnings=())

    def tick(self) -> None:
        """Updates history, waiting texts and the connection's state; called four times a second."""
        self._state.store_history()
        self.components.tick()
        self._event_logger.tick()
        self.health.tick()
        self.mode_list.tick()
        self.gimbals.request_limits()
        if self._state.link_lost and not self._lost:
            self._lost = True
            self.events.add("link", self.clock.unix_s(), "Connection lost", severity=d.MAV_SEVERITY_WARNING)
            self.disconnected(self._state.reason_lost())

    def _known_parameter(self, name: str) -> float | None:
        param = self.params.known(name)
        return None if param is None else param.value

    async def _read_parameter(self, name: str) -> float | None:
        with contextlib.suppress(GcsError):
            return (await self.params.get(name)).value
        return None

    def _home_in_use(self) -> str | None:
        """Why home must not move now, as a sentence; None: it may."""
        if self.streaming:
            return f"Vehicle {self.id} follows setpoints whose limits and altitudes refer to home."
        if self.offboard_mission is not None and self.offboard_mission.active:
            return f"Vehicle {self.id} flies a mission whose limits and altitudes refer to home."
        return None

    def _report_component(self, text: str, loss: bool) -> None:
        severity = d.MAV_SEVERITY_WARNING if loss else d.MAV_SEVERITY_INFO
        self.events.add("component", self.clock.unix_s(), text, severity=severity)

    def disconnected(self, why: str) -> None:
        """Ends all pending requests immediately with an error; `why` is part of a sentence."""
        self.mailbox.fail_all(Disconnected(f"Vehicle {self.id} was lost before it answered: {why}."))

    def _heartbeat(self) -> None:
        identity, state = self._identity, self._state.flight_state
        simulated = True if state.hil else identity.simulated
        if (state.vehicle_type, state.autopilot, simulated) != (
            identity.vehicle_type,
            identity.autopilot,
            identity.simulated,
        ):
            self._identity = replace(
                identity, vehicle_type=state.vehicle_type, autopilot=state.autopilot, simulated=simulated
            )
        if self._lost:
            self._lost = False
            self.gimbals.link_restored()
            self.health.connected()
            self.params.link_restored()
            self.events.add(
                "link", self.clock.unix_s(), "Connection restored", severity=d.MAV_SEVERITY_NOTICE
            )

    def _choose_endpoint(self, endpoints: Sequence[Endpoint]) -> Endpoint | None:
        self._endpoint_in_use = endpoint_to_use(endpoints, self._endpoint_in_use)
        return self._endpoint_in_use
