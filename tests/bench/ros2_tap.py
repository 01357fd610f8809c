"""Records the setpoints that a stream sends over ROS 2, as `relay.py` does for MAVLink."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Sequence
from typing import Any

from cyclonedds.core import DDSException, ReadCondition, SampleState, WaitSet
from cyclonedds.core import InstanceState as Instance
from cyclonedds.core import ViewState as View
from cyclonedds.domain import DomainParticipant
from cyclonedds.internal import InvalidSample
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from gcs_server.ros2.dds import open_domain
from gcs_server.ros2.dds_types import idl_type
from gcs_server.ros2.message_types import MESSAGES
from gcs_server.ros2.topics import wire_name

SETPOINT = "/fmu/in/trajectory_setpoint"
MAX_SAMPLES = 200
"""Maximum number of samples of a topic between two reads."""
NORTH_OFFSET = 4 + 8
"""Offset of the north position in a sample [bytes]: after the header and the time."""


class Ros2Tap:
    """Reads the setpoint topic of vehicles; runs in a thread of its own.

    The time of a setpoint is the one at which the stream's process handed it to DDS (its source timestamp),
    so a delay of this thread does not change it.
    """

    def __init__(self, domain_id: int, namespaces: Sequence[str]) -> None:
        self._domain = open_domain(domain_id, None)
        participant = DomainParticipant(domain_id)
        message_type, qos = (
            idl_type(MESSAGES["TrajectorySetpoint"]),
            Qos(Policy.History.KeepLast(MAX_SAMPLES)),
        )
        topics = {name: Topic(participant, wire_name(SETPOINT, name), message_type) for name in namespaces}
        self._readers = {name: DataReader(participant, topic, qos=qos) for name, topic in topics.items()}
        self._waitset = WaitSet(participant)
        for reader in self._readers.values():
            self._waitset.attach(ReadCondition(reader, SampleState.Any | View.Any | Instance.Any))
        self._epoch_s = time.clock_gettime(time.CLOCK_REALTIME) - time.monotonic()
        self._running = True
        self.setpoints: list[tuple[float, bytes]] = []
        """Monotonic time [s] and message of each, in the order in which they were read."""
        self._sent_s: dict[str, list[float]] = {namespace: [] for namespace in namespaces}
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Ros2Tap:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._running = False
        self._thread.join(2)

    def streams_s(self) -> list[list[float]]:
        """Times of the setpoints recorded so far, of each vehicle."""
        return list(self._sent_s.values())

    def sent_at_s(self, north_m: float) -> float | None:
        """Time of the first setpoint with this position."""
        expected_north = struct.pack("<f", north_m)
        times_s = (
            at_s for at_s, cdr in self.setpoints if cdr[NORTH_OFFSET : NORTH_OFFSET + 4] == expected_north
        )
        return next(times_s, None)

    def clear(self) -> None:
        """Deletes the recorded setpoints."""
        self.setpoints.clear()
        for sent_s in self._sent_s.values():
            sent_s.clear()

    def _run(self) -> None:
        while self._running:
            try:
                self._waitset.wait(duration(milliseconds=100))
            except DDSException:
                continue
            for namespace, reader in self._readers.items():
                for sample in reader.take(MAX_SAMPLES):
                    self._record(namespace, sample)

    def _record(self, namespace: str, sample: Any) -> None:
        if isinstance(sample, InvalidSample):  # a writer has ended
            return
        at_s = sample.sample_info.source_timestamp * 1e-9 - self._epoch_s
        self.setpoints.append((at_s, sample.cdr))
        self._sent_s[namespace].append(at_s)
