"""Return: climbs, flies to the destination and lands there (after RTL_LAND_DELAY), or follows a route."""

from __future__ import annotations

import math
from enum import Enum

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.mission.mission import Leg
from vehicle_sim.autopilot.own_commands import OwnCommands
from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.plans import RALLY, Plans
from vehicle_sim.autopilot.tasks.destination import Destination, DestinationChooser, DestinationKind
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import Vector, VehicleView

ALTITUDE_TOLERANCE_M = 0.8
"""Altitude error within which the vehicle continues with the next phase."""
MIN_RETURN_ALTITUDE_FACTOR = 2.0
"""The return altitude is at least this factor times NAV_ACC_RAD above the destination, unless the vehicle is
within NAV_ACC_RAD of it."""
SPEED_PARAMETERS = ("MPC_Z_V_AUTO_UP", "MPC_XY_CRUISE", "MPC_Z_V_AUTO_DN")
RALLY_CHECK_DELAY_S, RALLY_CHECK_EVERY_S = 0.8, 2.05
IDLE_COMMAND = 0


class ReturnPhase(Enum):
    """Phase of a return."""

    CLIMB = "climb"
    RETURN = "return"
    ROUTE = "route"
    DESCEND = "descend"
    WAIT = "wait"
    LOITER = "loiter"
    LAND = "land"


class ReturnHome:
    """The flight task of mode Return."""

    def __init__(
        self,
        view: VehicleView,
        announcer: Announcer,
        path: Path,
        home: Home,
        plans: Plans,
        commands: OwnCommands,
    ) -> None:
        self._view = view
        self._announcer = announcer
        self._path = path
        self._home = home
        self._plans = plans
        self._commands = commands
        self._chooser = DestinationChooser(view, announcer, home, plans)
        self._leg = Leg(path)
        self.phase = ReturnPhase.CLIMB
        self._phase_since_s = 0.0
        self._return_down_m = 0.0
        self._destination = Destination(DestinationKind.HOME, (0.0, 0.0, 0.0), 0.0)
        self._route: list[Vector] = []
        self._idle_sent = False
        self._rally_revision = 0
        self._rally_check_at_s = math.inf

    def enter(self, mission_seq: int) -> None:
        """Chooses the destination and the return altitude, and announces them."""
        self._destination = self._chooser.choose(mission_seq)
        self._route = list(self._destination.route_ned_m)
        self._idle_sent = False
        north, east, down = self._view.estimate.position_ned_m
        if not self._destination.climbs:
            self._leg.restart()
            self._fly_to_next_waypoint()
            return
        goal_n, goal_e, goal_d = self._destination.position_ned_m
        distance_m = math.hypot(north - goal_n, east - goal_e)
        vehicle_above_m = goal_d - down
        return_above_m = max(vehicle_above_m, self._return_above_m(distance_m))
        self._return_down_m = goal_d - return_above_m
        self._set_phase(ReturnPhase.CLIMB)
        self._path.target_ned_m = (north, east, self._return_down_m)
        rounded_above_m = math.ceil(return_above_m)
        if self._destination.kind is DestinationKind.MISSION_LANDING:
            amsl_m = round(self._view.origin[2] - self._return_down_m)
            self._announcer.announce(
                6, f"RTL Mission Land: climb to {amsl_m} m", "rtl_mission_land_climb", "i", amsl_m
            )
            return
        amsl_m = math.ceil(self._view.origin[2] - goal_d + return_above_m)
        self._announcer.announce(
            6, f"RTL: start return at {amsl_m} m ({rounded_above_m} m above destination)",
            "vrtl_return_at", "ii", amsl_m, rounded_above_m,
        )  # fmt: skip

    def _return_above_m(self, distance_m: float) -> float:
        """Return altitude above the destination: RTL_RETURN_ALT, which RTL_CONE_ANG limits within
        RTL_MIN_DIST."""
        parameter = self._view.parameter
        radius = parameter("NAV_ACC_RAD")
        if distance_m <= radius:
            return min(2.0 * distance_m, parameter("RTL_RETURN_ALT"))
        return_above_m = parameter("RTL_RETURN_ALT")
        cone_deg = self._view.choice("RTL_CONE_ANG")
        if cone_deg >= 90:
            return_above_m = parameter("RTL_DESCEND_ALT")
        elif cone_deg > 0 and distance_m < parameter("RTL_MIN_DIST"):
            return_above_m = min(return_above_m, distance_m / math.tan(math.radians(cone_deg)))
        return max(return_above_m, MIN_RETURN_ALTITUDE_FACTOR * radius)

    def duration_s(self, to_ned_m: Vector) -> float:
        """Duration of climb, flight and descent to a position, at the speeds in SPEED_PARAMETERS."""
        north, east, down = self._view.estimate.position_ned_m
        distance_m = math.hypot(north - to_ned_m[0], east - to_ned_m[1])
        vehicle_above_m = max(0.0, to_ned_m[2] - down)
        top_m = max(vehicle_above_m, self._return_above_m(distance_m))
        speeds = (self._view.parameter(name) for name in SPEED_PARAMETERS)
        legs = zip((top_m - vehicle_above_m, distance_m, top_m), speeds, strict=True)
        return sum(leg_m / max(0.1, speed) for leg_m, speed in legs)

    def run(self) -> None:
        """Runs one tick, and starts the next phase when the current one has ended."""
        goal_n, goal_e, _ = self._destination.position_ned_m
        north, east, down = self._view.estimate.position_ned_m
        distance_m = math.hypot(north - goal_n, east - goal_e)
        if self.phase is ReturnPhase.CLIMB and down <= self._return_down_m + ALTITUDE_TOLERANCE_M:
            self._set_phase(ReturnPhase.RETURN)
            self._path.target_ned_m = (goal_n, goal_e, self._return_down_m)
            self._path.face(goal_n, goal_e)
        elif self.phase is ReturnPhase.RETURN and distance_m < self._view.parameter("NAV_ACC_RAD"):
            if self._route:
                self._leg.restart()
                self._fly_to_next_waypoint()
            else:
                self._begin_descent()
        elif self.phase is ReturnPhase.ROUTE:
            self._follow_route()
        elif self.phase is ReturnPhase.DESCEND:
            goal = self._path.target_ned_m[2]
            if goal is None or down >= goal - ALTITUDE_TOLERANCE_M:
                self._set_phase(ReturnPhase.WAIT)
        elif self.phase is ReturnPhase.WAIT:
            self._wait()
        self._move()

    def _move(self) -> None:
        if self.phase is ReturnPhase.LAND:
            self._path.descend()
        elif self.phase is ReturnPhase.ROUTE:
            self._path.face(*self._leg.target_ned_m[:2])
            self._leg.fly()
        else:
            self._path.fly_to_target()

    def _begin_descent(self) -> None:
        self._announcer.announce(6, "RTL: land at destination", "rtl_land_at_destination")
        self._path.yaw_target_rad = self._destination.yaw_ned_rad
        if self._view.parameter("RTL_LAND_DELAY") == 0.0:
            self._land()
            return
        goal_n, goal_e, goal_d = self._destination.position_ned_m
        down = self._view.estimate.position_ned_m[2]
        self._set_phase(ReturnPhase.DESCEND)
        descend_alt_m = self._view.parameter("RTL_DESCEND_ALT")
        self._path.target_ned_m = (goal_n, goal_e, max(down, goal_d - descend_alt_m))

    def _wait(self) -> None:
        delay_s = self._view.parameter("RTL_LAND_DELAY")
        if delay_s < 0.0:
            self._set_phase(ReturnPhase.LOITER)
            self._announcer.announce(6, "RTL: completed, loitering", "rtl_completed_loiter")
        elif self._view.time_s - self._phase_since_s >= delay_s:
            self._land()

    def _land(self) -> None:
        self._set_phase(ReturnPhase.LAND)
        self._path.target_ned_m = self._destination.position_ned_m

    # --- routes ----------------------------------------------------------------------------------------

    def _fly_to_next_waypoint(self) -> None:
        waypoint = self._route.pop(0)
        if not self._route:
            # above the landing point, at the trajectory's current altitude
            waypoint = (waypoint[0], waypoint[1], self._path.position_ned_m[2])
        next_target = self._route[0] if self._route else None
        self._leg.set(waypoint, next_target, self._view.parameter("NAV_ACC_RAD"))
        self._set_phase(ReturnPhase.ROUTE)

    def _follow_route(self) -> None:
        n, e, d = self._view.estimate.position_ned_m
        tn, te, td = self._leg.target_ned_m
        if math.hypot(tn - n, te - e) > self._leg.acceptance_m or abs(td - d) > ALTITUDE_TOLERANCE_M:
            return
        if self._route:
            self._fly_to_next_waypoint()
        elif self._destination.kind is DestinationKind.MISSION_LANDING:
            self._path.yaw_target_rad = self._destination.yaw_ned_rad
            self._land()
        else:
            self._begin_descent()

    # --- checks ----------------------------------------------------------------------------------------

    def check_landing(self) -> None:
        """Sends the idle command once after a landing, as PX4 does."""
        if self.phase is ReturnPhase.LAND and not self._idle_sent:
            self._idle_sent = True
            parameter = self._view.parameter
            ground_amsl_m = self._view.origin[2] - self._destination.position_ned_m[2]
            radius_m, loiter_m = parameter("NAV_ACC_RAD"), parameter("NAV_LOITER_RAD")
            self._commands.send(IDLE_COMMAND, 0.0, radius_m, loiter_m, math.nan, 0.0, 0.0, ground_amsl_m)

    def check_rally_points(self) -> None:
        """Reports rally points in an unsupported frame shortly after their upload, and then every two
        seconds; call it at each tick."""
        if self._rally_revision != self._plans.revision(RALLY):
            self._rally_revision = self._plans.revision(RALLY)
            self._rally_check_at_s = self._view.time_s + RALLY_CHECK_DELAY_S
        if self._view.time_s >= self._rally_check_at_s:
            is_repeated = self._chooser.report_unsupported()
            self._rally_check_at_s = self._view.time_s + RALLY_CHECK_EVERY_S if is_repeated else math.inf

    @property
    def checks_rally_points(self) -> bool:
        """Whether rally points must still be checked."""
        return math.isfinite(self._rally_check_at_s)

    @property
    def landing(self) -> bool:
        """Whether the return descends to land at its destination."""
        return self.phase in (ReturnPhase.DESCEND, ReturnPhase.WAIT, ReturnPhase.LAND)

    def _set_phase(self, phase: ReturnPhase) -> None:
        self.phase = phase
        self._phase_since_s = self._view.time_s
