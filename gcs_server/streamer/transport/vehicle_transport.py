"""Sends a setpoint over the link on which the vehicle is reached now, MAVLink or ROS 2."""

from __future__ import annotations

from collections.abc import Callable

from gcs_server.streamer.transport.mavlink_transport import MavlinkTransport
from gcs_server.streamer.transport.ros2 import Ros2Transport, TopicSender
from gcs_server.streamer.transport.sender import PayloadSender
from gcs_server.streamer.values.outgoing import Outgoing, SetpointDue
from gcs_server.streamer.values.stream_request import OFFBOARD
from missions.setpoints import DirectSetpoint

Topics = Callable[[], TopicSender | None]
"""The vehicle's ROS 2 topics; None while the vehicle is reached over MAVLink."""


def no_topics() -> None:
    """`Topics` of a vehicle that is reached over MAVLink only."""
    return


class VehicleTransport:
    """Sends to one vehicle. If the vehicle's link changes, the setpoint is packed again for the new link.

    Args:
        sender: sends MAVLink payloads to the vehicle.
        target: the vehicle's system id and its autopilot's component id.
        topics: see `Topics`.
        ros2: packs ROS 2 messages.
    """

    def __init__(
        self, sender: PayloadSender, target: tuple[int, int], topics: Topics, ros2: Ros2Transport
    ) -> None:
        self.mavlink = MavlinkTransport(sender, target)
        self._ros2, self.topics = ros2, topics
        self._setpoint: DirectSetpoint | None = None
        self._packed_for: MavlinkTransport | Ros2Transport | None = None

    def load(self, setpoint: DirectSetpoint) -> None:
        """See `SetpointLoader`."""
        self._setpoint, self._packed_for = setpoint, None
        self._pack(self.mavlink if self.topics() is None else self._ros2)

    def send(self, outgoing: Outgoing) -> bool:
        """Sends a setpoint or mode request; returns False if the link cannot send now or cannot carry the
        setpoint."""
        topics = self.topics()
        if topics is None and isinstance(outgoing, SetpointDue) and outgoing.mode != OFFBOARD:
            return False  # MAVLink setpoints are for Offboard only
        try:
            self._pack(self.mavlink if topics is None else self._ros2)
        except ValueError:
            return False
        return self.mavlink.send(outgoing) if topics is None else self._ros2.send(outgoing, topics)

    def _pack(self, transport: MavlinkTransport | Ros2Transport) -> None:
        if self._packed_for is not transport and self._setpoint is not None:
            transport.load(self._setpoint)
            self._packed_for = transport
