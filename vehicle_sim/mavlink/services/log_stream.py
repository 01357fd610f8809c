"""Streams the log over MAVLink: MAV_CMD_LOGGING_START and _STOP, LOGGING_DATA and LOGGING_ACK.

As in PX4, one client at a time gets it, and stopping is not acknowledged.
"""

from __future__ import annotations

from vehicle_sim.commands.command import ACCEPTED, TEMPORARILY_REJECTED, UNSUPPORTED, Command
from vehicle_sim.logger.logger import Logger
from vehicle_sim.logger.stream import PIECE_BYTES, UlogStream
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link

LOGGING_START, LOGGING_STOP = 2510, 2511


class LogStreamService:
    """The log stream of one vehicle."""

    def __init__(self, context: Context, logger: Logger) -> None:
        self._context, self._logger = context, logger
        self._stream: UlogStream | None = None
        self._link, self._client = "", (0, 0)
        self.handlers = {"LOGGING_ACK": self.acknowledge}
        self.commands = {LOGGING_START: self.start, LOGGING_STOP: self.stop}

    @property
    def busy(self) -> bool:
        """Whether a client gets the log."""
        return self._stream is not None

    def start(self, command: Command) -> int | None:
        """Starts the stream to the sender."""
        if round(command.p1) != 0:
            return UNSUPPORTED
        if self._stream is not None:
            return TEMPORARILY_REJECTED
        if not self._logger.can_log:
            return ACCEPTED  # as a PX4 whose logger has nothing to send
        self._link, self._client = command.link, command.sender
        self._stream = self._logger.start_stream()
        return ACCEPTED

    def stop(self, command: Command) -> int | None:
        """Ends the stream, whoever gets it."""
        self._end()
        return None

    def acknowledge(self, link: Link, message: Message) -> None:
        """The client has received a piece."""
        if self._context.addresses_autopilot(message) and self._stream is not None:
            self._stream.acknowledge(message.sequence)

    def step(self) -> None:
        """Sends what is due."""
        if self._stream is None:
            return
        link = next((each for each in self._context.links if each.name == self._link), None)
        pieces = self._stream.due(self._context.view.time_boot_us())
        if link is None or self._stream.ended:
            self._end()
            return
        for piece in pieces:
            link.send(
                "LOGGING_DATA_ACKED" if piece.acked else "LOGGING_DATA",
                target_system=self._client[0], target_component=self._client[1],
                sequence=piece.sequence, length=len(piece.data),
                first_message_offset=piece.first_message_offset,
                data=piece.data.ljust(PIECE_BYTES, b"\0"),
            )  # fmt: skip

    def _end(self) -> None:
        if self._stream is not None:
            self._stream = None
            self._logger.stop_stream()
