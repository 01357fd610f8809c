"""The modes that this server has registered with PX4, in the process that sends the setpoints.

PX4 sends three arming check requests a second for a mode, and returns (RTL) 1.1 s after the last reply. So a
stalled event loop must not stop the replies. If the event loop sends nothing for too long, the replies report
that the mode cannot run; PX4 then does not start the mode, or leaves it.

Without new setpoints PX4 keeps the last one, which may be a velocity. Therefore this module
sends a velocity of zero while one of the modes is active and no stream flies the vehicle, for example before
the mission begins.
"""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final, Protocol

from gcs_server.clock import Clock
from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import (
    CHECK_REPLY,
    CHECK_REQUEST,
    COMPLETED,
    OVERRIDES,
    REGISTER,
    REGISTER_REPLY,
    SENT_TYPES,
    UNREGISTER,
    ExternalMode,
    ModeDeclaration,
    Registration,
    controllers_message,
)
from gcs_server.ros2.message_types import MESSAGES, MalformedMessage, Values
from gcs_server.ros2.mode_executor import ARMED, MODE_COMPLETED, ExecutorCommand, Message
from gcs_server.ros2.mode_executor import COMMAND as EXECUTOR_COMMAND
from gcs_server.ros2.topics import COMMAND_ACK, STATUS
from gcs_server.streamer.transport.ros2 import encode, with_time
from missions.setpoints import Velocity

log = logging.getLogger(__name__)

STEP_S: Final = 0.02
"""Period of reading and replying [s]. PX4 accepts a reply within 0.1 s of its request, and rejects it after
0.4 s."""
REMOVE_EVERY_S: Final = 0.2
"""Time between two removals [s], because PX4 queues only one removal."""
MAX_MODES: Final = 4
"""Maximum number of modes of one vehicle, because PX4 queues only four simultaneous replies."""
READ_TYPES: Final = {
    REGISTER_REPLY: "RegisterExtComponentReply",
    CHECK_REQUEST: "ArmingCheckRequest",
    STATUS: "VehicleStatus",
    COMMAND_ACK: "VehicleCommandAck",
    MODE_COMPLETED: "ModeCompleted",
}
CONNECTED_TO: Final = (REGISTER, CHECK_REPLY)
"""Topics to which PX4 must subscribe before a registration is requested."""
CONNECTED_FROM: Final = (REGISTER_REPLY, CHECK_REQUEST)
"""Topics that PX4 must publish before a registration is requested."""
REQUIRED_TOPICS: Final = frozenset(
    {REGISTER, UNREGISTER, REGISTER_REPLY, CHECK_REQUEST, CHECK_REPLY, COMPLETED}
)
"""Topics without which a mode cannot be registered, flown, or removed."""
STOP_MESSAGES: Final = encode(Velocity((0.0, 0.0, 0.0)))[1]
"""The setpoint of zero velocity."""
WRITTEN: Final = frozenset({*SENT_TYPES, *(topic for topic, _ in STOP_MESSAGES)})
"""Topics to which this module sends."""


def topics_for(declaration: ModeDeclaration) -> frozenset[str]:
    """The topics that a mode needs, without the topics of its setpoints."""
    deferring = {OVERRIDES} if declaration.defer_failsafes_s else set[str]()
    executing = {EXECUTOR_COMMAND, MODE_COMPLETED} if declaration.executor else set[str]()
    return REQUIRED_TOPICS | deferring | executing


class ModePort(Protocol):
    """The topics of one vehicle."""

    def send(self, topic: str, data: bytes) -> None:
        """Raises OSError if the message cannot be sent now."""
        ...

    def connected(self) -> bool:
        """Whether DDS has connected the topics of registrations and checks with PX4, in both directions."""
        ...

    def take(self) -> Iterable[tuple[str, bytes]]:
        """Messages received since the last call: topics with their bytes."""
        ...


OpenModePort = Callable[[DdsAddress], ModePort]


def no_mode_port(address: DdsAddress) -> ModePort:
    """Opens no topics; used where ROS 2 is not available. Always raises ValueError."""
    raise ValueError(f"ROS 2 is not available for {address}")


@dataclass(slots=True)
class _VehicleModes:
    address: DdsAddress
    port: ModePort
    modes: list[ExternalMode] = field(default_factory=list[ExternalMode])
    removals: list[Message] = field(default_factory=list[Message])
    """Removals that are not sent yet."""
    next_removal_s: float = 0.0
    """Earliest time of the next removal."""
    active_nav_state: int | None = None
    """The current mode of an armed vehicle, as `nav_state`; None: disarmed or unknown."""


class ExternalModes:
    """The registered modes of all vehicles.

    Args:
        clock: monotonic time, and the time of messages.
        open_port: opens the topics of a vehicle; does not wait.
    """

    def __init__(self, clock: Clock, open_port: OpenModePort) -> None:
        self._clock, self._open_port = clock, open_port
        self._vehicles: dict[str, _VehicleModes] = {}
        self._next_s = 0.0

    def register(self, vehicle_id: str, address: DdsAddress, declaration: ModeDeclaration) -> None:
        """Begins to register a mode.

        Raises:
            ValueError: the vehicle has a mode of this name, or too many modes.
        """
        vehicle = self._vehicles.get(vehicle_id)
        registered = [] if vehicle is None else [m for m in vehicle.modes if not _has_ended(m)]
        if any(mode.declaration.name == declaration.name for mode in registered):
            raise ValueError(f"the mode {declaration.name!r} is already registered")
        if len(registered) >= MAX_MODES:
            raise ValueError(f"{MAX_MODES} modes are already registered")
        if vehicle is None or vehicle.address != address:
            if registered:
                raise ValueError("modes are already registered over another ROS 2 link, or in other layouts")
            vehicle = self._vehicles[vehicle_id] = _VehicleModes(address, self._open_port(address))
        vehicle.modes = [mode for mode in vehicle.modes if mode.declaration.name != declaration.name]
        mode = ExternalMode(declaration, secrets.randbits(63), self._clock.monotonic_s())
        vehicle.modes.append(mode)

    def unregister(self, vehicle_id: str, name: str) -> None:
        """Removes a mode, also one whose registration was refused or lost."""
        for vehicle, mode in self._modes_of(vehicle_id):
            if mode.declaration.name == name:
                vehicle.removals += mode.remove()
                vehicle.modes = [other for other in vehicle.modes if other is not mode]

    def set_ready(self, vehicle_id: str, name: str, ready: bool) -> None:
        """Sets whether PX4 may arm the vehicle in a mode."""
        for _, mode in self._modes_of(vehicle_id):
            if mode.declaration.name == name:
                mode.ready = ready

    def complete(self, vehicle_id: str, mode: str, success: bool) -> None:
        """Reports to PX4 that a mode (`external_1` …) is complete, or that it has failed."""
        for vehicle, each in self._modes_of(vehicle_id):
            if each.registration.mode == mode:
                self._send(vehicle, each.completed(success=success))

    def execute(self, vehicle_id: str, mode: str, command: ExecutorCommand) -> None:
        """Sends a command of a mode's executor to PX4; `Registration.executor` contains the outcome later."""
        for vehicle, each in self._modes_of(vehicle_id):
            if each.registration.mode == mode and each.executor is not None:
                self._send(vehicle, each.executor.execute(command, self._clock.monotonic_s()))

    def forget(self, vehicle_id: str) -> None:
        """Removes all modes of a vehicle."""
        for _, mode in self._modes_of(vehicle_id):
            self.unregister(vehicle_id, mode.declaration.name)

    def close(self) -> None:
        """Unregisters all modes at once; PX4 may miss some of the messages, and then removes those modes
        because they do not reply."""
        for vehicle in self._vehicles.values():
            for mode in vehicle.modes:
                self._send(vehicle, mode.remove())
        self._vehicles.clear()

    def states(self) -> dict[str, tuple[Registration, ...]]:
        """The modes by vehicle."""
        return {
            vehicle_id: tuple(mode.registration for mode in vehicle.modes)
            for vehicle_id, vehicle in self._vehicles.items()
        }

    def step(self, now_s: float, *, server_alive: bool, flown: Callable[[str], bool]) -> float:
        """Reads messages, and sends replies and due requests; returns the time of the next step.

        Args:
            now_s: current time [s, monotonic].
            server_alive: whether the event loop is running.
            flown: whether a stream flies the vehicle with this id.
        """
        if not self._vehicles:
            return float("inf")
        if now_s < self._next_s:
            return self._next_s
        self._next_s = now_s + STEP_S
        for vehicle_id, vehicle in list(self._vehicles.items()):
            try:
                self._read(vehicle, now_s, server_alive)
                self._send_due(vehicle, now_s, stop=not flown(vehicle_id))
            except Exception:
                # PX4 receives no more replies for this vehicle's modes, and executes its failsafe
                log.exception("the modes of vehicle %s failed", vehicle_id)
                vehicle.modes.clear()
            if not vehicle.modes and not vehicle.removals and now_s >= vehicle.next_removal_s:
                del self._vehicles[vehicle_id]
        return self._next_s

    def _modes_of(self, vehicle_id: str) -> list[tuple[_VehicleModes, ExternalMode]]:
        """A vehicle's modes, each with the data of the vehicle."""
        vehicle = self._vehicles.get(vehicle_id)
        return [] if vehicle is None else [(vehicle, mode) for mode in vehicle.modes]

    def _read(self, vehicle: _VehicleModes, now_s: float, server_alive: bool) -> None:
        for topic, data in vehicle.port.take():
            try:
                values = MESSAGES[READ_TYPES[topic]].decode(data)
            except MalformedMessage:
                continue  # the vehicle's link reports malformed messages
            if topic == STATUS:
                vehicle.active_nav_state = values["nav_state"] if values["arming_state"] == ARMED else None
            for mode in vehicle.modes:
                self._send(vehicle, _pass_to_mode(mode, topic, values, now_s, server_alive))

    def _send_due(self, vehicle: _VehicleModes, now_s: float, *, stop: bool) -> None:
        registering = [mode for mode in vehicle.modes if mode.registration.state == "registering"]
        connected = not registering or vehicle.port.connected()
        for mode in vehicle.modes:
            if mode in registering and not connected:
                mode.wait_for_connection(now_s)
                continue
            # one registration at a time, because PX4 queues only two requests
            if mode not in registering[1:] and now_s >= mode.due_s:
                self._send(vehicle, mode.step(now_s))
            if mode.executor is not None and now_s >= mode.executor.due_s:
                self._send(vehicle, mode.executor.step(now_s))
        if vehicle.removals and now_s >= vehicle.next_removal_s:
            self._send(vehicle, [vehicle.removals.pop(0)])
            vehicle.next_removal_s = now_s + REMOVE_EVERY_S
        nav_states = [mode.registration.nav_state for mode in vehicle.modes if mode.registration.mode]
        if stop and vehicle.active_nav_state is not None and vehicle.active_nav_state in nav_states:
            self._send(vehicle, [controllers_message(vehicle.active_nav_state, "velocity"), *STOP_MESSAGES])

    def _send(self, vehicle: _VehicleModes, messages: Iterable[Message]) -> None:
        for topic, data in messages:
            # PX4 v1.17 ignores a reply that is older than 0.3 s by its own clock; without a time it is new
            unix_us = 0 if topic == CHECK_REPLY else int(self._clock.unix_s() * 1e6)
            try:
                vehicle.port.send(topic, with_time(data, unix_us))
            except OSError:
                return  # not connected yet; registrations and PX4's requests are repeated later


def _pass_to_mode(
    mode: ExternalMode, topic: str, values: Values, now_s: float, server_alive: bool
) -> list[Message]:
    """Passes a message of PX4 to a mode; returns the messages to send."""
    if topic == STATUS:
        return mode.on_status(values)
    if topic == REGISTER_REPLY:
        return mode.on_reply(values, now_s)
    if topic == CHECK_REQUEST:
        return mode.on_check_request(values, now_s, can_run=server_alive)
    if mode.executor is not None and topic == COMMAND_ACK:
        mode.executor.on_ack(values)
    elif mode.executor is not None:
        mode.executor.on_completed(values)
    return []


def _has_ended(mode: ExternalMode) -> bool:
    return mode.registration.state in ("refused", "lost")
