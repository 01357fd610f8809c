"""What PX4 does when something is lost: conditions in, one action out; no state but what it is given."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from vehicle_sim.autopilot.modes import NavState


class Action(IntEnum):
    """PX4's failsafe actions, numbered as its events number them; later is more severe."""

    NONE = 0
    WARN = 1
    FALLBACK_POSITION = 2
    FALLBACK_ALTITUDE = 3
    FALLBACK_STABILIZED = 4
    HOLD = 5
    RTL = 6
    LAND = 7
    DESCEND = 8
    DISARM = 9
    TERMINATE = 10


class Cause(IntEnum):
    """Why, as failsafe events number it."""

    GENERIC = 0
    MANUAL_CONTROL_LOSS = 1
    GCS_LOSS = 2
    BATTERY_LOW = 3
    BATTERY_CRITICAL = 4
    BATTERY_EMERGENCY = 5


ACTION_MODES: dict[Action, NavState] = {
    Action.FALLBACK_POSITION: NavState.POSITION,
    Action.FALLBACK_ALTITUDE: NavState.ALTITUDE,
    Action.FALLBACK_STABILIZED: NavState.STABILIZED,
    Action.HOLD: NavState.HOLD,
    Action.RTL: NavState.RTL,
    Action.LAND: NavState.LAND,
    Action.DESCEND: NavState.DESCEND,
    Action.TERMINATE: NavState.TERMINATION,
}

_OFFBOARD_LOSS = {
    0: Action.FALLBACK_POSITION,
    1: Action.FALLBACK_ALTITUDE,
    2: Action.FALLBACK_STABILIZED,
    3: Action.RTL,
    4: Action.LAND,
    5: Action.HOLD,
    6: Action.TERMINATE,
    7: Action.DISARM,
}
"""COM_OBL_RC_ACT."""

_GCS_LOSS = {1: Action.HOLD, 2: Action.RTL, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.DISARM}
"""NAV_DLL_ACT."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """What may be wrong with an armed vehicle in flight."""

    mode: NavState
    """The mode asked for."""
    offboard_lost: bool
    offboard_loss_action: int
    """COM_OBL_RC_ACT."""
    position_lost: bool
    """The mode needs a position and there is none."""
    gcs_lost: bool
    gcs_loss_action: int
    """NAV_DLL_ACT."""
    battery_warning: int
    low_battery_action: int
    """COM_LOW_BAT_ACT."""
    overridden: frozenset[Cause]
    """Causes the operator has taken over from."""


@dataclass(frozen=True, slots=True)
class Decision:
    """The failsafe's answer."""

    action: Action = Action.NONE
    cause: Cause = Cause.GENERIC
    delayed: bool = False
    """PX4 holds for COM_FAIL_ACT_T before it acts, so that an operator can take over."""


def decide(conditions: Conditions) -> Decision:
    """The most severe action that the conditions ask for."""
    wanted: list[Decision] = []
    if conditions.gcs_lost and conditions.gcs_loss_action in _GCS_LOSS:
        wanted.append(Decision(_GCS_LOSS[conditions.gcs_loss_action], Cause.GCS_LOSS, True))
    wanted += _battery(conditions.battery_warning, conditions.low_battery_action)
    wanted = [decision for decision in wanted if decision.cause not in conditions.overridden]
    if conditions.mode is NavState.OFFBOARD and conditions.offboard_lost:
        action = _OFFBOARD_LOSS.get(conditions.offboard_loss_action, Action.FALLBACK_POSITION)
        wanted.append(Decision(action))
    if conditions.position_lost:
        wanted.append(Decision(Action.DESCEND))
    return max(wanted, key=lambda decision: decision.action, default=Decision())


def _battery(warning: int, action: int) -> list[Decision]:
    if warning == 1:
        return [Decision(Action.WARN, Cause.BATTERY_LOW)]
    if warning == 2 and action in (2, 3):
        return [Decision(Action.LAND if action == 2 else Action.RTL, Cause.BATTERY_CRITICAL, True)]
    if warning >= 3 and action in (2, 3):
        return [Decision(Action.LAND, Cause.BATTERY_EMERGENCY, True)]
    return [Decision(Action.WARN, Cause.BATTERY_CRITICAL)] if warning else []
