"""From waypoint to waypoint: how fast at each moment, and along which line (PX4's position smoothing).

The speed wanted falls with the distance left so that the stop, or the speed a corner allows, fits into jerk
and acceleration. While the trajectory turns it is no faster than before, and it aims at the line rather than
at the target. Height and place are reached together; a vehicle that lags stretches the trajectory's time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from vehicle_sim.autopilot.trajectory import Axis, max_speed_for_distance, synchronise
from vehicle_sim.vehicle_view import Vector, VehicleView

ALIGNED = 0.98
"""Cosine of the angle between velocity and target beyond which the trajectory no longer counts as turning."""
TURNING_SPEED_M_S = 0.2
L1_LEAST_M = 5.0
SLOW_M_S = 0.5


class Limits(NamedTuple):
    """How fast; what is not finite is as the parameters say."""

    cruise_m_s: float
    climb_m_s: float
    descent_m_s: float


@dataclass(frozen=True, slots=True)
class Way:
    """Where from, where to, and what comes then; NED metres."""

    previous_ned_m: Vector
    target_ned_m: Vector
    next_ned_m: Vector | None
    """None: stop at the target."""
    acceptance_m: float


def _clamped(speed_m_s: float, limit_m_s: float) -> tuple[float, float]:
    """A part of the velocity within its limit, and by how much the other part must slow down with it.

    Slow parts are only cut: who is a hand's breadth off his height need not crawl along the leg.
    """
    if speed_m_s <= limit_m_s:
        return speed_m_s, 1.0
    slow = speed_m_s < SLOW_M_S and limit_m_s < SLOW_M_S
    return limit_m_s, 1.0 if slow else limit_m_s / speed_m_s


class Smoothing:
    """Three axes of one vehicle, and the speed they had before a turn."""

    def __init__(self, view: VehicleView) -> None:
        self._view = view
        self.x, self.y, self.z = Axis(), Axis(), Axis()
        self._before_turn_m_s = 0.0

    def begin(self) -> None:
        """A new flight task knows no speed before a turn: one that begins across its way brakes first."""
        self._before_turn_m_s = 0.0

    def fly(self, dt_s: float, way: Way, limits: Limits) -> None:
        """One tick along the way in all axes."""
        stretched_s = dt_s * self._stretch()
        for axis in (self.x, self.y, self.z):
            axis.fly(stretched_s)
        north, east, down = self._wanted(way, limits)
        self._plan_level(north, east)
        self.plan_vertical(down)
        synchronise(self.x, self.y, self.z)

    def fly_level(self, dt_s: float, way: Way | None, limits: Limits) -> float:
        """One tick north and east only; without a way to rest.

        Returns:
            How long the tick is for the trajectory, which waits for a vehicle that lags [s].
        """
        stretched_s = dt_s * self._stretch()
        self.x.fly(stretched_s)
        self.y.fly(stretched_s)
        north = east = 0.0
        if way is not None:
            speed, (aim_n, aim_e) = self._level(way, limits)
            dn, de = aim_n - self.x.position_m, aim_e - self.y.position_m
            length = math.hypot(dn, de)
            if length > 1e-6:
                north, east = speed * dn / length, speed * de / length
        self._plan_level(north, east)
        synchronise(self.x, self.y)
        return stretched_s

    def plan_vertical(self, velocity_m_s: float) -> None:
        """Towards a vertical speed (down is positive) by the limits of that direction."""
        parameter = self._view.parameter
        name = "MPC_ACC_UP_MAX" if velocity_m_s < self.z.velocity_m_s else "MPC_ACC_DOWN_MAX"
        self.z.plan(
            velocity_m_s,
            acceleration_limit_m_s2=parameter(name),
            jerk_limit_m_s3=parameter("MPC_JERK_AUTO"),
        )

    def vertical_speed(self, way_m: float, limits: Limits) -> float:
        """How fast to climb or sink this far, never negative."""
        parameter = self._view.parameter
        up = way_m < 0.0
        override = limits.climb_m_s if up else limits.descent_m_s
        limit = override if math.isfinite(override) else parameter(
            "MPC_Z_V_AUTO_UP" if up else "MPC_Z_V_AUTO_DN"
        )  # fmt: skip
        acceleration = parameter("MPC_ACC_UP_MAX" if up else "MPC_ACC_DOWN_MAX")
        return min(limit, max_speed_for_distance(parameter("MPC_JERK_AUTO"), acceleration, abs(way_m)))

    def _plan_level(self, north_m_s: float, east_m_s: float) -> None:
        parameter = self._view.parameter
        acceleration, jerk = parameter("MPC_ACC_HOR"), parameter("MPC_JERK_AUTO")
        for axis, wanted in ((self.x, north_m_s), (self.y, east_m_s)):
            axis.plan(wanted, acceleration_limit_m_s2=acceleration, jerk_limit_m_s3=jerk)

    def _stretch(self) -> float:
        """How much the trajectory waits: not for a vehicle that is ahead, it would never arrive."""
        x, y, _ = self._view.estimate.position_ned_m
        behind_n, behind_e = self.x.position_m - x, self.y.position_m - y
        if behind_n * self.x.velocity_m_s + behind_e * self.y.velocity_m_s < 0.0:
            return 1.0
        error_m = math.hypot(behind_n, behind_e)
        return 1.0 - min(1.0, error_m / max(0.1, self._view.parameter("MPC_XY_ERR_MAX")))

    def _wanted(self, way: Way, limits: Limits) -> Vector:
        horizontal, (aim_n, aim_e) = self._level(way, limits)
        dn, de = aim_n - self.x.position_m, aim_e - self.y.position_m
        dd = way.target_ned_m[2] - self.z.position_m
        vertical = self.vertical_speed(dd, limits)
        length = math.sqrt(dn * dn + de * de + dd * dd)
        if length < 1e-6:
            return (0.0, 0.0, 0.0)
        speed = math.hypot(horizontal, vertical)
        across = _clamped(speed * math.hypot(dn, de) / length, horizontal)
        rising = _clamped(across[1] * speed * abs(dd) / length, vertical)
        level = across[0] * rising[1]
        flat = max(math.hypot(dn, de), 1e-9)
        return (level * dn / flat, level * de / flat, math.copysign(rising[0], dd))

    def _level(self, way: Way, limits: Limits) -> tuple[float, tuple[float, float]]:
        """The horizontal speed, and the place to aim at."""
        speed = self._level_speed(way, limits)
        if self._turning(way):
            return min(speed, self._before_turn_m_s), self._crossing(way)
        self._before_turn_m_s = speed
        return speed, way.target_ned_m[:2]

    def _level_speed(self, way: Way, limits: Limits) -> float:
        parameter = self._view.parameter
        cruise = limits.cruise_m_s if math.isfinite(limits.cruise_m_s) else parameter("MPC_XY_CRUISE")
        cruise = min(cruise, parameter("MPC_XY_VEL_MAX"))
        jerk, acceleration = parameter("MPC_JERK_AUTO"), parameter("MPC_ACC_HOR")
        tn, te, td = way.target_ned_m
        at_target = 0.0
        if way.next_ned_m is not None:
            nn, ne, nd = way.next_ned_m
            onward_m = math.hypot(nn - tn, ne - te)
            level = max(abs(td - self.z.position_m), abs(nd - td)) < parameter("NAV_MC_ALT_RAD")
            if onward_m > 0.001 and onward_m >= way.acceptance_m and level:
                exit_speed = max_speed_for_distance(jerk, acceleration, onward_m)
                at_target = min(self._corner_speed(way, (nn, ne)), exit_speed, cruise)
        left_m = math.hypot(tn - self.x.position_m, te - self.y.position_m)
        return min(cruise, max_speed_for_distance(jerk, acceleration, left_m, at_target))

    def _corner_speed(self, way: Way, onward: tuple[float, float]) -> float:
        tn, te, _ = way.target_ned_m
        an, ae = tn - self.x.position_m, te - self.y.position_m
        bn, be = tn - onward[0], te - onward[1]
        lengths = math.hypot(an, ae) * math.hypot(bn, be)
        cosine = (an * bn + ae * be) / lengths if lengths > 1e-9 else 0.0
        half = min(math.acos(max(-1.0, min(1.0, cosine))), math.pi - 1e-6) / 2.0
        sideways = self._view.parameter("MPC_XY_TRAJ_P") * self._view.parameter("MPC_ACC_HOR")
        return math.sqrt(sideways * way.acceptance_m * math.tan(half))

    def _turning(self, way: Way) -> bool:
        vn, ve = self.x.velocity_m_s, self.y.velocity_m_s
        dn, de = way.target_ned_m[0] - self.x.position_m, way.target_ned_m[1] - self.y.position_m
        speed, left_m = math.hypot(vn, ve), math.hypot(dn, de)
        if speed <= TURNING_SPEED_M_S or left_m <= way.acceptance_m:
            return False
        return (vn * dn + ve * de) / (speed * left_m) < ALIGNED

    def _crossing(self, way: Way) -> tuple[float, float]:
        """Where to aim while turning: on the line to the target, a radius ahead of the trajectory.

        Who has passed the target aims back at it.
        """
        pn, pe, _ = way.previous_ned_m
        tn, te, _ = way.target_ned_m
        length = math.hypot(tn - pn, te - pe)
        if length < 1e-6:
            return tn, te
        un, ue = (tn - pn) / length, (te - pe) / length
        x, y = self.x.position_m, self.y.position_m
        along = (x - pn) * un + (y - pe) * ue
        if along > length:
            return tn, te
        closest_n, closest_e = pn + un * along, pe + ue * along
        off_m = math.hypot(closest_n - x, closest_e - y)
        radius = max(way.acceptance_m, L1_LEAST_M)
        ahead = math.sqrt(radius * radius - off_m * off_m) if radius > off_m else 0.0
        return closest_n + un * ahead, closest_e + ue * ahead
