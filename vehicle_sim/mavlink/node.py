"""The MAVLink side of one vehicle: passes received messages to the services, and sends the streams."""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.commands.calibration import CalibrationCommands
from vehicle_sim.commands.flight import FailureCommands, FlightCommands
from vehicle_sim.commands.gimbal import GimbalCommands
from vehicle_sim.logger.logger import Logger
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import BY_NAME, Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.mavlink.services.camera import CameraService
from vehicle_sim.mavlink.services.commands import CommandService, OwnCommandService
from vehicle_sim.mavlink.services.ftp import FtpService
from vehicle_sim.mavlink.services.inputs import InputService
from vehicle_sim.mavlink.services.log_stream import LogStreamService
from vehicle_sim.mavlink.services.logs import LogService
from vehicle_sim.mavlink.services.mission import MissionService
from vehicle_sim.mavlink.services.params import ParamService
from vehicle_sim.mavlink.services.requests import ModesMonitor, RequestService
from vehicle_sim.mavlink.services.shell import ShellService, Terminal
from vehicle_sim.mavlink.services.streams import OriginService, RangingService, TimeService
from vehicle_sim.mavlink.services.texts import TextService
from vehicle_sim.mavlink.services.vision import VisionService
from vehicle_sim.payload.camera import Camera
from vehicle_sim.storage.files import VehicleFiles

MAV_TYPE_GCS, MAV_TYPE_ONBOARD_CONTROLLER = 6, 18
RATE_INTERVAL_US = 1_000_000
HEARTBEAT = BY_NAME["HEARTBEAT"].id


class Node:
    """The MAVLink side of one vehicle."""

    def __init__(self, autopilot: Autopilot, system_id: int, files: VehicleFiles, logger: Logger) -> None:
        self.context = Context(autopilot, system_id)
        self._texts = TextService(self.context)
        self._time = TimeService(self.context)
        self.params = ParamService(self.context)
        self._mission = MissionService(self.context)
        self._ftp = FtpService(self.context, files)
        self._logs = LogService(self.context, files, logger)
        self._log_stream = LogStreamService(self.context, logger)
        self._ranging = RangingService(self.context)
        self._camera: CameraService | None = None
        requests = RequestService(self.context, self._time.send_ping, files)
        gimbal = GimbalCommands(self.context)
        calibration = CalibrationCommands(self.context, self.params.send_as_changed)
        self.failures = FailureCommands(self.context)
        ModesMonitor(self.context)
        self._shell = ShellService(self.context)
        OwnCommandService(self.context, gimbal.commands)
        groups = (
            FlightCommands(self.context), requests, gimbal, calibration, self.failures, self._log_stream,
        )  # fmt: skip
        self.commands = {number: handler for group in groups for number, handler in group.commands.items()}
        """Handlers of commands from any source."""
        self.mavlink_commands = frozenset(requests.commands)
        """Numbers of the commands that PX4 handles only over MAVLink."""
        self._handlers: dict[str, Callable[[Link, Message], None]] = {"HEARTBEAT": self._heartbeat}
        services = (
            self._texts, self._time, self.params, self._mission, CommandService(self.context, self.commands),
            InputService(self.context), VisionService(self.context), self._ftp, self._logs, self._log_stream,
            self._shell, OriginService(self.context),
        )  # fmt: skip
        for service in services:
            self._handlers |= service.handlers
        self._send_functions: dict[int, Callable[[Link], None]] = {
            BY_NAME["PING"].id: self._time.send_ping,
            BY_NAME["TIMESYNC"].id: self._time.send_timesync,
            BY_NAME["LINK_NODE_STATUS"].id: requests.send_link_node_status,
            BY_NAME["MISSION_CURRENT"].id: self._mission.send_current,
            BY_NAME["CURRENT_EVENT_SEQUENCE"].id: self._texts.send_current_sequence,
            BY_NAME["DISTANCE_SENSOR"].id: self._ranging.send,
        }
        self._rates_update_at_us = RATE_INTERVAL_US
        self._idle_until_us = 0
        """Until this time `step` has nothing to do, unless a message is received or an action is pending."""
        self._bytes_at_last_rate: dict[str, tuple[int, int]] = {}
        """Sent and received bytes when the data rates were last computed, by link."""

    @property
    def system_id(self) -> int:
        """System id of the vehicle."""
        return self.context.system_id

    def add_camera(self, camera: Camera) -> None:
        """Adds a camera as a separate MAVLink component."""
        self._camera = service = CameraService(self.context, camera)

        def send_heartbeats(link: Link) -> None:
            """Sends the vehicle's heartbeat, then the camera's. MAVSDK does not connect to a vehicle if it
            receives the heartbeat of another component first."""
            self._send(link, HEARTBEAT)
            service.send_heartbeat(link)

        self._send_functions[HEARTBEAT] = send_heartbeats

    def open_console(self, console: Callable[[], Terminal]) -> None:
        """Gives ground stations a console of the vehicle; `console` creates one session per link."""
        self._shell.console = console

    def add_link(self, link: Link) -> None:
        """Adds a link, and starts its streams."""
        now_us = self.context.view.time_boot_us()
        self._idle_until_us = 0
        self._bytes_at_last_rate.pop(link.name, None)
        for msg_id in list(link.streamed_ids()):
            link.set_interval(msg_id, link.interval_us(msg_id), now_us)
        self._ranging.start_streams(link, now_us)
        self.context.links.append(link)

    def remove_link(self, link: Link) -> None:
        """Removes a link."""
        if link in self.context.links:
            self.context.links.remove(link)

    def receive(self, link: Link, data: bytes) -> None:
        """Handles bytes received on a link; invalid bytes are skipped."""
        self._idle_until_us = 0
        for message in link.feed(data):
            link.known_senders.add(message.sender)
            handler = self._handlers.get(message.name)
            if handler is not None:
                handler(link, message)
            if self._camera is not None:
                self._camera.receive(link, message)
                if self._camera.is_only_recipient(message):
                    continue
            self._forward(link, message)

    @property
    def needs_every_step(self) -> bool:
        """Whether `step` must be called after each simulation step, not only after each tick of the
        autopilot."""
        context = self.context
        return bool(context.links) or context.has_pending or self._camera is not None

    @property
    def has_pending(self) -> bool:
        """Whether an action of a service or the report of a reached mission item is pending."""
        return self.context.has_pending or self._mission.has_pending

    def step(self) -> None:
        """Called after each simulation step: runs pending actions, then sends the streams that are due."""
        context = self.context
        now_us = context.view.time_boot_us()
        if now_us < self._idle_until_us and not context.has_pending and not self._mission.has_pending:
            return
        busy = self._step_services()
        send_functions = self._send_functions
        next_us = self._rates_update_at_us
        for link in context.links:
            if link.next_due_us <= now_us:
                for msg_id in link.due(now_us):
                    send = send_functions.get(msg_id)
                    if send is not None:
                        send(link)
                    else:
                        self._send(link, msg_id)
            next_us = min(next_us, link.next_due_us)
        if now_us >= self._rates_update_at_us:
            self._update_rates(now_us)
        self._idle_until_us = 0 if busy else next_us

    def _send(self, link: Link, msg_id: int) -> None:
        layout_and_payload = self.context.telemetry.payload(msg_id)
        if layout_and_payload is not None:
            link.send_payload(*layout_and_payload)

    def _step_services(self) -> bool:
        """Runs due actions, then steps each service that has work; returns whether any service had work."""
        if self.context.has_pending:
            self.context.run_due()
        busy = False
        for service in (self._ftp, self._logs, self._log_stream, self._shell, self.params, self._mission):
            if service.busy:
                service.step()
                busy = True
        if self._camera is not None:
            self._camera.step()
            busy = True
        return busy

    def _update_rates(self, now_us: int) -> None:
        for link in self.context.links:
            sent, received = self._bytes_at_last_rate.get(link.name, (0, 0))
            link.tx_rate, link.rx_rate = link.sent_bytes - sent, link.received_bytes - received
            self._bytes_at_last_rate[link.name] = (link.sent_bytes, link.received_bytes)
        self._rates_update_at_us = now_us + RATE_INTERVAL_US

    def _heartbeat(self, link: Link, message: Message) -> None:
        if message.type == MAV_TYPE_GCS:
            if not math.isfinite(link.gcs_heartbeat_at_s):
                self._texts.start_event_sequence(link)
            now_s = self.context.view.time_s
            link.gcs_heartbeat_at_s = self.context.autopilot.commander.checks.gcs_heartbeat_at_s = now_s
        elif message.type == MAV_TYPE_ONBOARD_CONTROLLER and message.system_id == self.system_id:
            self.context.autopilot.commander.checks.companion_heartbeat_at_s = self.context.view.time_s

    def _forward(self, link: Link, message: Message) -> None:
        if message.system_id == self.system_id and message.component_id == 1:
            return
        if (
            message.values.get("target_system", 0) == self.system_id
            and message.values.get("target_component") == 1
        ):
            return
        for other in self.context.links:
            if other is not link:
                other.send_raw(message.raw)
