"""Counts the lines of Python that a call executes: a measure of work that does not depend on the machine's
load."""

import sys
from collections.abc import Callable
from typing import Any


def count_executed_lines(work: Callable[[], object], max_lines: int = 10_000_000) -> int:
    """Number of lines of Python that `work` executes, including the functions that it calls.

    Raises:
        AssertionError: more than `max_lines` lines; this also stops work that would not end.
    """
    count = 0

    def trace(_frame: Any, event: str, _argument: object) -> Any:
        nonlocal count
        if event == "line":
            count += 1
            if count > max_lines:
                raise AssertionError(f"more than {max_lines} lines")
        return trace

    previous_trace = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(previous_trace)
    return count
