"""The vehicle's console (PX4's shell) over SERIAL_CONTROL.

The protocol has no acknowledgement and no numbers: what is lost stays lost. PX4 echoes what it received, so
a line that takes several messages is sent piece by piece, each after the echo of the one before: no line is
ever run without its beginning. A line is never sent twice. Output that is lost on the way is missing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from gcs_server.errors import GcsError, InvalidRequest, NoReply, Refused
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.mailbox import Reply
from gcs_server.vehicle.services.port import VehiclePort

PIECE_BYTES: Final = 70
"""Length of SERIAL_CONTROL.data."""
MAX_LINE_BYTES: Final = 250
"""Longer lines are refused; PX4's own limit on small boards is lower than the 1000 of its simulation."""
ECHO_S: Final = 2.0
"""Maximum wait for the echo of a piece [s]."""
PROMPTS: Final = ("pxh> ", "nsh> ")
"""The console's prompt in simulation, and on hardware."""
KEPT_CHARACTERS: Final = 100_000
"""Output that is kept for clients that ask later."""
SHOWN_CHARACTERS: Final = 4_000
"""Newest output in the telemetry."""
IDLE_S: Final = 120.0
"""Without a line, or a client that reads, for this time the console is closed [s]."""
CLOSINGS: Final = 3
"""A closing message has no answer, so it is sent this often."""
OPEN: Final = d.SERIAL_CONTROL_FLAG_RESPOND | d.SERIAL_CONTROL_FLAG_EXCLUSIVE
SHELL: Final = d.SERIAL_CONTROL_DEV_SHELL


@dataclass(frozen=True, slots=True)
class ShellOutput:
    """Output of the vehicle's console."""

    open: bool
    """Whether this server has the console open."""
    end: int
    """Characters of output since the vehicle was found; the next output begins there."""
    text: str
    """Output that ends at `end`."""


class ShellService:
    """The console of one vehicle; all clients share it, and one line is sent at a time."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._lock = asyncio.Lock()
        self._text, self._end = "", 0
        self._news = asyncio.Event()
        self._open, self._used_s = False, 0.0

    def output(self, after: int = 0) -> ShellOutput:
        """The kept output after a number of characters; reading keeps the console open.

        Args:
            after: `end` of the output that the caller has; 0: all that is kept.
        """
        self._used_s = self._vehicle.clock.monotonic_s()
        start = self._end - len(self._text)
        return ShellOutput(self._open, self._end, self._text[max(0, after - start) :])

    def newest(self) -> ShellOutput:
        """The newest output, for the telemetry."""
        return self.output(self._end - SHOWN_CHARACTERS)

    async def run(self, line: str, *, while_armed: bool = False, wait_s: float = 2.0) -> tuple[str, bool]:
        """Sends a line; returns its output, and whether the prompt has come back within the wait.

        Args:
            line: one line without its end.
            while_armed: whether it is also sent while the vehicle is armed.
            wait_s: maximum wait for the prompt [s].

        Raises:
            InvalidRequest: the line is too long, or has characters that are not printable.
            Refused: the vehicle is armed, or its links carry no console.
            NoReply: the vehicle did not echo the line, so it may not have been run.
            Disconnected: the vehicle was lost.
        """
        pieces = _pieces(line)
        async with self._lock:
            self._require(while_armed)
            await self._ensure_open()
            start, echo = self._end, ""
            for piece in pieces:
                self._require(while_armed)
                self._send(piece.encode(), OPEN)
                echo += piece
                if not await self._wait(partial(self._has_echoed, echo, start), ECHO_S):
                    self._close()
                    raise self._no_echo(line, is_complete=piece is pieces[-1])
            complete = await self._wait(lambda: self._since(start).endswith(PROMPTS), wait_s)
            return self._since(start), complete

    def _has_echoed(self, text: str, start: int) -> bool:
        return text in self._since(start)

    def _require(self, while_armed: bool) -> None:
        vehicle = self._vehicle
        vehicle.require("shell")
        if vehicle.flight_state.armed and not while_armed:
            raise Refused(
                f"Vehicle {vehicle.id} is armed, and a line of its console acts at once, unchecked.",
                remedy="Send it with while_armed if that is meant.",
            )

    async def _ensure_open(self) -> None:
        clock = self._vehicle.clock
        self._used_s = clock.monotonic_s()
        if not self._open:
            self._open = True
            self._vehicle.in_background("console", self._receive())
            await clock.sleep(0.0)  # the task waits for the answer before the line is sent

    async def _receive(self) -> None:
        """Keeps the output until nobody uses the console any more."""
        vehicle = self._vehicle

        def is_output(message: Reply) -> bool:
            return message.get_srcSystem() == vehicle.identity.system_id and message.device == SHELL

        with vehicle.mailbox.expect(d.MAVLINK_MSG_ID_SERIAL_CONTROL, matches=is_output) as waiter:
            try:
                while self._open and vehicle.clock.monotonic_s() - self._used_s < IDLE_S:
                    try:
                        async with asyncio.timeout(1.0):
                            message = await waiter.next()
                    except TimeoutError:
                        continue
                    data = bytes(message.data[: min(message.count, PIECE_BYTES)])
                    self._add(data.decode("utf-8", "replace").replace("\r", ""))
            except GcsError:  # the vehicle is lost
                self._open = False
        if self._open:
            self._close()

    def _add(self, text: str) -> None:
        self._text = (self._text + text)[-KEPT_CHARACTERS:]
        self._end += len(text)
        self._news.set()

    def _since(self, start: int) -> str:
        return self._text[max(0, start - (self._end - len(self._text))) :]

    async def _wait(self, condition: Callable[[], bool], at_most_s: float) -> bool:
        """Waits for output until a condition is true; returns whether it is."""
        end_s = self._vehicle.clock.monotonic_s() + at_most_s
        while not condition():
            self._news.clear()
            left_s = end_s - self._vehicle.clock.monotonic_s()
            if left_s <= 0 or not self._open:
                return False
            try:
                async with asyncio.timeout(min(left_s, 0.2)):
                    await self._news.wait()
            except TimeoutError:
                continue
        return True

    def _close(self) -> None:
        """Closes the console; PX4 forgets what was typed."""
        self._open = False
        for _ in range(CLOSINGS):
            self._send(b"", 0)

    def _send(self, data: bytes, flags: int) -> None:
        padded = list(data.ljust(PIECE_BYTES, b"\0"))
        identity = self._vehicle.identity
        self._vehicle.send(
            d.MAVLink_serial_control_message(
                SHELL, flags, 0, 0, len(data), padded, identity.system_id, identity.component_id
            )
        )

    def _no_echo(self, line: str, *, is_complete: bool) -> NoReply:
        what = "it may or may not have been run" if is_complete else "it was not run"
        return NoReply(
            f"Vehicle {self._vehicle.id} did not echo {line[:60]!r}: {what}.",
            deadline_s=ECHO_S,
            remedy="Look at the state it should have changed, then send it again.",
        )


def _pieces(line: str) -> list[str]:
    """The messages of a line; the last one ends it.

    Raises:
        InvalidRequest: see `ShellService.run`.
    """
    if not line.isascii() or not (line.isprintable()):
        raise InvalidRequest("line", "A line has printable ASCII characters only, without a line end.")
    if len(line) > MAX_LINE_BYTES:
        raise InvalidRequest("line", f"A line has at most {MAX_LINE_BYTES} characters, not {len(line)}.")
    text = f"{line}\n"
    return [text[start : start + PIECE_BYTES] for start in range(0, len(text), PIECE_BYTES)]
