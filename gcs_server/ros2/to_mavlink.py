"""Converts a vehicle's ROS 2 messages to the MAVLink messages that PX4 creates from the same data.

PX4 fills its MAVLink messages from the topics that it bridges to ROS 2 (`src/modules/mavlink/streams`). This
module does the same, so that a vehicle's state, page, recordings and replays do not depend on the link. A
message contains only valid values; values that ROS 2 does not carry are marked as unknown.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.ros2.message_types import MalformedMessage, Values
from gcs_server.vehicle.px4.modes import BY_NAME, BY_NAV_STATE

MAX_UPTIME_US: Final = 10 * 365 * 86_400 * 1_000_000
"""Larger timestamps count from 1970."""
TIMESYNC_TIMEOUT_S: Final = 3.0
"""Time without `timesync_status` after which the first timestamp is used as the time of the boot [s]."""
MAX_OFFSET_US: Final = 2**62
"""Larger offsets are implausible and are ignored."""


class BootTime:
    """Time since boot of one vehicle."""

    def __init__(self) -> None:
        self._offset_us: int | None = None
        self._first_timestamp: tuple[float, int] | None = None
        """Arrival time of the first timestamp that counts from 1970 [s, monotonic], and this timestamp
        [µs]."""

    def synchronize(self, estimated_offset_us: int) -> None:
        """Stores the offset of `timesync_status` [µs]; it is added to timestamps that count from 1970."""
        if abs(estimated_offset_us) < MAX_OFFSET_US:
            self._offset_us = estimated_offset_us

    def boot_ms(self, timestamp_us: int, now_s: float) -> int | None:
        """Time since boot, in 32 bits as in MAVLink [ms]; None while it is not known.

        Args:
            timestamp_us: a message's timestamp.
            now_s: time of the server [s, monotonic].
        """
        if timestamp_us < MAX_UPTIME_US:
            return timestamp_us // 1000 & 0xFFFFFFFF
        if self._offset_us is None:
            if self._first_timestamp is None:
                self._first_timestamp = now_s, timestamp_us
            if now_s - self._first_timestamp[0] < TIMESYNC_TIMEOUT_S:
                return None
            self._offset_us = -self._first_timestamp[1]
        return max(0, timestamp_us + self._offset_us) // 1000 & 0xFFFFFFFF


MODE_REQUIREMENTS: Final = (
    ("angular_velocity_invalid", "mode_req_angular_velocity", "no valid angular velocity"),
    ("attitude_invalid", "mode_req_attitude", "no valid attitude estimate"),
    ("local_altitude_invalid", "mode_req_local_alt", "no valid altitude estimate"),
    ("local_position_invalid", "mode_req_local_position", "no valid local position estimate"),
    (
        "local_position_invalid_relaxed",
        "mode_req_local_position_relaxed",
        "no valid local position estimate",
    ),
    ("global_position_invalid", "mode_req_global_position", "no valid global position estimate"),
    (
        "global_position_invalid_relaxed",
        "mode_req_global_position_relaxed",
        "no valid global position estimate",
    ),
    ("auto_mission_missing", "mode_req_mission", "no mission on the vehicle"),
    ("offboard_control_signal_lost", "mode_req_offboard_signal", "no offboard setpoints are received"),
    ("home_position_invalid", "mode_req_home_position", "no home position"),
    ("manual_control_signal_lost", "mode_req_manual_control", "no manual control input"),
)
"""(flag, mask of the modes with this requirement, text); a mode's bit number is its `nav_state`."""
IN_ANY_MODE: Final = (
    ("battery_unhealthy", "battery unhealthy"),
    ("battery_low_remaining_time", "remaining flight time too low"),
    ("geofence_breached", "geofence breached"),
    ("wind_limit_exceeded", "wind speed limit exceeded"),
    ("flight_time_limit_exceeded", "flight time limit exceeded"),
    ("navigator_failure", "navigator failure"),
    ("fd_critical_failure", "critical failure (attitude or external failsafe)"),
    ("fd_esc_arming_failure", "an ESC did not arm"),
    ("fd_imbalanced_prop", "imbalanced propeller detected"),
    ("fd_motor_failure", "motor failure"),
)
"""(flag, text) of problems that matter in every mode."""


def problems(flags: Values, nav_state: int) -> Iterator[str]:
    """Texts of the flags that prevent arming or flying in a mode.

    Args:
        flags: a decoded `failsafe_flags`.
        nav_state: the mode, 0 to 31.
    """
    if nav_state < 32 and flags["mode_req_prevent_arming"] >> nav_state & 1:
        yield "PX4 does not arm in this mode"
    for flag, mask, text in MODE_REQUIREMENTS:
        if flags[flag] and nav_state < 32 and flags[mask] >> nav_state & 1:
            yield text
    for flag, text in IN_ANY_MODE:
        if flags[flag]:
            yield text


ARMED: Final = 2
"""VehicleStatus.ARMING_STATE_ARMED."""
HIL_STATE_ON: Final = 1
NAV_TAKEOFF, NAV_LAND, NAV_DESCEND, NAV_PRECLAND = 17, 18, 12, 20
ESTIMATOR_STATUS_PERIOD_S: Final = 1.0
"""Period of ESTIMATOR_STATUS while its flags do not change."""
UNKNOWN_U16: Final = 0xFFFF
PREARM, AHRS, RC = (
    d.MAV_SYS_STATUS_PREARM_CHECK,
    d.MAV_SYS_STATUS_AHRS,
    d.MAV_SYS_STATUS_SENSOR_RC_RECEIVER,
)
Messages = Iterator[MAVLink_message]


class MavlinkConverter:
    """Converts the messages of one vehicle. Stores the newest values of some topics, because some MAVLink
    messages combine several topics."""

    def __init__(self) -> None:
        self.boot_time = BootTime()
        self._status: Values | None = None
        self._landed: bool | None = None
        self._flags: Values | None = None
        self._rates_frd_rad_s = (math.nan,) * 3
        self._local: Values | None = None
        self._home: Values | None = None
        self._home_is_assumed = False
        self._latched: dict[int, MAVLink_message] = {}
        self._last_estimator_status = (-math.inf, 0)
        """Time of the last ESTIMATOR_STATUS, and its flags."""
        self._by_topic: dict[str, Callable[[Values, float], Messages]] = {
            "/fmu/out/timesync_status": self._timesync,
            "/fmu/out/vehicle_status": self._vehicle_status,
            "/fmu/out/vehicle_land_detected": self._land_detected,
            "/fmu/out/failsafe_flags": self._failsafe_flags,
            "/fmu/out/home_position": self._home_position,
            "/fmu/out/position_setpoint_triplet": self._triplet,
            "/fmu/out/vehicle_odometry": self._odometry,
            "/fmu/out/vehicle_attitude": self._attitude,
            "/fmu/out/vehicle_local_position": self._local_position,
            "/fmu/out/vehicle_global_position": self._global_position,
            "/fmu/out/vehicle_gps_position": self._gps,
            "/fmu/out/battery_status": self._battery,
        }

    @property
    def address(self) -> tuple[int, int] | None:
        """The vehicle's system and component id; None before its first status."""
        status = self._status
        return None if status is None else (status["system_id"], status["component_id"])

    def convert(self, topic: str, values: Values, now_s: float) -> list[MAVLink_message]:
        """The MAVLink messages for a ROS 2 message; none before the first vehicle status.

        Raises:
            MalformedMessage: values that no vehicle can have.
        """
        messages = list(self._by_topic[topic](values, now_s))
        return messages if self._status is not None else []

    def latched(self, msg_id: int) -> MAVLink_message | None:
        """The last message from a topic that PX4 publishes only at a change; sent again when a client
        requests it. None: there is no such message yet."""
        return self._latched.get(msg_id)

    @property
    def nav_state(self) -> int:
        """The current mode; 0 before the first status."""
        return 0 if self._status is None else self._status["nav_state"]

    def problems(self, nav_state: int) -> list[str]:
        """Texts of the failsafe flags that prevent arming or flying in a mode."""
        return [] if self._flags is None else list(dict.fromkeys(problems(self._flags, nav_state)))

    # --- state ------------------------------------------------------------------------------------

    def _timesync(self, values: Values, _now_s: float) -> Messages:
        self.boot_time.synchronize(values["estimated_offset"])
        yield from ()

    def _vehicle_status(self, values: Values, _now_s: float) -> Messages:
        if not 1 <= values["system_id"] <= 254 or not values["component_id"]:
            raise MalformedMessage(
                f"system/component id {values['system_id']}/{values['component_id']} is not valid"
            )
        self._status = values
        armed = values["arming_state"] == ARMED
        base_mode = d.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base_mode |= d.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        base_mode |= d.MAV_MODE_FLAG_HIL_ENABLED if values["hil_state"] == HIL_STATE_ON else 0
        state = d.MAV_STATE_ACTIVE if armed else d.MAV_STATE_STANDBY
        if values["calibration_enabled"]:
            state = d.MAV_STATE_CALIBRATING
        elif armed and values["failsafe"]:
            state = d.MAV_STATE_CRITICAL
        mode = _custom_mode(values["nav_state"])
        yield d.MAVLink_heartbeat_message(
            values["system_type"], d.MAV_AUTOPILOT_PX4, base_mode, mode, state, 3
        )
        yield d.MAVLink_current_mode_message(0, mode, _custom_mode(values["nav_state_user_intention"]))
        yield from self._landed_state()
        yield self._sys_status()

    def _land_detected(self, values: Values, _now_s: float) -> Messages:
        self._landed = values["landed"]
        yield from self._landed_state()

    def _landed_state(self) -> Messages:
        if self._landed is None or self._status is None:
            return
        landed = d.MAV_LANDED_STATE_ON_GROUND
        if not self._landed:
            landed = {
                NAV_TAKEOFF: d.MAV_LANDED_STATE_TAKEOFF,
                NAV_LAND: d.MAV_LANDED_STATE_LANDING,
                NAV_DESCEND: d.MAV_LANDED_STATE_LANDING,
                NAV_PRECLAND: d.MAV_LANDED_STATE_LANDING,
            }.get(self._status["nav_state"], d.MAV_LANDED_STATE_IN_AIR)
        yield d.MAVLink_extended_sys_state_message(d.MAV_VTOL_STATE_UNDEFINED, landed)

    def _failsafe_flags(self, values: Values, _now_s: float) -> Messages:
        self._flags = values
        if self._status is not None:
            yield self._sys_status()

    def _sys_status(self) -> MAVLink_message:
        """Health of the attitude estimate and manual control; PX4's pre-arm check is in the healthy mask."""
        assert self._status is not None
        flags, present, healthy = self._flags, AHRS, 0
        if flags is not None and not flags["attitude_invalid"]:
            healthy |= AHRS
        if flags is not None and not flags["manual_control_signal_lost"]:
            present |= RC
            healthy |= RC
        healthy |= PREARM if self._status["pre_flight_checks_pass"] else 0
        return d.MAVLink_sys_status_message(
            present, present, healthy, UNKNOWN_U16, UNKNOWN_U16, -1, -1, 0, 0, 0, 0, 0, 0
        )

    # --- home and target ----------------------------------------------------------------------------

    def _home_position(self, values: Values, _now_s: float) -> Messages:
        if not (values["valid_hpos"] and values["valid_alt"]):
            return
        self._home, self._home_is_assumed = values, False
        yield from self._home_message(values)

    def _home_message(self, values: Values) -> Messages:
        message = d.MAVLink_home_position_message(
            *_scaled_global(values),
            values["x"],
            values["y"],
            values["z"],
            (1.0, 0.0, 0.0, 0.0),
            0.0,
            0.0,
            0.0,
        )
        self._latched[message.get_msgId()] = message
        yield message

    def _assume_home(self, values: Values) -> Messages:
        """Uses the position of a vehicle that is disarmed on the ground as its home until PX4 sends the home
        position.

        PX4 sends its home only when it changes, so a server that connects later does not receive it. When
        PX4 arms, it sets home to the vehicle's position and sends it.
        """
        is_unknown = self._home is None or self._home_is_assumed
        status, local = self._status, self._local
        if not is_unknown or status is None or status["arming_state"] == ARMED or not self._landed:
            return
        if local is None or not (local["xy_valid"] and local["z_valid"]):
            return
        is_first = self._home is None
        self._home, self._home_is_assumed = {**values, **{axis: local[axis] for axis in "xyz"}}, True
        messages = list(self._home_message(self._home))
        yield from messages if is_first else ()

    def _triplet(self, values: Values, now_s: float) -> Messages:
        boot_ms = self.boot_time.boot_ms(values["timestamp"], now_s)
        if not values["current.valid"] or boot_ms is None:
            return
        position = {axis: values[f"current.{axis}"] for axis in ("lat", "lon", "alt")}
        if not all(map(math.isfinite, position.values())):
            return
        lat, lon, _ = _scaled_global(position)
        message = d.MAVLink_position_target_global_int_message(
            boot_ms, d.MAV_FRAME_GLOBAL, 0xFF8, lat, lon, position["alt"], *(0.0,) * 8
        )
        self._latched[message.get_msgId()] = message
        yield message

    # --- motion ---------------------------------------------------------------------------------------

    def _odometry(self, values: Values, _now_s: float) -> Messages:
        self._rates_frd_rad_s = values["angular_velocity"]
        yield from ()

    def _attitude(self, values: Values, now_s: float) -> Messages:
        boot_ms = self.boot_time.boot_ms(values["timestamp"], now_s)
        if boot_ms is not None:
            yield d.MAVLink_attitude_quaternion_message(boot_ms, *values["q"], *self._rates_frd_rad_s)

    def _local_position(self, values: Values, now_s: float) -> Messages:
        self._local = values
        boot_ms = self.boot_time.boot_ms(values["timestamp"], now_s)
        if boot_ms is None:
            return
        position_valid = values["xy_valid"] and values["z_valid"]
        if position_valid and values["v_xy_valid"] and values["v_z_valid"]:
            axes = ("x", "y", "z", "vx", "vy", "vz")
            yield d.MAVLink_local_position_ned_message(boot_ms, *(values[axis] for axis in axes))
        yield from self._estimator_status(values, boot_ms, now_s)

    def _estimator_status(self, local: Values, boot_ms: int, now_s: float) -> Messages:
        flags = 0 if self._flags is not None and self._flags["attitude_invalid"] else d.ESTIMATOR_ATTITUDE
        flags |= d.ESTIMATOR_VELOCITY_HORIZ if local["v_xy_valid"] else 0
        flags |= d.ESTIMATOR_VELOCITY_VERT if local["v_z_valid"] else 0
        flags |= d.ESTIMATOR_POS_HORIZ_REL if local["xy_valid"] else 0
        flags |= d.ESTIMATOR_POS_HORIZ_ABS if local["xy_valid"] and local["xy_global"] else 0
        flags |= d.ESTIMATOR_POS_VERT_ABS if local["z_valid"] else 0
        if (
            self._last_estimator_status[1] == flags
            and now_s - self._last_estimator_status[0] < ESTIMATOR_STATUS_PERIOD_S
        ):
            return
        self._last_estimator_status = now_s, flags
        unknown, eph_m, epv_m = math.nan, local["eph"], local["epv"]
        yield d.MAVLink_estimator_status_message(
            boot_ms * 1000, flags, unknown, unknown, unknown, unknown, unknown, unknown, eph_m, epv_m
        )

    def _global_position(self, values: Values, now_s: float) -> Messages:
        boot_ms, local = self.boot_time.boot_ms(values["timestamp"], now_s), self._local
        if boot_ms is None or local is None or not (values["lat_lon_valid"] and values["alt_valid"]):
            return
        yield from self._assume_home(values)
        relative_alt_m = -local["z"] if self._home is None else values["alt"] - self._home["alt"]
        vx_cm_s, vy_cm_s, vz_cm_s = [
            _bounded(local[axis] * 100, -32767, 32767, 0) for axis in ("vx", "vy", "vz")
        ]
        heading = math.degrees(local["heading"]) % 360 if math.isfinite(local["heading"]) else math.nan
        yield d.MAVLink_global_position_int_message(
            boot_ms,
            *_scaled_global(values),
            _bounded(relative_alt_m * 1e3, -(2**31), 2**31 - 1, 0),
            vx_cm_s,
            vy_cm_s,
            vz_cm_s,
            _bounded(heading * 100, 0, 35_999, UNKNOWN_U16),
        )

    # --- sensors ----------------------------------------------------------------------------------------

    def _gps(self, values: Values, _now_s: float) -> Messages:
        lat, lon = values["latitude_deg"], values["longitude_deg"]
        position = _scaled_global({"lat": lat, "lon": lon, "alt": values["altitude_msl_m"]})
        yield d.MAVLink_gps_raw_int_message(
            values["timestamp"],
            values["fix_type"],
            *position,
            _bounded(values["hdop"] * 100, 0, 65_534, UNKNOWN_U16),
            _bounded(values["vdop"] * 100, 0, 65_534, UNKNOWN_U16),
            _bounded(values["vel_m_s"] * 100, 0, 65_534, UNKNOWN_U16),
            _bounded(math.degrees(values["cog_rad"]) % 360 * 100, 0, 35_999, UNKNOWN_U16),
            min(values["satellites_used"], 254),
            h_acc=_bounded(values["eph"] * 1e3, 0, 2**32 - 1, 0),
            v_acc=_bounded(values["epv"] * 1e3, 0, 2**32 - 1, 0),
        )

    def _battery(self, values: Values, _now_s: float) -> Messages:
        if not values["connected"]:
            return
        used = [v for v in values["voltage_cell_v"] if math.isfinite(v) and v > 0.0][:10]
        volts = used or [values["voltage_v"]]
        cells = [_bounded(volt * 1000, 0, 65_534, UNKNOWN_U16) for volt in volts]
        current_a, remaining = values["current_a"], values["remaining"]
        yield d.MAVLink_battery_status_message(
            max(0, values["id"] - 1),
            d.MAV_BATTERY_FUNCTION_ALL,
            d.MAV_BATTERY_TYPE_LIPO,
            32767,
            cells + [UNKNOWN_U16] * (10 - len(cells)),
            _bounded(current_a * 100, 0, 32767, -1) if current_a >= 0.0 else -1,
            _bounded(values["discharged_mah"], 0, 2**31 - 1, -1),
            -1,
            _bounded(math.ceil(remaining * 100), 0, 100, -1) if math.isfinite(remaining) else -1,
            _bounded(values["time_remaining_s"], 0, 2**31 - 1, 0),
        )


def _custom_mode(nav_state: int) -> int:
    """MAVLink's `custom_mode` of a navigation state; 0 for unknown states. PX4 reports Descend as Land."""
    mode = BY_NAME["land"] if nav_state == NAV_DESCEND else BY_NAV_STATE.get(nav_state)
    return 0 if mode is None else mode.custom_mode


def _scaled_global(values: Values) -> tuple[int, int, int]:
    """Latitude and longitude [1e-7 °] and altitude [mm].

    Raises:
        MalformedMessage: the values are not a position on the earth.
    """
    lat, lon, alt = values["lat"], values["lon"], values["alt"]
    if not (-90.0 <= lat <= 90.0 and -180.0 <= lon <= 180.0 and abs(alt) < 1e6):
        raise MalformedMessage(f"{lat:.7g}°, {lon:.7g}°, {alt:.7g} m is not a position")
    return round(lat * 1e7), round(lon * 1e7), round(alt * 1e3)


def _bounded(value: float, low: int, high: int, unknown: int) -> int:
    """The value rounded and limited to `low` … `high`; `unknown` if it is not finite."""
    return min(max(round(value), low), high) if math.isfinite(value) else unknown
