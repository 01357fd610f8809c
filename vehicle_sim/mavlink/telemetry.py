"""What each telemetry message says, packed straight from the vehicle's state.

A payload is built once a step and shared by the links. A builder that returns None has nothing to say yet.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.modes import MODES
from vehicle_sim.control.setpoints import ControlLevel
from vehicle_sim.geodesy import to_global
from vehicle_sim.mavlink.dialect import BY_NAME, LAYOUTS, Layout, pack

SENSORS_PRESENT = 50348079
SENSORS_ENABLED = 50413615
SENSORS_HEALTHY = 52480063
PREARM_BIT = 0x10000000
"""MAV_SYS_STATUS_PREARM_CHECK."""
GPS_WEEK_ODID_EPOCH_S = 1546300800
NAN = math.nan

Builder = Callable[[], bytes | None]


def _packer(name: str) -> Callable[..., bytes]:
    return BY_NAME[name].packer.pack


_ATTITUDE = _packer("ATTITUDE")
_ATTITUDE_QUATERNION = _packer("ATTITUDE_QUATERNION")
_LOCAL = _packer("LOCAL_POSITION_NED")
_GLOBAL = _packer("GLOBAL_POSITION_INT")
_TARGET_LOCAL = _packer("POSITION_TARGET_LOCAL_NED")
_TARGET_ATTITUDE = _packer("ATTITUDE_TARGET")


class Telemetry:
    """Payloads of one vehicle."""

    def __init__(self, autopilot: Autopilot, system_id: int) -> None:
        self._autopilot = autopilot
        self._body = autopilot.body
        self._system_id = system_id
        self._cache: dict[int, bytes | None] = {}
        self._step = -1
        self._builders: dict[int, Builder] = {
            BY_NAME[name[1:].upper()].id: getattr(self, name)
            for name in dir(self)
            if name.startswith("_") and name[1:].upper() in BY_NAME
        }

    @property
    def ids(self) -> frozenset[int]:
        """Messages this module can build."""
        return frozenset(self._builders)

    def payload(self, msg_id: int) -> tuple[Layout, bytes] | None:
        """Layout and payload of a message now, or None."""
        step = self._body.simulation.steps
        if step != self._step:
            self._cache.clear()
            self._step = step
        if msg_id not in self._cache:
            builder = self._builders.get(msg_id)
            self._cache[msg_id] = builder() if builder else None
        payload = self._cache[msg_id]
        if payload is None:
            return None
        return LAYOUTS[msg_id], payload

    # --- state of the vehicle --------------------------------------------------------------------------

    def _heartbeat(self) -> bytes:
        commander = self._autopilot.commander
        return pack(
            "HEARTBEAT",
            type=2,
            autopilot=12,
            base_mode=commander.base_mode(),
            custom_mode=commander.custom_mode(),
            system_status=commander.system_status(),
            mavlink_version=3,
        )[1]

    def _sys_status(self) -> bytes:
        commander, battery, i = self._autopilot.commander, self._body.simulation.battery, self._body.row
        started = self._body.belief.valid_attitude
        ready = commander.report.armable(commander.intended)
        return pack(
            "SYS_STATUS",
            onboard_control_sensors_present=SENSORS_PRESENT if started else 0,
            onboard_control_sensors_enabled=SENSORS_ENABLED if started else 0,
            onboard_control_sensors_health=SENSORS_HEALTHY | (PREARM_BIT if ready else 0),
            load=100,
            voltage_battery=round(float(battery.voltage_v[i]) * 1000),
            current_battery=round(float(battery.current_a[i]) * 100),
            battery_remaining=math.ceil(float(battery.remaining[i]) * 100),
            onboard_control_sensors_health_extended=1,
        )[1]

    def _extended_sys_state(self) -> bytes:
        return pack("EXTENDED_SYS_STATE", landed_state=self._autopilot.commander.landed_state())[1]

    def _current_mode(self) -> bytes:
        commander = self._autopilot.commander
        return pack(
            "CURRENT_MODE",
            standard_mode=MODES[commander.active].standard_mode,
            custom_mode=commander.custom_mode(),
            intended_custom_mode=commander.intended_custom_mode(),
        )[1]

    def _system_time(self) -> bytes:
        body = self._body
        return pack("SYSTEM_TIME", time_unix_usec=body.time_unix_us(), time_boot_ms=body.time_boot_ms())[1]

    def _battery_status(self) -> bytes:
        battery, i = self._body.simulation.battery, self._body.row
        volts = round(float(battery.voltage_v[i]) * 1000)
        warning = self._autopilot.commander.battery_warning
        return pack(
            "BATTERY_STATUS",
            battery_function=1,
            type=1,
            temperature=32767,
            voltages=[volts] + [65535] * 9,
            current_battery=round(float(battery.current_a[i]) * 100),
            current_consumed=round(float(battery.consumed_mah[i])),
            energy_consumed=-1,
            battery_remaining=math.ceil(float(battery.remaining[i]) * 100),
            charge_state=1 + warning,
        )[1]

    # --- motion ----------------------------------------------------------------------------------------

    def _attitude(self) -> bytes:
        b = self._body.belief
        return _ATTITUDE(
            self._body.time_boot_ms(), b.roll_rad, b.pitch_rad, b.yaw_ned_rad, *b.rates_frd_rad_s
        )

    def _attitude_quaternion(self) -> bytes:
        b = self._body.belief
        return _ATTITUDE_QUATERNION(
            self._body.time_boot_ms(), *b.q_ned_frd, *b.rates_frd_rad_s, 1.0, 0.0, 0.0, 0.0
        )

    def _local_position_ned(self) -> bytes | None:
        b = self._body.belief
        if not b.valid_altitude:
            return None
        return _LOCAL(self._body.time_boot_ms(), *b.position_ned_m, *b.velocity_ned_m_s)

    def _global_position_int(self) -> bytes | None:
        b, home = self._body.belief, self._autopilot.home
        if not b.valid_position or not math.isfinite(b.lat_deg):
            return None
        relative = b.alt_amsl_m - home.alt_amsl_m if home.valid else 0.0
        vn, ve, vd = b.velocity_ned_m_s
        return _GLOBAL(
            self._body.time_boot_ms(),
            round(b.lat_deg * 1e7),
            round(b.lon_deg * 1e7),
            round(b.alt_amsl_m * 1000),
            round(relative * 1000),
            _i16(vn * 100),
            _i16(ve * 100),
            _i16(vd * 100),
            int(math.degrees(b.yaw_ned_rad) % 360.0 * 100.0) % 36000,
        )

    def _odometry(self) -> bytes:
        b = self._body.belief
        variances = [NAN] * 21
        return pack(
            "ODOMETRY",
            time_usec=self._body.time_boot_us(),
            frame_id=1,
            child_frame_id=1,
            x=b.position_ned_m[0],
            y=b.position_ned_m[1],
            z=b.position_ned_m[2],
            q=b.q_ned_frd,
            vx=b.velocity_ned_m_s[0],
            vy=b.velocity_ned_m_s[1],
            vz=b.velocity_ned_m_s[2],
            rollspeed=b.rates_frd_rad_s[0],
            pitchspeed=b.rates_frd_rad_s[1],
            yawspeed=b.rates_frd_rad_s[2],
            pose_covariance=variances,
            velocity_covariance=variances,
            estimator_type=8,
        )[1]

    def _altitude(self) -> bytes:
        b, home = self._body.belief, self._autopilot.home
        baro = float(self._body.simulation.sensors.baro_alt_amsl_m[self._body.row])
        known = b.valid_position and math.isfinite(b.alt_amsl_m)
        relative = b.alt_amsl_m - home.alt_amsl_m if known and home.valid else NAN
        return pack(
            "ALTITUDE",
            time_usec=self._body.time_boot_us(),
            altitude_monotonic=baro,
            altitude_amsl=b.alt_amsl_m if known else NAN,
            altitude_local=-b.position_ned_m[2] if known else NAN,
            altitude_relative=relative,
            altitude_terrain=-home.position_ned_m[2] if known and home.valid else NAN,
            bottom_clearance=max(0.0, relative) if known and home.valid else NAN,
        )[1]

    def _vfr_hud(self) -> bytes:
        b = self._body.belief
        vn, ve, vd = b.velocity_ned_m_s
        armed = self._autopilot.commander.armed
        thrust = float(self._body.simulation.target.thrust[self._body.row]) if armed else 0.0
        return pack(
            "VFR_HUD",
            groundspeed=math.hypot(vn, ve),
            heading=int(math.degrees(b.yaw_ned_rad) % 360.0) % 360,
            throttle=max(0, min(100, int(100 * thrust))),
            alt=b.alt_amsl_m if math.isfinite(b.alt_amsl_m) else -b.position_ned_m[2],
            climb=-vd,
        )[1]

    def _position_target_local_ned(self) -> bytes:
        row, i = self._body.simulation.target, self._body.row
        time_ms = self._body.time_boot_ms()
        setpoints = self._body.simulation.setpoints
        idle = int(setpoints.level[i]) != ControlLevel.TRAJECTORY
        if idle:
            yaw = self._body.belief.yaw_ned_rad
            return _TARGET_LOCAL(time_ms, *(NAN,) * 6, 0.0, 0.0, 100.0, yaw, 0.0, 63, 1)
        p = row.position_ned_m[i].tolist()
        v = row.velocity_ned_m_s[i].tolist()
        a = row.acceleration_ned_m_s2[i].tolist()
        yaw, rate = float(row.yaw_ned_rad[i]), float(row.yaw_rate_ned_rad_s[i])
        mask = 0
        for bit, value in enumerate((*p, *v, *a)):
            if value != value:
                mask |= 1 << bit
        mask |= (1024 if yaw != yaw else 0) | (2048 if rate != rate else 0)
        return _TARGET_LOCAL(time_ms, *p, *v, *a, yaw, rate, mask, 1)

    def _position_target_global_int(self) -> bytes | None:
        commander, navigator = self._autopilot.commander, self._autopilot.navigator
        north, east, down = navigator.target_ned_m
        if not commander.armed or north is None or east is None or down is None:
            return None
        lat_deg, lon_deg, alt_m = self._to_global(north, east, down)
        return pack(
            "POSITION_TARGET_GLOBAL_INT",
            time_boot_ms=self._body.time_boot_ms(),
            coordinate_frame=5,
            lat_int=round(lat_deg * 1e7),
            lon_int=round(lon_deg * 1e7),
            alt=alt_m,
        )[1]

    def _to_global(self, north: float, east: float, down: float) -> tuple[float, float, float]:
        lat0, lon0, alt0 = self._body.origin
        lat, lon = to_global(north, east, lat0, lon0)  # type: ignore[arg-type]
        return float(lat), float(lon), alt0 - down

    def _attitude_target(self) -> bytes:
        target, i = self._body.simulation.target, self._body.row
        return _TARGET_ATTITUDE(
            self._body.time_boot_ms(),
            *target.q_ned_frd[i].tolist(),
            *target.rates_frd_rad_s[i].tolist(),
            float(target.thrust[i]),
            0,
        )

    def _servo_output_raw(self) -> bytes:
        motors = [round(value) for value in self._body.simulation.motors_us[self._body.row].tolist()]
        values = {f"servo{n + 1}_raw": (motors[n] if n < len(motors) else 900) for n in range(16)}
        return pack("SERVO_OUTPUT_RAW", time_usec=self._body.time_boot_us() & 0xFFFFFFFF, **values)[1]

    # --- sensors ---------------------------------------------------------------------------------------

    def _highres_imu(self) -> bytes:
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
            temperature=float(s.baro_temperature_deg_c[i]),
            fields_updated=7167,
        )[1]  # fmt: skip

    def _scaled_imu(self) -> bytes:
        s, i = self._body.simulation.sensors, self._body.row
        ax, ay, az = (round(v / 9.80665 * 1000) for v in s.accel_frd_m_s2[i].tolist())
        gx, gy, gz = (round(v * 1000) for v in s.gyro_frd_rad_s[i].tolist())
        mx, my, mz = (round(v * 1000) for v in s.mag_frd_gauss[i].tolist())
        return pack(
            "SCALED_IMU", time_boot_ms=self._body.time_boot_ms(), xacc=ax, yacc=ay, zacc=az,
            xgyro=gx, ygyro=gy, zgyro=gz, xmag=mx, ymag=my, zmag=mz, temperature=1500,
        )[1]  # fmt: skip

    def _scaled_pressure(self) -> bytes:
        s, i = self._body.simulation.sensors, self._body.row
        return pack(
            "SCALED_PRESSURE",
            time_boot_ms=self._body.time_boot_ms(),
            press_abs=float(s.baro_pressure_hpa[i]),
            temperature=round(float(s.baro_temperature_deg_c[i]) * 100),
        )[1]

    def _gps_raw_int(self) -> bytes:
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

    def _distance_sensor(self) -> bytes:
        return pack(
            "DISTANCE_SENSOR", time_boot_ms=self._body.time_boot_ms(), max_distance=10000, orientation=25
        )[1]

    def _vibration(self) -> bytes:
        b = self._body.simulation.sensors.accel_frd_m_s2[self._body.row]
        return pack(
            "VIBRATION",
            time_usec=self._body.time_boot_us(),
            vibration_y=0.01,
            vibration_z=abs(float(b[2]) + 9.80665) * 0.1,
        )[1]

    def _estimator_status(self) -> bytes:
        e, i, b = self._body.simulation.estimate, self._body.row, self._body.belief
        armed = self._autopilot.commander.armed and not self._autopilot.commander.landed
        flags = 1 | (0b100100 if b.valid_altitude else 0) | (0b11010 if b.valid_position else 0)
        flags |= 0b1100000 | (768 if b.valid_position else 0) | (0 if armed else 128)
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

    # --- places ----------------------------------------------------------------------------------------

    def _home_position(self) -> bytes | None:
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
            q=(math.cos(home.yaw_ned_rad / 2), 0.0, 0.0, math.sin(home.yaw_ned_rad / 2)),
            time_usec=home.set_at_us,
        )[1]

    def _gps_global_origin(self) -> bytes | None:
        lat, lon, alt = self._body.origin
        if not math.isfinite(lat):
            return None
        return pack(
            "GPS_GLOBAL_ORIGIN",
            latitude=round(lat * 1e7),
            longitude=round(lon * 1e7),
            altitude=round(alt * 1000),
            time_usec=self._body.time_boot_us(),
        )[1]

    def _open_drone_id_location(self) -> bytes | None:
        b, home = self._body.belief, self._autopilot.home
        if not math.isfinite(b.lat_deg) or not home.valid:
            return None
        vn, ve, vd = b.velocity_ned_m_s
        return pack(
            "OPEN_DRONE_ID_LOCATION",
            status=2 if not self._autopilot.commander.landed else 1,
            direction=round(math.degrees(math.atan2(ve, vn)) % 360.0 * 100) % 36000,
            speed_horizontal=min(25425, round(math.hypot(vn, ve) * 100)),
            speed_vertical=_i16(-vd * 100),
            latitude=round(b.lat_deg * 1e7),
            longitude=round(b.lon_deg * 1e7),
            altitude_barometric=float(self._body.simulation.sensors.baro_alt_amsl_m[self._body.row]),
            altitude_geodetic=float(round(b.alt_amsl_m)),
            height=b.alt_amsl_m - home.alt_amsl_m,
            horizontal_accuracy=12,
            vertical_accuracy=5,
            barometer_accuracy=0,
            speed_accuracy=4,
            timestamp=(self._body.time_unix_us() // 1_000_000) % 3600,
            timestamp_accuracy=1,
        )[1]

    def _open_drone_id_system(self) -> bytes | None:
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
            timestamp=max(0, self._body.time_unix_us() // 1_000_000 - GPS_WEEK_ODID_EPOCH_S),
        )[1]

    def _time_estimate_to_target(self) -> bytes:
        home, b = self._autopilot.home, self._body.belief
        seconds = 0
        if home.valid and not self._autopilot.commander.landed:
            way = math.dist(b.position_ned_m[:2], home.position_ned_m[:2])
            height = max(0.0, home.position_ned_m[2] - b.position_ned_m[2])
            seconds = round(way / max(0.1, self._body.parameter("MPC_XY_CRUISE")) + height / 0.7)
        return pack(
            "TIME_ESTIMATE_TO_TARGET", safe_return=seconds, land=-1, mission_next_item=-1, mission_end=-1,
            commanded_action=-1,
        )[1]  # fmt: skip

    # --- gimbal ----------------------------------------------------------------------------------------

    def _mount_orientation(self) -> bytes | None:
        gimbal = self._autopilot.gimbal
        if not gimbal.enabled:
            return None
        a = gimbal.actual
        return pack(
            "MOUNT_ORIENTATION",
            time_boot_ms=self._body.time_boot_ms(),
            roll=math.degrees(a.roll_rad),
            pitch=math.degrees(a.pitch_rad),
            yaw=math.degrees(a.yaw_rad),
            yaw_absolute=math.degrees(gimbal.yaw_ned_rad) % 360.0,
        )[1]

    def _gimbal_manager_information(self) -> bytes | None:
        gimbal, parameter = self._autopilot.gimbal, self._body.parameter
        if not gimbal.enabled:
            return None
        pitch, yaw, roll = (parameter(f"MNT_RANGE_{axis}") for axis in ("PITCH", "YAW", "ROLL"))
        return pack(
            "GIMBAL_MANAGER_INFORMATION",
            time_boot_ms=self._body.time_boot_ms(),
            cap_flags=132530,
            gimbal_device_id=gimbal.device_id,
            roll_min=-roll, roll_max=roll, pitch_min=-pitch, pitch_max=pitch, yaw_min=-yaw, yaw_max=yaw,
        )[1]  # fmt: skip

    def _gimbal_manager_status(self) -> bytes | None:
        gimbal = self._autopilot.gimbal
        if not gimbal.enabled:
            return None
        return pack(
            "GIMBAL_MANAGER_STATUS",
            time_boot_ms=self._body.time_boot_ms(),
            flags=int(gimbal.flags),
            gimbal_device_id=gimbal.device_id,
            primary_control_sysid=gimbal.primary[0],
            primary_control_compid=gimbal.primary[1],
        )[1]

    def _gimbal_device_attitude_status(self) -> bytes | None:
        gimbal = self._autopilot.gimbal
        if not gimbal.enabled:
            return None
        rates = gimbal.rates_rad_s
        return pack(
            "GIMBAL_DEVICE_ATTITUDE_STATUS",
            time_boot_ms=self._body.time_boot_ms(),
            flags=int(gimbal.flags),
            q=gimbal.device_quaternion(),
            angular_velocity_x=rates.roll_rad,
            angular_velocity_y=rates.pitch_rad,
            angular_velocity_z=rates.yaw_rad,
            gimbal_device_id=gimbal.device_id,
        )[1]


def _i16(value: float) -> int:
    return max(-32768, min(32767, round(value)))
