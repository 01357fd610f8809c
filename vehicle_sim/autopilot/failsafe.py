"""PX4's failsafe state machine: selects the most severe action that the failure conditions require."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum

from vehicle_sim.autopilot.modes import NavState


class Action(IntEnum):
    """PX4's failsafe actions with the numbers of its events; higher is more severe."""

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
    """Cause of a failsafe, with the numbers of PX4's events."""

    GENERIC = 0
    MANUAL_CONTROL_LOSS = 1
    GCS_LOSS = 2
    BATTERY_LOW = 3
    BATTERY_CRITICAL = 4
    BATTERY_EMERGENCY = 5


class ClearCondition(Enum):
    """When a failsafe action ends (PX4's ClearCondition)."""

    WHEN_CONDITION_CLEARS = "when the failure condition is gone"
    ON_MODE_CHANGE = "after the failure condition is gone, when the operator changes the mode"
    NEVER = "never"


class UserTakeover(Enum):
    """Whether a mode change by the operator ends an action whose cause still exists.

    PX4's UserTakeoverAllowed.
    """

    AUTO = "yes, and the action is delayed for a takeover"
    ALWAYS = "yes, without a delay"
    NEVER = "no"


@dataclass(frozen=True, slots=True)
class ActionOptions:
    """The action that a failure condition requires (PX4's ActionOptions)."""

    name: str
    """Name of the failure condition."""
    action: Action
    cause: Cause = Cause.GENERIC
    clear: ClearCondition = ClearCondition.WHEN_CONDITION_CLEARS
    """When the action ends."""
    takeover: UserTakeover = UserTakeover.AUTO
    deferrable: bool = False
    """Whether an external mode or executor may defer the action. Recorded on PX4 for a lost ground station;
    PX4's source also defers actions for lost manual control and for the battery, and no others."""


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
_NOT_DELAYED = (Action.HOLD, Action.DISARM, Action.TERMINATE)
_FALLBACK_ORDER = (Action.HOLD, Action.RTL, Action.LAND, Action.DESCEND)
"""An action that cannot run is replaced by the next action in this order that can run."""
_LANDING_MODES = (NavState.LAND, NavState.PRECISION_LAND)


@dataclass(frozen=True, slots=True)
class Decision:
    """The decision of the failsafe."""

    action: Action = Action.NONE
    cause: Cause = Cause.GENERIC
    pending: Action = Action.NONE
    """The action that follows Hold after the delay COM_FAIL_ACT_T; NONE: no delay."""


NO_FAILSAFE = Decision()
"""The decision if no failure condition exists and no action is latched."""
DEFER_DEFAULT_S = 30.0
DEFERRAL_DISABLED, DEFERRAL_ENABLED, FAILSAFE_DEFERRED = 0, 1, 2
"""`failsafe_defer_state`; FAILSAFE_DEFERRED: a failsafe would act without the deferral."""


class Failsafe:
    """The failsafe state of one vehicle: required actions, takeover by the operator, delay, deferral."""

    def __init__(self) -> None:
        self._actions: dict[str, ActionOptions] = {}
        """Actions by name of the failure condition; `ClearCondition` defines when an action is removed."""
        self._existing_conditions: frozenset[str] = frozenset()
        """Names of the conditions that existed at the last check."""
        self._taken_over = False
        """Whether the operator has ended the action by a mode change."""
        self._acts_at_s: float | None = None
        """End of the delay before the action; None: no action."""
        self._decision = Decision()
        self._defers = False
        self._defer_limit_s = math.inf
        self._deferred_since_s: float | None = None

    @property
    def deferral(self) -> int:
        """`failsafe_defer_state`."""
        if not self._defers:
            return DEFERRAL_DISABLED
        return DEFERRAL_ENABLED if self._deferred_since_s is None else FAILSAFE_DEFERRED

    def defer(self, enabled: bool, timeout_s: int) -> None:
        """Enables or disables the deferral of failsafes; while a failsafe acts, only disabling has an effect.

        Args:
            enabled: True enables the deferral.
            timeout_s: longest time that an action is deferred; 0: PX4's default, negative: no limit.
        """
        if enabled and self._decision.action > Action.WARN:
            return
        self._defers = enabled
        self._defer_limit_s = math.inf if timeout_s < 0 else timeout_s or DEFER_DEFAULT_S

    def reset(self) -> None:
        """Clears all actions, but not the deferral; called at arming and disarming."""
        self._actions.clear()
        self._existing_conditions = frozenset()
        self._taken_over, self._acts_at_s, self._decision = False, None, Decision()

    def on_mode_change(self) -> None:
        """Called when the operator changes the mode; ends the actions that a mode change can end."""
        worst = self._worst()
        if worst.action > Action.WARN and worst.takeover is not UserTakeover.NEVER:
            self._taken_over = True
        ended = [
            name for name, options in self._actions.items()
            if name not in self._existing_conditions and options.clear is ClearCondition.ON_MODE_CHANGE
        ]  # fmt: skip
        for name in ended:
            del self._actions[name]

    def update(
        self,
        now_s: float,
        actions: Sequence[ActionOptions],
        *,
        intended: NavState,
        can_run: Callable[[NavState], bool],
        delay_s: float,
    ) -> Decision:
        """Updates the decision; called at each check while armed (10 Hz; 50 Hz while a failsafe acts)."""
        if not actions and not self._actions:  # the usual case
            self._deferred_since_s, self._acts_at_s = None, None
            self._taken_over, self._decision = False, NO_FAILSAFE
            self._existing_conditions = frozenset()
            return NO_FAILSAFE
        self._update_actions(actions)
        self._update_deferral(now_s)
        worst = self._worst()
        if self._taken_over and worst.action > Action.WARN and worst.takeover is not UserTakeover.NEVER:
            worst = ActionOptions("taken over", Action.NONE)
        self._decision = self._decide(now_s, worst, intended, can_run, delay_s)
        return self._decision

    def _update_actions(self, actions: Sequence[ActionOptions]) -> None:
        required = {options.name: options for options in actions if options.action is not Action.NONE}
        for name, options in required.items():
            previous = self._actions[name].action if name in self._existing_conditions else Action.NONE
            if options.action > max(previous, Action.WARN):
                self._taken_over = False
            self._actions[name] = options
        for name in [name for name in self._actions if name not in required]:
            if self._actions[name].clear is ClearCondition.WHEN_CONDITION_CLEARS:
                del self._actions[name]
        if not self._actions:
            self._taken_over = False
        self._existing_conditions = frozenset(required)

    def _update_deferral(self, now_s: float) -> None:
        since_s = self._deferred_since_s
        if self._defers and since_s is not None and now_s - since_s > self._defer_limit_s:
            self._defers = False
        has_deferrable = any(each.deferrable and each.action > Action.WARN for each in self._actions.values())
        if not (self._defers and has_deferrable):
            self._deferred_since_s = None
        elif since_s is None:
            self._deferred_since_s = now_s

    def _worst(self) -> ActionOptions:
        acting = [each for each in self._actions.values() if not (self._defers and each.deferrable)]
        return max(acting, key=lambda options: options.action, default=ActionOptions("none", Action.NONE))

    def _decide(
        self,
        now_s: float,
        worst: ActionOptions,
        intended: NavState,
        can_run: Callable[[NavState], bool],
        delay_s: float,
    ) -> Decision:
        action = worst.action
        if action <= Action.WARN:
            self._acts_at_s = None
            return Decision(action, worst.cause)
        if self._acts_at_s is None:
            self._acts_at_s = now_s + max(0.0, delay_s)
        waits = now_s < self._acts_at_s and worst.takeover is UserTakeover.AUTO and action not in _NOT_DELAYED
        chosen = _first_runnable(Action.HOLD if waits else action, can_run)
        if intended in _LANDING_MODES and chosen in (Action.HOLD, Action.RTL) and can_run(intended):
            return Decision(Action.WARN, worst.cause)
        if intended is NavState.RTL and chosen in (Action.HOLD, Action.RTL) and can_run(intended):
            return Decision(Action.WARN, worst.cause)
        return Decision(chosen, worst.cause, action if waits else Action.NONE)


def _first_runnable(action: Action, can_run: Callable[[NavState], bool]) -> Action:
    """The action if it can run, otherwise the next action of `_FALLBACK_ORDER` that can."""
    if action not in _FALLBACK_ORDER:
        return action
    for each in _FALLBACK_ORDER[_FALLBACK_ORDER.index(action) :]:
        if each is Action.DESCEND or can_run(ACTION_MODES[each]):
            return each
    return Action.DESCEND
