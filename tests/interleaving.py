"""A scheduler that decides the order at every await point of one piece of work.

The work and all tasks that it starts are marked by a context variable. The event loop counts their steps; a
step ends at an await point. Before one step it runs another piece of work (`at_step`), whose first step runs
first. It then delays each further step of the marked work as its seed decides.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable, Coroutine
from contextvars import Context, ContextVar, copy_context
from typing import Any

from gcs_server.scenarios.simulated_time import SimulatedTimeLoop

_observed: ContextVar[bool] = ContextVar("observed", default=False)
MAX_HELD_S = 3.0
"""Time after which held steps run in any case, because the other work may wait for them."""


class InterleavingLoop(SimulatedTimeLoop):
    """An event loop on simulated time that observes one piece of work."""

    def __init__(self) -> None:
        super().__init__()
        self.steps = 0
        """Steps of the observed work so far."""
        self._at_step: tuple[int, Callable[[], None]] | None = None
        self._random: random.Random | None = None
        self._held: list[tuple[Any, tuple[Any, ...], Context]] | None = None

    def observe(self, work: Coroutine[Any, Any, Any]) -> asyncio.Task[Any]:
        """Starts the observed work."""
        context = copy_context()
        context.run(_observed.set, True)
        return context.run(self.create_task, work)

    def at_step(self, number: int, action: Callable[[], None], seed: int) -> None:
        """Runs `action`, which may start tasks, directly before a step of the observed work."""
        self._at_step, self._random = (number, action), random.Random(seed)

    def release(self) -> None:
        """Runs the held steps, and holds no more."""
        held, self._held, self._random = self._held, None, None
        for callback, args, context in held or ():
            super().call_soon(self._step, callback, args, context=context)

    def call_soon(self, callback: Any, *args: Any, context: Context | None = None) -> asyncio.Handle:
        """See the base class; steps of the observed work are counted, and may be delayed."""
        is_step = isinstance(getattr(callback, "__self__", None), asyncio.Task)
        if not is_step or not (context or copy_context()).get(_observed, False):
            return super().call_soon(callback, *args, context=context)
        return super().call_soon(self._step, callback, args, context=context)

    def _step(self, callback: Any, args: tuple[Any, ...]) -> None:
        if self._held is not None:
            self._held.append((callback, args, copy_context()))
            return
        self.steps += 1
        if self._at_step is not None and self.steps == self._at_step[0]:
            _, action = self._at_step
            self._at_step = None
            Context().run(action)
            self._held = [(callback, args, copy_context())]
            assert self._random is not None
            delay_s = self._random.choice((0.0, 0.0, 0.01, 0.1, MAX_HELD_S))
            Context().run(self.call_later, delay_s, self.release)
            return
        callback(*args)


def run_interleaved(scenario: Callable[[InterleavingLoop], Coroutine[Any, Any, Any]]) -> Any:
    """Runs a coroutine function in such a loop."""
    with asyncio.Runner(loop_factory=InterleavingLoop) as runner:
        loop = runner.get_loop()
        assert isinstance(loop, InterleavingLoop)
        return runner.run(scenario(loop))
