"""Isolates errors: each work is run by itself, and its errors are kept as texts.

What fails here is a fault of this program that some vehicle's data brought to light. It is logged, and stands
in `GET /warnings` until the same work succeeds; the others are served as ever.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from gcs_server.clock import Clock

LOG_EVERY_S = 60.0
"""A fault that stands is logged again this seldom."""
MOST_FAULTS = 50
"""Most faults that are listed."""

T = TypeVar("T")
P = ParamSpec("P")


class Isolation:
    """Runs works that may fail.

    Args:
        clock: limits the log.
        log: where a fault is written with its traceback.
        whose: begins each sentence about a fault: "Vehicle 1", "The 3D view".
    """

    def __init__(self, clock: Clock, log: logging.Logger, whose: str) -> None:
        self._clock = clock
        self._log = log
        self._whose = whose
        self._faults: dict[str, str] = {}
        self._logged_s: dict[str, float] = {}

    def run(self, what: str, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T | None:
        """The work's result; None where it failed. `what` names the work, for people."""
        try:
            result = work(*args, **kwargs)
        except Exception as error:  # whatever brought it about, the others are served
            self._note(what, error)
            return None
        if self._faults:
            self._faults.pop(what, None)
        return result

    @property
    def faults(self) -> list[str]:
        """The work that fails now, as sentences."""
        return list(self._faults.values())

    def _note(self, what: str, error: Exception) -> None:
        if what not in self._logged_s and len(self._logged_s) >= MOST_FAULTS:
            return
        said = f"{self._whose}: {what} failed ({type(error).__name__}: {error})"
        self._faults[what] = f"{said[:300]}. This is an error in the server; everything else continues."
        now_s = self._clock.monotonic_s()
        if now_s - self._logged_s.get(what, float("-inf")) >= LOG_EVERY_S:
            self._logged_s[what] = now_s
            self._log.error("%s: %s failed", self._whose, what, exc_info=error)
