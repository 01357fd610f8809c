"""Commands of PX4's commander and navigator: their effects and results."""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle_sim.autopilot.arming import Reason
from vehicle_sim.autopilot.modes import (
    STANDARD_MODES,
    NavState,
    UnsupportedAutoMode,
    exists,
    from_numbers,
)
from vehicle_sim.commands.command import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    FAILED,
    IN_PROGRESS,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Command,
    CommandHost,
    Handler,
)
from vehicle_sim.geodesy import is_position

NO_ACKNOWLEDGEMENT = frozenset(
    {0, 1, 2, 93, 203, 206, 214, 242, 243, 260, 311, 500, 521, 530, 531, 532, 2003, 3000, 30001, 30002,
     42600}
)  # fmt: skip
"""Commands that PX4 does not acknowledge, because no module handles them or the module sends no result."""
ALWAYS_ACCEPTED = frozenset({187, 191})
"""Commands without effect here: set actuators, go around (fixed wing)."""
ARM_DISARM, SET_MODE, SET_STANDARD_MODE = 400, 176, 262
TAKEOFF, LAND, RETURN, PRECISION_LAND, ORBIT, FIGURE_EIGHT = 22, 21, 20, 23, 34, 35
REPOSITION, CHANGE_SPEED, SET_HOME, TERMINATE, MISSION_START = 192, 178, 179, 185, 300
CHANGE_ALTITUDE, GO_TO_LANDING, HIGH_LATENCY = 186, 189, 2600
RUN_PREARM_CHECKS, STORAGE, REBOOT, ACTUATOR_TEST = 401, 245, 246, 310
GRIPPER, AUTOTUNE, EXTERNAL_POSITION, EXTERNAL_WIND = 211, 212, 43003, 43004
VTOL_TAKEOFF = 84
SET_NAV_STATE = 100_001
"""PX4 accepts this command only from its own modules and over ROS 2; the number is too large for MAVLink."""
FORCE_DISARM = 21196
"""param2 of ARM_DISARM."""
AUTO_FLAG, GUIDED_FLAG, STABILIZE_FLAG, MANUAL_FLAG, CUSTOM_FLAG = 4, 8, 16, 64, 1
"""MAV_MODE_FLAG."""
FIRST_MOTOR, FIRST_SERVO, MOTOR_COUNT, SERVO_COUNT, FIRST_PX4_FUNCTION = 1, 33, 12, 8, 1000
"""ACTUATOR_OUTPUT_FUNCTION; numbers from 1000 on are PX4-specific."""
LOAD_PARAMETERS, SAVE_PARAMETERS = 0, 1
"""param1 of PREFLIGHT_STORAGE."""
STORAGE_RESETS = {
    2: (("*",), ("LND_FLIGHT_T_HI", "LND_FLIGHT_T_LO", "COM_FLIGHT_UUID")),
    3: (("CAL_ACC*", "CAL_GYRO*", "CAL_MAG*"), ()),
    4: (("*",), ()),
}
"""Parameters to reset, and exceptions, by param1 of PREFLIGHT_STORAGE."""
GRIPPER_TIMEOUT_S = 1.0
"""PD_GRIPPER_TO: after this time the movement of a gripper without feedback counts as finished."""
ALTITUDE_LIMIT_M = 100_000.0
"""Largest altitude that messages can contain."""
INT32_MAX = 0x7FFFFFFF
REPOSITION_CHANGE_MODE = 1
"""The only flag of DO_REPOSITION that PX4 supports; it must be set."""
GROUND_STATION_COMPONENT = 190
"""Component id of ground stations; PX4 sends a text about a refused DO_SET_MODE only for this sender."""


class FlightCommands:
    """The commands that the commander and the navigator execute."""

    def __init__(self, host: CommandHost) -> None:
        self._host = host
        self._commander = host.autopilot.commander
        self._navigator = host.autopilot.navigator
        self._announcer = host.autopilot.announcer
        self._gripper_closed = True
        self.commands: dict[int, Handler] = {
            **dict.fromkeys(NO_ACKNOWLEDGEMENT, lambda c: None),
            **dict.fromkeys(ALWAYS_ACCEPTED, lambda c: ACCEPTED),
            ARM_DISARM: self._arm,
            SET_MODE: self._set_mode,
            SET_STANDARD_MODE: self._set_standard_mode,
            SET_NAV_STATE: self._set_nav_state,
            TAKEOFF: self._takeoff,
            LAND: self._land,
            RETURN: self._return,
            PRECISION_LAND: self._precision_land,
            ORBIT: self._orbit,
            FIGURE_EIGHT: self._figure_eight,
            REPOSITION: self._reposition,
            CHANGE_ALTITUDE: self._change_altitude,
            GO_TO_LANDING: self._go_to_landing,
            HIGH_LATENCY: self._high_latency,
            CHANGE_SPEED: self._change_speed,
            SET_HOME: self._set_home,
            TERMINATE: self._terminate,
            MISSION_START: self._mission_start,
            RUN_PREARM_CHECKS: self._run_prearm_checks,
            STORAGE: self._storage,
            REBOOT: lambda c: ACCEPTED if c.p1 == 0.0 else DENIED,
            ACTUATOR_TEST: self._actuator_test,
            GRIPPER: self._gripper,
            AUTOTUNE: self._autotune,
            # An external position is used only during dead reckoning.
            EXTERNAL_POSITION: lambda c: TEMPORARILY_REJECTED,
            EXTERNAL_WIND: self._external_wind,
            # PX4 accepts this mode on every vehicle; a multicopter then keeps its position.
            VTOL_TAKEOFF: lambda c: self._switch(NavState.VTOL_TAKEOFF),
        }

    # --- arming and modes ------------------------------------------------------------------------------

    def _arm(self, c: Command) -> int | None:
        action = _rounded(c.p1)
        if action == 0:
            reason = Reason.EXTERNAL_COMMAND if c.external else Reason.INTERNAL_COMMAND
            disarmed = self._commander.disarm(reason, force=_rounded(c.p2) == FORCE_DISARM)
            return ACCEPTED if disarmed else TEMPORARILY_REJECTED
        if action != 1:
            self._announcer.announce(
                2, f"Unsupported ARM_DISARM param: {c.p1:.3f}", "commander_unsupported_arm_disarm_param",
                "f", c.p1,
            )  # fmt: skip
            return None
        reason = Reason.EXTERNAL_COMMAND if c.external else Reason.INTERNAL_COMMAND
        return ACCEPTED if self._commander.arm(reason) else TEMPORARILY_REJECTED

    def _set_mode(self, c: Command) -> int:
        base_mode = int(c.p1) & 0xFF if math.isfinite(c.p1) else 0
        if not base_mode & CUSTOM_FLAG:
            mode = _mode_from_flags(base_mode)
            return (
                ACCEPTED
                if mode is None
                else self._switch(mode, report_refusal=c.sender[1] == GROUND_STATION_COMPONENT)
            )
        main_mode = int(c.p2) if math.isfinite(c.p2) else 0
        sub_mode = int(c.p3) if math.isfinite(c.p3) else 0
        try:
            mode = from_numbers(main_mode, sub_mode, self._host.view.px4)
        except UnsupportedAutoMode:
            self._announcer.announce(2, "Unsupported auto mode", "commander_unsupported_auto_mode")
            return TEMPORARILY_REJECTED
        if mode is None:
            return ACCEPTED
        return self._switch(mode, report_refusal=c.sender[1] == GROUND_STATION_COMPONENT)

    def _switch(self, mode: NavState, *, report_refusal: bool = True) -> int:
        if self._commander.set_mode(mode):
            return ACCEPTED
        if report_refusal:
            self._commander.refusals.report(mode)
        return TEMPORARILY_REJECTED

    def _set_standard_mode(self, c: Command) -> int:
        mode = STANDARD_MODES.get(int(c.p1) if math.isfinite(c.p1) else 0)
        return FAILED if mode is None else self._switch(mode, report_refusal=False)

    def _set_nav_state(self, c: Command) -> int:
        """Handles SET_NAV_STATE. While disarmed, PX4 accepts an unknown mode number, but does not change the
        mode."""
        number = int(c.p1) if math.isfinite(c.p1) else 0
        if not exists(number, self._host.view.px4):
            return TEMPORARILY_REJECTED if self._commander.armed else ACCEPTED
        return self._switch(NavState(number), report_refusal=False)

    # --- flying ----------------------------------------------------------------------------------------

    def _takeoff(self, c: Command) -> int:
        # The altitude is stored even while disarmed: ground stations may command the take-off before arming.
        self._navigator.request_takeoff(c.p7)
        return self._switch(NavState.TAKEOFF)

    def _land(self, c: Command) -> int:
        result = self._switch(NavState.LAND)
        if result == ACCEPTED:
            self._announcer.announce(6, "Landing at current position", "commander_landing_current_pos")
        return result

    def _return(self, c: Command) -> int:
        return ACCEPTED if self._commander.return_to_launch() else TEMPORARILY_REJECTED

    def _precision_land(self, c: Command) -> int:
        result = self._switch(NavState.PRECISION_LAND)
        if result == ACCEPTED:
            self._announcer.announce(6, "Precision landing", "commander_landing_prec_land")
        return result

    def _orbit(self, c: Command) -> int:
        self._navigator.orbit((c.p5, c.p6, c.p7), c.p1, c.p2, c.p3)
        result = self._switch(NavState.ORBIT, report_refusal=False)
        if result != ACCEPTED:
            self._announcer.text(2, "Orbit refused")
        return result

    def _figure_eight(self, c: Command) -> int | None:
        self._announcer.text(2, "Figure 8 command only available for fixed wing and vtol vehicles.")
        return None

    def _reposition(self, c: Command) -> int:
        flags = int(c.p2) if math.isfinite(c.p2) else 0
        if flags != REPOSITION_CHANGE_MODE:
            return UNSUPPORTED
        outside = self._is_outside_fence(c.p5, c.p6, c.p7)
        was_holding = self._commander.active is NavState.HOLD
        result = self._switch(NavState.HOLD)
        if result != ACCEPTED or not self._commander.armed:
            return result
        if outside:
            self._announcer.announce(
                2, "Reposition is outside geofence", "navigator_reposition_outside_geofence"
            )
        elif self._commander.active is NavState.HOLD:
            self._navigator.goto(c.p5, c.p6, c.p7, c.p4)
            if math.isfinite(c.p1) and c.p1 > 0.0:
                self._navigator.path.cruise_m_s = c.p1
            elif not was_holding:
                self._navigator.path.cruise_m_s = math.nan
        return result

    def _change_altitude(self, c: Command) -> int:
        """Switches to Hold at the altitude AMSL in param1 [m], and stops the vehicle horizontally."""
        outside = self._is_outside_fence(math.nan, math.nan, c.p1)
        result = self._switch(NavState.HOLD)
        if result != ACCEPTED or not self._commander.armed:
            return result
        if outside:
            self._announcer.announce(
                2, "Altitude outside the geofence", "navigator_change_altitude_outside_geofence"
            )
        elif self._commander.active is NavState.HOLD:
            self._navigator.stop_at(c.p1)
        return result

    def _is_outside_fence(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> bool:
        estimate = self._host.view.estimate
        current = estimate.lat_deg, estimate.lon_deg
        lat, lon = (lat_deg, lon_deg) if is_position(lat_deg, lon_deg) else current
        alt = alt_amsl_m if math.isfinite(alt_amsl_m) else estimate.alt_amsl_m
        return math.isfinite(lat) and not self._navigator.fence.allows(lat, lon, alt)

    def _change_speed(self, c: Command) -> int:
        self._navigator.change_speed(c.p1, c.p2)
        return ACCEPTED

    def _set_home(self, c: Command) -> int:
        if not self._host.view.choice("COM_HOME_EN"):
            return DENIED
        if c.p1 > 0.5:
            return ACCEPTED if self._commander.home.set_to_current_position() else TEMPORARILY_REJECTED
        if not (abs(c.p5) <= 90.0 and abs(c.p6) <= 180.0 and abs(c.p7) <= ALTITUDE_LIMIT_M):
            return DENIED
        if not self._host.view.estimate.valid_position:
            return TEMPORARILY_REJECTED
        self._commander.home.set(c.p5, c.p6, c.p7, (c.p2, c.p3, c.p4))
        return ACCEPTED

    def _terminate(self, c: Command) -> int:
        if c.p1 > 0.5 and self._commander.terminate():
            return ACCEPTED
        return DENIED

    def _mission_start(self, c: Command) -> int:
        started = self._commander.start_mission(c.p1)
        if started is None:
            return DENIED
        return ACCEPTED if started else TEMPORARILY_REJECTED

    def _go_to_landing(self, c: Command) -> int:
        """DO_LAND_START: continues the mission at the start of its landing."""
        start = self._navigator.mission.landing_start
        if start is None:
            return CANCELLED
        self._commander.start_mission(float(start))
        return ACCEPTED

    # --- other commands --------------------------------------------------------------------------------

    def _actuator_test(self, c: Command) -> int | None:
        if self._commander.armed or self._host.view.choice("COM_MOT_TEST_EN") != 1:
            return DENIED
        function = int(c.p5 + 0.5) if math.isfinite(c.p5) else 0
        is_known = (
            FIRST_MOTOR <= function < FIRST_MOTOR + MOTOR_COUNT
            or FIRST_SERVO <= function < FIRST_SERVO + SERVO_COUNT
            or function >= FIRST_PX4_FUNCTION
        )
        return ACCEPTED if is_known else None

    def _high_latency(self, c: Command) -> int:
        self._announcer.announce(
            2, "No high-latency telemetry to control", "commander_ctrl_high_latency_failed"
        )
        return FAILED

    def _run_prearm_checks(self, c: Command) -> int:
        self._commander.run_checks()
        return ACCEPTED

    def _storage(self, c: Command) -> int | None:
        if self._commander.armed:
            return TEMPORARILY_REJECTED
        action = int(c.p1) if math.isfinite(c.p1) else -1
        if action in STORAGE_RESETS:
            only, keep = STORAGE_RESETS[action]
            parameters = self._host.view.parameters
            self._host.call_soon(lambda: parameters.reset_all(only=only, keep=keep))
        return ACCEPTED if action in (LOAD_PARAMETERS, SAVE_PARAMETERS, *STORAGE_RESETS) else None

    def _gripper(self, c: Command) -> int | None:
        close = c.p2 == 1.0
        if close == self._gripper_closed:
            return ACCEPTED
        self._gripper_closed = close
        self._host.acknowledge(c, IN_PROGRESS, progress=255)
        self._host.call_later(GRIPPER_TIMEOUT_S, lambda: self._host.acknowledge(c, ACCEPTED))
        return None

    def _autotune(self, c: Command) -> int:
        """DO_AUTOTUNE_ENABLE, which PX4 accepts on the ground; the tuning itself is not simulated."""
        if self._commander.armed:
            self._announcer.text(4, "Autotuning is not simulated")
            return UNSUPPORTED
        self._host.view.parameters.set("MC_AT_START", 1)
        return IN_PROGRESS

    def _external_wind(self, c: Command) -> int:
        self._host.acknowledge(c, ACCEPTED)
        return UNSUPPORTED  # PX4 sends both acknowledgements (recorded)


def _rounded(value: float) -> int:
    """The nearest integer, halves away from zero; 0 for NaN, as recorded on PX4."""
    if math.isnan(value):
        return 0
    return int(math.copysign(math.floor(min(abs(value), INT32_MAX) + 0.5), value))


def _mode_from_flags(base: int) -> NavState | None:
    """The mode that the deprecated base mode flags select; None: no mode."""
    if base & AUTO_FLAG:
        return NavState.MISSION
    if not base & MANUAL_FLAG:
        return None
    if base & GUIDED_FLAG:
        return NavState.POSITION
    return NavState.STABILIZED if base & STABILIZE_FLAG else NavState.MANUAL


INJECT_FAILURE = 420
BATTERY, MOTOR = 100, 101
"""Values of FAILURE_UNIT."""
OK, OFF, WRONG = 0, 1, 4
"""Values of FAILURE_TYPE."""


class FailureCommands:
    """Handles INJECT_FAILURE as in PX4's simulation, if SYS_FAILURE_EN permits failures.

    The battery can be discharged. Motor failures are accepted without an effect on the flight: in PX4 they
    only hide the status of ESCs, and this vehicle has none. PX4 does not acknowledge failures of other units,
    such as sensors; use a fault script for those.
    """

    def __init__(self, host: CommandHost) -> None:
        self._host = host
        self._failures: dict[int, Callable[[int], int | None]] = {
            BATTERY: self._battery,
            MOTOR: lambda failure: ACCEPTED if failure in (OK, OFF, WRONG) else UNSUPPORTED,
        }
        self.commands: dict[int, Handler] = {INJECT_FAILURE: self.inject}

    def inject(self, command: Command) -> int | None:
        """Injects the failure of the unit in param1 and of the type in param2."""
        if self._host.view.choice("SYS_FAILURE_EN") != 1:
            return DENIED
        inject_failure = self._failures.get(_as_integer(command.p1))
        return None if inject_failure is None else inject_failure(_as_integer(command.p2))

    def _battery(self, failure_type: int) -> int | None:
        if failure_type not in (OK, OFF):
            return None
        view = self._host.view
        view.simulation.set_battery_empty(view.row, failure_type == OFF)
        return ACCEPTED


def _as_integer(value: float) -> int:
    return round(value) if math.isfinite(value) else -1
