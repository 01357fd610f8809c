"""Whether the executor of the mission's mode is still in charge of the vehicle.

PX4 takes the charge from an executor when somebody else changes the mode, or a failsafe does. It reports this
in a message of its own, which may arrive before or after the new mode.
"""

from __future__ import annotations

from missions.runner.reading import Reading

CONFIRM_S = 1.0
"""Time to wait for the new mode, which names who took over [s]."""
REPLACED = "Someone else commands the vehicle: PX4 no longer accepts commands of the mission's mode"
"""The reason, if the mode has not changed in this time."""


class ExecutorCharge:
    """The charge during one part of the mission; never lost if the mode has no executor."""

    def __init__(self) -> None:
        self._had = False
        self._lost_since_s: float | None = None

    def begin_part(self, reading: Reading) -> None:
        """Starts with a new part of the mission."""
        self._had, self._lost_since_s = reading.executor_in_charge is True, None

    def lost(self, reading: Reading) -> bool:
        """Whether the executor was in charge during this part, and no longer is."""
        self._had |= reading.executor_in_charge is True
        if self._had and reading.executor_in_charge is False and reading.armed is not False:
            return True
        self._lost_since_s = None
        return False

    def confirmed(self, now_s: float) -> bool:
        """Whether the charge has been lost for `CONFIRM_S`; call it only while it is lost."""
        if self._lost_since_s is None:
            self._lost_since_s = now_s
        return now_s - self._lost_since_s >= CONFIRM_S
