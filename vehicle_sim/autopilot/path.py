"""The trajectory that all automatic modes share: a target, smooth axes towards it, and the set points.

Lengths in metres, NED; `run` methods of the flight tasks call it once a tick of 50 Hz.
"""

from __future__ import annotations

import math

from vehicle_sim.autopilot.body import Body, Vector
from vehicle_sim.autopilot.row import SetpointRow
from vehicle_sim.autopilot.trajectory import Axis, YawRamp, max_speed_for_distance

TICK_S = 0.02
"""PX4's flight tasks run at 50 Hz."""
TAKEN_OVER_M_S2 = 10.0
"""More is no motion but a push against the ground."""


class Path:
    """Where the trajectory is, how it moves and where it leads."""

    def __init__(self, body: Body, row: SetpointRow) -> None:
        self._body = body
        self._row = row
        self.x, self.y, self.z, self.yaw = Axis(), Axis(), Axis(), YawRamp()
        self.target_ned_m: tuple[float | None, float | None, float | None] = (None, None, None)
        """None: not chosen yet, the vehicle comes to rest first."""
        self.yaw_target_rad = 0.0
        self.cruise_m_s = math.nan
        """NaN, here and below: as the parameters say."""
        self.climb_m_s = math.nan
        self.descent_m_s = math.nan

    def restart(self, *, in_air: bool, goes_on: bool = False) -> None:
        """Begin where the vehicle is, as fast as it moves.

        Args:
            in_air: on the ground the trajectory begins at rest.
            goes_on: take over what the flight task before asked for last, where it controlled it.
        """
        belief = self._body.belief
        asked = self._row.asked() if goes_on and in_air else ((math.nan,) * 3,) * 3
        for k, axis in enumerate((self.x, self.y, self.z)):
            at, speed, acceleration = (row[k] for row in asked)
            axis.reset(
                at if math.isfinite(at) else belief.position_ned_m[k],
                speed if math.isfinite(speed) else belief.velocity_ned_m_s[k] if in_air else 0.0,
            )
            if abs(acceleration) <= TAKEN_OVER_M_S2:
                axis.acceleration_m_s2 = acceleration
        self.yaw.reset(belief.yaw_ned_rad)
        self.yaw_target_rad = belief.yaw_ned_rad
        self.target_ned_m = (None, None, None)

    def idle(self) -> None:
        """The vehicle stands: the trajectory waits at its place, and a target may still lift it."""
        x, y, z = self._body.belief.position_ned_m
        self.x.reset(x)
        self.y.reset(y)
        self.z.reset(z)

    @property
    def position_ned_m(self) -> Vector:
        """Where the trajectory is."""
        return (self.x.position_m, self.y.position_m, self.z.position_m)

    def face(self, north_m: float, east_m: float) -> None:
        """Turn the nose towards a place, where MPC_YAW_MODE wants that and it is not right here."""
        dn, de = north_m - self.x.position_m, east_m - self.y.position_m
        if math.hypot(dn, de) > 1.0 and self._body.choice("MPC_YAW_MODE") in (0, 3, 4):
            self.yaw_target_rad = math.atan2(de, dn)

    def fly_to_target(self, flying: bool) -> None:
        """One tick towards the target in all axes."""
        self.advance_horizontal()
        self.advance_vertical(flying)
        self.write()

    def advance_horizontal(self) -> None:
        """One tick north and east: PX4 stretches time for a vehicle that lags."""
        limit = dict(
            acceleration_limit_m_s2=self._body.parameter("MPC_ACC_HOR"),
            jerk_limit_m_s3=self._body.parameter("MPC_JERK_AUTO"),
        )
        north, east, _ = self.target_ned_m
        if north is None or east is None:
            wanted_n = wanted_e = 0.0
            if math.hypot(self.x.velocity_m_s, self.y.velocity_m_s) < 0.05:
                self.target_ned_m = (self.x.position_m, self.y.position_m, self.target_ned_m[2])
        else:
            dn, de = north - self.x.position_m, east - self.y.position_m
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
        behind_n, behind_e = self.x.position_m - x, self.y.position_m - y
        stretch = 1.0
        if behind_n * self.x.velocity_m_s + behind_e * self.y.velocity_m_s >= 0.0:
            # A vehicle that is ahead is not waited for: a trajectory that stood would never arrive.
            error_m = math.hypot(behind_n, behind_e)
            stretch -= min(1.0, error_m / max(0.1, self._body.parameter("MPC_XY_ERR_MAX")))
        self.x.advance(wanted_n, TICK_S, stretch=stretch, **limit)
        self.y.advance(wanted_e, TICK_S, stretch=stretch, **limit)

    def advance_vertical(self, flying: bool) -> None:
        """One tick up or down."""
        down = self.target_ned_m[2]
        z = self._body.belief.position_ned_m[2]
        if not flying:
            self.z.reset(z)
        if down is None:
            wanted = 0.0
            if abs(self.z.velocity_m_s) < 0.05 and flying:
                north, east, _ = self.target_ned_m
                self.target_ned_m = (north, east, self.z.position_m)
        else:
            wanted = self._vertical_speed(down - self.z.position_m)
        self.z_towards(wanted)
        if abs(self.z.position_m - z) > 1.0:
            self.z.position_m = z + math.copysign(1.0, self.z.position_m - z)

    def _vertical_speed(self, way_m: float) -> float:
        up = way_m < 0.0
        override = self.climb_m_s if up else self.descent_m_s
        limit = override if math.isfinite(override) else self._body.parameter(
            "MPC_Z_V_AUTO_UP" if up else "MPC_Z_V_AUTO_DN"
        )  # fmt: skip
        acceleration = self._body.parameter("MPC_ACC_UP_MAX" if up else "MPC_ACC_DOWN_MAX")
        jerk = self._body.parameter("MPC_JERK_AUTO")
        return math.copysign(min(limit, max_speed_for_distance(jerk, acceleration, abs(way_m))), way_m)

    def z_towards(self, velocity_m_s: float) -> None:
        """One tick towards a vertical speed (down is positive)."""
        name = "MPC_ACC_UP_MAX" if velocity_m_s < self.z.velocity_m_s else "MPC_ACC_DOWN_MAX"
        self.z.advance(
            velocity_m_s,
            TICK_S,
            acceleration_limit_m_s2=self._body.parameter(name),
            jerk_limit_m_s3=self._body.parameter("MPC_JERK_AUTO"),
        )

    def turn(self) -> None:
        """One tick of the heading towards its target."""
        fastest_rad_s = math.radians(self._body.parameter("MPC_YAWRAUTO_MAX"))
        self.yaw.advance(self.yaw_target_rad, TICK_S, fastest_rad_s)

    def write(self) -> None:
        """Turn, and hand the trajectory to the controllers."""
        self.turn()
        x, y, z = self.x, self.y, self.z
        self._row.trajectory(
            (x.position_m, y.position_m, z.position_m),
            (x.velocity_m_s, y.velocity_m_s, z.velocity_m_s),
            (x.acceleration_m_s2, y.acceleration_m_s2, z.acceleration_m_s2),
            self.yaw.yaw_ned_rad,
            self.yaw.rate_rad_s,
        )
