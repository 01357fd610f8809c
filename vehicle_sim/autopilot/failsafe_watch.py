"""Computes the failsafe decision from the vehicle's state, and sends PX4's texts about the decision."""

from __future__ import annotations

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.checks import Checks
from vehicle_sim.autopilot.failsafe import NO_FAILSAFE, Action, ActionOptions, Cause, Decision, Failsafe
from vehicle_sim.autopilot.failsafe_actions import RC_IN_DISABLED, Conditions, flight_actions, ground_actions
from vehicle_sim.autopilot.fence_watch import FenceWatch
from vehicle_sim.autopilot.modes import MODES, NavState
from vehicle_sim.autopilot.monitors import TERMINATION_DISABLED, Monitors
from vehicle_sim.autopilot.offboard import Offboard, SetpointKind
from vehicle_sim.autopilot.setpoint_writer import bool_view
from vehicle_sim.external_modes.registry import is_external
from vehicle_sim.external_modes.slots import Overrides
from vehicle_sim.vehicle_view import VehicleView

_WARNING_EVENTS = {
    Cause.BATTERY_LOW: "commander_failsafe_enter_low_bat",
    Cause.BATTERY_CRITICAL: "commander_failsafe_enter_crit_bat_warn",
    Cause.BATTERY_EMERGENCY: "commander_failsafe_enter_crit_low_bat_warn",
}


class FailsafeWatch:
    """The failsafe of one vehicle."""

    def __init__(
        self,
        view: VehicleView,
        announcer: Announcer,
        checks: Checks,
        offboard: Offboard,
        fence: FenceWatch,
        monitors: Monitors,
    ) -> None:
        self._view, self._announcer, self._checks = view, announcer, checks
        self._offboard, self._fence, self._monitors = offboard, fence, monitors
        self._failsafe = Failsafe()
        self._had_sticks = False
        self._parameter_values: tuple[int, ...] = ()
        self._parameters_revision = -1
        """`parameter_changes` at which the parameters were read."""
        self._condition_values: tuple[object, ...] = ()
        self._conditions = Conditions(NavState.HOLD)
        self._flight_actions: list[ActionOptions] = []
        self.decision = Decision()

    @property
    def deferral(self) -> int:
        """`failsafe_defer_state`: 0 disabled, 1 enabled, 2 enabled and a failsafe is deferred now."""
        return self._failsafe.deferral

    def in_early_takeoff(self, armed_for_s: float) -> bool:
        """Whether the vehicle was armed so recently that an attitude failure disarms the vehicle."""
        parameter = self._view.parameter
        return armed_for_s < parameter("COM_SPOOLUP_TIME") + parameter("COM_LKDOWN_TKO")

    def reset(self) -> None:
        """Clears the failsafe; called at arming and disarming."""
        self._failsafe.reset()
        self._had_sticks = False
        self.decision = Decision()

    def on_mode_change(self) -> None:
        """Called when the operator changes the mode."""
        self._failsafe.on_mode_change()

    def update(
        self, intended: NavState, *, armed_for_s: float, may_act: bool, overrides: Overrides
    ) -> Decision:
        """Updates the decision, and reports changes.

        Args:
            intended: the intended mode.
            armed_for_s: time since arming.
            may_act: whether all actions are allowed, because the vehicle flies or has flown; before that
                PX4 acts only on the battery and on a lost position.
            overrides: settings of the active external mode and of the executor in charge.
        """
        values = self._read_conditions(intended, armed_for_s)
        if values != self._condition_values:
            self._condition_values = values
            self._conditions = Conditions._make((*values, *self._parameter_values))
            self._flight_actions = flight_actions(self._conditions)
        actions = self._flight_actions if may_act else ground_actions(self._conditions)
        previous = self.decision
        self._failsafe.defer(overrides.defer_failsafes, overrides.defer_timeout_s)
        self.decision = self._failsafe.update(
            self._view.time_s,
            actions,
            intended=intended,
            can_run=self._can_run,
            delay_s=self._view.parameter("COM_FAIL_ACT_T"),
        )
        if self.decision is not previous and self.decision != previous:
            self._announce(previous, self.decision, intended)
        return self.decision

    def _can_run(self, mode: NavState) -> bool:
        return self._checks.position_usable or not MODES[mode].needs_position

    def _read_conditions(self, mode: NavState, armed_for_s: float) -> tuple[object, ...]:
        """The failure conditions, in the order of `Conditions`."""
        view, checks, monitors = self._view, self._checks, self._monitors
        if self._parameters_revision != view.parameter_changes:
            self._read_parameters()
        has_sticks = checks.has_manual_control()
        self._had_sticks = self._had_sticks or has_sticks
        sticks_enabled = view.choice("COM_RC_IN_MODE") != RC_IN_DISABLED
        return (
            mode,
            not self._offboard.has_signal(),
            self._needs_position(mode) and not checks.position_usable,
            is_external(mode) and not checks.report.runnable(mode),
            has_sticks,
            self._had_sticks and not has_sticks and sticks_enabled,
            checks.gcs_lost(),
            checks.battery_warning,
            bool(self._fence.breaches),
            monitors.wind_too_high,
            monitors.flight_time_over,
            monitors.attitude_failure,
            self.in_early_takeoff(armed_for_s),
        )

    def _read_parameters(self) -> None:
        """Reads the parameters, in the order of `Conditions`."""
        choice = self._view.choice
        self._parameters_revision = self._view.parameter_changes
        self._parameter_values = (
            choice("COM_OBL_RC_ACT"),
            self._view.optional_choice("COM_POSCTL_NAVL", 0) == 1,
            choice("NAV_RCL_ACT"),
            choice("COM_RCL_EXCEPT"),
            choice("NAV_DLL_ACT"),
            choice("COM_DLL_EXCEPT"),
            choice("COM_LOW_BAT_ACT"),
            choice("GF_ACTION"),
            choice("COM_WIND_MAX_ACT"),
            choice("CBRK_FLIGHTTERM") != TERMINATION_DISABLED,
            self._view.px4.fallback_needs_sticks,
        )
        self._condition_values = ()

    def _needs_position(self, mode: NavState) -> bool:
        if mode is NavState.OFFBOARD:
            return self._offboard.kind in (
                SetpointKind.POSITION,
                SetpointKind.VELOCITY,
                SetpointKind.ACCELERATION,
            )
        return MODES[mode].needs_position

    def _announce(self, previous: Decision, decision: Decision, intended: NavState) -> None:
        custom_mode, delay_s = MODES[intended].custom_mode, self._view.parameter("COM_FAIL_ACT_T")
        announcer, action, cause = self._announcer, decision.action, decision.cause
        if action is Action.NONE or (decision.pending and previous.pending):
            return
        self._checks.announce_changes()
        if action is Action.WARN:
            if previous.action <= Action.WARN:
                self._warn(cause, custom_mode)
            return
        if decision.pending:
            text = f"Failsafe activated: entering Hold for {delay_s:.0f} seconds"
            if cause is Cause.GENERIC:
                name, argument_format, values = (
                    "commander_failsafe_enter_generic_hold",
                    "IBH",
                    (int(delay_s),),
                )
            else:
                name, argument_format, values = (
                    "commander_failsafe_enter_hold",
                    "IBHB",
                    (int(delay_s), cause),
                )
            announcer.announce(2, text, name, argument_format, custom_mode, decision.pending, *values)
            return
        if action == previous.action and not previous.pending:
            return
        if cause is not Cause.GENERIC:
            announcer.announce(
                2, "Failsafe activated", "commander_failsafe_enter", "IBB", custom_mode, action, cause
            )
            return
        name = "commander_failsafe_enter_generic"
        if action in (Action.FALLBACK_ALTITUDE, Action.FALLBACK_STABILIZED, Action.DESCEND):
            name = "commander_failsafe_enter_autopilot_disengaged"
        announcer.announce(2, "Failsafe activated", name, "IB", custom_mode, action)

    def _warn(self, cause: Cause, custom_mode: int) -> None:
        if cause in _WARNING_EVENTS:
            self._announcer.announce(2, "Failsafe activated", _WARNING_EVENTS[cause])
        elif cause is Cause.GENERIC:
            name = "commander_failsafe_enter_generic_warn"
            self._announcer.announce(2, "Failsafe activated", name, "I", custom_mode)
        else:
            name = "commander_failsafe_enter_warn"
            self._announcer.announce(2, "Failsafe activated", name, "IB", custom_mode, cause)


class CheckSkipper:
    """Skips the checks of one vehicle in a steady flight while they would give the same result as last time.

    `Commander` runs the checks at 10 Hz, usually with the same inputs as last time. Their result depends only
    on the values that are compared here; on commands, parameters and the commander's state, whose change ends
    the steady flight; and on time, but only if a sensor sends no data, the position was lost, or a link has
    been connected since boot. In these conditions no check is skipped.
    """

    def __init__(
        self,
        view: VehicleView,
        checks: Checks,
        failsafe: FailsafeWatch,
        fence: FenceWatch,
    ) -> None:
        self._checks, self._failsafe, self._fence = checks, failsafe, fence
        self._simulation, self._row = view.simulation, view.row
        sensors = view.simulation.sensors
        self._baro_fresh, self._mag_fresh = bool_view(sensors.baro_fresh), bool_view(sensors.mag_fresh)
        self._gnss_used = bool_view(view.simulation.fusion.gnss_pos)
        self._inputs: tuple[object, ...] | None = None
        """Inputs of the last checks; None: the next checks must run."""

    def reset(self) -> None:
        """Makes the next checks run, because a full tick may change values that are not compared."""
        self._inputs = None

    def store_inputs(self, armed_at_s: float) -> None:
        """Stores the inputs of the checks that have just run in a steady tick."""
        self._inputs = self._read_inputs(armed_at_s)

    def skip_if_unchanged(self, armed_at_s: float) -> bool:
        """Whether the inputs are unchanged; True: this call replaces the checks."""
        if self._inputs is None or self._read_inputs(armed_at_s) != self._inputs:
            self._inputs = None
            return False
        self._checks.sensors.note_fresh_data()
        return True

    def _read_inputs(self, armed_at_s: float) -> tuple[object, ...] | None:
        """The inputs of the checks; None: the result also depends on time."""
        checks, simulation, row = self._checks, self._simulation, self._row
        estimate, now_s = simulation.estimates[row], simulation.time_s
        if (
            checks.has_been_connected
            or checks.has_unreported_change
            or not estimate.valid_position
            or now_s < checks.position_usable_at_s
            or not (self._baro_fresh[row] and self._mag_fresh[row])
            or self._failsafe.decision is not NO_FAILSAFE
            or self._failsafe.in_early_takeoff(now_s - armed_at_s)
        ):
            return None
        return (
            checks.report, estimate.valid_velocity, estimate.valid_attitude, checks.offboard.has_signal(),
            checks.battery_warning, self._gnss_used[row], self._fence.breaches, checks.logging,
            checks.external.health(),
        )  # fmt: skip
