"""Base class of the telemetry builders; each builder method is named after its message."""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.commander import Commander
from vehicle_sim.autopilot.modes import MODES, NavState
from vehicle_sim.autopilot.offboard import SetpointKind
from vehicle_sim.mavlink.dialect import BY_NAME

NAN = math.nan

Builder = Callable[[], bytes | None]


class MessageGroup:
    """A group of telemetry messages; for example, method `heartbeat` builds the payload of HEARTBEAT.

    A builder returns None if it has no data yet.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._view = autopilot.view

    def builders(self) -> dict[int, Builder]:
        """The builders by message id."""
        unknown = () if self._view.px4.gnss_integrity else ("gnss_integrity",)
        return {
            BY_NAME[name.upper()].id: getattr(self, name)
            for name in dir(self)
            if name.upper() in BY_NAME and name not in unknown
        }


def packer(name: str) -> Callable[..., bytes]:
    """A function that packs a message from its fields in wire order."""
    return BY_NAME[name].packer.pack


def i16(value: float) -> int:
    """Rounds a value and limits it to the range of a signed 16-bit integer."""
    return max(-32768, min(32767, round(value)))


ARMED_FLAG, STABILIZE_FLAG = 128, 16
"""Values of MAV_MODE_FLAG."""
UNINITIALIZED, CALIBRATING, STANDBY, ACTIVE, CRITICAL, TERMINATED = 0, 2, 3, 4, 5, 8
"""Values of MAV_STATE."""


def base_mode(commander: Commander) -> int:
    """The field `base_mode` of HEARTBEAT."""
    flags = MODES[commander.active].base_flags | (ARMED_FLAG if commander.armed else 0)
    return flags | STABILIZE_FLAG if _controls_attitude(commander) else flags


def _controls_attitude(commander: Commander) -> bool:
    mode = commander.active
    if mode is NavState.OFFBOARD:
        # The last received setpoint decides, even if the stream has stopped.
        return commander.offboard.kind not in (SetpointKind.NONE, SetpointKind.RATES)
    if commander.external.mode(mode) is not None:
        return commander.external.controllers(mode).attitude
    return mode not in (NavState.ACRO, NavState.TERMINATION)


def system_status(commander: Commander) -> int:
    """The field `system_status` of HEARTBEAT."""
    if commander.terminated:
        return TERMINATED
    if commander.armed:
        return CRITICAL if commander.in_failsafe else ACTIVE
    if commander.calibrating:
        return CALIBRATING
    return STANDBY if commander.report.armable(commander.intended_or_replacement) else UNINITIALIZED
