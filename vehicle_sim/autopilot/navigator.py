"""From the active mode to a trajectory: take-off, hold, goto, landing, return, orbit and sinking blind."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.body import Body, Vector
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.row import NAN3, SetpointRow
from vehicle_sim.autopilot.trajectory import Axis, YawRamp, max_speed_for_distance
from vehicle_sim.geodesy import to_local

TICK_S = 0.02
"""PX4's flight tasks run at 50 Hz."""
CLIMB_DELAY_S = 1.4
"""From the start of the take-off ramp until the climb begins (measured on PX4: the ramp passes zero then)."""
CLIMB_ACCELERATION_M_S2 = 0.5
CLIMB_APPROACH = 1.15
"""Speed over the square root of the height left near the target (both from recorded take-offs)."""
LANDING_MODES = frozenset({NavState.LAND, NavState.PRECISION_LAND})


class ReturnPhase(Enum):
    """Where a return to launch is."""

    CLIMB = "climb"
    RETURN = "return"
    DESCEND = "descend"
    WAIT = "wait"
    LAND = "land"


@dataclass(slots=True)
class Home:
    """Where the vehicle returns to, in its local frame and on the globe."""

    lat_deg: float = math.nan
    lon_deg: float = math.nan
    alt_amsl_m: float = math.nan
    position_ned_m: Vector = (0.0, 0.0, 0.0)
    yaw_ned_rad: float = 0.0
    set_at_us: int = 0
    manual: bool = False

    @property
    def valid(self) -> bool:
        """Whether it was ever set."""
        return math.isfinite(self.lat_deg)


class Navigator:
    """Trajectories of one vehicle."""

    def __init__(self, body: Body, announcer: Announcer, row: SetpointRow, home: Home) -> None:
        self._body = body
        self._announcer = announcer
        self._row = row
        self.home = home
        self._x, self._y, self._z, self._yaw = Axis(), Axis(), Axis(), YawRamp()
        self.target_ned_m: tuple[float | None, float | None, float | None] = (None, None, None)
        self._yaw_target_rad = 0.0
        self._takeoff_alt_amsl_m = math.nan
        self.cruise_m_s = math.nan
        self.climb_m_s = math.nan
        self.descent_m_s = math.nan
        self.phase = ReturnPhase.CLIMB
        self._phase_since_s = 0.0
        self._return_z_m = 0.0
        self._climb_since_s = math.nan
        self._orbit: tuple[float, float, float, float] | None = None
        """Centre north, east, radius, speed."""

    # --- what commands ask for -------------------------------------------------------------------------

    def request_takeoff(self, alt_amsl_m: float) -> None:
        """Remember the altitude a take-off command gave (NaN: MIS_TAKEOFF_ALT)."""
        self._takeoff_alt_amsl_m = alt_amsl_m

    def goto(self, lat_deg: float, lon_deg: float, alt_amsl_m: float, yaw_ned_rad: float) -> None:
        """DO_REPOSITION; what is not finite stays as it is."""
        north, east, down = self._trajectory_position()
        old = self.target_ned_m
        origin_lat, origin_lon, origin_alt = self._body.origin
        target_n, target_e, target_d = (
            old[0] if old[0] is not None else north,
            old[1] if old[1] is not None else east,
            old[2] if old[2] is not None else down,
        )
        if _is_latitude(lat_deg) and math.isfinite(lon_deg):
            n, e = to_local(lat_deg, lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
            target_n, target_e = float(n), float(e)
        if math.isfinite(alt_amsl_m):
            target_d = -(alt_amsl_m - origin_alt)
        self.target_ned_m = (target_n, target_e, target_d)
        if math.isfinite(yaw_ned_rad):
            self._yaw_target_rad = yaw_ned_rad
        else:
            self._face(target_n, target_e)

    def orbit(self, lat_deg: float, lon_deg: float, radius_m: float, speed_m_s: float) -> None:
        """DO_ORBIT around a place, by default around where the vehicle is."""
        north, east, _ = self._trajectory_position()
        if _is_latitude(lat_deg) and math.isfinite(lon_deg):
            origin_lat, origin_lon, _ = self._body.origin
            n, e = to_local(lat_deg, lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
            north, east = float(n), float(e)
        radius = radius_m if math.isfinite(radius_m) else 1.0
        fastest = self._body.parameter("MPC_XY_VEL_MAX")
        speed = max(-fastest, min(fastest, speed_m_s)) if math.isfinite(speed_m_s) else 1.0
        if not 1.0 <= abs(radius) <= 1000.0:
            self._announcer.both(2, "Orbit radius limit exceeded", "orbit_radius_exceeded")
            return
        self._orbit = (north, east, abs(radius), math.copysign(speed, radius * speed))

    # --- modes -----------------------------------------------------------------------------------------

    def enter(self, mode: NavState, previous: NavState, *, in_air: bool) -> None:
        """Start a mode from where the vehicle is and how it moves."""
        belief = self._body.belief
        if previous is not NavState.TAKEOFF or mode is not NavState.HOLD:
            for axis, at, speed in zip(
                (self._x, self._y, self._z), belief.position_ned_m, belief.velocity_ned_m_s, strict=True
            ):
                axis.reset(at, speed if in_air else 0.0)
            self._yaw.reset(belief.yaw_ned_rad)
            self._yaw_target_rad = belief.yaw_ned_rad
            self.target_ned_m = (None, None, None)
        if mode is NavState.TAKEOFF:
            self._enter_takeoff()
        elif mode is NavState.RTL:
            self._enter_return()
        elif mode is NavState.ORBIT and self._orbit is None:
            n, e, _ = belief.position_ned_m
            self._orbit = (n, e, 1.0, 1.0)

    def _enter_takeoff(self) -> None:
        self._climb_since_s = math.nan
        origin_alt = self._body.origin[2]
        default_m = self._body.parameter("MIS_TAKEOFF_ALT")
        lowest = self.home.alt_amsl_m + default_m
        wanted = self._takeoff_alt_amsl_m
        self._takeoff_alt_amsl_m = math.nan
        here = self._body.belief.alt_amsl_m
        if not math.isfinite(wanted):
            self._announcer.both(
                6,
                f"Using default takeoff altitude: {default_m:.1f} m",
                "navigator_takeoff_default_alt",
                "f",
                default_m,
            )
        elif here > max(wanted, lowest):
            self._announcer.both(
                2, "Already higher than takeoff altitude", "navigator_takeoff_already_higher"
            )
        wanted = max(
            lowest, here if here > lowest + 1.0 else lowest, wanted if math.isfinite(wanted) else lowest
        )
        north, east, _ = self._body.belief.position_ned_m
        self.target_ned_m = (north, east, -(wanted - origin_alt))

    def _enter_return(self) -> None:
        north, east, down = self._body.belief.position_ned_m
        home_n, home_e, home_d = self.home.position_ned_m
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
        self.target_ned_m = (north, east, self._return_z_m)
        amsl, above = round(self.home.alt_amsl_m + height), round(height)
        self._announcer.both(
            6, f"RTL: start return at {amsl} m ({above} m above destination)",
            "vrtl_return_at", "ii", amsl, above,
        )  # fmt: skip

    def finished(self, mode: NavState) -> bool:
        """Whether a take-off has arrived."""
        down = self.target_ned_m[2]
        if mode is not NavState.TAKEOFF or down is None:
            return False
        return self._body.belief.position_ned_m[2] <= down + self._body.parameter("NAV_MC_ALT_RAD")

    def wants_to_climb(self, mode: NavState) -> bool:
        """Whether the mode would lift a vehicle that stands on the ground."""
        down = self.target_ned_m[2]
        if mode is NavState.TAKEOFF:
            return True
        if mode is NavState.RTL and self.landing:
            return False
        if mode in (NavState.HOLD, NavState.RTL) and down is not None:
            return down < self._body.belief.position_ned_m[2] - 0.5
        return False

    def descends(self, mode: NavState) -> bool:
        """Whether the mode is on its way down, so that contact may be landing."""
        if mode is NavState.RTL:
            return self.phase in (ReturnPhase.DESCEND, ReturnPhase.LAND)
        return mode not in (NavState.TAKEOFF, NavState.HOLD, NavState.ORBIT, NavState.FOLLOW)

    def run(self, mode: NavState, *, flying: bool) -> None:
        """One tick of the active mode; writes the set points."""
        if mode in LANDING_MODES:
            self._land(flying)
        elif mode is NavState.TAKEOFF:
            self._climb(flying)
        elif mode is NavState.RTL:
            self._return(flying)
        elif mode is NavState.ORBIT:
            self._circle(flying)
        elif mode in (NavState.HOLD, NavState.FOLLOW, NavState.MISSION):
            self._fly_to_target(flying)
        else:
            self.sink()

    def sink(self) -> None:
        """Level and down at landing speed: what is left without sticks or without a position."""
        speed = self._body.parameter("MPC_LAND_SPEED")
        self._row.trajectory(
            velocity_ned_m_s=(math.nan, math.nan, speed),
            acceleration_ned_m_s2=(0.0, 0.0, math.nan),
            yaw_ned_rad=self._yaw_target_rad,
        )

    def idle(self) -> None:
        """The vehicle stands: the trajectory waits at its place, and a target may still lift it."""
        x, y, z = self._body.belief.position_ned_m
        self._x.reset(x)
        self._y.reset(y)
        self._z.reset(z)

    # --- pieces ----------------------------------------------------------------------------------------

    def _trajectory_position(self) -> Vector:
        return (self._x.position_m, self._y.position_m, self._z.position_m)

    def _face(self, north_m: float, east_m: float) -> None:
        dn, de = north_m - self._x.position_m, east_m - self._y.position_m
        if math.hypot(dn, de) > 1.0 and self._body.choice("MPC_YAW_MODE") in (0, 3, 4):
            self._yaw_target_rad = math.atan2(de, dn)

    def _fly_to_target(self, flying: bool) -> None:
        self._advance_horizontal()
        self._advance_vertical(flying)
        self._write()

    def _advance_horizontal(self) -> None:
        limit = dict(
            acceleration_limit_m_s2=self._body.parameter("MPC_ACC_HOR"),
            jerk_limit_m_s3=self._body.parameter("MPC_JERK_AUTO"),
        )
        north, east, _ = self.target_ned_m
        if north is None or east is None:
            wanted_n = wanted_e = 0.0
            if math.hypot(self._x.velocity_m_s, self._y.velocity_m_s) < 0.05:
                self.target_ned_m = (self._x.position_m, self._y.position_m, self.target_ned_m[2])
        else:
            dn, de = north - self._x.position_m, east - self._y.position_m
            distance = math.hypot(dn, de)
            cruise = self.cruise_m_s if math.isfinite(self.cruise_m_s) else math.inf
            cruise = min(
                cruise if cruise < math.inf else self._body.parameter("MPC_XY_CRUISE"),
                self._body.parameter("MPC_XY_VEL_MAX"),
            )
            speed = min(
                cruise,
                max_speed_for_distance(limit["jerk_limit_m_s3"], limit["acceleration_limit_m_s2"], distance),
            )
            wanted_n = wanted_e = 0.0
            if distance > 1e-6:
                wanted_n, wanted_e = speed * dn / distance, speed * de / distance
        x, y, _ = self._body.belief.position_ned_m
        behind_n, behind_e = self._x.position_m - x, self._y.position_m - y
        stretch = 1.0
        if behind_n * self._x.velocity_m_s + behind_e * self._y.velocity_m_s >= 0.0:
            # A vehicle that is ahead is not waited for: a trajectory that stood would never arrive.
            error_m = math.hypot(behind_n, behind_e)
            stretch -= min(1.0, error_m / max(0.1, self._body.parameter("MPC_XY_ERR_MAX")))
        self._x.advance(wanted_n, TICK_S, stretch=stretch, **limit)
        self._y.advance(wanted_e, TICK_S, stretch=stretch, **limit)

    def _advance_vertical(self, flying: bool) -> None:
        down = self.target_ned_m[2]
        z = self._body.belief.position_ned_m[2]
        if not flying:
            self._z.reset(z)
        if down is None:
            wanted = 0.0
            if abs(self._z.velocity_m_s) < 0.05 and flying:
                north, east, _ = self.target_ned_m
                self.target_ned_m = (north, east, self._z.position_m)
        else:
            wanted = self._vertical_speed(down - self._z.position_m)
        self._z_towards(wanted)
        if abs(self._z.position_m - z) > 1.0:
            self._z.position_m = z + math.copysign(1.0, self._z.position_m - z)

    def _vertical_speed(self, way_m: float) -> float:
        up = way_m < 0.0
        override = self.climb_m_s if up else self.descent_m_s
        limit = override if math.isfinite(override) else self._body.parameter(
            "MPC_Z_V_AUTO_UP" if up else "MPC_Z_V_AUTO_DN"
        )  # fmt: skip
        acceleration = self._body.parameter("MPC_ACC_UP_MAX" if up else "MPC_ACC_DOWN_MAX")
        jerk = self._body.parameter("MPC_JERK_AUTO")
        return math.copysign(min(limit, max_speed_for_distance(jerk, acceleration, abs(way_m))), way_m)

    def _z_towards(self, velocity_m_s: float) -> None:
        name = "MPC_ACC_UP_MAX" if velocity_m_s < self._z.velocity_m_s else "MPC_ACC_DOWN_MAX"
        self._z.advance(
            velocity_m_s,
            TICK_S,
            acceleration_limit_m_s2=self._body.parameter(name),
            jerk_limit_m_s3=self._body.parameter("MPC_JERK_AUTO"),
        )

    def _climb(self, flying: bool) -> None:
        _, _, down = self.target_ned_m
        z = self._body.belief.position_ned_m[2]
        del flying
        self._advance_horizontal()
        now_s = self._body.time_s
        if math.isnan(self._climb_since_s):
            self._climb_since_s = now_s
        left_m = max(0.0, z - down) if down is not None else 0.0
        wanted = min(self._body.parameter("MPC_TKO_SPEED"), CLIMB_APPROACH * math.sqrt(left_m))
        if now_s - self._climb_since_s < CLIMB_DELAY_S:
            wanted = 0.0
        rate = CLIMB_ACCELERATION_M_S2 if -wanted < self._z.velocity_m_s else 2.0
        step = rate * TICK_S
        self._z.velocity_m_s += max(-step, min(step, -wanted - self._z.velocity_m_s))
        self._z.acceleration_m_s2 = 0.0
        self._z.position_m = z
        self._write()

    def height_above_ground_m(self) -> float:
        """Over where the vehicle took off (it has no working range finder)."""
        return self.home.position_ned_m[2] - self._body.belief.position_ned_m[2]

    def _land_speed(self) -> float:
        parameter = self._body.parameter
        height = self.height_above_ground_m()
        fast, slow = parameter("MPC_Z_V_AUTO_DN"), parameter("MPC_LAND_SPEED")
        high, low = parameter("MPC_LAND_ALT1"), parameter("MPC_LAND_ALT2")
        if height >= high:
            return fast
        if height > low and high > low:
            return slow + (fast - slow) * (height - low) / (high - low)
        return slow

    def _land(self, flying: bool) -> None:
        self._advance_horizontal()
        self._z_towards(self._land_speed())
        self._z.position_m = self._body.belief.position_ned_m[2]
        del flying
        self._write()

    def _set_phase(self, phase: ReturnPhase) -> None:
        self.phase = phase
        self._phase_since_s = self._body.time_s

    def _return(self, flying: bool) -> None:
        home_n, home_e, home_d = self.home.position_ned_m
        north, east, down = self._body.belief.position_ned_m
        distance = math.hypot(north - home_n, east - home_e)
        waited_s = self._body.time_s - self._phase_since_s
        if self.phase is ReturnPhase.CLIMB and down <= self._return_z_m + 0.8:
            self._set_phase(ReturnPhase.RETURN)
            self.target_ned_m = (home_n, home_e, self._return_z_m)
            self._face(home_n, home_e)
        elif self.phase is ReturnPhase.RETURN and distance < self._body.parameter("NAV_ACC_RAD"):
            self._set_phase(ReturnPhase.DESCEND)
            self._announcer.both(6, "RTL: land at destination", "rtl_land_at_destination")
            self._yaw_target_rad = self.home.yaw_ned_rad
            descend = self._body.parameter("RTL_DESCEND_ALT")
            self.target_ned_m = (home_n, home_e, max(down, home_d - descend))
        elif self.phase is ReturnPhase.DESCEND:
            goal = self.target_ned_m[2]
            if goal is None or down >= goal - 0.8:
                self._set_phase(ReturnPhase.WAIT)
        elif self.phase is ReturnPhase.WAIT:
            delay = self._body.parameter("RTL_LAND_DELAY")
            if delay >= 0.0 and waited_s >= delay:
                self._set_phase(ReturnPhase.LAND)
        if self.phase is ReturnPhase.LAND:
            self._land(flying)
        else:
            self._fly_to_target(flying)

    @property
    def landing(self) -> bool:
        """A return that has arrived over home."""
        return self.phase in (ReturnPhase.DESCEND, ReturnPhase.WAIT, ReturnPhase.LAND)

    def _circle(self, flying: bool) -> None:
        if self._orbit is None:
            self._fly_to_target(flying)
            return
        centre_n, centre_e, radius, speed = self._orbit
        north, east, _ = self._body.belief.position_ned_m
        dn, de = north - centre_n, east - centre_e
        distance = math.hypot(dn, de)
        un, ue = (dn / distance, de / distance) if distance > 0.01 else (1.0, 0.0)
        inward = max(-3.0, min(3.0, 0.8 * (radius - distance)))
        along = speed * max(0.0, 1.0 - abs(radius - distance) / radius)
        self._advance_vertical(flying)
        vn, ve = un * inward - ue * along, ue * inward + un * along
        centripetal = -along * along / radius
        self._yaw_target_rad = math.atan2(-de, -dn)
        self._turn()
        self._row.trajectory(
            (math.nan, math.nan, self._z.position_m),
            (vn, ve, self._z.velocity_m_s),
            (un * centripetal, ue * centripetal, math.nan),
            self._yaw.yaw_ned_rad,
        )

    def _turn(self) -> None:
        self._yaw.advance(
            self._yaw_target_rad,
            TICK_S,
            math.radians(self._body.parameter("MPC_YAWRAUTO_MAX")),
            math.radians(self._body.parameter("MPC_YAWRAUTO_ACC")),
        )

    def _write(self) -> None:
        self._turn()
        x, y, z = self._x, self._y, self._z
        self._row.trajectory(
            (x.position_m, y.position_m, z.position_m),
            (x.velocity_m_s, y.velocity_m_s, z.velocity_m_s),
            (x.acceleration_m_s2, y.acceleration_m_s2, z.acceleration_m_s2),
            self._yaw.yaw_ned_rad,
            self._yaw.rate_rad_s,
        )


def _is_latitude(value: float) -> bool:
    return math.isfinite(value) and abs(value) <= 90.0


__all__ = ["NAN3", "TICK_S", "Home", "Navigator", "ReturnPhase"]
