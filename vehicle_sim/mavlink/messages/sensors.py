"""Messages with sensor measurements and the estimator's status."""

from __future__ import annotations

import math

import numpy as np

from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.messages.message_group import NAN, MessageGroup
from vehicle_sim.world.lidar import SECTOR_DEG

STANDARD_TEMPERATURE_DEG_C = 15.0
"""HIGHRES_IMU contains the air temperature that PX4 assumes, not the temperature of the barometer."""

ATTITUDE_AND_HEIGHT_ABOVE_GROUND = 1 | 64
HORIZONTAL_VELOCITY_AND_POSITION = 2 | 8 | 16
VERTICAL_VELOCITY_AND_POSITION = 4 | 32
CONSTANT_POSITION = 128
PREDICTED_HORIZONTAL_POSITION = 256 | 512
GPS_GLITCH, ACCEL_ERROR = 1024, 2048
"""Bits of ESTIMATOR_STATUS_FLAGS."""
DOWN, FORWARD = 25, 0
"""Values of MAV_SENSOR_ORIENTATION."""
BODY_FRD = 12
"""Value of MAV_FRAME."""
OUT_OF_RANGE_CM = -100
"""PX4's simulation sends -1 m if the sensor measures nothing; in the unsigned field this is 65436."""
MIN_RANGE_CM, INTEGRITY_RECEIVER = 10, 4
GROUND_VIBRATION, FLYING_VIBRATION = (0.0117, 0.107), (0.096, 1.42)
"""PX4's vibration metrics of gyro [rad/s] and accelerometer [m/s²], as measured."""


class SensorMessages(MessageGroup):
    """Builders of the messages with measurements, vibration and the estimator's status."""

    def highres_imu(self) -> bytes:
        s, i = self._view.simulation.sensors, self._view.row
        ax, ay, az = s.accel_frd_m_s2[i].tolist()
        gx, gy, gz = s.gyro_frd_rad_s[i].tolist()
        mx, my, mz = s.mag_frd_gauss[i].tolist()
        return pack(
            "HIGHRES_IMU",
            time_usec=self._view.time_boot_us(),
            xacc=ax, yacc=ay, zacc=az, xgyro=gx, ygyro=gy, zgyro=gz, xmag=mx, ymag=my, zmag=mz,
            abs_pressure=float(s.baro_pressure_hpa[i]) * 100.0,
            pressure_alt=float(s.baro_alt_amsl_m[i]),
            temperature=STANDARD_TEMPERATURE_DEG_C,
            fields_updated=7167,
        )[1]  # fmt: skip

    def gnss_integrity(self) -> bytes:
        """What a receiver without integrity monitoring reports: nothing is known."""
        return pack(
            "GNSS_INTEGRITY", id=INTEGRITY_RECEIVER, raim_hfom=65535, raim_vfom=65535,
            corrections_quality=255, system_status_summary=255, gnss_signal_quality=255,
            post_processing_quality=255,
        )[1]  # fmt: skip

    def scaled_imu(self) -> bytes:
        s, i = self._view.simulation.sensors, self._view.row
        ax, ay, az = (round(v / 9.80665 * 1000) for v in s.accel_frd_m_s2[i].tolist())
        gx, gy, gz = (round(v * 1000) for v in s.gyro_frd_rad_s[i].tolist())
        mx, my, mz = (round(v * 1000) for v in s.mag_frd_gauss[i].tolist())
        return pack(
            "SCALED_IMU", time_boot_ms=self._view.time_boot_ms(), xacc=ax, yacc=ay, zacc=az,
            xgyro=gx, ygyro=gy, zgyro=gz, xmag=mx, ymag=my, zmag=mz, temperature=1500,
        )[1]  # fmt: skip

    def scaled_pressure(self) -> bytes:
        s, i = self._view.simulation.sensors, self._view.row
        return pack(
            "SCALED_PRESSURE",
            time_boot_ms=self._view.time_boot_ms(),
            press_abs=float(s.baro_pressure_hpa[i]),
            temperature=round(float(s.baro_temperature_deg_c[i]) * 100),
        )[1]

    def gps_raw_int(self) -> bytes:
        s, i = self._view.simulation.sensors, self._view.row
        fix_type = int(s.gps_fix_type[i])
        if fix_type < 2:
            return pack("GPS_RAW_INT", time_usec=self._view.time_boot_us(), fix_type=fix_type, eph=65535,
                        epv=65535, vel=65535, cog=65535)[1]  # fmt: skip
        vn, ve, _ = s.gps_velocity_ned_m_s[i].tolist()
        alt = round(float(s.gps_alt_amsl_m[i]) * 1000)
        return pack(
            "GPS_RAW_INT",
            time_usec=self._view.time_boot_us(),
            fix_type=fix_type,
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
        """Contains the distance of the sensor that points down, which PX4's simulation has too."""
        view = self._view
        measured_m = view.simulation.distance_down_m(view.row)
        min_range_m, max_range_m = (view.parameter(f"SIH_DISTSNSR_{end}") for end in ("MIN", "MAX"))
        distance_cm = round(measured_m * 100) if math.isfinite(measured_m) else OUT_OF_RANGE_CM
        return pack(
            "DISTANCE_SENSOR", time_boot_ms=view.time_boot_ms(), current_distance=distance_cm & 0xFFFF,
            min_distance=_cm(min_range_m), max_distance=_cm(max_range_m), orientation=DOWN,
        )[1]  # fmt: skip

    def distance_forward(self) -> bytes | None:
        """Contains the distance of the forward sensor; None if the world has no forward lidar."""
        view, lidars = self._view, self._view.simulation.world.lidars
        if not lidars.forward:
            return None
        measured_m = view.simulation.distance_forward_m(view.row)
        return pack(
            "DISTANCE_SENSOR", time_boot_ms=view.time_boot_ms(), id=1, orientation=FORWARD,
            current_distance=_cm(measured_m) if math.isfinite(measured_m) else _cm(lidars.range_m) + 1,
            min_distance=MIN_RANGE_CM, max_distance=_cm(lidars.range_m),
        )[1]  # fmt: skip

    def obstacle_distance(self) -> bytes | None:
        """Contains the distances of 72 sectors of 5 degrees, clockwise from the nose; maximum range plus 1 cm
        means no obstacle."""
        view, lidars = self._view, self._view.simulation.world.lidars
        if not lidars.around:
            return None
        range_cm = _cm(lidars.range_m)
        distances_cm = np.minimum(view.simulation.distances_around_m(view.row) * 100.0, range_cm + 1.0)
        return pack(
            "OBSTACLE_DISTANCE", time_usec=view.time_boot_us(),
            distances=np.rint(distances_cm).astype(int).tolist(),
            increment=int(SECTOR_DEG), increment_f=SECTOR_DEG,
            min_distance=MIN_RANGE_CM, max_distance=range_cm, frame=BODY_FRD,
        )[1]  # fmt: skip

    def vibration(self) -> bytes:
        gyro, accel = FLYING_VIBRATION if not self._autopilot.commander.landed else GROUND_VIBRATION
        return pack("VIBRATION", time_usec=self._view.time_boot_us(), vibration_y=gyro, vibration_z=accel)[1]

    def estimator_status(self) -> bytes:
        fleet_estimates, i, estimate = self._view.simulation.estimate, self._view.row, self._view.estimate
        in_air = self._autopilot.commander.armed and not self._autopilot.commander.landed
        fusion = self._view.simulation.fusion
        predicted = estimate.valid_position or fusion.gnss_pos[i] or fusion.gnss_vel[i]
        flags = (
            ATTITUDE_AND_HEIGHT_ABOVE_GROUND
            | (VERTICAL_VELOCITY_AND_POSITION if estimate.valid_altitude else 0)
            | (HORIZONTAL_VELOCITY_AND_POSITION if estimate.valid_position else 0)
        )
        flags |= (PREDICTED_HORIZONTAL_POSITION if predicted else 0) | (0 if in_air else CONSTANT_POSITION)
        flags |= GPS_GLITCH if fleet_estimates.gps_rejected[i] else 0
        flags |= ACCEL_ERROR if fusion.bad_acc_vertical[i] else 0
        return pack(
            "ESTIMATOR_STATUS",
            time_usec=self._view.time_boot_us(),
            flags=flags & 0xFFFF,
            vel_ratio=float(fleet_estimates.innovation_ratio_velocity[i]),
            pos_horiz_ratio=float(fleet_estimates.innovation_ratio_position[i]),
            pos_vert_ratio=float(fleet_estimates.innovation_ratio_height[i]),
            mag_ratio=float(fleet_estimates.innovation_ratio_mag[i]),
            tas_ratio=NAN,
            pos_horiz_accuracy=float(fleet_estimates.horizontal_accuracy_m[i]),
            pos_vert_accuracy=float(fleet_estimates.vertical_accuracy_m[i]),
        )[1]


def _cm(metres: float) -> int:
    return max(0, min(65535, round(metres * 100)))
