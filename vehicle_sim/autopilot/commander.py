"""Who is in charge: arming, the mode asked for and the mode flown, failsafes, automatic disarming."""

from __future__ import annotations

from enum import IntEnum

from vehicle_sim.autopilot import health
from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.body import Body
from vehicle_sim.autopilot.checks import Checks
from vehicle_sim.autopilot.failsafe import ACTION_MODES, Action, Cause, Conditions, Decision, decide
from vehicle_sim.autopilot.home import HomeKeeper
from vehicle_sim.autopilot.land_detector import LandedState
from vehicle_sim.autopilot.modes import MODES, NavState
from vehicle_sim.autopilot.navigator import Navigator
from vehicle_sim.autopilot.offboard import Kind, Offboard
from vehicle_sim.autopilot.row import SetpointRow

NAVIGATION_GROUPS = {
    NavState.MANUAL: 0,
    NavState.ALTITUDE: 1,
    NavState.POSITION: 2,
    NavState.MISSION: 3,
    NavState.HOLD: 4,
    NavState.RTL: 5,
    NavState.ACRO: 6,
    NavState.OFFBOARD: 7,
    NavState.STABILIZED: 8,
}


class Reason(IntEnum):
    """Why the vehicle was armed or disarmed, as its events number it."""

    EXTERNAL_COMMAND = 4
    LANDING = 6
    PREFLIGHT = 7
    KILL = 8
    FAILSAFE = 5


_DISARM_TEXTS = {
    Reason.EXTERNAL_COMMAND: "external command",
    Reason.LANDING: "landing",
    Reason.PREFLIGHT: "auto preflight disarming",
    Reason.FAILSAFE: "failsafe",
    Reason.KILL: "kill-switch",
}


class Commander:
    """The state machine of one vehicle."""

    def __init__(
        self, body: Body, announcer: Announcer, row: SetpointRow, navigator: Navigator, offboard: Offboard
    ) -> None:
        self._body = body
        self._announcer = announcer
        self._row = row
        self._navigator = navigator
        self.offboard = offboard
        self.home = HomeKeeper(body, navigator.home)
        self.checks = Checks(body, announcer, offboard, navigator.home)
        self.armed = False
        self.intended = NavState.HOLD
        self.active = NavState.HOLD
        self.landed = True
        self.terminated = False
        self.failsafe = Decision()
        self._armed_at_s = 0.0
        self._landed_at_s = 0.0
        self._flew = False
        self._failsafe_since_s: float | None = None
        self._overridden: set[Cause] = set()

    # --- commands --------------------------------------------------------------------------------------

    def arm(self) -> bool:
        """Arm if every check allows it in this mode; says why not."""
        if self.armed:
            return True
        self._check()
        if not self.report.armable(self.intended):
            self._announcer.both(
                2, "Arming denied: Resolve system health failures first",
                "commander_arm_denied_resolve_failures",
            )  # fmt: skip
            return False
        self.armed = True
        self._armed_at_s = self._body.time_s
        self._flew = False
        self._overridden.clear()
        self._row.armed(True)
        self.home.set_here()
        self._announcer.both(
            6, "Armed by external command", "commander_armed_by", "B", Reason.EXTERNAL_COMMAND
        )
        self._navigator.enter(self.active, self.active, in_air=False)
        return True

    def disarm(self, reason: Reason = Reason.EXTERNAL_COMMAND, *, force: bool = False) -> bool:
        """Stop the motors; in the air only when forced."""
        if not self.armed:
            return True
        if not self.landed and not force:
            self._announcer.both(2, "Disarming denied: not landed", "commander_disarm_denied_not_landed")
            return False
        self.armed = False
        self._row.armed(False)
        self._row.idle()
        self._announcer.both(6, f"Disarmed by {_DISARM_TEXTS[reason]}", "commander_disarmed_by", "B", reason)
        self._body.simulation.refill_battery(self._body.row)
        self._overridden.clear()
        self._failsafe_since_s = None
        self.failsafe = Decision()
        if self.intended in (NavState.LAND, NavState.RTL, NavState.TAKEOFF, NavState.PRECISION_LAND):
            self.intended = NavState.HOLD
        self._activate(self.intended)
        return True

    def set_mode(self, mode: NavState) -> bool:
        """Change the mode asked for; in flight only to one that can run."""
        if self.armed and not self._can_switch(mode):
            self._announcer.both(
                2,
                f"Switching to {MODES[mode].name} is currently not available",
                "commander_modeswitch_not_avail",
                "IB",
                MODES[mode].custom_mode,
                NAVIGATION_GROUPS.get(mode, 9),
            )
            return False
        if self.failsafe.action > Action.WARN and self.failsafe.cause is not Cause.GENERIC:
            self._overridden.add(self.failsafe.cause)
        self.intended = mode
        self.failsafe = self.failsafe if self.terminated else self._decide()
        if self.failsafe.action <= Action.WARN:
            self._failsafe_since_s = None
            restart = mode in (NavState.TAKEOFF,) and self.active is mode
            self._activate(mode, restart=restart)
        return True

    def _can_switch(self, mode: NavState) -> bool:
        if self.terminated:
            return False
        return mode is self.active or self.checks.fresh(self.intended, terminated=self.terminated).runnable(
            mode
        )

    def terminate(self) -> bool:
        """End the flight: motors off, for good. Only while armed."""
        if not self.armed:
            return False
        self.terminated = True
        self._enter_failsafe(Decision(Action.TERMINATE))
        return True

    def run_checks(self) -> None:
        """RUN_PREARM_CHECKS: check and report now."""
        self._check()
        self.checks.announce()

    # --- each tick -------------------------------------------------------------------------------------

    def update(self, *, landed: bool) -> None:
        """Check, fail safe, disarm: call at 50 Hz after the land detector."""
        self._note_landing(landed)
        if not self.armed:
            self.home.follow()
        self._check()
        self._run_failsafe()
        self._auto_disarm()
        self._end_takeoff()

    def _end_takeoff(self) -> None:
        arrived = self.active is NavState.TAKEOFF and self._navigator.finished(NavState.TAKEOFF)
        if self.armed and arrived:
            self.intended = NavState.HOLD
            self._activate(NavState.HOLD)

    def _note_landing(self, landed: bool) -> None:
        if landed == self.landed:
            return
        self.landed = landed
        now_s = self._body.time_s
        if landed:
            self._landed_at_s = now_s
            if self.armed:
                self._announcer.both(6, "Landing detected", "commander_landing_detected")
        elif self.armed:
            self._flew = True
            self._announcer.both(6, "Takeoff detected", "commander_takeoff_detected")
            self.home.lifted()

    def _check(self) -> None:
        self.checks.run(self.intended, terminated=self.terminated)

    @property
    def report(self) -> health.Report:
        """The arming report."""
        return self.checks.report

    # --- failsafe --------------------------------------------------------------------------------------

    def _decide(self) -> Decision:
        if not self.armed or (self.landed and not self._flew and self.intended is not NavState.OFFBOARD):
            return Decision()
        body, belief = self._body, self._body.belief
        needs_position = MODES[self.intended].needs_position
        if self.intended is NavState.OFFBOARD:
            kind = self.offboard.setpoint.kind
            needs_position = kind in (Kind.POSITION, Kind.VELOCITY, Kind.ACCELERATION)
        return decide(
            Conditions(
                mode=self.intended,
                offboard_lost=not self.offboard.signal(),
                offboard_loss_action=body.choice("COM_OBL_RC_ACT"),
                position_lost=needs_position and not belief.valid_position,
                gcs_lost=self.checks.gcs_lost(),
                gcs_loss_action=body.choice("NAV_DLL_ACT"),
                battery_warning=self.checks.battery_warning,
                low_battery_action=body.choice("COM_LOW_BAT_ACT"),
                overridden=frozenset(self._overridden),
            )
        )

    def _run_failsafe(self) -> None:
        if self.terminated:
            return
        decision = self._decide()
        if decision != self.failsafe:
            if decision.action is Action.NONE:
                self.failsafe = decision
                self._failsafe_since_s = None
                if self.armed:
                    self._activate(self.intended)
                return
            self._enter_failsafe(decision)
        elif decision.delayed and self._delay_over():
            self._failsafe_since_s = None
            self._announcer.both(
                2, "Failsafe activated", "commander_failsafe_enter", "IBB",
                MODES[self.intended].custom_mode, decision.action, decision.cause,
            )  # fmt: skip
            self._act(decision.action)

    def _delay_over(self) -> bool:
        since_s = self._failsafe_since_s
        return since_s is not None and self._body.time_s - since_s >= self._body.parameter("COM_FAIL_ACT_T")

    def _enter_failsafe(self, decision: Decision) -> None:
        self.failsafe = decision
        custom = MODES[self.intended].custom_mode
        delay_s = self._body.parameter("COM_FAIL_ACT_T")
        if decision.action is Action.WARN:
            if decision.cause is Cause.BATTERY_LOW:
                self._announcer.both(2, "Failsafe activated", "commander_failsafe_enter_low_bat")
            return
        if decision.delayed and 0.0 < delay_s < 65535.0:
            self._failsafe_since_s = self._body.time_s
            self._announcer.both(
                2, f"Failsafe activated: entering Hold for {delay_s:.0f} seconds",
                "commander_failsafe_enter_hold", "IBHB", custom, decision.action, int(delay_s),
                decision.cause,
            )  # fmt: skip
            self._act(Action.HOLD)
            return
        name = "commander_failsafe_enter_generic"
        if decision.action in (Action.FALLBACK_ALTITUDE, Action.FALLBACK_STABILIZED):
            name = "commander_failsafe_enter_autopilot_disengaged"
        self._announcer.both(2, "Failsafe activated", name, "IB", custom, decision.action)
        self._act(decision.action)

    def _act(self, action: Action) -> None:
        if action is Action.DISARM:
            self.disarm(Reason.FAILSAFE, force=True)
            return
        mode = ACTION_MODES.get(action)
        if mode is None:
            return
        if MODES[mode].needs_position and not self._body.belief.valid_position:
            mode = NavState.DESCEND
        self._activate(mode)

    @property
    def in_failsafe(self) -> bool:
        """Flying something else than was asked for."""
        return self.failsafe.action > Action.WARN

    # --- modes and disarming ---------------------------------------------------------------------------

    def _activate(self, mode: NavState, *, restart: bool = False) -> None:
        if mode is self.active and not restart:
            return
        previous, self.active = self.active, mode
        if self.armed:
            self._navigator.enter(mode, previous, in_air=not self.landed)

    def _auto_disarm(self) -> None:
        if not self.armed or not self.landed:
            return
        now_s = self._body.time_s
        landing_s = self._body.parameter("COM_DISARM_LAND")
        preflight_s = self._body.parameter("COM_DISARM_PRFLT")
        if self._flew:
            if landing_s > 0.0 and now_s - self._landed_at_s >= landing_s:
                self.disarm(Reason.LANDING)
        elif preflight_s > 0.0 and now_s - self._armed_at_s >= preflight_s:
            self.disarm(Reason.PREFLIGHT)

    def landed_state(self) -> LandedState:
        """MAV_LANDED_STATE as EXTENDED_SYS_STATE reports it."""
        if self.landed:
            return LandedState.ON_GROUND
        if self.active is NavState.TAKEOFF:
            return LandedState.TAKEOFF
        if self.active in (NavState.LAND, NavState.PRECISION_LAND):
            return LandedState.LANDING
        if self.active is NavState.RTL and self._navigator.landing:
            return LandedState.LANDING
        return LandedState.IN_AIR

    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode of the mode flown."""
        return MODES[self.active].custom_mode

    def intended_custom_mode(self) -> int:
        """The mode asked for."""
        return MODES[self.intended].custom_mode

    def base_mode(self) -> int:
        """HEARTBEAT.base_mode."""
        mode = MODES[self.active]
        flags = mode.base_flags | 16
        if self.active in (NavState.ACRO, NavState.TERMINATION):
            flags &= ~16
        if self.active is NavState.OFFBOARD:
            kind = self.offboard.setpoint.kind
            if not self.offboard.signal() or kind in (Kind.NONE, Kind.RATES):
                flags &= ~16
        return flags | (128 if self.armed else 0)

    def system_status(self) -> int:
        """MAV_STATE."""
        if self.terminated:
            return 8
        if self.armed:
            return 5 if self.in_failsafe else 4
        return 3 if self.report.armable(self.intended) else 0
