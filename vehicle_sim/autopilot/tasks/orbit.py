"""Orbit: a circle around a place, nose to the middle."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.body import Body
from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.row import SetpointRow
from vehicle_sim.geodesy import is_place, to_local


class Orbit:
    """The flight task of mode Orbit."""

    def __init__(self, body: Body, announcer: Announcer, path: Path, row: SetpointRow) -> None:
        self._body = body
        self._announcer = announcer
        self._path = path
        self._row = row
        self._orbit: tuple[float, float, float, float] | None = None
        """Centre north, east, radius, speed."""

    def enter(self) -> None:
        """Without a command before: 1 m around where the vehicle is."""
        if self._orbit is None:
            north, east, _ = self._body.belief.position_ned_m
            self._orbit = (north, east, 1.0, 1.0)

    def request(self, lat_deg: float, lon_deg: float, radius_m: float, speed_m_s: float) -> None:
        """DO_ORBIT around a place, by default around where the vehicle is."""
        north, east, _ = self._path.position_ned_m
        if is_place(lat_deg, lon_deg):
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

    def run(self, flying: bool) -> None:
        """One tick around the circle, or towards it."""
        if self._orbit is None:
            self._path.fly_to_target(flying)
            return
        centre_n, centre_e, radius, speed = self._orbit
        north, east, _ = self._body.belief.position_ned_m
        dn, de = north - centre_n, east - centre_e
        distance = math.hypot(dn, de)
        un, ue = (dn / distance, de / distance) if distance > 0.01 else (1.0, 0.0)
        inward = max(-3.0, min(3.0, 0.8 * (radius - distance)))
        along = speed * max(0.0, 1.0 - abs(radius - distance) / radius)
        self._path.advance_vertical(flying)
        vn, ve = un * inward - ue * along, ue * inward + un * along
        centripetal = -along * along / radius
        self._path.yaw_target_rad = math.atan2(-de, -dn)
        self._path.turn()
        self._row.trajectory(
            (math.nan, math.nan, self._path.z.position_m),
            (vn, ve, self._path.z.velocity_m_s),
            (un * centripetal, ue * centripetal, math.nan),
            self._path.yaw.yaw_ned_rad,
        )
