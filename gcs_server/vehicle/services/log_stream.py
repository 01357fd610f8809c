"""Receives the vehicle's log while it is written: MAV_CMD_LOGGING_START, LOGGING_DATA and LOGGING_ACK.

PX4 sends the definitions one piece at a time, each up to 50 times until it is acknowledged, then the samples,
which it sends once. It streams to one client at a time, does not acknowledge MAV_CMD_LOGGING_STOP, and sends
nothing after a restart.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gcs_server.errors import NoReply, Refused, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.mailbox import Reply, Waiter
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import RESULT_TEXT, Request
from gcs_server.vehicle.services.ulog_pieces import UlogPieces

ATTEMPTS = 5
"""Requests to start or stop; one a second."""
SILENCE_S = 1.0
STALLED_S = 10.0
"""A stream of which nothing arrives for this time, while the vehicle is connected, has ended [s]."""
_DATA = (d.MAVLINK_MSG_ID_LOGGING_DATA, d.MAVLINK_MSG_ID_LOGGING_DATA_ACKED)

Write = Callable[[bytes], None]


class LogStreamService:
    """The log stream of one vehicle."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle

    async def start(self, pieces: UlogPieces, write: Write) -> None:
        """Asks the vehicle to stream its log, and waits for the begin of it.

        Raises:
            Refused: it streams already, to another client or from before; or its links carry no files.
            Rejected: it cannot stream.
            NoReply: it did not answer, or sent nothing.
            Disconnected: the vehicle was lost.
        """
        vehicle = self._vehicle
        vehicle.require("files")
        answered = False
        with self._expect(*_DATA, d.MAVLINK_MSG_ID_COMMAND_ACK) as waiter:
            for attempt in range(ATTEMPTS):
                self._command(d.MAV_CMD_LOGGING_START, attempt)
                while not pieces.began and (message := await _next(waiter)) is not None:
                    if message.get_msgId() == d.MAVLINK_MSG_ID_COMMAND_ACK:
                        answered = self._is_accepted(message, attempt) or answered
                    else:
                        self._take(message, pieces, write)
                if pieces.began:
                    return
        what = "accepted to stream its log, and sent nothing" if answered else "did not answer"
        raise NoReply(
            f"Vehicle {vehicle.id} {what}.",
            deadline_s=ATTEMPTS * SILENCE_S,
            remedy="Its logger must run with MAVLink as a target, and its link carry 5 kB/s or more.",
        )

    async def receive(self, pieces: UlogPieces, write: Write, should_stop: Callable[[], bool]) -> str | None:
        """Receives until the stream ends.

        Args:
            pieces: what `start` has begun.
            write: gets what is complete.
            should_stop: asked with each message, and each second.

        Returns:
            Why the vehicle ended it; None: `should_stop` did.

        Raises:
            Disconnected: the vehicle was lost; call it again when it is back.
        """
        clock = self._vehicle.clock
        last_s = clock.monotonic_s()
        with self._expect(*_DATA) as waiter:
            while not should_stop():
                message = await _next(waiter)
                now_s = clock.monotonic_s()
                if message is not None:
                    self._take(message, pieces, write)
                    last_s = now_s
                    if pieces.begins_again:
                        return "The vehicle has begun another log."
                elif now_s - last_s >= STALLED_S:
                    return "The vehicle sends no more: it has restarted, or another client has stopped it."
        return None

    async def stop(self, pieces: UlogPieces | None = None, write: Write = lambda _: None) -> None:
        """Tells the vehicle to stop, until nothing arrives any more.

        Raises:
            NoReply: it goes on sending.
            Disconnected: the vehicle was lost.
        """
        with self._expect(*_DATA) as waiter:
            for attempt in range(ATTEMPTS):
                self._command(d.MAV_CMD_LOGGING_STOP, attempt)
                end_s = self._vehicle.clock.monotonic_s() + SILENCE_S
                while (message := await _next(waiter)) is not None:
                    if pieces is not None:
                        self._take(message, pieces, write)
                    if self._vehicle.clock.monotonic_s() > end_s:
                        break
                else:
                    return
        raise NoReply(
            f"Vehicle {self._vehicle.id} was told {ATTEMPTS} times to stop its log stream, and goes on.",
            deadline_s=ATTEMPTS * SILENCE_S,
            remedy="Try again; a restart of the vehicle ends it, too.",
        )

    def stop_soon(self) -> None:
        """Tells the vehicle to stop, and waits for nothing."""
        for attempt in range(3):
            self._command(d.MAV_CMD_LOGGING_STOP, attempt)

    def _take(self, message: Reply, pieces: UlogPieces, write: Write) -> None:
        data = bytes(message.data[: message.length])
        if complete := pieces.add(
            message.sequence, message.first_message_offset, data, self._vehicle.clock.monotonic_s()
        ):
            write(complete)
        if message.get_msgId() == d.MAVLINK_MSG_ID_LOGGING_DATA_ACKED and pieces.began:
            identity = self._vehicle.identity
            self._vehicle.send(
                d.MAVLink_logging_ack_message(identity.system_id, identity.component_id, message.sequence)
            )

    def _is_accepted(self, ack: Reply, attempt: int) -> bool:
        """Whether an acknowledgement accepts the start; a refusal of a repeated request is that of a stream
        that begins.

        Raises:
            Refused: the vehicle streams already.
            Rejected: it refuses.
        """
        if ack.command != d.MAV_CMD_LOGGING_START:
            return False
        if ack.result == d.MAV_RESULT_ACCEPTED:
            return True
        if ack.result == d.MAV_RESULT_TEMPORARILY_REJECTED:
            if attempt:
                return True
            raise Refused(
                f"Vehicle {self._vehicle.id} does not stream its log: it streams already, to another client "
                "or from before, or its logger does not write to MAVLink.",
                remedy="Stop that stream, which ends it for its client, too; then start again.",
            )
        reason = RESULT_TEXT.get(ack.result, f"result {ack.result}")
        raise Rejected(
            f"Vehicle {self._vehicle.id} does not stream its log: {reason}.", mav_result=ack.result
        )

    def _command(self, command: int, attempt: int) -> None:
        identity = self._vehicle.identity
        request = Request(command, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        self._vehicle.send(request.message(identity.system_id, identity.component_id, attempt, False))

    def _expect(self, *msg_ids: int):  # noqa: ANN202 the mailbox's context manager
        identity = self._vehicle.identity
        autopilot = (identity.system_id, identity.component_id)
        return self._vehicle.mailbox.expect(
            *msg_ids,
            matches=lambda message: (message.get_srcSystem(), message.get_srcComponent()) == autopilot,
        )


async def _next(waiter: Waiter) -> Reply | None:
    """The next message; None after a silence. Other tasks run between messages that have arrived already."""
    await asyncio.sleep(0)
    try:
        async with asyncio.timeout(SILENCE_S):
            return await waiter.next()
    except TimeoutError:
        return None
