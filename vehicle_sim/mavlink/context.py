"""Context of all MAVLink services of a vehicle: the autopilot, the links, replies and delayed actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.commands.command import Command
from vehicle_sim.mavlink.dialect import LAYOUTS, Layout, Message, pack
from vehicle_sim.mavlink.link import Link
from vehicle_sim.mavlink.messages.gimbal import GimbalMessages
from vehicle_sim.mavlink.messages.message_group import Builder, MessageGroup
from vehicle_sim.mavlink.messages.motion import MotionMessages
from vehicle_sim.mavlink.messages.navigation import NavigationMessages
from vehicle_sim.mavlink.messages.sensors import SensorMessages
from vehicle_sim.mavlink.messages.state import StateMessages

AUTOPILOT_COMPONENT = 1
LAST_MAVLINK_COMMAND = 65535
AckListener = Callable[[Command, int, int], None]
GCS_TIMEOUT_S = 2.5
"""A ground station counts as connected for this long after its last heartbeat; one heartbeat may be lost."""


MESSAGE_GROUPS: tuple[type[MessageGroup], ...] = (
    StateMessages,
    MotionMessages,
    SensorMessages,
    NavigationMessages,
    GimbalMessages,
)


class Telemetry:
    """Telemetry payloads of one vehicle; each is built at most once per step and shared by all links."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._simulation = autopilot.view.simulation
        self._cache: dict[int, tuple[Layout, bytes] | None] = {}
        self._cached_step = -1
        self._builders: dict[int, Builder] = {}
        for group in MESSAGE_GROUPS:
            self._builders |= group(autopilot).builders()

    @property
    def ids(self) -> frozenset[int]:
        """Ids of the messages that can be built."""
        return frozenset(self._builders)

    def payload(self, msg_id: int) -> tuple[Layout, bytes] | None:
        """Layout and current payload of a message; None: no data."""
        step = self._simulation.steps
        if step != self._cached_step:
            self._cache.clear()
            self._cached_step = step
        elif msg_id in self._cache:
            return self._cache[msg_id]
        builder = self._builders.get(msg_id)
        payload = builder() if builder else None
        layout_and_payload = None if payload is None else (LAYOUTS[msg_id], payload)
        self._cache[msg_id] = layout_and_payload
        return layout_and_payload


class Context:
    """Data, replies and delayed actions that all MAVLink services of one vehicle share."""

    def __init__(self, autopilot: Autopilot, system_id: int) -> None:
        self.autopilot = autopilot
        self.view = autopilot.view
        self.system_id = system_id
        self.links: list[Link] = []
        self.telemetry = Telemetry(autopilot)
        self._next_actions: list[Callable[[], None]] = []
        """Actions of `call_soon`."""
        self._run_requested = False
        """Whether a service has requested a call of `run_due`."""
        self.gcs_timeout_s = GCS_TIMEOUT_S
        """Simulated time; longer if the simulation runs faster than real time."""
        self._timers: list[tuple[float, Callable[[], None]]] = []
        """(simulated time [s], action of `call_later`)."""
        self._ack_listeners: list[AckListener] = []

    @property
    def autopilot_id(self) -> tuple[int, int]:
        """(system id, component id)."""
        return self.system_id, AUTOPILOT_COMPONENT

    def gcs_connected(self, link: Link) -> bool:
        """Whether a ground station is connected on a link; otherwise this link carries no status texts."""
        return self.view.time_s - link.gcs_heartbeat_at_s < self.gcs_timeout_s

    def addresses_autopilot(self, message: Message) -> bool:
        """Whether target system and component address this autopilot."""
        values = message.values
        return values.get("target_system") == self.system_id and values.get("target_component") in (
            AUTOPILOT_COMPONENT,
            0,
        )

    def broadcast(self, name: str, /, **fields: Any) -> None:
        """Sends a message on every link."""
        layout, payload = pack(name, **fields)
        for link in self.links:
            link.send_payload(layout, payload)

    def add_ack_listener(self, listener: AckListener) -> None:
        """Calls `listener(command, result, progress)` with each acknowledgement of a command."""
        self._ack_listeners.append(listener)

    def acknowledge(self, command: Command, result: int, *, progress: int = 0) -> None:
        """Acknowledges a command on all transports."""
        for listener in self._ack_listeners:
            listener(command, result, progress)
        self.send_ack(command, result, progress=progress)

    def send_ack(self, command: Command, result: int, *, progress: int = 0) -> None:
        """Sends COMMAND_ACK on every link on which the sender of the command has sent messages.

        PX4's internal commands, which have larger numbers than MAVLink's, are not acknowledged over MAVLink.
        """
        links = [link for link in self.links if command.sender in link.known_senders]
        if not links or command.number > LAST_MAVLINK_COMMAND:
            return
        layout, payload = pack(
            "COMMAND_ACK", command=command.number, result=result, progress=progress,
            target_system=command.sender[0], target_component=command.sender[1],
        )  # fmt: skip
        for link in links:
            link.send_payload(layout, payload)

    def call_soon(self, action: Callable[[], None]) -> None:
        """Runs an action before the next tick, as PX4's commander replies milliseconds later from its own
        loop."""
        self._next_actions.append(action)

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Runs an action once after a simulated time."""
        self._timers.append((self.view.time_s + seconds, action))

    @property
    def has_pending(self) -> bool:
        """Whether an action or a call of `run_due` is pending."""
        return bool(self._next_actions or self._timers or self._run_requested)

    def wake(self) -> None:
        """Requests a call of `run_due`, for a service that has work without having received a message."""
        self._run_requested = True

    def run_due(self) -> None:
        """Runs the actions that are due."""
        self._run_requested = False
        if self._next_actions:
            actions, self._next_actions = self._next_actions, []
            for action in actions:
                action()
        if self._timers:
            now_s = self.view.time_s
            due = [action for due_s, action in self._timers if due_s <= now_s]
            self._timers = [(due_s, action) for due_s, action in self._timers if due_s > now_s]
            for action in due:
                action()
