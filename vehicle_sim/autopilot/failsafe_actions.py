"""The failsafe action that each failure condition requires, from PX4's parameters."""

from __future__ import annotations

from typing import NamedTuple

from vehicle_sim.autopilot.failsafe import Action, ActionOptions, Cause, ClearCondition, UserTakeover
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.external_modes.registry import is_external

_LINK_LOSS_ACTIONS = {1: Action.HOLD, 2: Action.RTL, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.DISARM}
"""By value of NAV_DLL_ACT and NAV_RCL_ACT."""
_FENCE_ACTIONS = {1: Action.WARN, 2: Action.HOLD, 3: Action.RTL, 4: Action.TERMINATE, 5: Action.LAND}
"""By value of GF_ACTION."""
_WIND_ACTIONS = {1: Action.WARN, 2: Action.HOLD, 3: Action.RTL, 4: Action.TERMINATE, 5: Action.LAND}
"""By value of COM_WIND_MAX_ACT."""
_BATTERY_ACTIONS = {
    1: (Action.RTL, Action.RTL), 2: (Action.LAND, Action.LAND), 3: (Action.RTL, Action.LAND),
}  # fmt: skip
"""By value of COM_LOW_BAT_ACT: actions at the critical and the emergency level; 0: only a warning."""
_OFFBOARD_LOSS_ACTIONS = {
    0: Action.FALLBACK_POSITION, 1: Action.FALLBACK_ALTITUDE, 2: Action.FALLBACK_STABILIZED, 3: Action.RTL,
    4: Action.LAND, 5: Action.HOLD, 6: Action.TERMINATE, 7: Action.DISARM,
}  # fmt: skip
"""By value of COM_OBL_RC_ACT."""
_EXCEPT_MISSION, _EXCEPT_HOLD, _EXCEPT_OFFBOARD = 1, 2, 4
"""Bits of COM_RCL_EXCEPT and COM_DLL_EXCEPT."""
_EXCEPT_EXTERNAL, _EXCEPT_ALTITUDE_CRUISE = 8, 16
"""Bits of COM_RCL_EXCEPT from PX4 v1.17 on."""
_HOLD_MODES = frozenset(
    {NavState.HOLD, NavState.TAKEOFF, NavState.LAND, NavState.RTL, NavState.DESCEND, NavState.FOLLOW,
     NavState.PRECISION_LAND, NavState.ORBIT}
)  # fmt: skip
"""Modes to which the bit `_EXCEPT_HOLD` applies."""
_FLOWN_BY_STICKS = (Action.FALLBACK_POSITION, Action.FALLBACK_ALTITUDE, Action.FALLBACK_STABILIZED)
RC_IN_DISABLED = 4
"""Value of COM_RC_IN_MODE that disables stick input."""


class Conditions(NamedTuple):
    """Failure conditions of an armed vehicle, and the parameters that define the actions.

    `FailsafeWatch` reads the conditions at each check, and the parameters when one of them changes.
    """

    mode: NavState
    """The intended mode."""
    offboard_lost: bool = False
    position_lost: bool = False
    """The mode requires a position, but the position estimate is invalid."""
    external_cannot_run: bool = False
    """The mode is external, and is unresponsive, reports that it cannot run, or lacks a requirement."""
    sticks: bool = False
    """The pilot controls the vehicle with sticks."""
    manual_lost: bool = False
    """Stick input was received since arming, but is lost now."""
    gcs_lost: bool = False
    battery_warning: int = 0
    fence_breached: bool = False
    wind_too_high: bool = False
    flight_time_over: bool = False
    attitude_failure: bool = False
    just_armed: bool = False
    """The time since spool-up is below COM_LKDOWN_TKO; an attitude failure then disarms the vehicle."""
    offboard_loss_action: int = 0
    position_loss_lands: bool = False
    """COM_POSCTL_NAVL: action for a lost position in Position mode: descend, or (False) Altitude mode."""
    manual_loss_action: int = 0
    manual_loss_except: int = 0
    """COM_RCL_EXCEPT, bit mask of the modes in which the action does not apply."""
    gcs_loss_action: int = 0
    gcs_loss_except: int = 0
    """COM_DLL_EXCEPT."""
    low_battery_action: int = 0
    fence_action: int = 0
    wind_action: int = 0
    may_terminate: bool = False
    """CBRK_FLIGHTTERM is not set."""
    fallback_needs_sticks: bool = False
    """As in PX4 v1.17: NAV_RCL_ACT replaces a mode that is flown by sticks if there are none, and
    COM_RCL_EXCEPT has bits for external modes and Altitude Cruise."""


def flight_actions(conditions: Conditions) -> list[ActionOptions]:
    """The actions that the current failure conditions require in flight."""
    actions = [
        *_link_actions(conditions),
        *_limit_actions(conditions),
        *battery_actions(conditions),
        *_attitude_actions(conditions),
    ]
    fallback = _mode_fallback(conditions)
    if fallback is not Action.NONE:
        actions.append(ActionOptions("mode", fallback, takeover=UserTakeover.ALWAYS))
    return actions


def _latched(
    name: str, action: Action, cause: Cause = Cause.GENERIC, *, deferrable: bool = False
) -> ActionOptions:
    """An action that lasts until the operator changes the mode. A termination never ends; a warning or a
    disarming ends with its condition."""
    if action is Action.TERMINATE:
        return ActionOptions(name, action, cause, ClearCondition.NEVER, UserTakeover.NEVER)
    if action is Action.DISARM:
        return ActionOptions(name, action, cause, takeover=UserTakeover.NEVER)
    clear = ClearCondition.WHEN_CONDITION_CLEARS if action is Action.WARN else ClearCondition.ON_MODE_CHANGE
    return ActionOptions(name, action, cause, clear, deferrable=deferrable)


def _manual_loss_excepted(conditions: Conditions) -> bool:
    mode, bits = conditions.mode, conditions.manual_loss_except
    if conditions.fallback_needs_sticks and is_external(mode):
        return bool(bits & _EXCEPT_EXTERNAL)
    if mode is NavState.ALTITUDE_CRUISE:
        return bool(bits & _EXCEPT_ALTITUDE_CRUISE)
    return _excepted(mode, bits)


def _excepted(mode: NavState, bits: int) -> bool:
    if mode is NavState.MISSION:
        return bool(bits & _EXCEPT_MISSION)
    if mode is NavState.OFFBOARD:
        return bool(bits & _EXCEPT_OFFBOARD)
    return mode in _HOLD_MODES and bool(bits & _EXCEPT_HOLD)


def _link_actions(conditions: Conditions) -> list[ActionOptions]:
    actions: list[ActionOptions] = []
    if (
        conditions.manual_lost
        and conditions.manual_loss_action in _LINK_LOSS_ACTIONS
        and not _manual_loss_excepted(conditions)
    ):
        actions.append(
            _latched(
                "manual",
                _LINK_LOSS_ACTIONS[conditions.manual_loss_action],
                Cause.MANUAL_CONTROL_LOSS,
                deferrable=True,
            )
        )
    landing = conditions.mode in (NavState.LAND, NavState.PRECISION_LAND)
    gcs_loss_counts = not landing and not _excepted(conditions.mode, conditions.gcs_loss_except)
    if conditions.gcs_lost and gcs_loss_counts and conditions.gcs_loss_action in _LINK_LOSS_ACTIONS:
        actions.append(
            _latched("gcs", _LINK_LOSS_ACTIONS[conditions.gcs_loss_action], Cause.GCS_LOSS, deferrable=True)
        )
    return actions


def _limit_actions(conditions: Conditions) -> list[ActionOptions]:
    actions: list[ActionOptions] = []
    if conditions.fence_breached and conditions.fence_action in _FENCE_ACTIONS:
        actions.append(_latched("fence", _FENCE_ACTIONS[conditions.fence_action]))
    if conditions.wind_too_high and conditions.wind_action in _WIND_ACTIONS:
        actions.append(_latched("wind", _WIND_ACTIONS[conditions.wind_action]))
    if conditions.flight_time_over:
        actions.append(ActionOptions("flight time", Action.RTL))
    return actions


def ground_actions(conditions: Conditions) -> list[ActionOptions]:
    """The actions that are required while an armed vehicle has not taken off."""
    actions = battery_actions(conditions)
    if conditions.position_lost:
        actions.append(ActionOptions("mode", _mode_fallback(conditions), takeover=UserTakeover.ALWAYS))
    return actions


def battery_actions(conditions: Conditions) -> list[ActionOptions]:
    """The action that the battery level requires (COM_LOW_BAT_ACT)."""
    if conditions.battery_warning <= 0:
        return []
    if conditions.battery_warning == 1:
        return [ActionOptions("battery", Action.WARN, Cause.BATTERY_LOW)]
    critical, emergency = _BATTERY_ACTIONS.get(conditions.low_battery_action, (Action.WARN, Action.WARN))
    if conditions.battery_warning == 2:
        return [ActionOptions("battery", critical, Cause.BATTERY_CRITICAL, deferrable=True)]
    return [ActionOptions("battery", emergency, Cause.BATTERY_EMERGENCY, deferrable=True)]


def _attitude_actions(conditions: Conditions) -> list[ActionOptions]:
    if not conditions.attitude_failure:
        return []
    action = Action.TERMINATE if conditions.may_terminate else Action.WARN
    return [_latched("attitude", Action.DISARM if conditions.just_armed else action)]


def _mode_fallback(conditions: Conditions) -> Action:
    action = _required_fallback(conditions)
    if conditions.fallback_needs_sticks and action in _FLOWN_BY_STICKS and not conditions.sticks:
        return _LINK_LOSS_ACTIONS.get(conditions.manual_loss_action, Action.NONE)
    return action


def _required_fallback(conditions: Conditions) -> Action:
    if conditions.mode is NavState.OFFBOARD and (conditions.offboard_lost or conditions.position_lost):
        # Without a valid position, Offboard counts as lost, and Altitude mode replaces Position mode.
        action = _OFFBOARD_LOSS_ACTIONS.get(conditions.offboard_loss_action, Action.FALLBACK_POSITION)
        if action is Action.FALLBACK_POSITION and conditions.position_lost:
            return Action.FALLBACK_ALTITUDE
        return action
    if conditions.external_cannot_run:
        return Action.RTL
    if not conditions.position_lost:
        return Action.NONE
    in_position_mode = conditions.mode in (NavState.POSITION, NavState.POSITION_SLOW)
    sticks = conditions.sticks or conditions.fallback_needs_sticks  # without sticks see _mode_fallback
    if in_position_mode and sticks and not conditions.position_loss_lands:
        return Action.FALLBACK_ALTITUDE
    return Action.DESCEND
