"""Runs the flight task of the active mode, and handles commands that change the target or the speed."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.fence_watch import FenceWatch
from vehicle_sim.autopilot.land_detector import LandedState
from vehicle_sim.autopilot.mission.mission import Mission
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.own_commands import CHANGE_SPEED, OwnCommands
from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.plans import Plans
from vehicle_sim.autopilot.setpoint_writer import SetpointWriter
from vehicle_sim.autopilot.tasks.climb import Climb
from vehicle_sim.autopilot.tasks.follow import Follow
from vehicle_sim.autopilot.tasks.orbit import Circle, Orbit
from vehicle_sim.autopilot.tasks.precision_landing import PrecisionLanding
from vehicle_sim.autopilot.tasks.return_home import ReturnHome
from vehicle_sim.autopilot.tick_arrays import Motion, SteadyTask, TickArrays
from vehicle_sim.geodesy import is_position, to_local
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import Vector, VehicleView

HOLDING_MODES = frozenset({NavState.HOLD, NavState.VTOL_TAKEOFF})
STOP_REACTION_S = 0.6
"""Delay before braking that PX4 assumes when it predicts the stopping position."""
MODES_WITHOUT_TASK = frozenset(
    {NavState.OFFBOARD, NavState.MANUAL, NavState.STABILIZED, NavState.ACRO, NavState.TERMINATION}
)
"""Modes without a flight task, and so without a trajectory that the next mode could continue."""
MODES_WITH_WAYPOINT = frozenset(
    {
        NavState.TAKEOFF, NavState.HOLD, NavState.MISSION, NavState.RTL, NavState.LAND,
        NavState.PRECISION_LAND,
    }
)  # fmt: skip
"""Modes that fly to a position."""


class Navigator:
    """The flight tasks of one vehicle's automatic modes."""

    def __init__(
        self,
        view: VehicleView,
        announcer: Announcer,
        setpoints: SetpointWriter,
        home: Home,
        plans: Plans,
        commands: OwnCommands,
        arrays: TickArrays,
    ) -> None:
        self._view = view
        self._setpoints = setpoints
        self._commands = commands
        self.home = home
        self.path = Path(view, setpoints, arrays)
        self._climb = Climb(view, announcer, self.path, home)
        self._return = ReturnHome(view, announcer, self.path, home, plans, commands)
        self._orbit = Orbit(view, announcer, self.path, setpoints)
        self._precision_landing = PrecisionLanding(view, self.path)
        self.follow = Follow(view, self.path, setpoints, home)
        self.fence = FenceWatch(view, announcer, home, plans)
        self.mission = Mission(view, announcer, self.path, home, plans, self.fence, commands, self._climb)
        self._landing_position: Vector = (0.0, 0.0, 0.0)
        commands.add_handlers({CHANGE_SPEED: lambda values: self.change_speed(values[0], values[1])})

    # --- commands -------------------------------------------------------------------------------------

    def request_takeoff(self, alt_amsl_m: float) -> None:
        """Stores the altitude of a take-off command (NaN: MIS_TAKEOFF_ALT)."""
        self._climb.alt_amsl_m = alt_amsl_m

    def orbit(
        self, lat_lon_alt: tuple[float, float, float], radius_m: float, speed_m_s: float, yaw_behaviour: float
    ) -> None:
        """Handles DO_ORBIT; NaN position: the vehicle's position; other NaN values: the default values."""
        self._orbit.request(lat_lon_alt, radius_m, speed_m_s, yaw_behaviour)

    @property
    def circle(self) -> Circle | None:
        """The circle of mode Orbit."""
        return self._orbit.circle

    def goto(self, lat_deg: float, lon_deg: float, alt_amsl_m: float, yaw_ned_rad: float) -> None:
        """Handles DO_REPOSITION.

        NaN position: the target position does not change; NaN altitude: the vehicle's altitude becomes the
        target; NaN yaw: the nose points to the target. If all values are NaN, the vehicle stops.
        """
        if not (is_position(lat_deg, lon_deg) or math.isfinite(alt_amsl_m) or math.isfinite(yaw_ned_rad)):
            self.stop_at(math.nan)
            return
        north, east, down = self._view.estimate.position_ned_m
        target_n, target_e, _ = self.path.target_ned_m
        origin_lat, origin_lon, origin_alt = self._view.origin
        if is_position(lat_deg, lon_deg):
            n, e = to_local(lat_deg, lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
            target_n, target_e = float(n), float(e)
        elif target_n is None or target_e is None:
            target_n, target_e = north, east
        target_d = -(alt_amsl_m - origin_alt) if math.isfinite(alt_amsl_m) else down
        self.path.target_ned_m = (target_n, target_e, target_d)
        self.path.face_target = not math.isfinite(yaw_ned_rad)
        if math.isfinite(yaw_ned_rad):
            self.path.yaw_target_rad = yaw_ned_rad
        else:
            self.path.face(target_n, target_e)

    def stop_at(self, alt_amsl_m: float) -> None:
        """Stops the vehicle at an altitude (NaN: the current altitude)."""
        north, east, down = self._stopping_position()
        if math.isfinite(alt_amsl_m):
            down = -(alt_amsl_m - self._view.origin[2])
        self.path.target_ned_m, self.path.face_target = (north, east, down), True

    def change_speed(self, speed_type: float, speed_m_s: float) -> None:
        """Handles DO_CHANGE_SPEED; an invalid speed restores the speed of the parameters."""
        valid_m_s = speed_m_s if math.isfinite(speed_m_s) and speed_m_s > 0.0 else math.nan
        number = int(speed_type) if math.isfinite(speed_type) else 0
        if number in (0, 1):  # airspeed, ground speed
            self.path.cruise_m_s = valid_m_s
        elif number == 2:  # climb
            self.path.climb_m_s = valid_m_s
        elif number == 3:  # descent
            self.path.descent_m_s = valid_m_s

    # --- modes -----------------------------------------------------------------------------------------

    def enter(self, mode: NavState, previous: NavState, *, in_air: bool) -> None:
        """Starts a mode from the vehicle's current position and velocity."""
        if previous is NavState.MISSION and mode is not NavState.MISSION:
            self.leave_mission()
        keeps_target = previous is NavState.TAKEOFF or (
            previous is NavState.MISSION and self.mission.finished
        )
        if not keeps_target or mode is not NavState.HOLD:
            self.path.restart(in_air=in_air, continue_setpoint=previous not in MODES_WITHOUT_TASK)
            if mode in HOLDING_MODES and in_air:
                self.path.target_ned_m, self.path.face_target = self._stopping_position(), True
        if mode is NavState.TAKEOFF:
            self._climb.enter()
        elif mode is NavState.RTL:
            self.path.cruise_m_s = math.nan
            self._commands.park_gimbal()
            self._return.enter(self.mission.current)
        elif mode is NavState.LAND:
            self._landing_position = self._view.estimate.position_ned_m
            self._commands.park_gimbal()
        elif mode is NavState.PRECISION_LAND:
            self._precision_landing.enter()
        elif mode is NavState.ORBIT:
            self._orbit.enter()
        elif mode is NavState.FOLLOW:
            self.follow.enter()
        elif mode is NavState.MISSION:
            self.mission.enter()

    def leave_mission(self) -> None:
        """Ends the mission: another mode became active, or the vehicle was disarmed."""
        if self.mission.active:
            self.mission.leave()

    def update_mode(self, mode: NavState, *, landed: bool) -> None:
        """Updates the state of a mode, on the ground and in flight."""
        if mode is NavState.MISSION:
            self.mission.update(landed=landed)
        elif mode is NavState.RTL and landed:
            self._return.check_landing()

    def check_fence_and_rally_points(self, *, landed: bool) -> None:
        """Checks the geofence and the rally points; called at each tick in every mode."""
        self.fence.update(landed=landed)
        self._return.check_rally_points()

    def _stopping_position(self) -> Vector:
        """Position at which Hold stops the vehicle, at the current altitude."""
        if (at_fence := self.fence.stop_ned_m) is not None:
            return at_fence
        (north, east, down), (vn, ve, _) = (
            self._view.estimate.position_ned_m, self._view.estimate.velocity_ned_m_s,
        )  # fmt: skip
        parameter = self._view.parameter
        prediction_s = 0.5 * math.hypot(vn, ve) / max(0.1, parameter("MPC_ACC_HOR")) + STOP_REACTION_S
        return (north + vn * prediction_s, east + ve * prediction_s, down)

    def waypoint(self, mode: NavState) -> tuple[float, float, float] | None:
        """Target of the mode: north and east [m, local frame], altitude AMSL [m]; None: no target.

        A landing at the current position has the altitude 0, as in PX4.
        """
        if mode is NavState.LAND:
            return (*self._landing_position[:2], 0.0)
        if mode is NavState.PRECISION_LAND:
            return self._precision_landing.waypoint
        north, east, down = self.path.target_ned_m
        if mode not in MODES_WITH_WAYPOINT or north is None or east is None or down is None:
            return None
        return north, east, self._view.origin[2] - down

    @property
    def return_duration_s(self) -> float:
        """Duration of a return from the current position [s]."""
        return self._return.duration_s(self.home.position_ned_m)

    def lands_in(self, mode: NavState) -> bool:
        """Whether the vehicle descends to land in this mode, but for a mission."""
        if mode is NavState.PRECISION_LAND:
            return self._precision_landing.landing
        return mode is NavState.LAND or (mode is NavState.RTL and self._return.landing)

    def landed_state_in_air(self, mode: NavState) -> LandedState:
        """MAV_LANDED_STATE of a vehicle in the air."""
        if mode is NavState.TAKEOFF or (mode is NavState.MISSION and self.mission.taking_off):
            return LandedState.TAKEOFF
        if self.lands_in(mode) or (mode is NavState.MISSION and self.mission.landing):
            return LandedState.LANDING
        return LandedState.IN_AIR

    def takeoff_finished(self, mode: NavState) -> bool:
        """Whether a take-off has reached its altitude."""
        target_down_m = self.path.target_ned_m[2]
        if mode is not NavState.TAKEOFF or target_down_m is None:
            return False
        return self._view.estimate.position_ned_m[2] <= target_down_m + self._view.parameter("NAV_MC_ALT_RAD")

    def wants_to_climb(self, mode: NavState) -> bool:
        """Whether a vehicle on the ground takes off in this mode."""
        target_down_m = self.path.target_ned_m[2]
        if mode is NavState.TAKEOFF:
            return self._climb.wants_to_climb
        if mode is NavState.MISSION:
            return self.mission.taking_off
        if mode is NavState.FOLLOW:
            return self.follow.has_target  # the task climbs to at least 1 m above ground
        if mode is NavState.RTL and self.lands_in(mode):
            return False
        if mode is NavState.HOLD:
            return self.path.starts_takeoff
        if mode is NavState.RTL and target_down_m is not None:
            return target_down_m < self._view.estimate.position_ned_m[2] - 0.5
        return False

    def run(self, mode: NavState) -> None:
        """Runs one tick of the active mode, and writes the setpoints."""
        self.path.follow_resets()
        if mode is NavState.LAND:
            self.path.descend()
        elif mode is NavState.PRECISION_LAND:
            self._precision_landing.run()
        elif mode is NavState.TAKEOFF:
            self._climb.run()
        elif mode is NavState.RTL:
            self._return.run()
        elif mode is NavState.ORBIT:
            self._orbit.run()
        elif mode is NavState.MISSION and self.mission.active:
            self.mission.run()
        elif mode is NavState.FOLLOW:
            self.follow.run()
        elif mode in HOLDING_MODES:
            self.path.fly_to_target()
        else:
            self.descend()

    def steady_task(self, mode: NavState) -> SteadyTask | None:
        """The motion of the mode until one of its end conditions; None: the mode needs full ticks."""
        if self.awaits_rally_check:
            return None
        if mode is NavState.MISSION:
            return self.mission.steady_task()
        if mode is NavState.TAKEOFF:
            return self._climb.steady_task(altitude_radius_m=self._view.parameter("NAV_MC_ALT_RAD"))
        if mode is NavState.PRECISION_LAND:
            return self._precision_landing.steady_task()
        return self.path.steady_task(Motion.DESCENT) if mode is NavState.LAND else None

    @property
    def awaits_rally_check(self) -> bool:
        """Whether rally points must be checked."""
        return self._return.checks_rally_points

    def commanded_state(self, mode: NavState) -> tuple[object, ...]:
        """State of the mode that commands can change between two ticks; for comparison."""
        if mode in MODES_WITHOUT_TASK:
            return ()
        if mode is NavState.MISSION:
            return self.path.commanded_state(), self.mission.commanded_state()
        return self.path.commanded_state()

    def descend(self) -> None:
        """Descends with level attitude at MPC_LAND_SPEED, when a mode lacks stick input or a position."""
        speed = self._view.parameter("MPC_LAND_SPEED")
        self._setpoints.trajectory(
            velocity_ned_m_s=(math.nan, math.nan, speed),
            acceleration_ned_m_s2=(0.0, 0.0, math.nan),
            yaw_ned_rad=self.path.yaw_target_rad,
        )
