"""The ROS 2 senders of the stream process: one DDS participant for each domain.

Opening a participant takes some tenths of a second. A thread opens the participant, so that the setpoints to
other vehicles continue.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import Message
from gcs_server.ros2.formats import formats_of
from gcs_server.ros2.message_types import MalformedMessage
from gcs_server.streamer.schedule.external_modes import CONNECTED_FROM, CONNECTED_TO, READ_TYPES, WRITTEN
from gcs_server.streamer.transport.ros2 import TOPIC_TYPES

if TYPE_CHECKING:
    from gcs_server.ros2.dds import Readers, Writers

log = logging.getLogger(__name__)
READ_DEPTH = 8
"""Maximum number of messages of a topic that are kept until the next reading."""


class Ros2Sender:
    """The topics of one vehicle. Sends nothing until DDS is open and the vehicle is connected, and nothing
    on a topic whose layout the vehicle has not confirmed."""

    def __init__(self, address: DdsAddress) -> None:
        self._address = address
        self._formats = formats_of(address, TOPIC_TYPES)
        self._opened: tuple[DdsAddress, Writers] | None = None
        self._connected: set[str] = set()
        """Topics to which the vehicle subscribes."""
        self._lock = threading.Lock()
        self._opening = False
        self._start_opening()

    def use(self, address: DdsAddress) -> None:
        """Opens the topics again if the vehicle has other ones, or others with a known layout."""
        if address == self._address:
            return
        previous = self._formats
        self._address, self._formats = address, formats_of(address, TOPIC_TYPES)
        self._connected = {
            topic for topic in self._connected if previous.get(topic) == self._formats.get(topic)
        }
        self._start_opening()

    def send(self, messages: Sequence[Message], required: Iterable[str] = ()) -> None:
        """See `TopicSender`."""
        if self._opened is None:
            raise OSError("DDS is not open yet")
        address, writers = self._opened
        opened = self._formats if address is self._address else formats_of(address, TOPIC_TYPES)
        for topic in (*required, *(topic for topic, _ in messages)):
            if topic not in opened or opened[topic] != self._formats.get(topic):
                raise OSError(f"the vehicle has not confirmed the layout of {topic}")
            if topic not in self._connected:
                if not writers.connected(topic):
                    raise OSError(f"no vehicle subscribes to {topic} yet")
                self._connected.add(topic)
        for topic, data in [(topic, opened[topic].to_vehicle(data)) for topic, data in messages]:
            writers.send(topic, data)

    def _start_opening(self) -> None:
        with self._lock:
            if self._opening:
                return  # the thread opens the new address, too
            self._opening = True
        name = f"dds {self._address.namespace}"
        threading.Thread(target=self._open, name=name, daemon=True).start()

    def _open(self) -> None:
        try:
            # real-time priority is for sending setpoints only; DDS's own threads inherit this priority
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            from gcs_server.ros2.dds import open_topics

            while True:
                address = self._address
                sent = formats_of(address, TOPIC_TYPES).values()
                self._opened = address, open_topics(address, sent)[0]
                with self._lock:
                    if address is self._address:
                        self._opening = False
                        return
        except Exception:
            self._opening = False
            log.exception("setpoints cannot be sent over ROS 2 to %s", self._address.namespace)


class ModeTopics:
    """The topics over which modes are registered with one vehicle; implements `ModePort`. Until DDS is open,
    nothing is received, and nothing can be sent."""

    def __init__(self, address: DdsAddress) -> None:
        self._address = address
        self._formats = formats_of(address, {*WRITTEN, *READ_TYPES})
        self._topics: tuple[Writers, Readers] | None = None
        threading.Thread(target=self._open, name=f"dds modes {address.namespace}", daemon=True).start()

    def send(self, topic: str, data: bytes) -> None:
        """See `ModePort`."""
        if self._topics is None:
            raise OSError("DDS is not open yet")
        if topic not in self._formats:
            raise OSError(f"the vehicle has not confirmed the layout of {topic}")
        self._topics[0].send(topic, self._formats[topic].to_vehicle(data))

    def connected(self) -> bool:
        """See `ModePort`."""
        if self._topics is None or not self._formats.keys() >= {*CONNECTED_TO, *CONNECTED_FROM}:
            return False
        writers, readers = self._topics
        return all(map(writers.connected, CONNECTED_TO)) and all(map(readers.connected, CONNECTED_FROM))

    def take(self) -> list[tuple[str, bytes]]:
        """See `ModePort`. Messages of another layout than the vehicle has confirmed are omitted."""
        taken: list[tuple[str, bytes]] = []
        for topic, data in () if self._topics is None else self._topics[1].take():
            with contextlib.suppress(MalformedMessage):
                taken.append((topic, self._formats[topic].to_server(data)))
        return taken

    def _open(self) -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            from gcs_server.ros2.dds import open_topics

            sent = [each for topic, each in self._formats.items() if topic in WRITTEN]
            read = [(each, READ_DEPTH) for topic, each in self._formats.items() if topic in READ_TYPES]
            self._topics = open_topics(self._address, sent, read)
        except Exception:
            log.exception("modes cannot be registered over ROS 2 with %s", self._address.namespace)


class Ros2Senders:
    """The senders of all vehicles that are reached over ROS 2."""

    def __init__(self) -> None:
        self._senders: dict[DdsAddress, Ros2Sender] = {}
        """By the address without formats."""

    def sender_for(self, address: DdsAddress) -> Ros2Sender:
        """The sender for an address; the first call for an address starts to open DDS."""
        vehicle = replace(address, formats=())
        sender = self._senders.get(vehicle)
        if sender is None:
            sender = self._senders[vehicle] = Ros2Sender(address)
        sender.use(address)
        return sender

    def close_unused(self, used: Collection[DdsAddress]) -> None:
        """Closes the senders for all addresses that are not in `used`."""
        vehicles = {replace(address, formats=()) for address in used}
        self._senders = {key: sender for key, sender in self._senders.items() if key in vehicles}
