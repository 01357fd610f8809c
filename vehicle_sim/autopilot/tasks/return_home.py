"""Return to launch: climb, fly home, descend, wait, land."""

from __future__ import annotations

import math
from enum import Enum

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.body import Body
from vehicle_sim.autopilot.home import Home
from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.tasks.descent import Descent


class ReturnPhase(Enum):
    """Where a return to launch is."""

    CLIMB = "climb"
    RETURN = "return"
    DESCEND = "descend"
    WAIT = "wait"
    LAND = "land"


class ReturnHome:
    """The flight task of mode Return."""

    def __init__(self, body: Body, announcer: Announcer, path: Path, home: Home, descent: Descent) -> None:
        self._body = body
        self._announcer = announcer
        self._path = path
        self._home = home
        self._descent = descent
        self.phase = ReturnPhase.CLIMB
        self._phase_since_s = 0.0
        self._return_z_m = 0.0

    def enter(self) -> None:
        """Choose the height of the way back and say it."""
        north, east, down = self._body.belief.position_ned_m
        home_n, home_e, home_d = self._home.position_ned_m
        distance = math.hypot(north - home_n, east - home_e)
        height = home_d - down
        wanted = self._body.parameter("RTL_RETURN_ALT")
        if distance <= self._body.parameter("NAV_ACC_RAD"):
            wanted = height
        elif distance < self._body.parameter("RTL_MIN_DIST"):
            cone_deg = self._body.choice("RTL_CONE_ANG")
            if 0 < cone_deg < 90:
                wanted = min(wanted, max(4.0, distance / math.tan(math.radians(cone_deg))))
        height = max(height, wanted)
        self._return_z_m = home_d - height
        self._set_phase(ReturnPhase.CLIMB)
        self._path.target_ned_m = (north, east, self._return_z_m)
        amsl, above = round(self._home.alt_amsl_m + height), round(height)
        self._announcer.both(
            6, f"RTL: start return at {amsl} m ({above} m above destination)",
            "vrtl_return_at", "ii", amsl, above,
        )  # fmt: skip

    def run(self, flying: bool) -> None:
        """One tick of the phase, or on to the next."""
        home_n, home_e, home_d = self._home.position_ned_m
        north, east, down = self._body.belief.position_ned_m
        distance = math.hypot(north - home_n, east - home_e)
        waited_s = self._body.time_s - self._phase_since_s
        if self.phase is ReturnPhase.CLIMB and down <= self._return_z_m + 0.8:
            self._set_phase(ReturnPhase.RETURN)
            self._path.target_ned_m = (home_n, home_e, self._return_z_m)
            self._path.face(home_n, home_e)
        elif self.phase is ReturnPhase.RETURN and distance < self._body.parameter("NAV_ACC_RAD"):
            self._set_phase(ReturnPhase.DESCEND)
            self._announcer.both(6, "RTL: land at destination", "rtl_land_at_destination")
            self._path.yaw_target_rad = self._home.yaw_ned_rad
            descend = self._body.parameter("RTL_DESCEND_ALT")
            self._path.target_ned_m = (home_n, home_e, max(down, home_d - descend))
        elif self.phase is ReturnPhase.DESCEND:
            goal = self._path.target_ned_m[2]
            if goal is None or down >= goal - 0.8:
                self._set_phase(ReturnPhase.WAIT)
        elif self.phase is ReturnPhase.WAIT:
            delay = self._body.parameter("RTL_LAND_DELAY")
            if delay >= 0.0 and waited_s >= delay:
                self._set_phase(ReturnPhase.LAND)
        if self.phase is ReturnPhase.LAND:
            self._descent.run()
        else:
            self._path.fly_to_target(flying)

    @property
    def landing(self) -> bool:
        """A return that has arrived over home."""
        return self.phase in (ReturnPhase.DESCEND, ReturnPhase.WAIT, ReturnPhase.LAND)

    def _set_phase(self, phase: ReturnPhase) -> None:
        self.phase = phase
        self._phase_since_s = self._body.time_s
