"""What the sensors measured and how well the estimator agrees with them."""

from __future__ import annotations

import math

from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.messages.family import NAN, Family

STANDARD_TEMPERATURE_DEG_C = 15.0
"""HIGHRES_IMU carries the air temperature PX4 assumes, not the barometer's own."""

GPS_GLITCH = 1024
"""Bit of ESTIMATOR_STATUS_FLAGS."""


class SensorMessages(Family):
    """Builders of the raw and scaled measurements."""

    def highres_imu(self) -> bytes:
        s, i = self._body.simulation.sensors, self._body.row
        ax, ay, az = s.accel_frd_m_s2[i].tolist()
        gx, gy, gz = s.gyro_frd_rad_s[i].tolist()
        mx, my, mz = s.mag_frd_gauss[i].tolist()
        return pack(
            "HIGHRES_IMU",
            time_usec=self._body.time_boot_us(),
            xacc=ax, yacc=ay, zacc=az, xgyro=gx, ygyro=gy, zgyro=gz, xmag=mx, ymag=my, zmag=mz,
            abs_pressure=float(s.baro_pressure_hpa[i]) * 100.0,
            pressure_alt=float(s.baro_alt_amsl_m[i]),
            temperature=STANDARD_TEMPERATURE_DEG_C,
            fields_updated=7167,
        )[1]  # fmt: skip

    def scaled_imu(self) -> bytes:
        s, i = self._body.simulation.sensors, self._body.row
        ax, ay, az = (round(v / 9.80665 * 1000) for v in s.accel_frd_m_s2[i].tolist())
        gx, gy, gz = (round(v * 1000) for v in s.gyro_frd_rad_s[i].tolist())
        mx, my, mz = (round(v * 1000) for v in s.mag_frd_gauss[i].tolist())
        return pack(
            "SCALED_IMU", time_boot_ms=self._body.time_boot_ms(), xacc=ax, yacc=ay, zacc=az,
            xgyro=gx, ygyro=gy, zgyro=gz, xmag=mx, ymag=my, zmag=mz, temperature=1500,
        )[1]  # fmt: skip

    def scaled_pressure(self) -> bytes:
        s, i = self._body.simulation.sensors, self._body.row
        return pack(
            "SCALED_PRESSURE",
            time_boot_ms=self._body.time_boot_ms(),
            press_abs=float(s.baro_pressure_hpa[i]),
            temperature=round(float(s.baro_temperature_deg_c[i]) * 100),
        )[1]

    def gps_raw_int(self) -> bytes:
        s, i = self._body.simulation.sensors, self._body.row
        fix = int(s.gps_fix_type[i])
        if fix < 2:
            return pack("GPS_RAW_INT", time_usec=self._body.time_boot_us(), fix_type=fix, eph=65535,
                        epv=65535, vel=65535, cog=65535)[1]  # fmt: skip
        vn, ve, _ = s.gps_velocity_ned_m_s[i].tolist()
        alt = round(float(s.gps_alt_amsl_m[i]) * 1000)
        return pack(
            "GPS_RAW_INT",
            time_usec=self._body.time_boot_us(),
            fix_type=fix,
            lat=round(float(s.gps_lat_deg[i]) * 1e7),
            lon=round(float(s.gps_lon_deg[i]) * 1e7),
            alt=alt,
            alt_ellipsoid=alt,
            eph=round(float(s.gps_hdop[i]) * 100),
            epv=round(float(s.gps_vdop[i]) * 100),
            vel=round(math.hypot(vn, ve) * 100),
            cog=round(math.degrees(math.atan2(ve, vn)) % 360.0 * 100) % 36000,
            satellites_visible=int(s.gps_satellites[i]),
            h_acc=round(float(s.gps_horizontal_accuracy_m[i]) * 1000),
            v_acc=round(float(s.gps_vertical_accuracy_m[i]) * 1000),
            vel_acc=round(float(s.gps_speed_accuracy_m_s[i]) * 1000),
        )[1]

    def distance_sensor(self) -> bytes:
        return pack(
            "DISTANCE_SENSOR", time_boot_ms=self._body.time_boot_ms(), max_distance=10000, orientation=25
        )[1]

    def vibration(self) -> bytes:
        b = self._body.simulation.sensors.accel_frd_m_s2[self._body.row]
        return pack(
            "VIBRATION",
            time_usec=self._body.time_boot_us(),
            vibration_y=0.01,
            vibration_z=abs(float(b[2]) + 9.80665) * 0.1,
        )[1]

    def estimator_status(self) -> bytes:
        e, i, b = self._body.simulation.estimate, self._body.row, self._body.belief
        armed = self._autopilot.commander.armed and not self._autopilot.commander.landed
        flags = 1 | (0b100100 if b.valid_altitude else 0) | (0b11010 if b.valid_position else 0)
        flags |= 0b1100000 | (768 if b.valid_position else 0) | (0 if armed else 128)
        flags |= GPS_GLITCH if e.gps_rejected[i] else 0
        return pack(
            "ESTIMATOR_STATUS",
            time_usec=self._body.time_boot_us(),
            flags=flags & 0xFFFF,
            vel_ratio=float(e.innovation_ratio_velocity[i]),
            pos_horiz_ratio=float(e.innovation_ratio_position[i]),
            pos_vert_ratio=float(e.innovation_ratio_height[i]),
            mag_ratio=float(e.innovation_ratio_mag[i]),
            tas_ratio=NAN,
            pos_horiz_accuracy=float(e.horizontal_accuracy_m[i]),
            pos_vert_accuracy=float(e.vertical_accuracy_m[i]),
        )[1]
