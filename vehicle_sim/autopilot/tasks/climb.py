"""Take-off: straight up to the height that was asked for."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.path import TICK_S, Path
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import VehicleView

CLIMB_DELAY_S = 1.4
"""From the start of the take-off ramp until the climb begins (measured on PX4: the ramp passes zero then)."""
LEAST_CLIMB_M = 0.2
"""Less above the vehicle does not lift it off."""
CLIMB_ACCELERATION_M_S2 = 0.5
CLIMB_APPROACH = 1.15
"""Speed over the square root of the height left near the target (both from recorded take-offs)."""


class Climb:
    """The flight task of mode Takeoff."""

    def __init__(self, view: VehicleView, announcer: Announcer, path: Path, home: Home) -> None:
        self._view = view
        self._announcer = announcer
        self._path = path
        self._home = home
        self.alt_amsl_m = math.nan
        """What the command asked for, kept until the climb begins; NaN: MIS_TAKEOFF_ALT."""
        self._climb_since_s = math.nan

    def enter(self) -> None:
        """Choose the height: the one asked for, else MIS_TAKEOFF_ALT from here, and never below here."""
        default_m = self._view.parameter("MIS_TAKEOFF_ALT")
        here = self._view.estimate.alt_amsl_m
        wanted, self.alt_amsl_m = self.alt_amsl_m, math.nan
        if not math.isfinite(wanted):
            wanted = here + default_m
            self._announcer.both(
                6,
                f"Using default takeoff altitude: {default_m:.1f} m",
                "navigator_takeoff_default_alt",
                "f",
                default_m,
            )
        elif wanted < here:
            wanted = here
            self._announcer.both(
                2, "Already higher than takeoff altitude", "navigator_takeoff_already_higher"
            )
        self.begin(wanted)

    @property
    def wants_to_climb(self) -> bool:
        """Whether the height that was chosen is above the vehicle; if not it stays on the ground."""
        down = self._path.target_ned_m[2]
        return down is not None and down < self._view.estimate.position_ned_m[2] - LEAST_CLIMB_M

    def begin(self, alt_amsl_m: float) -> None:
        """Straight up to an altitude, as a mission also asks for before its first item."""
        self._climb_since_s = math.nan
        north, east, _ = self._view.estimate.position_ned_m
        self._path.target_ned_m = (north, east, self._view.origin[2] - alt_amsl_m)

    @property
    def goal_alt_amsl_m(self) -> float:
        """The altitude of the climb that was begun."""
        down = self._path.target_ned_m[2]
        return math.nan if down is None else self._view.origin[2] - down

    def run(self) -> None:
        """One tick of the climb; the take-off ramp limits it at first."""
        _, _, down = self._path.target_ned_m
        z = self._view.estimate.position_ned_m[2]
        self._path.advance_horizontal()
        now_s = self._view.time_s
        if math.isnan(self._climb_since_s):
            self._climb_since_s = now_s
        left_m = max(0.0, z - down) if down is not None else 0.0
        high = self._home.position_ned_m[2] - z > self._view.parameter("MPC_LAND_ALT1")
        fastest = self._view.parameter("MPC_Z_V_AUTO_UP" if high else "MPC_TKO_SPEED")
        wanted = min(fastest, CLIMB_APPROACH * math.sqrt(left_m))
        if now_s - self._climb_since_s < CLIMB_DELAY_S:
            wanted = 0.0
        if high:
            self._path.z_towards(-wanted)
        else:
            rate = CLIMB_ACCELERATION_M_S2 if -wanted < self._path.z.velocity_m_s else 2.0
            step = rate * TICK_S
            self._path.z.velocity_m_s += max(-step, min(step, -wanted - self._path.z.velocity_m_s))
            self._path.z.acceleration_m_s2 = 0.0
        self._path.z.position_m = z
        self._path.write()
