"""INJECT_FAILURE: breaks the sensors and motors that PX4's simulated vehicle lets one break.

Units that nobody there listens to (gyro, baro, compass, remote control, …) get no answer, as in PX4.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle_sim.commands.command import ACCEPTED, DENIED, UNSUPPORTED, Command, CommandHost, Handler

INJECT_FAILURE = 420
GPS, BATTERY, MOTOR = 4, 100, 101
"""FAILURE_UNIT."""
OK, OFF, STUCK = 0, 1, 2
"""FAILURE_TYPE."""
EMPTY = 0.0


class FailureCommands:
    """Command 420, where SYS_FAILURE_EN allows it."""

    def __init__(self, host: CommandHost) -> None:
        self._host = host
        self._units: dict[int, Callable[[int, int], bool]] = {
            GPS: self._gps,
            BATTERY: self._battery,
            MOTOR: self._motor,
        }
        self.commands: dict[int, Handler] = {INJECT_FAILURE: self.inject}

    def inject(self, command: Command) -> int | None:
        """Unit, kind of failure and instance (0: all) in param1 to param3."""
        if self._host.view.choice("SYS_FAILURE_EN") != 1:
            return DENIED
        unit = self._units.get(_whole(command.p1))
        if unit is None:
            return None
        return ACCEPTED if unit(_whole(command.p2), _whole(command.p3)) else UNSUPPORTED

    def _gps(self, kind: int, instance: int) -> bool:
        if kind not in (OK, OFF, STUCK) or instance not in (0, 1):
            return False
        view = self._host.view
        view.simulation.set_gps_enabled(view.row, kind != OFF)
        view.simulation.set_gps_stuck(view.row, kind == STUCK)
        return True

    def _battery(self, kind: int, _instance: int) -> bool:
        view = self._host.view
        if kind == OFF:
            view.simulation.set_battery_remaining(view.row, EMPTY)
        elif kind == OK:
            view.simulation.refill_battery(view.row)
        return kind in (OK, OFF)

    def _motor(self, kind: int, instance: int) -> bool:
        view = self._host.view
        health = view.simulation.motor_health[view.row]
        if kind not in (OK, OFF) or not 0 <= instance <= len(health):
            return False
        which = slice(None) if instance == 0 else instance - 1
        health[which] = 1.0 if kind == OK else 0.0
        return True


def _whole(value: float) -> int:
    return round(value) if math.isfinite(value) else -1
