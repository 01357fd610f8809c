"""Flying a leg of a mission: along the line from waypoint to waypoint, at a corner as slow as its angle asks.

The speed wanted at each moment follows PX4's position smoothing: stop within jerk and acceleration, keep the
speed a corner allows (its acceptance radius as the turn's radius), and reach height and place together.
"""

from __future__ import annotations

import math

from vehicle_sim.autopilot.body import Body, Vector
from vehicle_sim.autopilot.path import TICK_S, Path
from vehicle_sim.autopilot.trajectory import max_speed_for_distance

TURNING_ALIGNMENT = 0.98
"""Cosine of the angle between velocity and target beyond which the vehicle counts as turning."""
TURNING_SPEED_M_S = 0.2
L1_LEAST_M = 5.0
MAX_Z_LEAD_M = 1.0
SLOW_M_S = 0.5


def _clamped(speed_m_s: float, limit_m_s: float) -> tuple[float, float]:
    """A part of the velocity within its limit, and by how much the other part must slow down with it.

    Slow parts are only cut: who is a hand's breadth off his height need not crawl along the leg.
    """
    if speed_m_s <= limit_m_s:
        return speed_m_s, 1.0
    slow = speed_m_s < SLOW_M_S and limit_m_s < SLOW_M_S
    return limit_m_s, 1.0 if slow else limit_m_s / speed_m_s


class Leg:
    """From `previous` to `target`, with a look at `next`; all NED metres."""

    def __init__(self, body: Body, path: Path) -> None:
        self._body = body
        self._path = path
        self.previous_ned_m: Vector = (0.0, 0.0, 0.0)
        self.target_ned_m: Vector = (0.0, 0.0, 0.0)
        self.next_ned_m: Vector | None = None
        """None: stop at the target."""
        self.acceptance_m = 0.0
        self._speed_before_turn_m_s = math.inf

    def set(self, target_ned_m: Vector, next_ned_m: Vector | None, acceptance_m: float) -> None:
        """Fly to a new target from where the last one was."""
        self.previous_ned_m = self.target_ned_m
        self.target_ned_m, self.next_ned_m, self.acceptance_m = target_ned_m, next_ned_m, acceptance_m
        self._speed_before_turn_m_s = math.inf
        self._path.target_ned_m = target_ned_m

    def restart(self) -> None:
        """Begin where the trajectory is."""
        self.target_ned_m = self._path.position_ned_m

    def fly(self, flying: bool) -> None:
        """One tick along the leg."""
        path, body = self._path, self._body
        vn, ve, vd = self._wanted_velocity()
        jerk, acceleration = body.parameter("MPC_JERK_AUTO"), body.parameter("MPC_ACC_HOR")
        stretch = self._stretch()
        for axis, wanted in ((path.x, vn), (path.y, ve)):
            axis.advance(
                wanted, TICK_S, acceleration_limit_m_s2=acceleration, jerk_limit_m_s3=jerk, stretch=stretch
            )
        z = body.belief.position_ned_m[2]
        if not flying:
            path.z.reset(z)
        path.z_towards(vd)
        if abs(path.z.position_m - z) > MAX_Z_LEAD_M:
            path.z.position_m = z + math.copysign(MAX_Z_LEAD_M, path.z.position_m - z)
        path.write()

    def _stretch(self) -> float:
        """How much the trajectory waits for a vehicle that is behind it."""
        path = self._path
        x, y, _ = self._body.belief.position_ned_m
        behind_n, behind_e = path.x.position_m - x, path.y.position_m - y
        if behind_n * path.x.velocity_m_s + behind_e * path.y.velocity_m_s < 0.0:
            return 1.0
        error_m = math.hypot(behind_n, behind_e)
        return 1.0 - min(1.0, error_m / max(0.1, self._body.parameter("MPC_XY_ERR_MAX")))

    def _wanted_velocity(self) -> Vector:
        path = self._path
        x, y, z = path.position_ned_m
        aim_n, aim_e = self.target_ned_m[:2]
        horizontal = self._horizontal_speed()
        if self._turning():
            aim_n, aim_e = self._crossing()
            horizontal = min(horizontal, self._speed_before_turn_m_s)
        else:
            self._speed_before_turn_m_s = horizontal
        dn, de, dd = aim_n - x, aim_e - y, self.target_ned_m[2] - z
        vertical = self._vertical_speed(dd)
        length = math.sqrt(dn * dn + de * de + dd * dd)
        if length < 1e-6:
            return (0.0, 0.0, 0.0)
        speed = math.hypot(horizontal, vertical)
        across = _clamped(speed * math.hypot(dn, de) / length, horizontal)
        level, up_down = across[0], across[1] * speed * abs(dd) / length
        rising = _clamped(up_down, vertical)
        level *= rising[1]
        flat = max(math.hypot(dn, de), 1e-9)
        return (level * dn / flat, level * de / flat, math.copysign(rising[0], dd))

    def _horizontal_speed(self) -> float:
        path, parameter = self._path, self._body.parameter
        cruise = path.cruise_m_s if math.isfinite(path.cruise_m_s) else parameter("MPC_XY_CRUISE")
        cruise = min(cruise, parameter("MPC_XY_VEL_MAX"))
        jerk, acceleration = parameter("MPC_JERK_AUTO"), parameter("MPC_ACC_HOR")
        x, y, z = path.position_ned_m
        tn, te, td = self.target_ned_m
        at_target = 0.0
        if self.next_ned_m is not None:
            nn, ne, nd = self.next_ned_m
            onward_m = math.hypot(nn - tn, ne - te)
            level = max(abs(td - z), abs(nd - td)) < parameter("NAV_MC_ALT_RAD")
            if onward_m > 0.001 and onward_m >= self.acceptance_m and level:
                exit_speed = max_speed_for_distance(jerk, acceleration, onward_m)
                at_target = min(self._corner_speed(x, y), min(exit_speed, cruise), cruise)
        left_m = math.hypot(tn - x, te - y)
        return min(cruise, max_speed_for_distance(jerk, acceleration, left_m, at_target))

    def _corner_speed(self, x_m: float, y_m: float) -> float:
        assert self.next_ned_m is not None
        tn, te, _ = self.target_ned_m
        an, ae = tn - x_m, te - y_m
        bn, be = tn - self.next_ned_m[0], te - self.next_ned_m[1]
        lengths = math.hypot(an, ae) * math.hypot(bn, be)
        cosine = (an * bn + ae * be) / lengths if lengths > 1e-9 else 0.0
        half = min(math.acos(max(-1.0, min(1.0, cosine))), math.pi - 1e-6) / 2.0
        sideways = self._body.parameter("MPC_XY_TRAJ_P") * self._body.parameter("MPC_ACC_HOR")
        return math.sqrt(sideways * self.acceptance_m * math.tan(half))

    def _vertical_speed(self, way_m: float) -> float:
        path, parameter = self._path, self._body.parameter
        up = way_m < 0.0
        override = path.climb_m_s if up else path.descent_m_s
        limit = override if math.isfinite(override) else parameter(
            "MPC_Z_V_AUTO_UP" if up else "MPC_Z_V_AUTO_DN"
        )  # fmt: skip
        acceleration = parameter("MPC_ACC_UP_MAX" if up else "MPC_ACC_DOWN_MAX")
        return min(limit, max_speed_for_distance(parameter("MPC_JERK_AUTO"), acceleration, abs(way_m)))

    def _turning(self) -> bool:
        path = self._path
        vn, ve = path.x.velocity_m_s, path.y.velocity_m_s
        dn, de = self.target_ned_m[0] - path.x.position_m, self.target_ned_m[1] - path.y.position_m
        speed, left_m = math.hypot(vn, ve), math.hypot(dn, de)
        if speed <= TURNING_SPEED_M_S or left_m <= self.acceptance_m:
            return False
        return (vn * dn + ve * de) / (speed * left_m) < TURNING_ALIGNMENT

    def _crossing(self) -> tuple[float, float]:
        """Where to aim while turning: on the line to the target, a radius ahead of the vehicle."""
        pn, pe, _ = self.previous_ned_m
        tn, te, _ = self.target_ned_m
        length = math.hypot(tn - pn, te - pe)
        if length < 1e-6:
            return tn, te
        un, ue = (tn - pn) / length, (te - pe) / length
        x, y, _ = self._path.position_ned_m
        along = (x - pn) * un + (y - pe) * ue
        closest_n, closest_e = pn + un * along, pe + ue * along
        off_m = math.hypot(closest_n - x, closest_e - y)
        radius = max(self.acceptance_m, L1_LEAST_M)
        ahead = math.sqrt(radius * radius - off_m * off_m) if radius > off_m else 0.0
        return closest_n + un * ahead, closest_e + ue * ahead
