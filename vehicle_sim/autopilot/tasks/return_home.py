"""Return: climb, fly to where it ends, land there (by RTL_LAND_DELAY after a wait); or along a route."""

from __future__ import annotations

import math
from enum import Enum

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.mission.leg import Leg
from vehicle_sim.autopilot.own_commands import OwnCommands
from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.plans import RALLY, Plans
from vehicle_sim.autopilot.tasks.descent import Descent
from vehicle_sim.autopilot.tasks.destination import Chooser, Destination, Kind
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import Vector, VehicleView

LEVEL_M = 0.8
"""So near its height the vehicle goes on."""
LOWEST_OVER_RADIUS = 2.0
"""PX4 returns no lower than twice NAV_ACC_RAD over the destination unless it is right there."""
RETURN_SPEEDS = ("MPC_Z_V_AUTO_UP", "MPC_XY_CRUISE", "MPC_Z_V_AUTO_DN")
RALLY_CHECKED_AFTER_S = 0.8
IDLE = 0


class ReturnPhase(Enum):
    """Where a return is."""

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
        descent: Descent,
        plans: Plans,
        commands: OwnCommands,
    ) -> None:
        self._view = view
        self._announcer = announcer
        self._path = path
        self._home = home
        self._descent = descent
        self._plans = plans
        self._commands = commands
        self._chooser = Chooser(view, announcer, home, plans)
        self._leg = Leg(path)
        self.phase = ReturnPhase.CLIMB
        self._phase_since_s = 0.0
        self._return_z_m = 0.0
        self._to = Destination(Kind.HOME, (0.0, 0.0, 0.0), 0.0)
        self._route: list[Vector] = []
        self._told_landed = False
        self._rally_revision = 0
        self._rally_due_s = math.inf

    def enter(self, mission_seq: int) -> None:
        """Choose where to, and the height of the way; say it."""
        self._to = self._chooser.choose(mission_seq)
        self._route = list(self._to.route_ned_m)
        self._told_landed = False
        north, east, down = self._view.estimate.position_ned_m
        if not self._to.climbs:
            self._leg.restart()
            self._next_on_route()
            return
        to_n, to_e, to_d = self._to.place_ned_m
        distance = math.hypot(north - to_n, east - to_e)
        height = to_d - down
        height = max(height, self._return_height(distance, height))
        self._return_z_m = to_d - height
        self._set_phase(ReturnPhase.CLIMB)
        self._path.target_ned_m = (north, east, self._return_z_m)
        above = math.ceil(height)
        if self._to.kind is Kind.LANDING:
            amsl = round(self._view.origin[2] - self._return_z_m)
            self._announcer.both(
                6, f"RTL Mission Land: climb to {amsl} m", "rtl_mission_land_climb", "i", amsl
            )
            return
        amsl = math.ceil(self._view.origin[2] - to_d + height)
        self._announcer.both(
            6, f"RTL: start return at {amsl} m ({above} m above destination)",
            "vrtl_return_at", "ii", amsl, above,
        )  # fmt: skip

    def _return_height(self, distance_m: float, height_m: float) -> float:
        """RTL_RETURN_ALT, or within RTL_MIN_DIST what the cone of RTL_CONE_ANG asks for."""
        parameter = self._view.parameter
        radius = parameter("NAV_ACC_RAD")
        if distance_m <= radius:
            return height_m
        wanted = parameter("RTL_RETURN_ALT")
        cone_deg = self._view.choice("RTL_CONE_ANG")
        if cone_deg >= 90:
            wanted = parameter("RTL_DESCEND_ALT")
        elif cone_deg > 0 and distance_m < parameter("RTL_MIN_DIST"):
            wanted = min(wanted, distance_m / math.tan(math.radians(cone_deg)))
        return max(wanted, LOWEST_OVER_RADIUS * radius)

    def duration_s(self, to_ned_m: Vector) -> float:
        """Climb, way and descent to a place from here, at the speeds of the parameters."""
        north, east, down = self._view.estimate.position_ned_m
        distance = math.hypot(north - to_ned_m[0], east - to_ned_m[1])
        height = max(0.0, to_ned_m[2] - down)
        top = max(height, self._return_height(distance, height))
        speeds = (self._view.parameter(name) for name in RETURN_SPEEDS)
        ways = zip((top - height, distance, top), speeds, strict=True)
        return sum(way_m / max(0.1, speed) for way_m, speed in ways)

    def run(self) -> None:
        """One tick of the phase, or on to the next."""
        to_n, to_e, _ = self._to.place_ned_m
        north, east, down = self._view.estimate.position_ned_m
        distance = math.hypot(north - to_n, east - to_e)
        if self.phase is ReturnPhase.CLIMB and down <= self._return_z_m + LEVEL_M:
            self._set_phase(ReturnPhase.RETURN)
            self._path.target_ned_m = (to_n, to_e, self._return_z_m)
            self._path.face(to_n, to_e)
        elif self.phase is ReturnPhase.RETURN and distance < self._view.parameter("NAV_ACC_RAD"):
            if self._route:
                self._leg.restart()
                self._next_on_route()
            else:
                self._begin_descent()
        elif self.phase is ReturnPhase.ROUTE:
            self._follow_route()
        elif self.phase is ReturnPhase.DESCEND:
            goal = self._path.target_ned_m[2]
            if goal is None or down >= goal - LEVEL_M:
                self._set_phase(ReturnPhase.WAIT)
        elif self.phase is ReturnPhase.WAIT:
            self._wait()
        self._move()

    def _move(self) -> None:
        if self.phase is ReturnPhase.LAND:
            self._descent.run()
        elif self.phase is ReturnPhase.ROUTE:
            self._path.face(*self._leg.target_ned_m[:2])
            self._leg.fly()
        else:
            self._path.fly_to_target()

    def _begin_descent(self) -> None:
        self._announcer.both(6, "RTL: land at destination", "rtl_land_at_destination")
        self._path.yaw_target_rad = self._to.yaw_ned_rad
        if self._view.parameter("RTL_LAND_DELAY") == 0.0:
            self._land()
            return
        to_n, to_e, to_d = self._to.place_ned_m
        down = self._view.estimate.position_ned_m[2]
        self._set_phase(ReturnPhase.DESCEND)
        descend = self._view.parameter("RTL_DESCEND_ALT")
        self._path.target_ned_m = (to_n, to_e, max(down, to_d - descend))

    def _wait(self) -> None:
        delay_s = self._view.parameter("RTL_LAND_DELAY")
        if delay_s < 0.0:
            self._set_phase(ReturnPhase.LOITER)
            self._announcer.both(6, "RTL: completed, loitering", "rtl_completed_loiter")
        elif self._view.time_s - self._phase_since_s >= delay_s:
            self._land()

    def _land(self) -> None:
        self._set_phase(ReturnPhase.LAND)
        self._path.target_ned_m = self._to.place_ned_m

    # --- routes ----------------------------------------------------------------------------------------

    def _next_on_route(self) -> None:
        place = self._route.pop(0)
        if not self._route:
            # above the landing, as high as the way to it
            place = (place[0], place[1], self._path.position_ned_m[2])
        onward = self._route[0] if self._route else None
        self._leg.set(place, onward, self._view.parameter("NAV_ACC_RAD"))
        self._set_phase(ReturnPhase.ROUTE)

    def _follow_route(self) -> None:
        n, e, d = self._view.estimate.position_ned_m
        tn, te, td = self._leg.target_ned_m
        if math.hypot(tn - n, te - e) > self._leg.acceptance_m or abs(td - d) > LEVEL_M:
            return
        if self._route:
            self._next_on_route()
        elif self._to.kind is Kind.LANDING:
            self._path.yaw_target_rad = self._to.yaw_ned_rad
            self._land()
        else:
            self._begin_descent()

    # --- any time --------------------------------------------------------------------------------------

    def notice_landing(self) -> None:
        """On the ground again: PX4 tells itself to idle, once."""
        if self.phase is ReturnPhase.LAND and not self._told_landed:
            self._told_landed = True
            parameter = self._view.parameter
            ground = self._view.origin[2] - self._to.place_ned_m[2]
            self._commands.send(
                IDLE, 0.0, parameter("NAV_ACC_RAD"), parameter("NAV_LOITER_RAD"), math.nan, 0.0, 0.0, ground
            )

    def notice_rally(self) -> None:
        """Each tick: new rally points in a frame that PX4 does not understand are told of a moment later."""
        if self._rally_revision != self._plans.revision(RALLY):
            self._rally_revision = self._plans.revision(RALLY)
            self._rally_due_s = self._view.time_s + RALLY_CHECKED_AFTER_S
        if self._view.time_s >= self._rally_due_s:
            self._rally_due_s = math.inf
            self._chooser.complain()

    @property
    def landing(self) -> bool:
        """A return that has arrived over its end."""
        return self.phase in (ReturnPhase.DESCEND, ReturnPhase.WAIT, ReturnPhase.LAND)

    def _set_phase(self, phase: ReturnPhase) -> None:
        self.phase = phase
        self._phase_since_s = self._view.time_s
