"""Counts faults of this server's code, and logs them at a limited rate; the faulty part continues.

`Isolation` runs the parts of a vehicle or a view, so that a fault stops only one part.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from gcs_server.clock import Clock

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


WORK_LOG_PERIOD_S = 60.0
"""Period at which a persistent fault is logged again [s]."""
MAX_FAULTS = 50
"""Maximum number of listed faults."""

T = TypeVar("T")
P = ParamSpec("P")


class Isolation:
    """Runs pieces of work that may fail.

    Args:
        clock: clock for the log period.
        log: receives faults with traceback.
        owner: start of each sentence about a fault: "Vehicle 1", "The 3D view".
    """

    def __init__(self, clock: Clock, log: logging.Logger, owner: str) -> None:
        self._clock = clock
        self._log = log
        self._owner = owner
        self._faults: dict[str, str] = {}
        self._logged_s: dict[str, float] = {}

    def run(self, work_name: str, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T | None:
        """Result of the work; None if it failed."""
        try:
            result = work(*args, **kwargs)
        except Exception as error:  # any error, so that other vehicles are not affected
            self._record_fault(work_name, error)
            return None
        if self._faults:
            self._faults.pop(work_name, None)
        return result

    @property
    def faults(self) -> list[str]:
        """Sentences about currently failing work."""
        return list(self._faults.values())

    def _record_fault(self, work_name: str, error: Exception) -> None:
        if work_name not in self._logged_s and len(self._logged_s) >= MAX_FAULTS:
            return
        text = f"{self._owner}: {work_name} failed ({type(error).__name__}: {error})"
        self._faults[work_name] = f"{text[:300]}. This is an error in the server; everything else continues."
        now_s = self._clock.monotonic_s()
        if now_s - self._logged_s.get(work_name, float("-inf")) >= WORK_LOG_PERIOD_S:
            self._logged_s[work_name] = now_s
            self._log.error("%s: %s failed", self._owner, work_name, exc_info=error)
