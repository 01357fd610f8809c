"""How much work a call does, counted in lines run: the same on any machine, however busy."""

import sys
from collections.abc import Callable
from typing import Any


def lines_run(work: Callable[[], object], most: int = 10_000_000) -> int:
    """Lines of Python that `work` runs, in all functions that it calls.

    Raises:
        AssertionError: more than `most`, so that a test of endless work ends.
    """
    count = 0

    def trace(_frame: Any, event: str, _argument: object) -> Any:
        nonlocal count
        if event == "line":
            count += 1
            if count > most:
                raise AssertionError(f"more than {most} lines")
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return count
