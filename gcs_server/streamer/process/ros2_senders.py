"""The ROS 2 senders of the stream process: one DDS participant for each domain.

Opening a participant takes some tenths of a second. A thread opens the participant, so that the setpoints to
other vehicles continue.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import SENT_TYPES, Message
from gcs_server.ros2.message_types import MESSAGES
from gcs_server.ros2.topics import Subscription
from gcs_server.streamer.schedule.external_modes import CONNECTED_FROM, CONNECTED_TO, READ_TYPES
from gcs_server.streamer.transport.ros2 import SETPOINT_TOPICS, TOPIC_TYPES

if TYPE_CHECKING:
    from gcs_server.ros2.dds import Readers, Writers

log = logging.getLogger(__name__)
READ_DEPTH = 8
"""Maximum number of messages of a topic that are kept until the next reading."""


class Ros2Sender:
    """The topics of one vehicle. Sends nothing until DDS is open and the vehicle is connected."""

    def __init__(self, address: DdsAddress) -> None:
        self._address = address
        self._writers: Writers | None = None
        self._connected: set[str] = set()
        """Topics to which the vehicle subscribes."""
        threading.Thread(target=self._open, name=f"dds {address.namespace}", daemon=True).start()

    def send(self, messages: Sequence[Message], required: Iterable[str] = ()) -> None:
        """See `TopicSender`."""
        writers = self._writers
        if writers is None:
            raise OSError("DDS is not open yet")
        for topic in (*required, *(topic for topic, _ in messages)):
            if topic not in self._connected:
                if not writers.connected(topic):
                    raise OSError(f"no vehicle subscribes to {topic} yet")
                self._connected.add(topic)
        for topic, data in messages:
            writers.send(topic, data)

    def _open(self) -> None:
        try:
            # real-time priority is for sending setpoints only; DDS's own threads inherit this priority
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            from gcs_server.ros2.dds import open_writers

            types = {topic: MESSAGES[kind] for topic, kind in TOPIC_TYPES.items()}
            self._writers = open_writers(self._address, types)
        except Exception:
            log.exception("setpoints cannot be sent over ROS 2 to %s", self._address)


class ModeTopics:
    """The topics over which modes are registered with one vehicle; implements `ModePort`. Until DDS is open,
    nothing is received, and nothing can be sent."""

    def __init__(self, address: DdsAddress) -> None:
        self._address = address
        self._topics: tuple[Writers, Readers] | None = None
        threading.Thread(target=self._open, name=f"dds modes {address.namespace}", daemon=True).start()

    def send(self, topic: str, data: bytes) -> None:
        """See `ModePort`."""
        if self._topics is None:
            raise OSError("DDS is not open yet")
        self._topics[0].send(topic, data)

    def connected(self) -> bool:
        """See `ModePort`."""
        if self._topics is None:
            return False
        writers, readers = self._topics
        return all(map(writers.connected, CONNECTED_TO)) and all(map(readers.connected, CONNECTED_FROM))

    def take(self) -> list[tuple[str, bytes]]:
        """See `ModePort`."""
        return [] if self._topics is None else self._topics[1].take()

    def _open(self) -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            from gcs_server.ros2.dds import open_topics

            trajectory = "TrajectorySetpoint"  # for the velocity of zero before a stream flies the vehicle
            sent = {**SENT_TYPES, SETPOINT_TOPICS[trajectory]: trajectory}
            read = [Subscription(topic, kind, 0.0, READ_DEPTH) for topic, kind in READ_TYPES.items()]
            self._topics = open_topics(
                self._address, {topic: MESSAGES[kind] for topic, kind in sent.items()}, read
            )
        except Exception:
            log.exception("modes cannot be registered over ROS 2 with %s", self._address)


class Ros2Senders:
    """The senders of all vehicles that are reached over ROS 2."""

    def __init__(self) -> None:
        self._senders: dict[DdsAddress, Ros2Sender] = {}

    def sender_for(self, address: DdsAddress) -> Ros2Sender:
        """The sender for an address; the first call for an address starts to open DDS."""
        if address not in self._senders:
            self._senders[address] = Ros2Sender(address)
        return self._senders[address]

    def close_unused(self, used: Collection[DdsAddress]) -> None:
        """Closes the senders for all addresses that are not in `used`."""
        self._senders = {address: sender for address, sender in self._senders.items() if address in used}
