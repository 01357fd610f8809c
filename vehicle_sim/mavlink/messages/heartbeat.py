"""The fields `base_mode` and `system_status` of HEARTBEAT, from the commander's state."""

from __future__ import annotations

from vehicle_sim.autopilot.commander import Commander
from vehicle_sim.autopilot.modes import MODES, NavState
from vehicle_sim.autopilot.offboard import SetpointKind

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
