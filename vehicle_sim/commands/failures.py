"""INJECT_FAILURE as in PX4's simulation.

The battery can be discharged. Motor failures are accepted without an effect on the flight: in PX4 they only
hide the status of ESCs, and this vehicle has none. PX4 does not acknowledge failures of other units, such as
sensors; use a fault script for those.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle_sim.commands.command import ACCEPTED, DENIED, UNSUPPORTED, Command, CommandHost, Handler

INJECT_FAILURE = 420
BATTERY, MOTOR = 100, 101
"""Values of FAILURE_UNIT."""
OK, OFF, WRONG = 0, 1, 4
"""Values of FAILURE_TYPE."""


class FailureCommands:
    """Handles INJECT_FAILURE if SYS_FAILURE_EN permits failures."""

    def __init__(self, host: CommandHost) -> None:
        self._host = host
        self._failures: dict[int, Callable[[int], int | None]] = {
            BATTERY: self._battery,
            MOTOR: lambda failure: ACCEPTED if failure in (OK, OFF, WRONG) else UNSUPPORTED,
        }
        self.commands: dict[int, Handler] = {INJECT_FAILURE: self.inject}

    def inject(self, command: Command) -> int | None:
        """Injects the failure of the unit in param1 and of the type in param2."""
        if self._host.view.choice("SYS_FAILURE_EN") != 1:
            return DENIED
        inject_failure = self._failures.get(_as_integer(command.p1))
        return None if inject_failure is None else inject_failure(_as_integer(command.p2))

    def _battery(self, failure_type: int) -> int | None:
        if failure_type not in (OK, OFF):
            return None
        view = self._host.view
        view.simulation.set_battery_empty(view.row, failure_type == OFF)
        return ACCEPTED


def _as_integer(value: float) -> int:
    return round(value) if math.isfinite(value) else -1
