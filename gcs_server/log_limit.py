"""Limits repeated log lines: logs a few lines from the same source line, then only their number."""

from __future__ import annotations

import logging
from collections.abc import Callable

LINES_PER_PERIOD = 5
PERIOD_S = 10.0
MAX_LINE_LENGTH = 4000
MAX_SOURCE_LINES = 1000


class LogLimit(logging.Filter):
    """Passes `LINES_PER_PERIOD` log lines of each source line per `PERIOD_S`.

    Args:
        monotonic_s: returns the time [s].
    """

    def __init__(self, monotonic_s: Callable[[], float]) -> None:
        super().__init__()
        self._monotonic_s = monotonic_s
        self._source_lines: dict[tuple[str, int, str], tuple[float, int]] = {}
        """Start of the period and number of lines since then, by file, line and error."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether this line is written."""
        now_s = self._monotonic_s()
        error = record.exc_info[0].__name__ if record.exc_info and record.exc_info[0] else ""
        source_line = (record.pathname, record.lineno, error)
        since_s, count = self._source_lines.get(source_line, (now_s, 0))
        if now_s - since_s >= PERIOD_S:
            if count > LINES_PER_PERIOD:
                excess = count - LINES_PER_PERIOD
                record.msg = f"{record.getMessage()} ({excess} more such lines since the last one)"
                record.args = ()
            since_s, count = now_s, 0
        if len(self._source_lines) >= MAX_SOURCE_LINES and source_line not in self._source_lines:
            self._source_lines.clear()
        self._source_lines[source_line] = (since_s, count + 1)
        if count >= LINES_PER_PERIOD:
            return False
        text = record.getMessage()
        if len(text) > MAX_LINE_LENGTH:
            record.msg, record.args = f"{text[:MAX_LINE_LENGTH]} … ({len(text)} characters)", ()
        return True
