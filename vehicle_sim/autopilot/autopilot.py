"""One vehicle's autopilot: runs commander, navigator, take-off ramp and land detector in PX4's order."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.arming import auto_disarm_after_s
from vehicle_sim.autopilot.commander import Commander
from vehicle_sim.autopilot.goto import Goto, GotoControl
from vehicle_sim.autopilot.land_detector import DetectorInputs, LandDetector, LandingThresholds
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.navigator import MODES_WITH_WAYPOINT, Navigator
from vehicle_sim.autopilot.offboard import ControlMode, Offboard, Setpoint, SetpointKind, kind_for_controllers
from vehicle_sim.autopilot.own_commands import OwnCommands
from vehicle_sim.autopilot.path import TICK_S
from vehicle_sim.autopilot.plans import Plans
from vehicle_sim.autopilot.setpoint_writer import SetpointWriter, float_view
from vehicle_sim.autopilot.sticks import Sticks
from vehicle_sim.autopilot.takeoff import TILT_LIMIT_RISE_RAD_S, TakeoffRamp, TakeoffState
from vehicle_sim.autopilot.tasks.manual import ATTITUDE_RATE_MODES, STICK_MODES, StickTasks
from vehicle_sim.autopilot.tick_arrays import (
    DOWN,
    ON_GROUND,
    RAMP,
    SETPOINT_DOWN,
    STREAM,
    TILT,
    SteadyTask,
    TickArrays,
)
from vehicle_sim.control.setpoints import ControlLevel
from vehicle_sim.external_modes.registry import is_external
from vehicle_sim.geodesy import to_global
from vehicle_sim.home import Home
from vehicle_sim.payload.gimbal import Gimbal
from vehicle_sim.vehicle_view import Vector, VehicleView

AUTO_DESCENT_FACTOR = 1.2
"""The position controller may descend at this factor times MPC_Z_V_AUTO_DN in automatic modes."""


class Autopilot:
    """The autopilot of one vehicle; `SteadyTicks` calls it at 50 Hz between simulation steps.

    Args:
        view: the vehicle.
        arrays: arrays of all vehicles.
    """

    def __init__(self, view: VehicleView, arrays: TickArrays) -> None:
        self.view, self.row = view, view.row
        self.announcer = Announcer(view.time_boot_ms)
        self._setpoints = SetpointWriter(view)
        self.home = Home()
        self.offboard = Offboard(view, self.announcer)
        self.plans = Plans()
        self.own_commands = OwnCommands()
        self.navigator = Navigator(
            view, self.announcer, self._setpoints, self.home, self.plans, self.own_commands, arrays
        )
        self.sticks = Sticks(view)
        self.commander = Commander(
            view, self.announcer, self._setpoints, self.navigator, self.offboard, self.own_commands,
            self.sticks,
        )  # fmt: skip
        self._stick_tasks = StickTasks(view, self._setpoints, self.sticks, self.home)
        self.takeoff = TakeoffRamp(float_view(arrays.motion[view.row, RAMP:]))
        self.land_detector = LandDetector(arrays.detector[view.row], arrays.detector_limits[view.row])
        self.gimbal = Gimbal(view, lambda: self.waypoint)
        self._control_mode = ControlMode()
        self._goto = GotoControl(view, self._setpoints)
        # Memory views, because NumPy takes three times as long; those of the thrusts contain all vehicles.
        self._motion = float_view(arrays.motion[view.row])
        self._thrusts = float_view(view.simulation.target.thrust)
        self._hover_thrusts = float_view(view.simulation.target.hover_thrust)
        self.offboard.on_setpoint = self._apply_immediately
        self._cached_thresholds: LandingThresholds | None = None
        self.steady = False
        """Whether the next tick may run in the compiled loops (`SteadyTicks`)."""
        self.ran_full_tick = True
        """Whether the last tick was a full tick, not a tick in the compiled loops."""
        self._state_at_steady_start: tuple[object, ...] = ()
        view.parameters.add_listener(self._discard_thresholds)

    def update(self) -> None:
        """Runs one tick."""
        self._let_pilot_take_over()
        self._select_setpoints()
        self._detect_landing()
        self.update_after_detection()

    def update_after_detection(self) -> None:
        """Runs the part of a tick that follows the land detector."""
        self._setpoints.set_in_air(not self.land_detector.landed)
        self.commander.update(landed=self.land_detector.landed)
        self._run_flight_tasks()

    def update_steady(self) -> bool:
        """Runs a tick of a steady flight, in which `SteadyTicks` computes land detector and trajectory.

        Returns:
            False if a check changed the vehicle's state; this method then also computes the trajectory.
        """
        if self.commander.update_steady():
            if self.commander.active is NavState.OFFBOARD:
                self._publish_level()
                self._motion[SETPOINT_DOWN] = self.offboard.setpoint.velocity_ned_m_s[2]
                self._write_offboard_setpoint()
            if not self.gimbal.at_rest:
                self.gimbal.update(TICK_S)
            self.ran_full_tick = False
            return True
        self._run_flight_tasks()
        return False

    def stays_steady(self) -> bool:
        """Whether the flight is steady, and no command or parameter has changed since the last tick."""
        if self.steady and self._commanded_state() != self._state_at_steady_start:
            self.steady = False
        return self.steady

    def begin_steady(self) -> SteadyTask | None:
        """Begins a steady flight after a full tick; None: the next tick must be a full one."""
        self.ran_full_tick = True
        task = self._steady_task()
        self.steady = task is not None
        if task is not None:
            self._state_at_steady_start = self._commanded_state()
            self.navigator.path.read_settings()
        return task

    def _steady_task(self) -> SteadyTask | None:
        commander, detector = self.commander, self.land_detector
        overridden = self._goto.goal or self.offboard.has_topic_setpoints or self.sticks.moved
        if overridden or commander.external.has_modes or not commander.allows_steady_flight:
            return None
        if is_on_ground_or_ramping(self.takeoff, detector):
            return ground_task(self.view, commander, self.navigator, self.takeoff, detector)
        if not commander.took_off:
            return None
        if commander.active is NavState.OFFBOARD:
            levels = {self.offboard.level, self._control_mode.level}
            return STREAM if levels == {ControlLevel.TRAJECTORY} else None
        return self.navigator.steady_task(commander.active)

    def _commanded_state(self) -> tuple[object, ...]:
        """State that commands and parameters can change between two ticks; a change ends a steady flight."""
        commander, home, active = self.commander, self.home, self.commander.active
        return (
            commander.armed, commander.intended, active, commander.terminated, self.view.parameter_changes,
            self.plans.changes, home.set_at_us, home.position_ned_m, self.sticks.moved, self._goto.goal,
            self.offboard.has_topic_setpoints, self.offboard.level, commander.external.has_modes,
            self.navigator.commanded_state(active),
        )  # fmt: skip

    def _run_flight_tasks(self) -> None:
        self._update_takeoff()
        self._write_setpoints()
        self._run_goto()
        self.gimbal.update(TICK_S)

    @property
    def follows_external_setpoints(self) -> bool:
        """Whether the active mode follows external setpoints: Offboard or an external mode."""
        active = self.commander.active
        return active is NavState.OFFBOARD or is_external(active)

    def _select_setpoints(self) -> None:
        """Selects the kind of setpoints that an external mode sends, or restores the kind of Offboard."""
        active = self.commander.active
        if is_external(active):
            self.offboard.select_kind(kind_for_controllers(self.commander.external.controllers(active)))
            return
        self.offboard.restore_kind()
        if active is not NavState.OFFBOARD:
            self.offboard.clear_topic_setpoints()

    @property
    def waypoint(self) -> tuple[float, float, float] | None:
        """Latitude, longitude [deg] and altitude AMSL [m] of the current target; None: no target."""
        waypoint = self.navigator.waypoint(self.commander.active) if self.commander.armed else None
        if waypoint is None:
            return None
        lat_deg, lon_deg, _ = self.view.origin
        lat, lon = to_global(waypoint[0], waypoint[1], lat_deg, lon_deg)  # type: ignore[arg-type]
        return float(lat), float(lon), waypoint[2]

    @property
    def has_attitude_setpoint(self) -> bool:
        """Whether Offboard is active and the newest setpoint is an attitude (SET_ATTITUDE_TARGET)."""
        commander, offboard = self.commander, self.offboard
        is_attitude = offboard.setpoint.kind is SetpointKind.ATTITUDE or offboard.invalid_attitude is not None
        return commander.armed and commander.active is NavState.OFFBOARD and is_attitude

    def _detect_landing(self) -> None:
        estimate, i = self.view.estimate, self.view.row
        controls_trajectory = not self._setpoints.below_trajectory
        thrust = self._thrusts[i] if self.takeoff.ramp_started or not controls_trajectory else 0.0
        estimates_hover = self.takeoff.flying and controls_trajectory and self.view.choice("MPC_USE_HTE") != 0
        # An unknown horizontal velocity does not prevent the detection of a landing.
        vn, ve, vd = estimate.velocity_ned_m_s
        previous_down_m, down_m = self._motion[DOWN], estimate.position_ned_m[2]
        self._motion[DOWN] = down_m
        inputs = DetectorInputs(
            self.commander.armed,
            thrust,
            self._hover_thrusts[i],
            estimates_hover,
            (vn, ve, vd) if estimate.valid_velocity else (0.0, 0.0, vd),
            (down_m - previous_down_m) / TICK_S,
            estimate.valid_altitude,
            estimate.rates_frd_rad_s,
            estimate.height_above_ground_m,
            controls_trajectory,
            self._motion[SETPOINT_DOWN],
        )
        self.land_detector.update(self.view.time_s, inputs, self._landing_thresholds())

    def _landing_thresholds(self) -> LandingThresholds:
        if self._cached_thresholds is None:
            self._cached_thresholds = LandingThresholds.for_vehicle(self.view)
        return self._cached_thresholds

    def _discard_thresholds(self, _name: str, _value: float) -> None:
        self._cached_thresholds = None

    @property
    def _flies_by_sticks(self) -> bool:
        return self.commander.active in STICK_MODES and self.sticks.valid

    def _let_pilot_take_over(self) -> None:
        """Switches to Position if the pilot moves the sticks in an automatic mode."""
        commander = self.commander
        if not commander.armed or commander.landed or commander.active in STICK_MODES:
            self.sticks.moved = False
        elif self.sticks.takes_over(offboard=commander.active is NavState.OFFBOARD):
            self.announcer.text(6, "Pilot took over using sticks\t")
            commander.set_mode(NavState.POSITION)

    def _update_takeoff(self) -> None:
        if self.takeoff.flying and self.commander.armed and not self.land_detector.landed:
            return
        parameter, active = self.view.parameter, self.commander.active
        if self._flies_by_sticks:
            wants_to_climb = self._stick_tasks.wants_to_climb()
        elif self.follows_external_setpoints:
            wants_to_climb = self.offboard.wants_to_climb(self.view.estimate.position_ned_m[2])
        else:
            wants_to_climb = self.navigator.wants_to_climb(active)
        self.takeoff.update(
            self.view.time_s,
            TICK_S,
            armed=self.commander.armed,
            landed=self.land_detector.landed,
            wants_to_climb=wants_to_climb,
            spoolup_s=parameter("COM_SPOOLUP_TIME"),
            ramp_s=parameter("MPC_TKO_RAMP_T"),
            speed_m_s=parameter("MPC_Z_VEL_MAX_UP"),
            velocity_gain=parameter("MPC_Z_VEL_P_ACC"),
        )

    def _write_setpoints(self) -> None:
        commander, takeoff = self.commander, self.takeoff
        if not commander.armed or commander.active is NavState.TERMINATION:
            self._setpoints.disable_controllers()
            return
        uses_external, level = self.follows_external_setpoints, self._publish_level()
        external_below_trajectory = uses_external and level is not ControlLevel.TRAJECTORY
        on_ground = not takeoff.ramp_started or (takeoff.flying and self.land_detector.ground_contact)
        self._setpoints.set_limits(
            ramping=takeoff.state is TakeoffState.RAMPUP,
            landed=self.land_detector.landed or on_ground,
            climb_limit_m_s=takeoff.climb_limit_m_s,
            descent_limit_m_s=self._descent_limit_m_s(),
            min_thrust=math.nan if takeoff.flying else 0.0,
            tilt_limit_rad=self._tilt_limit_rad(),
        )
        if uses_external:
            self._motion[SETPOINT_DOWN] = self.offboard.setpoint.velocity_ned_m_s[2]
        if commander.active in ATTITUDE_RATE_MODES:
            # Without stick input too: PX4 keeps the last stick positions, or centred sticks.
            self._stick_tasks.run(commander.active)
        elif external_below_trajectory:
            if self.offboard.level is not ControlLevel.TRAJECTORY:
                self._write_offboard_setpoint()
        elif on_ground:
            # Before the take-off ramp and after ground contact PX4 accelerates downwards (minimum thrust).
            self._setpoints.trajectory(acceleration_ned_m_s2=(0.0, 0.0, 100.0))
        elif self._flies_by_sticks:
            self._stick_tasks.run(commander.active)
            self._motion[SETPOINT_DOWN] = self._setpoints.setpoint_down_m_s
        elif uses_external:
            if self.offboard.level is ControlLevel.TRAJECTORY:
                self._write_offboard_setpoint()
        elif not self._stick_tasks.stop_until_input(commander.active):
            self.navigator.run(commander.active)
            self._motion[SETPOINT_DOWN] = self._setpoints.setpoint_down_m_s
            return
        if not uses_external:
            # The vehicle does not follow the trajectory, so the trajectory stays at the vehicle.
            self.navigator.path.stay_at_vehicle()

    def _publish_level(self) -> ControlLevel:
        commander, external = self.commander, self.commander.external
        state = (commander.armed, commander.active, commander.failsafe.action, external.config_count)
        return self._control_mode.update(self.view.time_s, self.offboard.level, state)

    def _descent_limit_m_s(self) -> float:
        """Maximum descent speed; NaN: the controllers use MPC_Z_VEL_MAX_DN. In automatic modes the maximum
        exceeds the speed of the trajectory, so that a vehicle above the trajectory can return to it."""
        if self.commander.active not in MODES_WITH_WAYPOINT:
            return math.nan
        parameter = self.view.parameter
        return max(parameter("MPC_Z_VEL_MAX_DN"), AUTO_DESCENT_FACTOR * parameter("MPC_Z_V_AUTO_DN"))

    def apply_topic_setpoint(self, setpoint: Setpoint) -> None:
        """Applies a setpoint of a uORB topic in any mode: the controllers use the newest setpoint.

        A mode with its own setpoints overwrites a trajectory, attitude or rate setpoint within a tick; the
        controllers overwrite motor signals, thrust and torque within 4 ms.
        """
        self.offboard.store_topic_setpoint(setpoint)
        commander, level = self.commander, setpoint.kind.level
        if not commander.armed or commander.terminated or not self.takeoff.flying:
            return
        uses_external = self.follows_external_setpoints
        if uses_external and level is self._control_mode.level and level is self.offboard.level:
            if level is not ControlLevel.TRAJECTORY:
                self._write_offboard_setpoint()
        elif setpoint.kind in (SetpointKind.ATTITUDE, SetpointKind.RATES):
            self._setpoints.override_attitude(setpoint.q_ned_frd, setpoint.rates_frd_rad_s, setpoint.thrust)
        elif setpoint.kind in (SetpointKind.THRUST_TORQUE, SetpointKind.ACTUATORS):
            self._setpoints.override_motors(setpoint.thrust, setpoint.torque_frd, setpoint.motors)
        elif (
            not (uses_external or self._setpoints.below_trajectory)
            and self.view.simulation.takes_foreign_trajectory
        ):
            self._write_trajectory(setpoint)

    def fly_on(self, mode: NavState, trajectory_ned: tuple[Vector, Vector, Vector]) -> bool:
        """Flies on in a mode after `Simulation.place_in_flight`, from the trajectory's position [m], velocity
        [m/s] and acceleration [m/s²] (NaN: from the vehicle's).

        Returns:
            False if the mode cannot run.
        """
        self.steady = False
        self.commander.home.on_moved()
        self._setpoints.trajectory(*trajectory_ned, yaw_ned_rad=self.view.estimate.yaw_ned_rad)
        if mode is NavState.HOLD:  # in which a vehicle may already be
            self.navigator.enter(mode, mode, in_air=True)
        flies = self.commander.set_mode(mode)
        self.navigator.path.keep_speed()
        return flies

    def receive_goto(self, goto: Goto) -> None:
        """Handles GotoSetpoint, which overrides the setpoints of every mode that controls the position."""
        self._goto.receive(goto)

    def _run_goto(self) -> None:
        flying = self.commander.armed and self.takeoff.flying and not self.commander.terminated
        if flying and not self._setpoints.below_trajectory:
            self._goto.fly()

    def _tilt_limit_rad(self) -> float:
        """Tilt limit: MPC_TILTMAX_LND during the take-off, then slowly increasing; NaN: MPC_TILTMAX_AIR.

        Without this limit a vehicle with a horizontal setpoint would tip over before lift-off.
        """
        landing_rad = math.radians(self.view.parameter("MPC_TILTMAX_LND"))
        air_rad = math.radians(self.view.parameter("MPC_TILTMAX_AIR"))
        if not self.takeoff.flying:
            self._motion[TILT] = landing_rad
        else:
            self._motion[TILT] += TILT_LIMIT_RISE_RAD_S * TICK_S
        return self._motion[TILT] if self._motion[TILT] < air_rad else math.nan

    def _apply_immediately(self) -> None:
        """Applies an attitude, rate or motor setpoint at once, even if the position controller is active."""
        commander, setpoint = self.commander, self.offboard.setpoint
        if commander.active is not NavState.OFFBOARD or not commander.armed:
            return
        if self._control_mode.level is not ControlLevel.TRAJECTORY:
            self._write_offboard_setpoint()
        elif setpoint.kind in (SetpointKind.ATTITUDE, SetpointKind.RATES) and self.takeoff.flying:
            self._setpoints.override_attitude(setpoint.q_ned_frd, setpoint.rates_frd_rad_s, setpoint.thrust)

    def _write_offboard_setpoint(self) -> None:
        setpoint = self.offboard.setpoint
        if self.offboard.invalid:
            self.navigator.descend()
        elif self.offboard.awaits_setpoint:
            self._keep_outputs()
        elif setpoint.kind is SetpointKind.ATTITUDE and setpoint.q_ned_frd is not None:
            self._setpoints.attitude(setpoint.q_ned_frd, setpoint.thrust, setpoint.yaw_rate_ned_rad_s)
        elif setpoint.kind is SetpointKind.RATES:
            self._setpoints.rates(setpoint.rates_frd_rad_s, setpoint.thrust)
        elif setpoint.kind is SetpointKind.THRUST_TORQUE:
            self._setpoints.thrust_torque(setpoint.thrust, setpoint.torque_frd)
        elif setpoint.kind is SetpointKind.ACTUATORS:
            self._setpoints.motors(setpoint.motors)
        else:
            self._write_trajectory(setpoint)

    def _keep_outputs(self) -> None:
        """Keeps the last outputs until a setpoint of this level is received; only motor signals need this."""
        if self.offboard.level is ControlLevel.MOTORS:
            self._setpoints.freeze_motors()

    def _write_trajectory(self, setpoint: Setpoint) -> None:
        if setpoint.is_complete:
            self._setpoints.trajectory(
                setpoint.position_ned_m, setpoint.velocity_ned_m_s, setpoint.acceleration_ned_m_s2,
                setpoint.yaw_ned_rad, setpoint.yaw_rate_ned_rad_s,
            )  # fmt: skip
        else:
            self._setpoints.trajectory(velocity_ned_m_s=(0.0, 0.0, 0.0))


def ground_task(
    view: VehicleView,
    commander: Commander,
    navigator: Navigator,
    takeoff: TakeoffRamp,
    detector: LandDetector,
) -> SteadyTask | None:
    """The steady task until the take-off or landing state changes; None if the mode needs full ticks."""
    mode, state = commander.active, takeoff.state
    in_ground_contact = state is TakeoffState.FLIGHT and detector.ground_contact
    if navigator.awaits_rally_check:
        return None
    if mode is NavState.TAKEOFF and state is TakeoffState.RAMPUP:
        task = navigator.steady_task(mode) if view.parameter("MPC_TKO_RAMP_T") > TICK_S else None
    elif mode is NavState.TAKEOFF and state is TakeoffState.SPOOLUP:
        task = ON_GROUND._replace(
            wait_start_s=takeoff.armed_at_s, wait_duration_s=view.parameter("COM_SPOOLUP_TIME")
        )
    elif (
        mode is not NavState.RTL
        and navigator.lands_in(mode)
        and (in_ground_contact or state is TakeoffState.READY)
    ):
        task = ON_GROUND
    else:
        return None
    if task is None:
        return None
    task = task._replace(takeoff=state, landing_stages=detector.stages)
    if commander.landed and state is not TakeoffState.SPOOLUP:  # the task ends at the automatic disarming
        since_s = commander.landed_at_s if commander.took_off else commander.armed_at_s
        wait_s = auto_disarm_after_s(view, took_off=commander.took_off)
        task = task._replace(wait_start_s=since_s, wait_duration_s=wait_s)
    return task


def is_on_ground_or_ramping(takeoff: TakeoffRamp, detector: LandDetector) -> bool:
    """Whether the vehicle is on the ground or in its take-off ramp."""
    return not takeoff.flying or detector.stages != 0.0
