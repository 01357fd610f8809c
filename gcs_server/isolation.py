"""Isolates errors: runs each piece of work separately and keeps its error as text.

An error here is a fault of this program caused by some vehicle's data. It is logged, and listed in `GET
/warnings` until the same work succeeds; other vehicles are not affected.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from gcs_server.clock import Clock

LOG_EVERY_S = 60.0
"""Period at which a lasting fault is logged again."""
MAX_FAULTS = 50
"""Largest number of listed faults."""

T = TypeVar("T")
P = ParamSpec("P")


class Isolation:
    """Runs pieces of work that may fail.

    Args:
        clock: limits the log.
        log: receives faults with traceback.
        whose: start of each sentence about a fault: "Vehicle 1", "The 3D view".
    """

    def __init__(self, clock: Clock, log: logging.Logger, whose: str) -> None:
        self._clock = clock
        self._log = log
        self._whose = whose
        self._faults: dict[str, str] = {}
        self._logged_s: dict[str, float] = {}

    def run(self, what: str, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T | None:
        """Result of the work; None if it failed. `what` is the name of the work."""
        try:
            result = work(*args, **kwargs)
        except Exception as error:  # any error: the other vehicles must not be affected
            self._note(what, error)
            return None
        if self._faults:
            self._faults.pop(what, None)
        return result

    @property
    def faults(self) -> list[str]:
        """Sentences about currently failing work."""
        return list(self._faults.values())

    def _note(self, what: str, error: Exception) -> None:
        if what not in self._logged_s and len(self._logged_s) >= MAX_FAULTS:
            return
        said = f"{self._whose}: {what} failed ({type(error).__name__}: {error})"
        self._faults[what] = f"{said[:300]}. This is an error in the server; everything else continues."
        now_s = self._clock.monotonic_s()
        if now_s - self._logged_s.get(what, float("-inf")) >= LOG_EVERY_S:
            self._logged_s[what] = now_s
            self._log.error("%s: %s failed", self._whose, what, exc_info=error)
