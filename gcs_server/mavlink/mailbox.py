"""Waits for messages. A waiter is registered before the request is sent, and ends with a reply or an
error."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

from gcs_server.errors import GcsError
from gcs_server.faults import FaultLog
from gcs_server.mavlink.codec import Frame
from gcs_server.mavlink.dialect import MAVLink_message

Reply = Any
"""A dialect message; its fields depend on the awaited id."""
Matches = Callable[[Reply], bool]


MAX_UNREAD = 4096
"""Maximum number of unread messages in one waiter; more than PX4's parameters in one burst."""


class Waiter:
    """A stream of awaited messages: `await next()` returns the matches in order.

    With `MAX_UNREAD` unread matches, further ones are dropped.
    """

    def __init__(self, msg_ids: frozenset[int], matches: Matches | None) -> None:
        self.msg_ids = msg_ids
        self._matches = matches
        self._queue: asyncio.Queue[MAVLink_message | GcsError] = asyncio.Queue()

    def take(self) -> Reply | None:
        """An unread match, or None; raises the same errors as `next`."""
        if self._queue.empty():
            return None
        item = self._queue.get_nowait()
        if isinstance(item, GcsError):
            self._queue.put_nowait(item)
            raise item
        return item

    async def next(self) -> Reply:
        """The next match.

        Raises:
            Disconnected: the vehicle or its link was lost.
        """
        item = await self._queue.get()
        if isinstance(item, GcsError):
            self._queue.put_nowait(item)
            raise item
        return item

    def offer(self, message: MAVLink_message) -> None:
        """Adds a message if it matches; called by the mailbox."""
        if self._queue.qsize() < MAX_UNREAD and (self._matches is None or self._matches(message)):
            self._queue.put_nowait(message)

    def fail(self, error: GcsError) -> None:
        """Called by the mailbox: further calls of `next()` raise this error."""
        self._queue.put_nowait(error)


class Mailbox:
    """Delivers replies to the tasks that wait for them; a frame is decoded only if a task waits for it."""

    def __init__(self, decode: Callable[[Frame], MAVLink_message | None]) -> None:
        self._decode = decode
        self._waiters: list[Waiter] = []
        self._faults = FaultLog("mailbox")
        self.awaited: frozenset[int] = frozenset()
        """Awaited message ids; `deliver` ignores others."""

    @contextmanager
    def expect(self, *msg_ids: int, matches: Matches | None = None) -> Generator[Waiter]:
        """Registers a waiter for messages of these ids; send the request inside the `with` block."""
        waiter = Waiter(frozenset(msg_ids), matches)
        self._waiters.append(waiter)
        self._refresh()
        try:
            yield waiter
        finally:
            self._waiters.remove(waiter)
            self._refresh()

    def deliver(self, frame: Frame) -> None:
        """Delivers a frame to its waiters; cheap if there are none."""
        if frame.msg_id not in self.awaited:
            return
        message = self._decode(frame)
        if message is None:
            return
        for waiter in tuple(self._waiters):
            if frame.msg_id in waiter.msg_ids:
                try:  # a fault in one waiter's condition does not affect the other waiters
                    waiter.offer(message)
                except Exception as error:
                    self._faults.add(error, f"matching {message.get_type()}")

    def fail_all(self, error: GcsError) -> None:
        """Ends all waiters immediately with this error."""
        for waiter in tuple(self._waiters):
            waiter.fail(error)

    def _refresh(self) -> None:
        self.awaited = frozenset[int]().union(*(w.msg_ids for w in self._waiters))
