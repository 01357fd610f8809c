"""Runs the asynchronous client for the blocking client, on an event loop in a separate thread."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import AbstractContextManager
from typing import Any, Self, TypeVar

from anyio.from_thread import BlockingPortal, start_blocking_portal

T = TypeVar("T")
_END: Any = object()


class LoopThread:
    """The thread with the event loop; it runs during a `with` block.

    Args:
        leave: called in the event loop at the end of the block.
    """

    def __init__(self, leave: Callable[..., Any]) -> None:
        self._leave = leave
        self._starting: AbstractContextManager[BlockingPortal] = start_blocking_portal()
        self._started: BlockingPortal | None = None

    def __enter__(self) -> Self:
        self._started = self._starting.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._portal.call(self._leave)
        finally:
            self._starting.__exit__(None, None, None)

    @property
    def _portal(self) -> BlockingPortal:
        if self._started is None:
            raise RuntimeError("Use the client in a block: with SyncGcs() as gcs: …")
        return self._started


def iterate(portal: BlockingPortal, source: AsyncGenerator[T]) -> Generator[T]:
    """Iterates over an asynchronous generator, and always closes it at the end of the iteration."""

    async def next_item() -> T:
        return await anext(source, _END)

    try:
        while (found := portal.call(next_item)) is not _END:
            yield found
    finally:
        portal.call(source.aclose)
