"""A vehicle on real DDS that publishes recorded messages and acknowledges commands. Needs `cyclonedds`."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from gcs_server.ros2.dds_types import Sample, idl_type
from gcs_server.ros2.topics import COMMAND, COMMAND_ACK, wire_name
from tests.support.dds_publisher import TYPES, VEHICLE_STATUS, Publisher, status_bytes
from tests.support.dds_samples import recorded_samples

VEHICLE_ATTITUDE = "/fmu/out/vehicle_attitude"
MESSAGES_OF_TOPICS = {
    "/fmu/out/timesync_status": "TimesyncStatus",
    "/fmu/out/vehicle_land_detected": "VehicleLandDetected",
    VEHICLE_ATTITUDE: "VehicleAttitude",
    "/fmu/out/vehicle_local_position": "VehicleLocalPosition",
}
ARM_DISARM = 400
"""VehicleCommand.VEHICLE_CMD_COMPONENT_ARM_DISARM."""
DISARMED, ARMED = 1, 2
"""Values of VehicleStatus.arming_state."""


class AcknowledgingVehicle:
    """A vehicle that acknowledges every command. A command to arm arms it, any other command disarms it."""

    def __init__(self, domain_id: int, namespace: str, system_id: int) -> None:
        self._publisher, self._system_id = Publisher(domain_id, namespace), system_id
        command_type = TYPES["VehicleCommand"]
        topic = Topic(self._publisher.participant, wire_name(COMMAND, namespace), idl_type(command_type))
        qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(8))
        self._commands = DataReader(self._publisher.participant, topic, qos=qos)
        self._armed = False

    def step(self) -> None:
        """Acknowledges the received commands; publishes the status and one message of each other topic."""
        for sample in self._commands.take(8):
            if isinstance(sample, Sample):
                self._acknowledge(TYPES["VehicleCommand"].decode(sample.cdr))
        vehicle_status = status_bytes(
            system_id=self._system_id, arming_state=ARMED if self._armed else DISARMED
        )
        self._publisher.send(VEHICLE_STATUS, vehicle_status)
        for topic, message in MESSAGES_OF_TOPICS.items():
            self._publisher.send(topic, recorded_samples()[topic], message)

    def _acknowledge(self, command: dict[str, Any]) -> None:
        self._armed = command["command"] == ARM_DISARM and command["param1"] == 1.0
        ack = {"command": command["command"], "result": 0}  # accepted
        ack |= {f"target_{part}": command[f"source_{part}"] for part in ("system", "component")}
        self._publisher.send(COMMAND_ACK, TYPES["VehicleCommandAck"].encode(ack), "VehicleCommandAck")


class PeriodicThread:
    """A thread that calls its callbacks at 20 Hz."""

    def __init__(self) -> None:
        self.callbacks: list[Callable[[], None]] = []
        self.errors: list[Exception] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._main)
        self._thread.start()

    def _main(self) -> None:
        while not self._stop.wait(0.05):
            try:
                for callback in list(self.callbacks):
                    callback()
            except Exception as error:
                self.errors.append(error)
                return

    def close(self) -> None:
        self._stop.set()
        self._thread.join(10.0)
        if self.errors:
            raise self.errors[0]
