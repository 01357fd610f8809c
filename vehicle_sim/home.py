"""The home position and its updates: by command, while disarmed, at arming and at take-off."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vehicle_sim.geodesy import to_local
from vehicle_sim.vehicle_view import Vector, VehicleView

FIX_3D = 3
GPS_HOME_EVERY_US = 2_000_000


@dataclass(slots=True)
class Home:
    """The home position, local and global."""

    lat_deg: float = math.nan
    lon_deg: float = math.nan
    alt_amsl_m: float = math.nan
    position_ned_m: Vector = (0.0, 0.0, 0.0)
    yaw_ned_rad: float = 0.0
    set_at_us: int = 0
    manual: bool = False
    """Whether a command has set home (`manual_home`); such a home is not updated automatically."""

    @property
    def valid(self) -> bool:
        """Whether home has been set."""
        return math.isfinite(self.lat_deg)


class HomeUpdater:
    """Sets and updates the home position of one vehicle."""

    def __init__(self, view: VehicleView, home: Home) -> None:
        self._view = view
        self.home = home

    def set(self, lat_deg: float, lon_deg: float, alt_amsl_m: float, yaw_deg: float = math.nan) -> None:
        """Sets home to a commanded position."""
        origin_lat, origin_lon, origin_alt = self._view.origin
        north_m, east_m = to_local(lat_deg, lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
        home = self.home
        home.lat_deg, home.lon_deg, home.alt_amsl_m = lat_deg, lon_deg, alt_amsl_m
        home.position_ned_m = (float(north_m), float(east_m), -(alt_amsl_m - origin_alt))
        home.yaw_ned_rad = math.radians(yaw_deg)
        home.set_at_us, home.manual = self._view.time_boot_us(), True

    def on_origin_change(self) -> None:
        """Called when the local origin has changed; home keeps its global position."""
        home = self.home
        if home.valid:
            lat, lon, alt = self._view.origin
            north_m, east_m = to_local(home.lat_deg, home.lon_deg, lat, lon)  # type: ignore[arg-type]
            home.position_ned_m = (float(north_m), float(east_m), alt - home.alt_amsl_m)

    def set_to_current_position(self) -> bool:
        """Sets home to the current position; False: no valid position."""
        estimate, home = self._view.estimate, self.home
        if not estimate.valid_position:
            return False
        if math.isfinite(estimate.lat_deg):
            home.lat_deg, home.lon_deg, home.alt_amsl_m = (
                estimate.lat_deg,
                estimate.lon_deg,
                estimate.alt_amsl_m,
            )
            home.position_ned_m = estimate.position_ned_m
            home.yaw_ned_rad = estimate.yaw_ned_rad
            home.set_at_us, home.manual = self._view.time_boot_us(), False
        return True

    def _set_to_gps_position(self) -> None:
        """Sets home to the GPS position, at most every two seconds; used without a valid local position."""
        sensors, i, now_us = self._view.simulation.sensors, self._view.row, self._view.time_boot_us()
        home = self.home
        if int(sensors.gps_fix_type[i]) < FIX_3D or now_us - home.set_at_us < GPS_HOME_EVERY_US:
            return
        home.lat_deg, home.lon_deg = float(sensors.gps_lat_deg[i]), float(sensors.gps_lon_deg[i])
        home.alt_amsl_m = float(sensors.gps_alt_amsl_m[i])
        home.position_ned_m, home.yaw_ned_rad, home.set_at_us = (0.0, 0.0, 0.0), 0.0, now_us

    @property
    def _is_automatic(self) -> bool:
        """Whether home is updated automatically: COM_HOME_EN is set, and no command has set home."""
        return not self.home.manual and self._view.choice("COM_HOME_EN") != 0

    def on_arming_or_takeoff(self) -> None:
        """Sets home to the position where the vehicle was armed or took off."""
        if self._is_automatic:
            self.set_to_current_position()

    def update_disarmed(self) -> None:
        """Sets home of a disarmed vehicle, and again after the vehicle has moved by more than 1 m."""
        estimate = self._view.estimate
        if not self._is_automatic:
            return
        if not estimate.valid_position:
            self._set_to_gps_position()
            return
        if not self.home.valid or math.dist(estimate.position_ned_m, self.home.position_ned_m) > 1.0:
            self.set_to_current_position()
