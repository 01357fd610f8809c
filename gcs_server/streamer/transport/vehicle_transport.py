"""Sends a setpoint over the link on which the vehicle is reached now, MAVLink or ROS 2."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from gcs_server.links.base import Peer
from gcs_server.streamer.transport.mavlink import (
    MAVLINK_KINDS,
    MSG_COMMAND_LONG,
    Packed,
    encode,
    mode_command,
    with_time,
)
from gcs_server.streamer.transport.ros2 import Ros2Transport, TopicSender
from gcs_server.streamer.values.stream_request import OFFBOARD, ModeRequest, Outgoing, SetpointDue
from missions.setpoints import DirectSetpoint

if TYPE_CHECKING:  # the stream process has no connections
    from gcs_server.mavlink.connection import Connection


class SendPath(Protocol):
    """Link and peer of a vehicle."""

    @property
    def connection(self) -> Connection: ...

    @property
    def peer(self) -> Peer: ...


class PayloadSender(Protocol):
    """Sends payloads to one vehicle; may be called from any thread."""

    def send_payload(self, msg_id: int, payload: bytes, *, created_s: float | None = None) -> bool:
        """Sends a payload; returns False if nothing was sent. `created_s` is the monotonic time at which
        the payload was created; a payload that is too old is not sent."""
        ...

    def send_path(self) -> SendPath | None:
        """Current link and peer; None: the vehicle has no link."""
        ...


class NoSender(PayloadSender):
    """The sender of a removed vehicle, which sends nothing."""

    def send_payload(self, msg_id: int, payload: bytes, *, created_s: float | None = None) -> bool:
        return False

    def send_path(self) -> None:
        return None


class MavlinkTransport:
    """Sends to one vehicle.

    Args:
        sender: sends payloads to the vehicle.
        target: the vehicle's system id and its autopilot's component id.
    """

    def __init__(self, sender: PayloadSender, target: tuple[int, int]) -> None:
        self.sender = sender
        self._target = target
        self._packed: Packed = (0, b"")

    def load(self, setpoint: DirectSetpoint) -> None:
        """See `SetpointLoader`."""
        if setpoint.type not in MAVLINK_KINDS:
            raise ValueError(f"no MAVLink message carries {setpoint.type}")
        self._packed = encode(setpoint, self._target)

    def send(self, outgoing: Outgoing) -> bool:
        """Sends a setpoint or mode request; returns False if nothing was sent."""
        if isinstance(outgoing, ModeRequest):
            payload = mode_command(outgoing.mode, self._target, outgoing.attempt)
            return self.sender.send_payload(MSG_COMMAND_LONG, payload)
        msg_id, payload = self._packed
        return self.sender.send_payload(msg_id, with_time(payload, outgoing.now_s))


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
