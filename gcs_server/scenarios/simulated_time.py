"""Simulated time for asyncio: the event loop sets its clock to the next timer instead of waiting."""

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from typing import Any


class SimulatedTimeLoop(asyncio.SelectorEventLoop):
    """An event loop whose clock is set to the next timer when nothing else is ready."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.in_executor = False
        """Whether a function runs that would run in another thread."""
        selector = selectors.DefaultSelector()
        real_select = selector.select

        def select(timeout: float | None = None) -> Any:
            ready = real_select(0)
            if ready or timeout is None:
                return ready or real_select(1)  # waits for another thread or process
            self.now_s += timeout
            return ready

        selector.select = select  # type: ignore[method-assign]
        super().__init__(selector)

    def time(self) -> float:
        return self.now_s

    def run_in_executor(self, executor: Any, func: Any, *args: Any) -> Any:
        """Runs the function at once, because simulated time would advance while another thread works, by as
        much as the machine is busy."""
        future = self.create_future()
        self.in_executor = True
        try:
            future.set_result(func(*args))
        except Exception as error:
            future.set_exception(error)
        finally:
            self.in_executor = False
        return future


def run_on_simulated_time(scenario: Callable[[], Coroutine[Any, Any, Any]]) -> Any:
    """Runs a coroutine function on simulated time."""
    with asyncio.Runner(loop_factory=SimulatedTimeLoop) as runner:
        return runner.run(scenario())
