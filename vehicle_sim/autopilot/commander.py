"""The commander: arming, intended and active mode, failsafes, automatic disarming."""

from __future__ import annotations

import math

from vehicle_sim.autopilot import health
from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.arming import REASONS, FlightStatistics, Reason, arming_denial, auto_disarm_after_s
from vehicle_sim.autopilot.checks import Checks
from vehicle_sim.autopilot.failsafe import ACTION_MODES, Action, Decision
from vehicle_sim.autopilot.failsafe_watch import CheckSkipper, FailsafeWatch
from vehicle_sim.autopilot.land_detector import LandedState
from vehicle_sim.autopilot.modes import CANNOT_TAKE_OFF, MODES, NavState, event_number
from vehicle_sim.autopilot.monitors import Monitors
from vehicle_sim.autopilot.navigator import Navigator
from vehicle_sim.autopilot.offboard import Offboard
from vehicle_sim.autopilot.own_commands import PARACHUTE, RETURN, SET_HOME, OwnCommands
from vehicle_sim.autopilot.setpoint_writer import SetpointWriter
from vehicle_sim.autopilot.sticks import Sticks
from vehicle_sim.external_modes.registry import ExternalModes, is_external
from vehicle_sim.external_modes.requirements import built_in_requirements
from vehicle_sim.home import HomeUpdater
from vehicle_sim.vehicle_view import VehicleView

CHECK_EVERY_TICKS = 5
"""Interval of the checks: 10 Hz as in PX4; a change of the commander's state also makes them due."""
REPORT_EVERY_S = 1.0
"""Minimum interval between two reports."""


class ModeRefusals:
    """Reports the refused mode changes of one vehicle."""

    def __init__(self, view: VehicleView, announcer: Announcer) -> None:
        self._view, self._announcer = view, announcer
        self._reported_at_s = -math.inf

    def report(self, mode: NavState) -> None:
        """Reports that a mode is not available; does nothing within REPORT_EVERY_S of the last report."""
        now_s = self._view.time_s
        if now_s - self._reported_at_s <= REPORT_EVERY_S:
            return
        self._reported_at_s = now_s
        self._announcer.announce(
            2, f"Switching to {MODES[mode].name} is currently not available",
            "commander_modeswitch_not_avail", "IB",
            MODES[mode].custom_mode, event_number(mode),
        )  # fmt: skip


class Commander:
    """The state machine of one vehicle."""

    def __init__(
        self,
        view: VehicleView,
        announcer: Announcer,
        setpoints: SetpointWriter,
        navigator: Navigator,
        offboard: Offboard,
        commands: OwnCommands,
        sticks: Sticks,
    ) -> None:
        self._view = view
        self._sticks = sticks
        self._flight_statistics = FlightStatistics(view)
        self._announcer = announcer
        self._setpoints = setpoints
        self._navigator = navigator
        self.offboard = offboard
        self.home = HomeUpdater(view, navigator.home)
        self.monitors = Monitors(view, announcer)
        self.external = ExternalModes(
            view.parameters.mode_hashes,
            view.parameters.store_mode_hash,
            built_in_requirements(altitude_cruise=view.px4.altitude_cruise),
        )
        self.checks = Checks(view, announcer, offboard, navigator.home, self.monitors, self.external)
        self.armed = False
        self.intended = self.active = NavState.HOLD
        self._selected = NavState.HOLD
        """The mode that a command or a failsafe has selected; an external mode can replace it in `active`."""
        self.landed = True
        self.terminated = self.calibrating = False
        self._mode_was_selected = False
        self.refusals = ModeRefusals(view, announcer)
        self.failsafe_watch = FailsafeWatch(
            view, announcer, self.checks, offboard, navigator.fence, self.monitors
        )
        self._check_skipper = CheckSkipper(view, self.checks, self.failsafe_watch, navigator.fence)
        self._commands = commands
        commands.add_handlers({RETURN: self._handle_return, SET_HOME: self._handle_set_home})
        self._termination: Decision | None = None
        self._mode_after_disarming = NavState.HOLD
        """The last requested mode that allows arming; restored at disarming."""
        self.armed_at_s = 0.0
        self.landed_at_s = 0.0
        self.took_off = False
        self._ticks = 0
        self._checked_state: tuple[object, ...] = ()
        """The commander's state at the last check."""

    # --- commands --------------------------------------------------------------------------------------

    def arm(self, reason: Reason = Reason.EXTERNAL_COMMAND) -> bool:
        """Arms if all checks allow it in this mode; otherwise reports the reason."""
        if self.armed:
            return True
        self._check()
        denial = arming_denial(self.report, self.intended, self._sticks, calibrating=self.calibrating)
        if denial is not None:
            text, event_suffix = denial
            self._announcer.announce(2, f"Arming denied: {text}", f"commander_arm_denied_{event_suffix}")
            return False
        self.armed = True
        self.armed_at_s = self._view.time_s
        self.took_off = False
        self.failsafe_watch.reset()
        self._setpoints.set_armed(True)
        self.home.on_arming()
        self._announcer.announce(6, f"Armed by {REASONS[reason]}", "commander_armed_by", "B", reason)
        self._navigator.enter(self.active, self.active, in_air=False)
        return True

    def disarm(self, reason: Reason = Reason.EXTERNAL_COMMAND, *, force: bool = False) -> bool:
        """Disarms; a vehicle in the air disarms only with `force`."""
        if not self.armed:
            return True
        if not self.landed and not force:
            self._announcer.announce(2, "Disarming denied: not landed", "commander_disarm_denied_not_landed")
            return False
        self.armed = False
        self._setpoints.set_armed(False)
        self._setpoints.disable_controllers()
        self._announcer.announce(6, f"Disarmed by {REASONS[reason]}", "commander_disarmed_by", "B", reason)
        self.failsafe_watch.reset()
        self._flight_statistics.on_disarming()
        self._navigator.leave_mission()
        self._select_mode_of_disarmed()
        return True

    def _select_mode_of_disarmed(self) -> None:
        """Selects the mode before the landing; from v1.17 on the mode that the executor in charge owns, and
        Hold instead of one that does not answer."""
        if self._view.px4.disarms_to_owned_mode:
            selected = self.external.mode_after_disarming(self._mode_after_disarming)
            self.external.on_mode_change(selected)
            self._mode_after_disarming = NavState(selected)
        self.intended = self._mode_after_disarming
        self._activate(self.intended)

    def set_mode(self, mode: NavState) -> bool:
        """Changes the intended mode; an armed vehicle changes only to a mode that can run."""
        self._load_mission()
        if self.armed and not self._can_switch(mode):
            return False
        self._mode_was_selected = True
        self._change_mode(mode)
        return True

    def on_stick_input(self) -> None:
        """Called at stick input: a disarmed vehicle switches to Position if no mode has been selected yet."""
        if not self.armed and not self._mode_was_selected:
            self.set_mode(NavState.POSITION)

    def _change_mode(self, mode: NavState) -> None:
        self.intended = mode = NavState(self.external.replaced_mode(mode))
        self.external.on_mode_change(mode)
        if mode not in CANNOT_TAKE_OFF:
            self._mode_after_disarming = mode
        self.failsafe_watch.on_mode_change()
        if self.armed:
            self._run_failsafe()
        if self.failsafe.action <= Action.WARN:
            restart = mode is NavState.TAKEOFF and self.active is mode
            self._activate(mode, restart=restart)

    def return_to_launch(self) -> bool:
        """Handles RETURN_TO_LAUNCH; PX4 reports the return before the navigator reports the destination."""
        if self.armed and not self._can_switch(NavState.RTL):
            self.refusals.report(NavState.RTL)
            return False
        if self.active is NavState.MISSION and self._navigator.mission.finished and not self.landed:
            self._switch_after_task(NavState.HOLD)  # as the last item of the mission
        self._announcer.announce(6, "Returning to launch", "commander_rtl")
        return self.set_mode(NavState.RTL)

    def start_mission(self, first_item: float) -> bool | None:
        """Handles MISSION_START: switches to Mission and arms; None: no valid mission, or no such item.

        Args:
            first_item: index from 0; -1 continues at the current item.
        """
        self._load_mission()
        if not self.checks.has_mission:
            self._announcer.announce(
                2, "Mission start denied! No valid mission", "commander_mission_start_denied_no_mission"
            )
            return None
        if not -1.0 <= first_item < self._navigator.mission.count:
            return None
        if first_item >= 0.0:
            self._navigator.mission.set_current(int(first_item))
        if self.set_mode(NavState.MISSION) and self.arm(Reason.MISSION_START):
            return True
        self.refusals.report(NavState.MISSION)
        return False

    def _handle_return(self, _parameters: tuple[float, ...]) -> None:
        self.return_to_launch()

    def _handle_set_home(self, parameters: tuple[float, ...]) -> None:
        use_current, roll_deg, pitch_deg, yaw_deg, lat_deg, lon_deg, alt_amsl_m = parameters
        if use_current == 1.0:
            self.home.set_to_current_position()
        elif abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0:
            self.home.set(lat_deg, lon_deg, alt_amsl_m, (roll_deg, pitch_deg, yaw_deg))

    def _can_switch(self, mode: NavState) -> bool:
        if self.terminated:
            return False
        mode = NavState(self.external.replaced_mode(mode))
        report = self.checks.current_report(self.intended, armed=self.armed, terminated=self.terminated)
        return mode is self.active or report.runnable(mode)

    def terminate(self) -> bool:
        """Terminates the flight: stops the motors permanently; has no effect while disarmed."""
        if not self.armed:
            return False
        self.intended = self._mode_after_disarming = NavState.TERMINATION
        self._announcer.announce(
            2, "Failsafe activated", "commander_failsafe_enter_generic", "IB",
            MODES[self.intended].custom_mode, Action.TERMINATE,
        )  # fmt: skip
        self._terminate_flight()
        return True

    def run_checks(self) -> None:
        """Handles RUN_PREARM_CHECKS: runs the checks, and sends their report."""
        self._check()
        self.checks.announce()

    # --- each tick -------------------------------------------------------------------------------------

    def update(self, *, landed: bool) -> None:
        """Runs checks, failsafe and automatic disarming; call at 50 Hz after the land detector."""
        self._check_skipper.reset()
        self._update_landed(landed)
        if self.armed:
            self.home.correct()
        else:
            self.home.update_disarmed()
        self._navigator.check_fence_and_rally_points(landed=landed)
        self._load_mission()
        self.monitors.update(armed=self.armed, landed=landed)
        if self._check_is_due():
            self._run_checks()
        if self.external.effective_mode(self._selected) != self.active:
            self._activate(self._selected)
        self._update_mode(landed)

    def update_steady(self) -> bool:
        """Runs a tick of a steady flight; False: a check has changed the vehicle's state."""
        self.home.correct()
        self._navigator.fence.check()
        self._ticks += 1
        if self._ticks % CHECK_EVERY_TICKS != 0 or self._check_skipper.skip_if_unchanged(self.armed_at_s):
            return True
        self._run_checks()
        if self.allows_steady_flight:
            self._check_skipper.store_inputs(self.armed_at_s)
            return True
        self._update_mode(self.landed)
        return False

    @property
    def allows_steady_flight(self) -> bool:
        """Whether the vehicle is armed, no failsafe acts, no monitor needs updates and no check is due."""
        if not self.armed or self.terminated or self.failsafe.action is not Action.NONE:
            return False
        return self.monitors.needs_no_update and self._checked_state == self._state()

    def _state(self) -> tuple[object, ...]:
        """The state whose change makes the checks due."""
        return self.armed, self.intended, self.active, self.landed, self.checks.has_mission

    def _run_checks(self) -> None:
        self.checks.fence = self._navigator.fence.breaches
        self.checks.report_losses(armed=self.armed)
        self._check()
        self._run_failsafe()

    def _update_mode(self, landed: bool) -> None:
        if self.armed and not self.terminated:
            self._navigator.update_mode(self.active, landed=landed)
            self._end_task()
        self._auto_disarm()

    def _check_is_due(self) -> bool:
        """Whether the checks are due: at 10 Hz, after a change of the commander's state, and at each tick of
        a failsafe."""
        self._ticks += 1
        state = self._state()
        changed, self._checked_state = state != self._checked_state, state
        return changed or self._ticks % CHECK_EVERY_TICKS == 0 or self.failsafe.action is not Action.NONE

    def _load_mission(self) -> None:
        """Loads a changed mission; called at each tick, and before a command that may start the mission."""
        mission = self._navigator.mission
        mission.load_plan(armed=self.armed)
        self.checks.has_mission = mission.valid(landed=self.landed)

    def _end_task(self) -> None:
        """Switches to Hold after a mission, and after a take-off to Hold or Mission (COM_TAKEOFF_ACT)."""
        mission = self._navigator.mission
        taking_off = self.active is NavState.TAKEOFF and not self.landed
        ends_takeoff = taking_off and not self.external.executor_in_charge
        if ends_takeoff and self._navigator.takeoff_finished(self.active):
            starts_mission = self._view.choice("COM_TAKEOFF_ACT") == 1 and self.checks.has_mission
            self._switch_after_task(NavState.MISSION if starts_mission else NavState.HOLD)
            return
        ended = mission.finished or not self.checks.has_mission
        if ended and self.active is NavState.MISSION and not self.landed:
            if not self.checks.has_mission:
                text = "No valid mission available, loitering"
                self._announcer.announce(2, text, "mission_not_valid_loiter")
            self._switch_after_task(NavState.HOLD)

    def _switch_after_task(self, mode: NavState) -> None:
        self.intended = self._mode_after_disarming = mode
        self.external.on_mode_change(mode)
        self._activate(mode)

    def _update_landed(self, landed: bool) -> None:
        if landed == self.landed or self.terminated:
            return
        self.landed = landed
        if landed:
            self.landed_at_s = self._view.time_s
            if self.armed:
                self._announcer.announce(6, "Landing detected", "commander_landing_detected")
        elif self.armed:
            again_in_mission = self.took_off and self.active is NavState.MISSION
            self.took_off = True
            self._flight_statistics.on_takeoff()
            self._announcer.announce(6, "Takeoff detected", "commander_takeoff_detected")
            self.home.on_takeoff(again_in_mission=again_in_mission)

    def _check(self) -> None:
        self.checks.run(self.intended, armed=self.armed, terminated=self.terminated)

    @property
    def report(self) -> health.CheckResults:
        """The arming report."""
        return self.checks.report

    # --- failsafe --------------------------------------------------------------------------------------

    def _run_failsafe(self) -> None:
        if self.terminated or not self.armed:
            return
        externally_commanded = self.intended is NavState.OFFBOARD or is_external(self.intended)
        may_act = not self.landed or self.took_off or externally_commanded
        previous = self.failsafe
        decision = self.failsafe_watch.update(
            self.intended,
            armed_for_s=self._view.time_s - self.armed_at_s,
            may_act=may_act or self.monitors.attitude_failure,
            overrides=self.external.overrides(self.active),
        )
        if decision is previous or decision == previous:
            return
        if decision.action > Action.WARN:
            self._execute(decision.action)
        elif previous.action > Action.WARN:
            self._activate(self.intended)

    @property
    def failsafe(self) -> Decision:
        """The current decision of the failsafe."""
        return self._termination or self.failsafe_watch.decision

    def _execute(self, action: Action) -> None:
        if action is Action.DISARM:
            self.disarm(Reason.FAILSAFE, force=True)
            return
        if action is Action.TERMINATE:
            self._terminate_flight()
            return
        mode = ACTION_MODES.get(action)
        if mode is not None:
            self._activate(mode)

    def _terminate_flight(self) -> None:
        self.terminated = True
        self._termination = Decision(Action.TERMINATE)
        self._commands.send(PARACHUTE, 2.0)
        self._activate(NavState.TERMINATION)

    @property
    def intended_or_replacement(self) -> NavState:
        """The intended mode; if an external mode replaces it, the external mode."""
        return NavState(self.external.effective_mode(self.intended))

    @property
    def in_failsafe(self) -> bool:
        """Whether a failsafe has replaced the intended mode."""
        return self.failsafe.action > Action.WARN

    # --- modes and disarming ---------------------------------------------------------------------------

    def _activate(self, mode: NavState, *, restart: bool = False) -> None:
        self._selected = mode
        effective = NavState(self.external.effective_mode(mode))
        if effective is self.active and not restart:
            return
        previous, self.active = self.active, effective
        if self.armed:
            self._navigator.enter(effective, previous, in_air=not self.landed)

    def _auto_disarm(self) -> None:
        if not self.armed or not self.landed or self.terminated:
            return
        now_s = self._view.time_s
        if self.external.overrides(self.active).disable_auto_disarm:
            self.landed_at_s = now_s  # the delay starts again
            return
        if self.took_off and self.active is NavState.MISSION and not self._navigator.mission.finished:
            return
        delay_start_s = self.landed_at_s if self.took_off else self.armed_at_s
        if now_s - delay_start_s >= auto_disarm_after_s(self._view, took_off=self.took_off):
            self.disarm(Reason.LANDING if self.took_off else Reason.PREFLIGHT)

    def landed_state(self) -> LandedState:
        """MAV_LANDED_STATE as EXTENDED_SYS_STATE reports it."""
        return LandedState.ON_GROUND if self.landed else self._navigator.landed_state_in_air(self.active)

    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        return MODES[self.active].custom_mode

    def intended_custom_mode(self) -> int:
        """The custom_mode of the intended mode, or of its replacement."""
        return MODES[self.intended_or_replacement].custom_mode
