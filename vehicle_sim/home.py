"""The home position and its updates: by command, while disarmed, at arming, at take-off and after it."""

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
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    """Zero in versions of PX4 in which home has no tilt."""
    set_at_us: int = 0
    manual: bool = False
    """Whether a command has set home (`manual_home`); such a home is not updated automatically."""

    @property
    def valid(self) -> bool:
        """Whether home has been set."""
        return math.isfinite(self.lat_deg)


CORRECTION_S, CORRECTION_M = 120.0, 1.0
"""Time after a take-off in which PX4 v1.17 corrects the altitude of home, and smallest correction."""


class AltitudeCorrection:
    """Corrects the altitude of home against the drift of GNSS, as PX4 v1.17 does.

    When the barometer and the integrated vertical GNSS speed agree better with each other than with the GNSS
    altitude, home follows the GNSS altitude. PX4 does not filter the barometer, so the noise of the GNSS
    altitude alone moves home.
    """

    def __init__(self, view: VehicleView, home: Home) -> None:
        self._view, self._home = view, home
        self._until_s = -math.inf
        self._last_fix: tuple[int, float] = (0, 0.0)
        """Number and time [s] of the last fix."""
        self._speed_alt_m = math.nan
        """GNSS altitude at the start plus the integrated vertical GNSS speed; NaN: not started."""
        self._baro_offset_m = self._home_offset_m = 0.0

    def start(self) -> None:
        """Called at a take-off."""
        if self._view.px4.corrects_home:
            self._until_s = self._view.time_s + CORRECTION_S
            self._speed_alt_m, self._home_offset_m = math.nan, 0.0

    def update(self) -> None:
        """Evaluates a new fix."""
        now_s, sensors, i = self._view.time_s, self._view.simulation.sensors, self._view.row
        if now_s >= self._until_s or sensors.gps_count == self._last_fix[0] or not sensors.gps_fresh[i]:
            return
        interval_s = now_s - self._last_fix[1]
        self._last_fix = sensors.gps_count, now_s
        if int(sensors.gps_fix_type[i]) < FIX_3D:
            return
        gnss_m, baro_m = float(sensors.gps_alt_amsl_m[i]), float(sensors.baro_alt_amsl_m[i])
        if math.isnan(self._speed_alt_m):
            self._speed_alt_m, self._baro_offset_m = gnss_m, gnss_m - baro_m
            return
        self._speed_alt_m -= interval_s * float(sensors.gps_velocity_ned_m_s[i, 2])
        baro_m += self._baro_offset_m
        disagreement_m = abs(baro_m - self._speed_alt_m)
        expected_m = gnss_m + self._home_offset_m
        gnss_is_off = disagreement_m < min(abs(baro_m - expected_m), abs(self._speed_alt_m - expected_m))
        drift_m = baro_m - expected_m
        if gnss_is_off and abs(drift_m) > CORRECTION_M:
            home = self._home
            north_m, east_m, down_m = home.position_ned_m
            home.alt_amsl_m -= drift_m
            home.position_ned_m = (north_m, east_m, down_m + drift_m)
            home.set_at_us, home.manual = self._view.time_boot_us(), False
            self._home_offset_m = baro_m - gnss_m


class HomeUpdater:
    """Sets and updates the home position of one vehicle."""

    def __init__(self, view: VehicleView, home: Home) -> None:
        self._view = view
        self.home = home
        self._correction = AltitudeCorrection(view, home)

    def set(
        self, lat_deg: float, lon_deg: float, alt_amsl_m: float, attitude_deg: Vector = (0.0, 0.0, math.nan)
    ) -> None:
        """Sets home to a commanded position, with roll, pitch and yaw."""
        origin_lat, origin_lon, origin_alt = self._view.origin
        north_m, east_m = to_local(lat_deg, lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
        home = self.home
        home.lat_deg, home.lon_deg, home.alt_amsl_m = lat_deg, lon_deg, alt_amsl_m
        home.position_ned_m = (float(north_m), float(east_m), -(alt_amsl_m - origin_alt))
        self._set_attitude(*(math.radians(angle_deg) for angle_deg in attitude_deg))
        home.set_at_us, home.manual = self._view.time_boot_us(), True

    def _set_attitude(self, roll_rad: float, pitch_rad: float, yaw_ned_rad: float) -> None:
        home = self.home
        home.yaw_ned_rad = yaw_ned_rad
        if self._view.px4.home_has_tilt:
            home.roll_rad, home.pitch_rad = roll_rad, pitch_rad

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
            self._set_attitude(estimate.roll_rad, estimate.pitch_rad, estimate.yaw_ned_rad)
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

    def on_arming(self) -> None:
        """Sets home to the position where the vehicle was armed."""
        if self._is_automatic:
            self.set_to_current_position()

    def on_takeoff(self, *, again_in_mission: bool) -> None:
        """Sets home to the position where the vehicle took off.

        Args:
            again_in_mission: whether the vehicle has landed in between, in a mission; from v1.17 on PX4 then
                keeps home.
        """
        if not (again_in_mission and self._view.px4.home_has_tilt):
            self.on_arming()
        self._correction.start()

    def on_moved(self) -> None:
        """Called when the vehicle was moved in flight: its altitude is corrected from there on."""
        self._correction.start()

    def correct(self) -> None:
        """Corrects the altitude of home in flight; called at each tick."""
        self._correction.update()

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
