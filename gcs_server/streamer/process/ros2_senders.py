"""The streams' process on ROS 2: one DDS participant for each domain, opened by a thread.

Opening takes some tenths of a second, in which the setpoints of other vehicles continue.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Collection
from typing import TYPE_CHECKING

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.message_types import MESSAGES
from gcs_server.streamer.transport.ros2 import TOPIC_TYPES

if TYPE_CHECKING:
    from gcs_server.ros2.dds import Writers

log = logging.getLogger(__name__)


class Ros2Sender:
    """The topics of one vehicle. Sends nothing until DDS is open and the vehicle is connected."""

    def __init__(self, address: DdsAddress) -> None:
        self._address = address
        self._writers: Writers | None = None
        self._connected = False
        threading.Thread(target=self._open, name=f"dds {address.namespace}", daemon=True).start()

    def send(self, topic: str, data: bytes) -> None:
        """See `TopicSender`."""
        writers = self._writers
        if writers is None:
            raise OSError("DDS is not open yet")
        if not self._connected:
            self._connected = writers.connected(topic)
            if not self._connected:
                raise OSError(f"no vehicle subscribes to {topic} yet")
        writers.send(topic, data)

    def _open(self) -> None:
        try:
            # without real-time priority, which is for setpoints; DDS's own threads inherit this
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            from gcs_server.ros2.dds import open_writers

            types = {topic: MESSAGES[kind] for topic, kind in TOPIC_TYPES.items()}
            self._writers = open_writers(self._address, types)
        except Exception:
            log.exception("setpoints cannot be sent over ROS 2 to %s", self._address)


class Ros2Senders:
    """The senders of all vehicles that are reached over ROS 2."""

    def __init__(self) -> None:
        self._senders: dict[DdsAddress, Ros2Sender] = {}

    def at(self, address: DdsAddress) -> Ros2Sender:
        """The sender for an address; the first call opens it."""
        if address not in self._senders:
            self._senders[address] = Ros2Sender(address)
        return self._senders[address]

    def keep(self, used: Collection[DdsAddress]) -> None:
        """Closes all others."""
        self._senders = {address: sender for address, sender in self._senders.items() if address in used}
