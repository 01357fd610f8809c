"""PX4's ROS 2 client of one vehicle: it decodes and encodes messages, and has no DDS and no clock of
its own."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, Protocol

from vehicle_sim.commands.command import IN_PROGRESS, ROS2, Command, CommandHost, Handler, execute
from vehicle_sim.ros2.messages import MESSAGES, MalformedMessage
from vehicle_sim.ros2.outputs import Outputs
from vehicle_sim.ros2.setpoints import SetpointInputs
from vehicle_sim.ros2.topics import COMMAND, COMMAND_ACK, INPUTS, SERVICE_REPLY, SERVICE_REQUEST
from vehicle_sim.topics.states import States

CONNECTED_AFTER_S: Final = {True: 6.4, False: 1.3}
"""Time after boot of the first message, with and without time synchronization (`UXRCE_DDS_SYNCT`)."""
COMMAND_EVERY_US: Final = 10_000
"""The commander processes one command per cycle."""
COMMANDS_KEPT: Final = 4
"""Of a burst, PX4 keeps the last commands and drops older ones silently."""
Values = Mapping[str, Any]


def _ignore(_command: Command) -> None:
    """Ignores the command: PX4 has no module that answers it over ROS 2."""


class Port(Protocol):
    """Carries the messages; topics have the names of `topics.py`."""

    def publish(self, topic: str, data: bytes) -> None:
        """Sends a message; does not block."""
        ...

    def take(self) -> Iterable[tuple[str, bytes]]:
        """Received messages, a bounded number; does not block."""
        ...


class AckingHost(CommandHost, Protocol):
    """A host that reports the acknowledgements of commands from any source."""

    def add_ack_listener(self, listener: Callable[[Command, int, int], None]) -> None:
        """Calls `listener(command, result, progress)` for each acknowledgement."""
        ...


class Bridge:
    """One vehicle on ROS 2.

    Args:
        host: the vehicle.
        states: its state topics.
        handlers: handler of each command.
        silent: commands that PX4 answers over MAVLink only.
        port: carries the messages.
        report: called once for each topic on which a malformed message arrives.
    """

    def __init__(
        self,
        host: AckingHost,
        states: States,
        handlers: Mapping[int, Handler],
        silent: frozenset[int],
        port: Port,
        report: Callable[[str], None],
    ) -> None:
        self._host, self._view, self._port, self._report = host, host.view, port, report
        self._handlers = {**handlers, **dict.fromkeys(silent, _ignore)}
        synchronized = self._view.optional_choice("UXRCE_DDS_SYNCT", 1) != 0
        offset_us = int(self._view.boot_time_unix_s * 1e6) if synchronized else 0
        self._offset_us = offset_us
        self._connected_at_us = int(CONNECTED_AFTER_S[synchronized] * 1e6)
        self._outputs = Outputs(
            host.autopilot, states, port.publish, offset_us, synchronized=synchronized
        )  # fmt: skip
        self._commands: deque[tuple[Values, bool]] = deque(maxlen=COMMANDS_KEPT)
        """Each with whether the service sent it."""
        self._command_at_us = 0
        self._service_command: Command | None = None
        """The service's command that is not acknowledged yet."""
        self._malformed: set[str] = set()
        setpoints = SetpointInputs(host.autopilot)
        self._receivers: dict[str, Callable[[Values], None]] = {
            COMMAND: lambda values: self._commands.append((values, False)),
            SERVICE_REQUEST: lambda values: self._commands.append((values, True)),
            **setpoints.receivers,
        }
        self._types = {topic.name: topic.message for topic in INPUTS}
        self._types[SERVICE_REQUEST] = MESSAGES["VehicleCommand"]
        host.add_ack_listener(self._acknowledge)

    @property
    def connected(self) -> bool:
        """Whether the vehicle has booted so far that it sends and receives messages."""
        return self._view.time_boot_us() >= self._connected_at_us

    def step(self) -> None:
        """Exchanges messages; called after each simulation step."""
        now_us = self._view.time_boot_us()
        received = self._port.take()
        if now_us < self._connected_at_us:
            return
        for topic, data in received:
            self._receive(topic, data)
        if self._commands and now_us >= self._command_at_us:
            self._command_at_us = now_us + COMMAND_EVERY_US
            self._command(*self._commands.popleft())
        self._outputs.step(now_us)

    def _receive(self, topic: str, data: bytes) -> None:
        receiver = self._receivers.get(topic)
        if receiver is None:
            return
        try:
            values = self._types[topic].decode(data)
        except MalformedMessage as problem:
            if topic not in self._malformed:
                self._malformed.add(topic)
                self._report(
                    f"a message on {topic} was dropped. {problem}. Check the sender's px4_msgs version."
                )
            return
        receiver(values)

    def _command(self, values: Values, from_service: bool) -> None:
        system, component = self._host.own
        if values["target_system"] not in (0, system) or values["target_component"] not in (0, component):
            return
        command = Command(
            values["command"], *(values[f"param{n}"] for n in range(1, 8)),
            sender=(values["source_system"], values["source_component"]), link=ROS2,
        )  # fmt: skip
        if from_service:
            self._service_command = command
        execute(self._host, self._handlers, command)

    def _acknowledge(self, command: Command, result: int, progress: int) -> None:
        if not self.connected:
            return
        values = {
            "timestamp": self._view.time_boot_us() + self._offset_us, "command": command.number,
            "result": result, "result_param1": progress, "target_system": command.sender[0],
            "target_component": command.sender[1],
        }  # fmt: skip
        data = MESSAGES["VehicleCommandAck"].encode(values)
        self._port.publish(COMMAND_ACK, data)
        if command is self._service_command and result != IN_PROGRESS:
            self._service_command = None
            self._port.publish(SERVICE_REPLY, data)
