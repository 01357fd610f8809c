"""Messages about home, time to home, local origin and orbit, and messages for remote identification."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.frames import quaternion_of
from vehicle_sim.geodesy import to_global
from vehicle_sim.home import Home
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.messages.message_group import CRITICAL, MessageGroup, i16, system_status

ODID_EPOCH_UNIX_S = 1546300800
"""Start of the timestamp in OPEN_DRONE_ID_SYSTEM: 2019-01-01 00:00 UTC."""
ON_GROUND, AIRBORNE, EMERGENCY = 1, 2, 3
"""Values of MAV_ODID_STATUS."""


class NavigationMessages(MessageGroup):
    """Builders of these messages."""

    def home_position(self) -> bytes | None:
        home = self._autopilot.home
        if not home.valid:
            return None
        return pack(
            "HOME_POSITION",
            latitude=round(home.lat_deg * 1e7),
            longitude=round(home.lon_deg * 1e7),
            altitude=round(home.alt_amsl_m * 1000),
            x=home.position_ned_m[0],
            y=home.position_ned_m[1],
            z=home.position_ned_m[2],
            q=_attitude_quaternion(home),
            time_usec=home.set_at_us,
        )[1]

    def orbit_execution_status(self) -> bytes | None:
        commander, circle = self._autopilot.commander, self._autopilot.navigator.circle
        if circle is None or commander.landed or commander.active is not NavState.ORBIT:
            return None
        lat0, lon0, alt0 = self._view.origin
        lat, lon = to_global(circle.north_m, circle.east_m, lat0, lon0)  # type: ignore[arg-type]
        return pack(
            "ORBIT_EXECUTION_STATUS",
            time_usec=self._view.time_boot_us(),
            radius=math.copysign(circle.radius_m, circle.speed_m_s),
            frame=0,
            x=round(float(lat) * 1e7),
            y=round(float(lon) * 1e7),
            z=alt0 - self._autopilot.navigator.path.z.position_m,
        )[1]

    def gps_global_origin(self) -> bytes | None:
        lat, lon, alt = self._view.origin
        if not math.isfinite(lat):
            return None
        return pack(
            "GPS_GLOBAL_ORIGIN",
            latitude=round(lat * 1e7),
            longitude=round(lon * 1e7),
            altitude=round(alt * 1000),
            time_usec=self._view.time_boot_us(),
        )[1]

    def open_drone_id_location(self) -> bytes | None:
        estimate, home = self._view.estimate, self._autopilot.home
        if not math.isfinite(estimate.lat_deg) or not home.valid:
            return None
        vn, ve, vd = estimate.velocity_ned_m_s
        return pack(
            "OPEN_DRONE_ID_LOCATION",
            status=self._remote_id_status(),
            direction=round(math.degrees(math.atan2(ve, vn)) % 360.0) % 360 * 100,
            speed_horizontal=min(25425, round(math.hypot(vn, ve) * 100)),
            speed_vertical=i16(-vd * 100),
            latitude=round(estimate.lat_deg * 1e7),
            longitude=round(estimate.lon_deg * 1e7),
            altitude_barometric=float(self._view.simulation.sensors.baro_alt_amsl_m[self._view.row]),
            altitude_geodetic=float(round(estimate.alt_amsl_m)),
            height=estimate.alt_amsl_m - home.alt_amsl_m,
            horizontal_accuracy=12,
            vertical_accuracy=5,
            barometer_accuracy=0,
            speed_accuracy=3,
            timestamp=(self._view.time_unix_us() // 1_000_000) % 3600,
            timestamp_accuracy=1,
        )[1]

    def _remote_id_status(self) -> int:
        commander = self._autopilot.commander
        if system_status(commander) == CRITICAL:
            return EMERGENCY
        return ON_GROUND if commander.landed else AIRBORNE

    def open_drone_id_system(self) -> bytes | None:
        home = self._autopilot.home
        if not home.valid:
            return None
        return pack(
            "OPEN_DRONE_ID_SYSTEM",
            operator_latitude=round(home.lat_deg * 1e7),
            operator_longitude=round(home.lon_deg * 1e7),
            area_count=1,
            area_ceiling=-1000.0,
            area_floor=-1000.0,
            operator_altitude_geo=home.alt_amsl_m,
            timestamp=max(0, self._view.time_unix_us() // 1_000_000 - ODID_EPOCH_UNIX_S),
        )[1]

    def time_estimate_to_target(self) -> bytes:
        """Contains only the time to home, with the factor and margin of RTL_TIME_*."""
        seconds = 0
        if self._autopilot.commander.armed and self._autopilot.home.valid:
            view = self._view
            duration_s = self._autopilot.navigator.return_duration_s
            seconds = int(duration_s * view.parameter("RTL_TIME_FACTOR") + view.choice("RTL_TIME_MARGIN"))
        return pack(
            "TIME_ESTIMATE_TO_TARGET", safe_return=seconds, land=-1, mission_next_item=-1, mission_end=-1,
            commanded_action=-1,
        )[1]  # fmt: skip


def _attitude_quaternion(home: Home) -> tuple[float, float, float, float]:
    """The attitude of home as a quaternion; all NaN if home has no heading."""
    if math.isnan(home.yaw_ned_rad):
        return (math.nan, math.nan, math.nan, math.nan)
    return quaternion_of(home.roll_rad, home.pitch_rad, home.yaw_ned_rad)
