"""Counts faults of this server's code, and logs them at a limited rate; the faulty part continues."""

from __future__ import annotations

import logging
import time

log = logging.getLogger(__name__)

MAX_TRACEBACKS = 10
"""Maximum number of different faults that are logged with traceback; further faults are only counted."""
LOG_PERIOD_S = 10.0
"""Minimum time between two log lines for faults that were logged before [s]."""
WARNING_DURATION_S = 60.0
"""Time for which a fault is shown as a warning [s]."""
MAX_TEXT_LENGTH = 200


class FaultLog:
    """The faults of one part: catch the exception, `add` it, continue.

    Args:
        part: name of the part: "link radio".
    """

    def __init__(self, part: str) -> None:
        self.part = part
        self.count = 0
        self.newest = ""
        """The newest fault as `Type: text`, shortened."""
        self._newest_s = float("-inf")
        self._logged: set[str] = set()
        self._next_log_s = float("-inf")
        self._not_logged = 0

    def add(self, error: BaseException, action: str) -> None:
        """Counts a fault and logs it at the limited rate; never raises.

        Args:
            error: the exception.
            action: what failed: "handling a message".
        """
        now_s = time.monotonic()
        self.count += 1
        self._newest_s = now_s
        self.newest = _text(error)
        kind = f"{action} {type(error).__name__} {_source_line(error)}"
        if kind not in self._logged and len(self._logged) < MAX_TRACEBACKS:
            self._logged.add(kind)
            log.error("%s: %s failed; the rest continues", self.part, action, exc_info=error)
        elif now_s >= self._next_log_s:
            self._next_log_s = now_s + LOG_PERIOD_S
            log.warning(
                "%s: %s failed again: %s (%d not logged)", self.part, action, self.newest, self._not_logged
            )
            self._not_logged = 0
        else:
            self._not_logged += 1

    @property
    def recent(self) -> bool:
        """Whether a fault happened within the last minute."""
        return time.monotonic() - self._newest_s < WARNING_DURATION_S


def _text(error: BaseException) -> str:
    try:
        text = f"{type(error).__name__}: {error}"
    except Exception:  # converting the exception to text may fail, too
        text = type(error).__name__
    return text if len(text) <= MAX_TEXT_LENGTH else text[:MAX_TEXT_LENGTH] + " …"


def _source_line(error: BaseException) -> str:
    """The source line that raised the error, so that errors with varying texts count as one kind."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return "" if trace is None else f"{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}"
