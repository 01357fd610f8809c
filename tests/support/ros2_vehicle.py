"""A simulated vehicle, in simulated time, whose ROS 2 messages go to a list instead of a network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.px4_version import DEFAULT, Px4Version
from vehicle_sim.ros2.topics import COMMAND, COMMAND_ACK, SERVICE_REPLY, SERVICE_REQUEST, topics_of

READY_S = 4.0
NO_TIME_SYNC = {"UXRCE_DDS_SYNCT": 0}
"""Without time synchronization the vehicle publishes on ROS 2 1.3 s after its boot, otherwise after 6.4 s."""
ADDRESSES = {"target_system": 1, "target_component": 1, "source_system": 1, "source_component": 1}
HOVER_HEIGHT_M = 2.5
ARM_DISARM, TAKEOFF = 400, 22
"""Commands of VehicleCommand."""


class Ros2Vehicle:
    """One vehicle after its boot; `received_messages` has (time [s], topic, fields) of each message it
    published. Topics are named without the version that their names have on the wire."""

    def __init__(
        self,
        *,
        time_since_boot_s: float = READY_S,
        parameters: Mapping[str, float] = NO_TIME_SYNC,
        px4: Px4Version = DEFAULT,
        **options: Any,
    ) -> None:
        options = {"sensor_noise": False, "links": (), "px4": px4} | options
        topics = topics_of(px4)
        both = (*topics.outputs, *topics.inputs)
        self.message_types = {topic.base: topic.message for topic in both} | {
            SERVICE_REQUEST: topics.messages["VehicleCommand"],
            SERVICE_REPLY: topics.messages["VehicleCommandAck"],
        }
        """Type of each topic."""
        self.wire_names = {topic.base: topic.name for topic in both}
        self._base_names = {topic.name: topic.base for topic in both}
        self.sim = SimulatedFleet(1, parameters=parameters, **options)
        self.received_messages: list[tuple[float, str, dict[str, Any]]] = []
        self.reports: list[str] = []
        self._inbox: list[tuple[str, bytes]] = []
        self.sim.open_ros2(0, self, self.reports.append)
        self.run(time_since_boot_s)

    # --- transport -------------------------------------------------------------------------------------

    def publish(self, topic: str, data: bytes) -> None:
        """Receives a message from the vehicle on a topic, which is named as on the wire."""
        self.receive(self._base_names.get(topic, topic), data)

    def receive(self, topic: str, data: bytes) -> None:
        """Decodes and stores a message from the vehicle."""
        self.received_messages.append((self.sim.time_s, topic, self.message_types[topic].decode(data)))

    def take(self) -> Iterable[tuple[str, bytes]]:
        """Removes and returns the messages for the vehicle."""
        inbox, self._inbox = self._inbox, []
        return inbox

    # --- the ROS 2 node of the test ------------------------------------------------------------------------

    def send(self, topic: str, fields: Mapping[str, Any] = {}, **more_fields: Any) -> None:
        """Sends a message; fields that are not given are zero."""
        data = self.message_types[topic].encode({**fields, **more_fields})
        self._inbox.append((self.wire_names.get(topic, topic), data))

    def send_bytes(self, topic: str, data: bytes) -> None:
        """Sends these bytes, which need not be a valid message, on a topic, which is named as on the wire."""
        self._inbox.append((topic, data))

    def command(self, command_id: int, *parameters: float, topic: str = COMMAND, **fields: Any) -> None:
        """Sends a VehicleCommand."""
        parameter_fields = {f"param{n + 1}": value for n, value in enumerate(parameters)}
        self.send(
            topic, ADDRESSES | parameter_fields | {"command": command_id, "from_external": True} | fields
        )

    def run(self, seconds: float) -> None:
        """Simulates this time [s]."""
        self.sim.step(seconds)

    def stream(self, seconds: float, hz: float, *messages: tuple[str, Mapping[str, Any]]) -> None:
        """Sends these messages at this rate for this time [s]."""
        for _ in range(round(seconds * hz)):
            for topic, fields in messages:
                self.send(topic, fields)
            self.run(1.0 / hz)

    def newest_fields(self, topic: str) -> dict[str, Any]:
        """Fields of the newest message on a topic."""
        return next(fields for _, name, fields in reversed(self.received_messages) if name == topic)

    def all_fields(self, topic: str, since_s: float = 0.0) -> list[dict[str, Any]]:
        """Fields of each message on a topic since this time [s]."""
        return [fields for at_s, name, fields in self.received_messages if name == topic and at_s >= since_s]

    def acks(self, since_s: float = 0.0) -> list[tuple[int, int]]:
        """(command, result) of each VehicleCommandAck since this time [s]."""
        return [(ack["command"], ack["result"]) for ack in self.all_fields(COMMAND_ACK, since_s)]

    @property
    def position_ned_m(self) -> tuple[float, float, float]:
        """The position that the vehicle reports."""
        local = self.newest_fields("/fmu/out/vehicle_local_position")
        return local["x"], local["y"], local["z"]

    def hover(self) -> None:
        """Arms, takes off to HOVER_HEIGHT_M above the current altitude; ends in Hold."""
        self.command(ARM_DISARM, 1.0)
        nan = float("nan")
        self.command(TAKEOFF, nan, 0.0, 0.0, nan, nan, nan, self._hover_amsl_m())
        self.run(9.0)

    def _hover_amsl_m(self) -> float:
        return self.sim.autopilots[0].view.estimate.alt_amsl_m + HOVER_HEIGHT_M
