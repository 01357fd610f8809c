"""Whether the executor of the mission's mode is still in charge of the vehicle.

An executor is no longer in charge after another party or a failsafe has changed the mode. PX4 reports this
separately from the new mode, either before or after it.
"""

from __future__ import annotations

from missions.runner.reading import Reading

CONFIRM_S = 1.0
"""Time to wait for the new mode, which shows who took control [s]."""
REPLACED = "Another party commands the vehicle: PX4 no longer accepts commands of the mission's mode"
"""Reason for suspending the mission if the mode has not changed within `CONFIRM_S`."""


class ExecutorControl:
    """Detects that the executor is no longer in charge; without an executor, `is_lost` is never true."""

    def __init__(self) -> None:
        self._was_in_charge = False
        self._lost_since_s: float | None = None

    def begin_part(self, reading: Reading) -> None:
        """Resets the detection when a new part of the mission (take-off, setpoints or landing) begins."""
        self._was_in_charge, self._lost_since_s = reading.executor_in_charge is True, None

    def is_lost(self, reading: Reading) -> bool:
        """Whether the executor was in charge during this part and is no longer in charge."""
        self._was_in_charge |= reading.executor_in_charge is True
        if self._was_in_charge and reading.executor_in_charge is False and reading.armed is not False:
            return True
        self._lost_since_s = None
        return False

    def loss_confirmed(self, now_s: float) -> bool:
        """Whether `is_lost` has been true for `CONFIRM_S`; call it only while `is_lost` is true."""
        if self._lost_since_s is None:
            self._lost_since_s = now_s
        return now_s - self._lost_since_s >= CONFIRM_S
