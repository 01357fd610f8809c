"""The vehicle's console over MAVLink: SERIAL_CONTROL with device SHELL, at most one message per step.

As in PX4, only the flag RESPOND keeps the console open; timeout, baud rate and the flag EXCLUSIVE are
ignored.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link

SHELL = 10
"""SERIAL_CONTROL_DEV."""
REPLY, RESPOND = 1, 2
"""SERIAL_CONTROL_FLAG."""
PART_BYTES = 70
"""Length of SERIAL_CONTROL.data."""
MAX_UNSENT_BYTES = 200_000
"""Maximum number of output bytes that wait to be sent; further output is discarded."""


class Terminal(Protocol):
    """A console, independent of its transport."""

    @property
    def busy(self) -> bool:
        """Whether a command is still running."""
        ...

    def receive_text(self, text: str) -> str:
        """Processes received characters; returns the output."""
        ...

    def step(self) -> str:
        """New output of the running command."""
        ...


@dataclass(slots=True)
class _Session:
    """The console session of one link."""

    terminal: Terminal
    client: tuple[int, int]
    unsent: bytearray = field(default_factory=bytearray)


class ShellService:
    """One console for each link, opened by the first bytes that a client sends."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.console: Callable[[], Terminal] | None = None
        """Creates a terminal for a link; None: the vehicle has no console."""
        self._sessions: dict[str, _Session] = {}
        self.handlers = {"SERIAL_CONTROL": self.receive}

    @property
    def busy(self) -> bool:
        """Whether a console is open."""
        return bool(self._sessions)

    def receive(self, link: Link, message: Message) -> None:
        """Passes received characters to the console."""
        values = message.values
        if values["target_system"] not in (0, self._context.system_id) or values["target_component"] > 1:
            return
        if message.device != SHELL or self.console is None:
            return
        session = self._sessions.get(link.name)
        count = min(message.count, PART_BYTES)
        if count:
            if session is None:
                session = self._sessions[link.name] = _Session(self.console(), message.sender)
            session.client = message.sender
            text = bytes(message.data[:count]).decode("utf-8", "replace")
            self._queue_output(session, session.terminal.receive_text(text))
        if not message.flags & RESPOND:
            self._sessions.pop(link.name, None)

    def step(self) -> None:
        """Sends pending console output."""
        open_links = {link.name for link in self._context.links}
        for closed in self._sessions.keys() - open_links:
            del self._sessions[closed]
        for link in self._context.links:
            session = self._sessions.get(link.name)
            if session is None:
                continue
            if session.terminal.busy:
                self._queue_output(session, session.terminal.step())
            if session.unsent:
                part = bytes(session.unsent[:PART_BYTES])
                del session.unsent[:PART_BYTES]
                link.send(
                    "SERIAL_CONTROL", device=SHELL, flags=REPLY, count=len(part), data=part,
                    target_system=session.client[0], target_component=session.client[1],
                )  # fmt: skip

    @staticmethod
    def _queue_output(session: _Session, text: str) -> None:
        free_bytes = MAX_UNSENT_BYTES - len(session.unsent)
        session.unsent += text.encode("utf-8")[: max(0, free_bytes)]
