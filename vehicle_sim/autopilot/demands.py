"""Failsafe action for each failure condition, from PX4's parameters; one pure function per condition."""

from __future__ import annotations

from typing import NamedTuple

from vehicle_sim.autopilot.failsafe import Action, Cause, Clear, Demand, Takeover
from vehicle_sim.autopilot.modes import NavState

_LATCH = Clear.ON_MODE_CHANGE
_LINK_LOSS = {1: Action.HOLD, 2: Action.RTL, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.DISARM}
"""NAV_DLL_ACT and NAV_RCL_ACT."""
_FENCE = {1: Action.WARN, 2: Action.HOLD, 3: Action.RTL, 4: Action.TERMINATE, 5: Action.LAND}
"""GF_ACTION."""
_WIND = {1: Action.WARN, 2: Action.HOLD, 3: Action.RTL, 4: Action.TERMINATE, 5: Action.LAND}
"""COM_WIND_MAX_ACT."""
_BATTERY = {
    1: (Action.RTL, Action.RTL), 2: (Action.LAND, Action.LAND), 3: (Action.RTL, Action.LAND),
}  # fmt: skip
"""COM_LOW_BAT_ACT: actions for a critical battery and for an emergency; 0: warning only."""
_OFFBOARD = {
    0: Action.FALLBACK_POSITION, 1: Action.FALLBACK_ALTITUDE, 2: Action.FALLBACK_STABILIZED, 3: Action.RTL,
    4: Action.LAND, 5: Action.HOLD, 6: Action.TERMINATE, 7: Action.DISARM,
}  # fmt: skip
"""COM_OBL_RC_ACT."""
_EXCEPT_MISSION, _EXCEPT_HOLD, _EXCEPT_OFFBOARD = 1, 2, 4
"""Bits of COM_RCL_EXCEPT and COM_DLL_EXCEPT."""
_HOLD_LIKE = frozenset(
    {NavState.HOLD, NavState.TAKEOFF, NavState.LAND, NavState.RTL, NavState.DESCEND, NavState.FOLLOW,
     NavState.PRECISION_LAND, NavState.ORBIT}
)  # fmt: skip
RC_IN_DISABLED = 4


class Conditions(NamedTuple):
    """Failure conditions of an armed vehicle, and the parameters that define the actions.

    `FailsafeWatch` computes the first part at 50 Hz, and the second part when a parameter changes.
    """

    mode: NavState
    """The intended mode."""
    offboard_lost: bool = False
    position_lost: bool = False
    """The mode requires a position, but no valid position exists."""
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
    """Within three seconds after spool-up."""
    offboard_loss_action: int = 0
    position_loss_lands: bool = False
    """COM_POSCTL_NAVL: land instead of Altitude mode with sticks."""
    manual_loss_action: int = 0
    manual_loss_except: int = 0
    gcs_loss_action: int = 0
    gcs_loss_except: int = 0
    low_battery_action: int = 0
    fence_action: int = 0
    wind_action: int = 0
    may_terminate: bool = False
    """CBRK_FLIGHTTERM is not set."""


def flight_demands(c: Conditions) -> list[Demand]:
    """The demands of all current failure conditions."""
    demands = [*_links(c), *_limits(c), *battery_demands(c), *_failures(c)]
    fallback = _mode_fallback(c)
    if fallback is not Action.NONE:
        demands.append(Demand("mode", fallback, takeover=Takeover.ALWAYS))
    return demands


def _latched(name: str, action: Action, cause: Cause = Cause.GENERIC, *, deferrable: bool = False) -> Demand:
    """A demand that lasts until the operator changes the mode. A termination lasts forever; a warning and a
    disarming last while their condition exists."""
    if action is Action.TERMINATE:
        return Demand(name, action, cause, Clear.NEVER, Takeover.NEVER)
    if action is Action.DISARM:
        return Demand(name, action, cause, takeover=Takeover.NEVER)
    clear = Clear.WHEN_GONE if action is Action.WARN else _LATCH
    return Demand(name, action, cause, clear, deferrable=deferrable)


def _excepted(mode: NavState, bits: int) -> bool:
    if mode is NavState.MISSION:
        return bool(bits & _EXCEPT_MISSION)
    if mode is NavState.OFFBOARD:
        return bool(bits & _EXCEPT_OFFBOARD)
    return mode in _HOLD_LIKE and bool(bits & _EXCEPT_HOLD)


def _links(c: Conditions) -> list[Demand]:
    demands: list[Demand] = []
    if c.manual_lost and c.manual_loss_action in _LINK_LOSS and not _excepted(c.mode, c.manual_loss_except):
        demands.append(
            _latched("manual", _LINK_LOSS[c.manual_loss_action], Cause.MANUAL_CONTROL_LOSS, deferrable=True)
        )
    landing = c.mode in (NavState.LAND, NavState.PRECISION_LAND)
    gcs_counts = not landing and not _excepted(c.mode, c.gcs_loss_except)
    if c.gcs_lost and gcs_counts and c.gcs_loss_action in _LINK_LOSS:
        demands.append(_latched("gcs", _LINK_LOSS[c.gcs_loss_action], Cause.GCS_LOSS, deferrable=True))
    return demands


def _limits(c: Conditions) -> list[Demand]:
    demands: list[Demand] = []
    if c.fence_breached and c.fence_action in _FENCE:
        demands.append(_latched("fence", _FENCE[c.fence_action]))
    if c.wind_too_high and c.wind_action in _WIND:
        demands.append(_latched("wind", _WIND[c.wind_action]))
    if c.flight_time_over:
        demands.append(Demand("flight time", Action.RTL))
    return demands


def ground_demands(c: Conditions) -> list[Demand]:
    """The demands for an armed vehicle that has not taken off."""
    demands = battery_demands(c)
    if c.position_lost:
        demands.append(Demand("mode", _mode_fallback(c), takeover=Takeover.ALWAYS))
    return demands


def battery_demands(c: Conditions) -> list[Demand]:
    """The demands of the battery level, by COM_LOW_BAT_ACT."""
    if c.battery_warning <= 0:
        return []
    if c.battery_warning == 1:
        return [Demand("battery", Action.WARN, Cause.BATTERY_LOW)]
    critical, emergency = _BATTERY.get(c.low_battery_action, (Action.WARN, Action.WARN))
    if c.battery_warning == 2:
        return [Demand("battery", critical, Cause.BATTERY_CRITICAL, deferrable=True)]
    return [Demand("battery", emergency, Cause.BATTERY_EMERGENCY, deferrable=True)]


def _failures(c: Conditions) -> list[Demand]:
    if not c.attitude_failure:
        return []
    action = Action.TERMINATE if c.may_terminate else Action.WARN
    return [_latched("attitude", Action.DISARM if c.just_armed else action)]


def _mode_fallback(c: Conditions) -> Action:
    if c.mode is NavState.OFFBOARD and (c.offboard_lost or c.position_lost):
        # Without a valid position, Offboard counts as lost, and Altitude mode replaces Position mode.
        action = _OFFBOARD.get(c.offboard_loss_action, Action.FALLBACK_POSITION)
        return Action.FALLBACK_ALTITUDE if action is Action.FALLBACK_POSITION and c.position_lost else action
    if c.external_cannot_run:
        return Action.RTL
    if not c.position_lost:
        return Action.NONE
    in_position_mode = c.mode in (NavState.POSITION, NavState.POSITION_SLOW)
    if in_position_mode and c.sticks and not c.position_loss_lands:
        return Action.FALLBACK_ALTITUDE
    return Action.DESCEND
