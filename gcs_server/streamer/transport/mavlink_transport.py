"""Packs setpoints as MAVLink messages and passes them to the vehicle's sender."""

from __future__ import annotations

from gcs_server.streamer.transport.mavlink import (
    MAVLINK_KINDS,
    MSG_COMMAND_LONG,
    Packed,
    encode,
    mode_command,
    with_time,
)
from gcs_server.streamer.transport.sender import PayloadSender
from gcs_server.streamer.values.outgoing import ModeRequest, Outgoing
from missions.setpoints import DirectSetpoint


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
