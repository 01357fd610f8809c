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
        self._portal_context: AbstractContextManager[BlockingPortal] = start_blocking_portal()
        self._running_portal: BlockingPortal | None = None

    def __enter__(self) -> Self:
        self._running_portal = self._portal_context.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._portal.call(self._leave)
        finally:
            self._portal_context.__exit__(None, None, None)

    @property
    def _portal(self) -> BlockingPortal:
        if self._running_portal is None:
            raise RuntimeError("Use the client in a block: with SyncGcs() as gcs: …")
        return self._running_portal


def iterate(portal: BlockingPortal, source: AsyncGenerator[T]) -> Generator[T]:
    """Iterates over an asynchronous generator, and always closes it at the end of the iteration."""

    async def next_item() -> T:
        return await anext(source, _END)

    try:
        while (item := portal.call(next_item)) is not _END:
            yield item
    finally:
        portal.call(source.aclose)
