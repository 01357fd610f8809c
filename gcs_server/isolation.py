"""Isolates faults: runs each piece of work separately and keeps its fault as text.

A fault is an unexpected exception, such as one caused by a vehicle's data. It is logged, and listed in `GET
/warnings` until the same work succeeds. Other vehicles are not affected.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from gcs_server.clock import Clock

LOG_PERIOD_S = 60.0
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
        if now_s - self._logged_s.get(work_name, float("-inf")) >= LOG_PERIOD_S:
            self._logged_s[work_name] = now_s
            self._log.error("%s: %s failed", self._owner, work_name, exc_info=error)
