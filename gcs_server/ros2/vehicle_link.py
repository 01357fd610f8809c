"""One vehicle on a `ros2://` link: converts its samples to MAVLink frames, and the server's commands to
VehicleCommand.

Uses neither DDS nor a clock. `to_frames` runs in the link's thread, `send` in any thread.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Final, Protocol

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, FrameParser, encode_frame, encode_payload
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.ros2.commands import command_ack, command_fields, mode_of_command, requested_message
from gcs_server.ros2.formats import RESPONSE, VehicleFormats
from gcs_server.ros2.message_types import MESSAGES, MalformedMessage, Values
from gcs_server.ros2.to_mavlink import MavlinkConverter
from gcs_server.ros2.topics import COMMAND, COMMAND_ACK

PROBLEM_S: Final = 60.0
"""Time for which a problem is reported after its last occurrence."""
MAX_REQUESTED: Final = 16
"""Maximum number of requested messages that wait, and of commands for which a refusal can be explained."""
REFUSALS: Final = (d.MAV_RESULT_TEMPORARILY_REJECTED, d.MAV_RESULT_DENIED, d.MAV_RESULT_FAILED)


class Sender(Protocol):
    """Sends to the vehicle's topics."""

    def send(self, topic: str, data: bytes) -> None:
        """Raises OSError if the message cannot be sent."""
        ...


class VehicleLink:
    """One vehicle.

    Args:
        namespace: the vehicle's namespace; may be empty.
        sender: sends to the vehicle's topics.
        own_system_id: the server's system id.
    """

    def __init__(self, namespace: str, sender: Sender, own_system_id: int) -> None:
        self.namespace, self._sender, self._own_system_id = namespace, sender, own_system_id
        self.formats = VehicleFormats(namespace)
        self._converter = MavlinkConverter()
        self._seq = 0
        self._requested: set[int] = set()
        """Messages that the server has requested; written by any thread."""
        self._refusal_modes: dict[int, int | None] = {}
        """For each sent command: the mode whose requirements may explain a refusal."""
        self._problems: dict[str, tuple[str, float]] = {}
        """By topic: the problem, and the time of its last occurrence [s, monotonic]."""

    def to_frames(self, samples: Iterable[tuple[str, bytes]], now_s: float) -> bytes:
        """MAVLink frames of received samples. A malformed sample is skipped, and so is one of a topic whose
        layout the vehicle has not confirmed.

        Args:
            samples: topics with their bytes.
            now_s: time of reception [s, monotonic].
        """
        messages: list[MAVLink_message] = []
        for topic, data in samples:
            try:
                values = self._decode(topic, data)
                if values is None:
                    continue
                messages += self._convert_ack(values) if topic == COMMAND_ACK else self._converter.convert(
                    topic, values, now_s
                )  # fmt: skip
            except (MalformedMessage, ValueError, OverflowError) as problem:
                self._problems[topic] = str(problem), now_s
        while self._requested:
            latched = self._converter.latched(self._requested.pop())
            messages += [] if latched is None else [latched]
        return b"".join(self._frames(messages, now_s))

    def _decode(self, topic: str, data: bytes) -> Values | None:
        """The values of a sample for the converter; None: there is nothing to convert.

        Raises:
            MalformedMessage: the bytes do not have the vehicle's layout.
        """
        if topic == RESPONSE:
            self.formats.on_response(MESSAGES["MessageFormatResponse"].decode(data))
            return None
        topic_format = self.formats.usable.get(topic)
        if topic_format is None:
            return None
        return MESSAGES[topic_format.type].decode(topic_format.to_server(data))

    def send(self, data: bytes, unix_us: int) -> None:
        """Sends a frame of the server to the vehicle, if ROS 2 has a message for it.

        Raises:
            OSError: ROS 2 has no such message, DDS cannot send it, or the layout of the vehicle's topic for
                it is not known.
        """
        for frame in FrameParser().feed(data, 0.0):
            self._send_frame(frame, unix_us)

    def problems(self, now_s: float) -> list[str]:
        """The problems of this vehicle's messages, as sentences."""
        recent = [
            f"A message on {self._name(topic)} cannot be used: {why}."
            for topic, (why, at_s) in list(self._problems.items())
            if now_s - at_s < PROBLEM_S
        ]
        return recent and [
            *recent[:3],
            "Check which programs publish this topic; PX4's own messages have the layout that it confirmed.",
        ]

    def _name(self, topic: str) -> str:
        topic_format = self.formats.usable.get(topic)
        name = topic if topic_format is None else topic_format.name
        return f"/{self.namespace}{name}" if self.namespace else name

    def _convert_ack(self, values: Values) -> list[MAVLink_message]:
        ack = command_ack(values, self._own_system_id)
        if ack is None:
            return []
        mode = self._refusal_modes.get(values["command"])
        texts = [] if mode is None or values["result"] not in REFUSALS else self._converter.problems(mode)
        return [*(_statustext(text) for text in texts), ack]

    def _frames(self, messages: Iterable[MAVLink_message], now_s: float) -> Iterable[bytes]:
        address = self._converter.address
        if address is None:
            return
        for message in messages:
            try:
                payload = encode_payload(message)
            except struct.error as problem:
                self._problems[message.get_type()] = f"{message.get_type()}: {problem}", now_s
                continue
            yield encode_frame(message.get_msgId(), payload, self._seq, *address)
            self._seq = (self._seq + 1) & 0xFF

    def _send_frame(self, frame: Frame, unix_us: int) -> None:
        if frame.msg_id == d.MAVLINK_MSG_ID_HEARTBEAT:
            return  # PX4 has no topic for heartbeats: DDS itself discovers programs
        requested = requested_message(frame)
        if requested is not None:
            # PX4 does not answer requests for messages over ROS 2: the stored message is the answer
            if self._converter.latched(requested) is not None and len(self._requested) < MAX_REQUESTED:
                self._requested.add(requested)
            return
        command = command_fields(frame)
        if command is None:
            raise OSError(f"PX4 has no ROS 2 message for MAVLink message {frame.msg_id}")
        topic_format = self.formats.usable.get(COMMAND)
        if topic_format is None:
            raise OSError(self.formats.unusable[COMMAND].text)
        if len(self._refusal_modes) < MAX_REQUESTED or command["command"] in self._refusal_modes:
            mode = mode_of_command(command, self._converter.nav_state)
            self._refusal_modes[command["command"]] = mode
        data_to_send = MESSAGES["VehicleCommand"].encode({**command, "timestamp": unix_us})
        self._sender.send(COMMAND, topic_format.to_vehicle(data_to_send))


def _statustext(text: str) -> MAVLink_message:
    return d.MAVLink_statustext_message(d.MAV_SEVERITY_WARNING, text.encode()[:50].ljust(50, b"\0"))
