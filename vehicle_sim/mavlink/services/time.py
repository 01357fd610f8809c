"""TIMESYNC and PING, which measure the offset between two clocks and the round-trip time."""

from __future__ import annotations

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link


class TimeService:
    """Sends TIMESYNC and PING requests, and replies to received requests."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.handlers = {"TIMESYNC": self.timesync, "PING": self.ping}

    def timesync(self, link: Link, message: Message) -> None:
        """Replies to a request (tc1 = 0) with the vehicle's time [ns]."""
        if message.tc1 == 0:
            link.send(
                "TIMESYNC", tc1=self._context.view.time_boot_us() * 1000, ts1=message.ts1,
                target_system=message.system_id, target_component=message.component_id,
            )  # fmt: skip

    def ping(self, link: Link, message: Message) -> None:
        """Replies to a ping request."""
        if message.target_system == 0 and message.target_component == 0:
            link.send(
                "PING", time_usec=message.time_usec, seq=message.seq, target_system=message.system_id,
                target_component=message.component_id,
            )  # fmt: skip

    def send_timesync(self, link: Link) -> None:
        """Sends a TIMESYNC request."""
        link.send("TIMESYNC", ts1=self._context.view.time_boot_us() * 1000)

    def send_ping(self, link: Link) -> None:
        """Sends a ping request."""
        link.send("PING", time_usec=self._context.view.time_boot_us(), seq=link.ping_sequence)
        link.ping_sequence += 1
