"""PX4's uXRCE-DDS client of one vehicle: decodes and encodes messages; a `Port` exchanges them over DDS."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, Protocol

from vehicle_sim.commands.command import (
    IN_PROGRESS,
    ROS2,
    TEMPORARILY_REJECTED,
    Command,
    CommandHost,
    Handler,
    execute,
)
from vehicle_sim.external_modes.registry import EXECUTOR_COMPONENT
from vehicle_sim.ros2.external_modes import ExternalModeTopics, Publish, Values
from vehicle_sim.ros2.messages import MalformedMessage
from vehicle_sim.ros2.outputs import Outputs
from vehicle_sim.ros2.setpoints import SetpointInputs
from vehicle_sim.ros2.topics import (
    COMMAND,
    COMMAND_ACK,
    EXECUTOR_COMMAND,
    SERVICE_REPLY,
    SERVICE_REQUEST,
    topics_of,
)
from vehicle_sim.topics.states import States

CONNECTED_AFTER_S: Final = {True: 6.4, False: 1.3}
"""Time from boot to the first message, with (True) and without time synchronization (`UXRCE_DDS_SYNCT`)."""
CYCLE_US: Final = 10_000
"""Period of PX4's commander, which processes one command per cycle."""
COMMAND_QUEUE_LENGTH: Final = 4
"""Length of PX4's command queue; in a burst PX4 drops the oldest commands without a report."""
REQUEST: Final = "/fmu/in/message_format_request"
RESPONSE: Final = "/fmu/out/message_format_response"
PROTOCOL_VERSION: Final = 1
UNSET_HASH, UNSET_NAME = 3, "6"
"""Recorded values of the fields that PX4 leaves unset in a response."""


def response(request: Values, hashes: Mapping[str, int]) -> dict[str, Any]:
    """The fields of the MessageFormatResponse, except the time.

    PX4 looks up the part of the name after the last slash; a name without a slash is unknown to PX4.

    Args:
        request: fields of the MessageFormatRequest.
        hashes: see `Topics.hashes`.
    """
    fields: dict[str, Any] = {"protocol_version": PROTOCOL_VERSION, "message_hash": UNSET_HASH}
    if request["protocol_version"] != PROTOCOL_VERSION:
        return fields | {"topic_name": UNSET_NAME}
    name = request["topic_name"]
    message_hash = hashes.get(name.rpartition("/")[2]) if "/" in name else None
    fields["topic_name"] = name
    return fields if message_hash is None else fields | {"success": True, "message_hash": message_hash}


class MessageFormats:
    """Replies to programs that ask one vehicle for the hash of a topic's type, to check their px4_msgs
    version; of several requests in one step only the last gets a reply."""

    def __init__(self, hashes: Mapping[str, int], publish: Publish) -> None:
        self._hashes, self._publish = hashes, publish
        self._request: Values | None = None
        self.receivers = {REQUEST: self._store_request}

    def _store_request(self, request: Values) -> None:
        self._request = request

    def reply_to_newest(self) -> None:
        """Replies to the newest request since the last call."""
        request, self._request = self._request, None
        if request is not None:
            self._publish(RESPONSE, response(request, self._hashes))


def _ignore(_command: Command) -> None:
    """Handler of commands that PX4 ignores over ROS 2."""


class Port(Protocol):
    """Transport of the messages; `topics.py` defines the topics' names."""

    def publish(self, topic: str, data: bytes) -> None:
        """Sends a message; does not block."""
        ...

    def take(self) -> Iterable[tuple[str, bytes]]:
        """Received messages (topic, data), at most as many as the port's limit; does not block."""
        ...


class AcknowledgingHost(CommandHost, Protocol):
    """A command host that reports all acknowledgements, including those of commands from MAVLink."""

    def add_ack_listener(self, listener: Callable[[Command, int, int], None]) -> None:
        """Calls `listener(command, result, progress)` for each acknowledgement."""
        ...


class Bridge:
    """One vehicle on ROS 2.

    Args:
        host: the vehicle.
        states: the vehicle's state topics.
        handlers: handler of each command.
        mavlink_only: numbers of the commands that PX4 handles only over MAVLink.
        port: transport of the messages.
        report: called with an error message, once for each topic with a malformed message.
    """

    def __init__(
        self,
        host: AcknowledgingHost,
        states: States,
        handlers: Mapping[int, Handler],
        mavlink_only: frozenset[int],
        port: Port,
        report: Callable[[str], None],
    ) -> None:
        self._host, self._view, self._port, self._report_malformed = host, host.view, port, report
        self._topics = topics_of(self._view.px4)
        self._handlers = {**handlers, **dict.fromkeys(mavlink_only, _ignore)}
        synchronized = self._view.optional_choice("UXRCE_DDS_SYNCT", 1) != 0
        offset_us = int(self._view.boot_time_unix_s * 1e6) if synchronized else 0
        self._offset_us = offset_us
        self._connected_at_us = int(CONNECTED_AFTER_S[synchronized] * 1e6)
        self._outputs = Outputs(
            host.autopilot, states, port.publish, offset_us, synchronized=synchronized
        )  # fmt: skip
        self._commands: deque[tuple[Values, bool]] = deque(maxlen=COMMAND_QUEUE_LENGTH)
        """Commands that wait for the commander; True for a command from the ROS 2 service."""
        self._executor_commands: deque[Values] = deque(maxlen=COMMAND_QUEUE_LENGTH)
        self._next_cycle_at_us = 0
        self._service_command: Command | None = None
        """Command from the ROS 2 service that is not acknowledged yet."""
        self._reported_topics: set[str] = set()
        setpoints = SetpointInputs(host.autopilot)
        self._external = host.autopilot.commander.external
        self._external_mode_topics = ExternalModeTopics(host.autopilot, self._publish, offset_us)
        self._message_formats = MessageFormats(self._topics.hashes, self._publish)
        self._receivers: dict[str, Callable[[Values], None]] = {
            COMMAND: lambda values: self._commands.append((values, False)),
            SERVICE_REQUEST: lambda values: self._commands.append((values, True)),
            EXECUTOR_COMMAND: self._executor_commands.append,
            **self._external_mode_topics.receivers,
            **self._message_formats.receivers,
            **setpoints.receivers,
        }
        self._inputs = {topic.name: (topic.base, topic.message) for topic in self._topics.inputs}
        self._inputs[SERVICE_REQUEST] = (SERVICE_REQUEST, self._topics.messages["VehicleCommand"])
        host.add_ack_listener(self._acknowledge)

    @property
    def connected(self) -> bool:
        """Whether the vehicle sends and receives messages; false in the first seconds after boot."""
        return self._view.time_boot_us() >= self._connected_at_us

    def step(self) -> None:
        """Handles received messages and publishes outputs; called after each simulation step."""
        now_us = self._view.time_boot_us()
        received = self._port.take()
        if now_us < self._connected_at_us:
            return
        for topic, data in received:
            self._receive(topic, data)
        self._message_formats.reply_to_newest()
        if now_us >= self._next_cycle_at_us:
            self._next_cycle_at_us = now_us + CYCLE_US
            self._cycle()
        self._outputs.step(now_us)

    def _cycle(self) -> None:
        self._external_mode_topics.cycle()
        if self._commands:
            self._run_command(*self._commands.popleft())
        if self._executor_commands:
            self._forward_executor_command(self._executor_commands.popleft())

    def _publish(self, base: str, values: Values) -> None:
        """Publishes a message with the current time on a topic, which is named without version."""
        stamped = {"timestamp": self._view.time_boot_us() + self._offset_us, **values}
        topic = self._topics.output[base]
        self._port.publish(topic.name, topic.message.encode(stamped))

    def _receive(self, topic: str, data: bytes) -> None:
        base, message = self._inputs.get(topic, ("", None))
        receiver = self._receivers.get(base)
        if receiver is None or message is None:
            return
        try:
            values = message.decode(data)
        except MalformedMessage as problem:
            if topic not in self._reported_topics:
                self._reported_topics.add(topic)
                self._report_malformed(
                    f"a message on {topic} was dropped. {problem}. Check the sender's px4_msgs version."
                )
            return
        receiver(values)

    def _run_command(self, values: Values, from_service: bool) -> None:
        system, component = self._host.autopilot_id
        if values["target_system"] not in (0, system) or values["target_component"] not in (0, component):
            return
        command = _decode(values, values["source_system"])
        if from_service:
            self._service_command = command
        self._external.commanded_by_executor = values["source_component"] >= EXECUTOR_COMPONENT
        execute(self._host, self._handlers, command)
        self._external.commanded_by_executor = False

    def _forward_executor_command(self, values: Values) -> None:
        """Queues a command of the executor in charge as a command of the vehicle; rejects commands of other
        executors."""
        system = self._host.autopilot_id[0]
        if values["source_component"] == EXECUTOR_COMPONENT + self._external.executor_in_charge:
            self._commands.append(({**values, "source_system": system}, False))
        else:
            self._acknowledge(_decode(values, system), TEMPORARILY_REJECTED, 0)

    def _acknowledge(self, command: Command, result: int, progress: int) -> None:
        if not self.connected:
            return
        values = {
            "timestamp": self._view.time_boot_us() + self._offset_us, "command": command.number,
            "result": result, "result_param1": progress, "target_system": command.sender[0],
            "target_component": command.sender[1],
        }  # fmt: skip
        data = self._topics.messages["VehicleCommandAck"].encode(values)
        self._port.publish(COMMAND_ACK, data)
        if command is self._service_command and result != IN_PROGRESS:
            self._service_command = None
            self._port.publish(SERVICE_REPLY, data)


def _decode(values: Values, source_system: int) -> Command:
    return Command(
        values["command"], *(values[f"param{n}"] for n in range(1, 8)),
        sender=(source_system, values["source_component"]), link=ROS2, external=values["from_external"],
    )  # fmt: skip
