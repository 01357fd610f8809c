"""Checks the geofence in flight five times per second, as PX4 does."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.geofence import Breach, Cylinder, Zone, breaches, read_zones
from vehicle_sim.autopilot.plans import FENCE, Plans
from vehicle_sim.geodesy import to_global
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import Vector, VehicleView

CHECK_EVERY_S = 0.2
HOLD_ACTION = 2
"""GF_ACTION: Hold."""
STOP_VALID_S = 0.5
"""A stop at the fence applies to a Hold that begins within this time."""


class FenceWatch:
    """The geofence check of one vehicle."""

    def __init__(self, view: VehicleView, announcer: Announcer, home: Home, plans: Plans) -> None:
        self._view, self._announcer, self._home, self._plans = view, announcer, home, plans
        self.zones: tuple[Zone, ...] = ()
        self.breaches: frozenset[Breach] = frozenset()
        """The parts of the fence that the vehicle violates."""
        self._breach: tuple[float, Vector] | None = None
        """When and where the present breach was detected; None: there is none."""
        self._revision = 0
        self.checked_at_s = -math.inf

    def cylinder(self) -> Cylinder:
        """The cylinder around home."""
        radius, height = self.limits()
        home = self._home
        return Cylinder(home.lat_deg, home.lon_deg, home.alt_amsl_m, radius, height)

    def limits(self) -> tuple[float, float]:
        """GF_MAX_HOR_DIST and GF_MAX_VER_DIST [m]; 0: no limit."""
        return self._view.parameter("GF_MAX_HOR_DIST"), self._view.parameter("GF_MAX_VER_DIST")

    @property
    def enabled(self) -> bool:
        """Whether GF_ACTION is not 0 (none)."""
        return self._view.choice("GF_ACTION") != 0

    def allows(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> bool:
        """Whether the fence allows this position as the target of a command."""
        return not self.enabled or not breaches(self.zones, self.cylinder(), lat_deg, lon_deg, alt_amsl_m)

    def update(self, *, landed: bool) -> None:
        """Reads a changed fence, and checks the position; call at each tick."""
        if self._revision != self._plans.revision(FENCE):
            self._revision = self._plans.revision(FENCE)
            zones = read_zones(self._plans.items(FENCE))
            self.zones = tuple(zone for zone in zones if self._is_valid(zone, landed=landed))
        self.check()

    def check(self) -> None:
        """Checks the position if CHECK_EVERY_S has passed; only `update` reads a changed fence."""
        now_s = self._view.time_s
        if now_s - self.checked_at_s < CHECK_EVERY_S:
            return
        self.checked_at_s, estimate = now_s, self._view.estimate
        if not estimate.valid_position or not math.isfinite(estimate.lat_deg):
            return
        if not self.enabled or not (self.zones or any(self.limits())):
            self.breaches, self._breach = frozenset(), None
            return
        lat, lon, alt = self._position_to_check()
        self.breaches = breaches(self.zones, self.cylinder(), lat, lon, alt)
        if not self.breaches:
            self._breach = None
        elif self._breach is None:
            self._breach = (now_s, estimate.position_ned_m)

    @property
    def stop_ned_m(self) -> Vector | None:
        """Where a Hold that begins now stops because of the fence: where the breach was detected, so that the
        vehicle flies back; None: where it can stop."""
        if self._breach is None or self._view.choice("GF_ACTION") != HOLD_ACTION:
            return None
        detected_at_s, position_ned_m = self._breach
        is_new = self._view.time_s - detected_at_s < STOP_VALID_S
        return position_ned_m if is_new and self._view.choice("GF_PREDICT") != 1 else None

    def _position_to_check(self) -> tuple[float, float, float]:
        """The current position, or with GF_PREDICT the predicted stopping position."""
        estimate = self._view.estimate
        if self._view.choice("GF_PREDICT") != 1:
            return estimate.lat_deg, estimate.lon_deg, estimate.alt_amsl_m
        vn, ve, _ = estimate.velocity_ned_m_s
        speed = math.hypot(vn, ve)
        acceleration, jerk = self._view.parameter("MPC_ACC_HOR"), self._view.parameter("MPC_JERK_AUTO")
        prediction_s = speed / (2.0 * max(acceleration, 0.1)) + acceleration / max(jerk, 0.1)
        origin_lat, origin_lon, _ = self._view.origin
        north, east, _ = estimate.position_ned_m
        lat, lon = to_global(north + vn * prediction_s, east + ve * prediction_s, origin_lat, origin_lon)  # type: ignore[arg-type]
        return float(lat), float(lon), estimate.alt_amsl_m

    def _is_valid(self, zone: Zone, *, landed: bool) -> bool:
        """Whether PX4 keeps a zone: it discards a zone that home or a flying vehicle already violates."""
        home, estimate, is_valid = self._home, self._view.estimate, True
        if home.valid and not zone.allows(home.lat_deg, home.lon_deg):
            is_valid = False
            text = "Geofence invalid, doesn't contain Home position"
            self._announcer.announce(2, text, "navigator_geofence_invalid_against_home")
        if self.enabled and not landed and not zone.allows(estimate.lat_deg, estimate.lon_deg):
            is_valid = False
            text = "Geofence invalid, doesn't contain current vehicle position"
            self._announcer.announce(2, text, "navigator_geofence_invalid_against_cur_pos")
        return is_valid
