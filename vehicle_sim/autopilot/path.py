"""The trajectory that all automatic modes share: a target, smooth axes towards it, and the setpoints.

Lengths in metres, NED; `run` methods of the flight tasks call it once a tick of 50 Hz.
"""

from __future__ import annotations

import math
import operator

from vehicle_sim.autopilot.row import SetpointRow
from vehicle_sim.autopilot.smoothing import Limits, Smoothing, Way
from vehicle_sim.autopilot.trajectory import YawRamp, fly
from vehicle_sim.vehicle_view import Vector, VehicleView

TICK_S = 0.02
"""PX4's flight tasks run at 50 Hz."""
TAKEN_OVER_M_S2 = 10.0
"""More is no motion but a push against the ground."""
MAX_Z_LEAD_M = 1.0
"""So far the trajectory may be above or below the vehicle."""


class Path:
    """Where the trajectory is, how it moves and where it leads."""

    def __init__(self, view: VehicleView, row: SetpointRow) -> None:
        self._view = view
        self._row = row
        self._smoothing = Smoothing(view)
        self.x, self.y, self.z = self._smoothing.x, self._smoothing.y, self._smoothing.z
        self.yaw = YawRamp()
        self._way: Way | None = None
        """The way to `target_ned_m`, from where the vehicle was when that was chosen."""
        self.target_ned_m: tuple[float | None, float | None, float | None] = (None, None, None)
        """None: not chosen yet, the vehicle comes to rest first."""
        self.yaw_target_rad = 0.0
        self.faces_target = False
        """The nose follows the target while that is farther away than NAV_ACC_RAD."""
        self.cruise_m_s = math.nan
        """NaN, here and below: as the parameters say."""
        self.climb_m_s = math.nan
        self.descent_m_s = math.nan
        self._resets = self._reset_counters()

    def _reset_counters(self) -> list[int]:
        """How often the estimate was reset: level velocity, vertical velocity, level position, height."""
        return self._view.simulation.fusion.resets[:, self._view.row].tolist()

    def follow_resets(self) -> None:
        """Where the estimate was reset the trajectory goes on from there, instead of chasing the step."""
        now = self._reset_counters()
        if now == self._resets:
            return
        level_velocity, climb, level, height = map(operator.ne, now, self._resets)
        self._resets = now
        position, velocity = self._view.estimate.position_ned_m, self._view.estimate.velocity_ned_m_s
        for k, axis in enumerate((self.x, self.y, self.z)):
            if (level, level, height)[k]:
                axis.position_m = position[k]
            if (level_velocity, level_velocity, climb)[k]:
                axis.velocity_m_s = velocity[k]

    def restart(self, *, in_air: bool, goes_on: bool = False) -> None:
        """Begin where the vehicle is, as fast as it moves.

        Args:
            in_air: on the ground the trajectory begins at rest.
            goes_on: take over what the flight task before asked for last, where it controlled it.
        """
        estimate = self._view.estimate
        self._smoothing.begin()
        self._resets = self._reset_counters()
        self._way = None
        asked = self._row.asked() if goes_on and in_air else ((math.nan,) * 3,) * 3
        for k, axis in enumerate((self.x, self.y, self.z)):
            at, speed, acceleration = (row[k] for row in asked)
            axis.reset(
                at if math.isfinite(at) else estimate.position_ned_m[k],
                speed if math.isfinite(speed) else estimate.velocity_ned_m_s[k] if in_air else 0.0,
            )
            if abs(acceleration) <= TAKEN_OVER_M_S2:
                axis.acceleration_m_s2 = acceleration
        self.yaw.reset(estimate.yaw_ned_rad)
        self.yaw_target_rad = estimate.yaw_ned_rad
        self.faces_target = False
        self.target_ned_m = (None, None, None)

    def idle(self) -> None:
        """The vehicle stands: the trajectory waits at its place, and a target may still lift it."""
        x, y, z = self._view.estimate.position_ned_m
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
        if math.hypot(dn, de) > 1.0 and self._view.choice("MPC_YAW_MODE") in (0, 3, 4):
            self.yaw_target_rad = math.atan2(de, dn)

    @property
    def _limits(self) -> Limits:
        return Limits(self.cruise_m_s, self.climb_m_s, self.descent_m_s)

    def _face_target(self) -> None:
        north, east, _ = self.target_ned_m
        if not self.faces_target or north is None or east is None:
            return
        x, y, _ = self._view.estimate.position_ned_m
        if math.hypot(north - x, east - y) > self._view.parameter("NAV_ACC_RAD"):
            self.face(north, east)

    def fly_to_target(self) -> None:
        """One tick towards the target in all axes; what is not chosen yet comes to rest first."""
        self._face_target()
        north, east, down = self.target_ned_m
        if north is not None and east is not None and down is not None:
            self.fly_way(self._way_to((north, east, down)))
            return
        self.advance_vertical(self.advance_horizontal())
        self.write()

    def fly_way(self, way: Way) -> None:
        """One tick along a way.

        Also on the take-off ramp, with the height: a go-to given on the ground waits, far ahead of a vehicle
        that still stands, until that follows, and what lifts it is how high the trajectory is by then.
        """
        self._smoothing.fly(TICK_S, way, self._limits)
        self.keep_near()
        self.write()

    def _way_to(self, target_ned_m: Vector) -> Way:
        if self._way is None or self._way.target_ned_m != target_ned_m:
            here = self._view.estimate.position_ned_m
            self._way = Way(here, target_ned_m, None, self._view.parameter("NAV_ACC_RAD"))
        return self._way

    def advance_horizontal(self) -> float:
        """One tick north and east; how long it is for the trajectory [s], in height too."""
        north, east, down = self.target_ned_m
        way = None
        if north is not None and east is not None:
            way = self._way_to((north, east, self.z.position_m if down is None else down))
        elif math.hypot(self.x.velocity_m_s, self.y.velocity_m_s) < 0.05:
            self.target_ned_m = (self.x.position_m, self.y.position_m, down)
        return self._smoothing.fly_level(TICK_S, way, self._limits)

    def advance_vertical(self, tick_s: float = TICK_S) -> None:
        """One tick up or down."""
        north, east, down = self.target_ned_m
        wanted = 0.0
        if down is not None:
            way_m = down - self.z.position_m
            wanted = math.copysign(self._smoothing.vertical_speed(way_m, self._limits), way_m)
        elif abs(self.z.velocity_m_s) < 0.05:
            self.target_ned_m = (north, east, self.z.position_m)
        self.z_towards(wanted, tick_s)
        self.keep_near()

    def keep_near(self) -> None:
        """The trajectory stays within MAX_Z_LEAD_M of the vehicle's height."""
        z = self._view.estimate.position_ned_m[2]
        if abs(self.z.position_m - z) > MAX_Z_LEAD_M:
            self.z.position_m = z + math.copysign(MAX_Z_LEAD_M, self.z.position_m - z)

    def z_towards(self, velocity_m_s: float, tick_s: float = TICK_S) -> None:
        """One tick towards a vertical speed (down is positive)."""
        fly(self.z.row, tick_s)
        self._smoothing.plan_vertical(velocity_m_s)

    def turn(self) -> None:
        """One tick of the heading towards its target."""
        fastest_rad_s = math.radians(self._view.parameter("MPC_YAWRAUTO_MAX"))
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
