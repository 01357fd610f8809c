"""Orbit: flies to the nearest point of a circle, then around the circle with velocity setpoints. The heading
follows ORBIT_YAW_BEHAVIOUR."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.path import TICK_S, Path
from vehicle_sim.autopilot.setpoint_writer import SetpointWriter
from vehicle_sim.geodesy import is_position, to_local
from vehicle_sim.vehicle_view import VehicleView

ON_CIRCLE_M = 2.0
"""At this distance from the circle, the vehicle starts to fly along the circle."""
RADIUS_GAIN_PER_S = 1.0
"""Radial speed setpoint per metre of distance to the circle."""
RADIUS_MIN_M = 1.0
CENTRIPETAL_MAX_M_S2 = 2.0
"""Limit of the centripetal acceleration; above it PX4 reduces the speed and keeps the radius."""


class YawBehaviour(IntEnum):
    """ORBIT_YAW_BEHAVIOUR."""

    TO_CENTRE = 0
    INITIAL = 1
    UNCONTROLLED = 2
    TANGENT = 3
    STICKS = 4


@dataclass(frozen=True, slots=True)
class Circle:
    """The circle of an orbit."""

    north_m: float
    east_m: float
    down_m: float
    radius_m: float
    speed_m_s: float
    """Positive is clockwise seen from above."""
    yaw: YawBehaviour


class Orbit:
    """The flight task of mode Orbit."""

    def __init__(
        self, view: VehicleView, announcer: Announcer, path: Path, setpoints: SetpointWriter
    ) -> None:
        self._view = view
        self._announcer = announcer
        self._path = path
        self._setpoints = setpoints
        self._circle: Circle | None = None
        self._flies_around = False
        self._speed_m_s = 0.0
        """Current speed along the circle, with the acceleration limit MPC_ACC_HOR."""
        self._initial_yaw_rad = 0.0
        self._requested = False
        """Whether a command was accepted since the last entry of the mode."""
        self._commanded = False
        """Whether a command has set the circle."""

    @property
    def circle(self) -> Circle | None:
        """The commanded circle; None: the mode was entered without an accepted command."""
        return self._circle if self._commanded else None

    def enter(self) -> None:
        """Starts the mode; without a command the circle has a radius of 1 m around the vehicle."""
        self._flies_around = False
        self._initial_yaw_rad = self._view.estimate.yaw_ned_rad
        self._commanded, self._requested = self._requested, False
        if not self._commanded:
            north, east, down = self._view.estimate.position_ned_m
            self._circle = Circle(north, east, down, RADIUS_MIN_M, 1.0, self._default_yaw())

    def request(
        self, lat_lon_alt: tuple[float, float, float], radius_m: float, speed_m_s: float, yaw_behaviour: float
    ) -> None:
        """Handles DO_ORBIT; without a valid centre or altitude, the trajectory's current one applies."""
        north, east, down = self._path.position_ned_m
        lat_deg, lon_deg, alt_amsl_m = lat_lon_alt
        origin_lat, origin_lon, origin_alt = self._view.origin
        if is_position(lat_deg, lon_deg):
            n, e = to_local(lat_deg, lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
            north, east = float(n), float(e)
        if math.isfinite(alt_amsl_m) and math.isfinite(origin_alt):
            down = origin_alt - alt_amsl_m
        radius = radius_m if math.isfinite(radius_m) else RADIUS_MIN_M
        max_speed = self._view.parameter("MPC_XY_VEL_MAX")
        speed = max(-max_speed, min(max_speed, speed_m_s)) if math.isfinite(speed_m_s) else 1.0
        if not RADIUS_MIN_M <= abs(radius) <= self._view.parameter("MC_ORBIT_RAD_MAX"):
            self._announcer.announce(2, "Orbit radius limit exceeded", "orbit_radius_exceeded")
            self._requested = False
            return
        yaw = self._default_yaw()
        if math.isfinite(yaw_behaviour) and 0 <= int(yaw_behaviour) < len(YawBehaviour):
            yaw = YawBehaviour(int(yaw_behaviour))
        centripetal_limit = math.sqrt(CENTRIPETAL_MAX_M_S2 * abs(radius))
        speed = math.copysign(min(abs(speed), centripetal_limit), radius * speed)
        self._circle = Circle(north, east, down, abs(radius), speed, yaw)
        self._requested = self._commanded = True
        self._flies_around = self._flies_around and self._is_near_circle(self._circle)

    def _is_near_circle(self, circle: Circle) -> bool:
        north, east, down = self._view.estimate.position_ned_m
        error_m = math.hypot(north - circle.north_m, east - circle.east_m) - circle.radius_m
        return abs(error_m) < ON_CIRCLE_M and abs(down - circle.down_m) < self._view.parameter(
            "NAV_MC_ALT_RAD"
        )

    def _default_yaw(self) -> YawBehaviour:
        choice = self._view.choice("MC_ORBIT_YAW_MOD")
        return YawBehaviour(choice) if 0 <= choice < len(YawBehaviour) else YawBehaviour.TO_CENTRE

    def run(self) -> None:
        """Runs one tick towards the circle or, after the vehicle has reached the circle, around it."""
        circle = self._circle
        if circle is None:
            self._path.fly_to_target()
            return
        north, east, _ = self._view.estimate.position_ned_m
        dn, de = north - circle.north_m, east - circle.east_m
        distance_m = math.hypot(dn, de)
        un, ue = (dn / distance_m, de / distance_m) if distance_m > 0.01 else (1.0, 0.0)
        if self._flies_around or self._is_near_circle(circle):
            self._fly_around(circle, (un, ue), distance_m)
            return
        self._path.target_ned_m = (
            circle.north_m + un * circle.radius_m, circle.east_m + ue * circle.radius_m, circle.down_m,
        )  # fmt: skip
        self._path.yaw_target_rad = math.atan2(-de, -dn)
        self._path.fly_to_target()

    def _fly_around(self, circle: Circle, outward: tuple[float, float], distance_m: float) -> None:
        north, east, _ = self._view.estimate.position_ned_m
        if not self._flies_around:
            # The current altitude is kept; it is within NAV_MC_ALT_RAD of the circle's altitude.
            self._flies_around, self._speed_m_s = True, 0.0
            self._path.target_ned_m = (north, east, None)
        un, ue = outward
        radial_m_s = RADIUS_GAIN_PER_S * (circle.radius_m - distance_m)
        max_change = self._view.parameter("MPC_ACC_HOR") * TICK_S
        self._speed_m_s += max(-max_change, min(max_change, circle.speed_m_s - self._speed_m_s))
        speed = self._speed_m_s
        centripetal = -circle.speed_m_s * circle.speed_m_s / circle.radius_m
        self._path.x.reset(north)
        self._path.y.reset(east)
        self._path.advance_vertical()
        yaw_rad, yaw_rate_rad_s = self._yaw_setpoint(circle, math.atan2(ue, un))
        self._setpoints.trajectory(
            (math.nan, math.nan, self._path.z.position_m),
            (un * radial_m_s - ue * speed, ue * radial_m_s + un * speed, self._path.z.velocity_m_s),
            (un * centripetal, ue * centripetal, math.nan),
            yaw_rad,
            yaw_rate_rad_s,
        )

    def _yaw_setpoint(self, circle: Circle, outward_rad: float) -> tuple[float, float]:
        angle_rate_rad_s = circle.speed_m_s / circle.radius_m
        if circle.yaw is YawBehaviour.UNCONTROLLED or circle.yaw is YawBehaviour.STICKS:
            return math.nan, math.nan
        if circle.yaw is YawBehaviour.INITIAL:
            self._path.yaw_target_rad, angle_rate_rad_s = self._initial_yaw_rad, 0.0
        elif circle.yaw is YawBehaviour.TANGENT:
            self._path.yaw_target_rad = outward_rad + math.copysign(0.5 * math.pi, circle.speed_m_s)
        else:
            self._path.yaw_target_rad = outward_rad + math.pi
        self._path.turn()
        return self._path.yaw.yaw_ned_rad, angle_rate_rad_s
