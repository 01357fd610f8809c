"""A three-axis gimbal and its manager: who controls the gimbal, setpoints and motion.

The module reads MNT_MODE_IN and MNT_MODE_OUT when it starts: at boot unless MNT_MODE_IN is -1, or by the
console's `gimbal start`. Without an input by MAVLink it runs, but takes no commands (a guess: PX4 was
recorded with an input, and without the module). With MNT_MODE_OUT 0 the manager drives servos, which reach
the setpoint immediately, up to half of MNT_RANGE_* to either side. Servo angles are relative to the body,
unless MNT_DO_STAB compensates the vehicle's attitude. With MNT_MODE_OUT 2 the manager commands a separate
gimbal device. The device has a lag and a maximum rate, and keeps a locked yaw relative to north.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntFlag

from vehicle_sim.frames import Quaternion, angles_of, quaternion_of, wrap_angle
from vehicle_sim.geodesy import to_local
from vehicle_sim.vehicle_view import VehicleView

TIME_CONSTANT_S = 0.15
RATE_LIMIT_RAD_S = math.radians(90.0)
MAVLINK_INPUTS = (0, 4)
"""MNT_MODE_IN with gimbal protocol version 2: together with RC, or alone."""
OUTPUT_DEVICE = 2
STABILISE_ALL, STABILISE_YAW = 1, 2
"""MNT_DO_STAB."""
AXES = ("ROLL", "PITCH", "YAW")
GlobalPosition = tuple[float, float, float]
"""Latitude, longitude [deg], altitude AMSL [m]."""


class Flag(IntFlag):
    """GIMBAL_MANAGER_FLAGS; the device's flags are the same bits."""

    RETRACT = 1
    NEUTRAL = 2
    ROLL_LOCK = 4
    PITCH_LOCK = 8
    YAW_LOCK = 16


AXIS_LOCKS = (Flag.ROLL_LOCK, Flag.PITCH_LOCK, Flag.YAW_LOCK)


@dataclass(slots=True)
class Angles:
    """Euler angles of the gimbal.

    Setpoints of roll and pitch are relative to the horizon, those of yaw to north (with YAW_LOCK) or to the
    vehicle. Actual angles of servos are relative to the body, the actual yaw of a device to the vehicle.
    """

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0


@dataclass(slots=True)
class AngleRates:
    """Rates of the device's Euler angles."""

    roll_rad_s: float = 0.0
    pitch_rad_s: float = 0.0
    yaw_rad_s: float = 0.0


class Gimbal:
    """Manager and device of one vehicle.

    Args:
        waypoint: returns the position that the vehicle flies to, or None.
    """

    def __init__(self, view: VehicleView, waypoint: Callable[[], GlobalPosition | None]) -> None:
        self._view = view
        self._get_waypoint = waypoint
        self._input: int | None = None
        """MNT_MODE_IN when the module started; None: it does not run."""
        self._output = 0
        """MNT_MODE_OUT when the module started."""
        self.flags = Flag.ROLL_LOCK | Flag.PITCH_LOCK
        self.primary = (0, 0)
        self.setpoint = Angles()
        self.actual = Angles()
        self.rates = AngleRates()
        self._rate_setpoints: tuple[float, float] | None = None
        self._servo_inputs: tuple[float, ...] | None = None
        """Inputs of the current servo angles; `update` computes the angles again only if an input changes.

        None: the angles also depend on the vehicle's attitude or a rate; each `update` computes the angles.
        """
        self.at_rest = False
        """Whether `update` has no effect until a command, a parameter or the landed state changes."""
        self._roi: GlobalPosition | None = None
        self._waypoint_offsets: Angles | None = None
        """Offsets relative to the direction of the next waypoint; None: the gimbal does not point at a
        waypoint."""
        if view.choice("MNT_MODE_IN") >= 0:
            self.start()

    def start(self) -> None:
        """Starts the module with the present MNT_MODE_IN and MNT_MODE_OUT."""
        self._input, self._output = self._view.choice("MNT_MODE_IN"), self._view.choice("MNT_MODE_OUT")
        self.at_rest = False

    def stop(self) -> None:
        """Stops the module; nobody has control afterwards."""
        self._input = None
        self.primary = (0, 0)
        self.centre()

    @property
    def running(self) -> bool:
        """Whether the gimbal module runs."""
        return self._input is not None

    @property
    def enabled(self) -> bool:
        """Whether the gimbal module takes commands by MAVLink."""
        return self._input in MAVLINK_INPUTS

    @property
    def has_device(self) -> bool:
        """Whether the manager commands a separate gimbal device instead of servos."""
        return self._output == OUTPUT_DEVICE

    @property
    def device_id(self) -> int:
        """Device id that the manager reports: component id of a separate device, or 1 for servos."""
        return self._view.choice("MNT_MAV_COMPID") if self.has_device else 1

    @property
    def yaw_locked(self) -> bool:
        """Whether yaw is relative to north, not to the vehicle."""
        return bool(self.flags & Flag.YAW_LOCK)

    # --- control ---------------------------------------------------------------------------------------

    def configure(
        self, system: int, component: int, sender: tuple[int, int], autopilot: tuple[int, int]
    ) -> None:
        """Handles the primary control of DO_GIMBAL_MANAGER_CONFIGURE.

        System -1 changes nothing, -2 gives control to the autopilot (as in PX4, not to the sender), and -3
        releases control if the sender has control. Otherwise the given component gets control.
        """
        if system == -1:
            return
        if system == -2:
            self.primary = autopilot
        elif system == -3:
            if self.primary == sender:
                self.primary = (0, 0)
        elif system >= 0:
            self.primary = (system & 0xFF, max(0, component) & 0xFF)

    def controls(self, sender: tuple[int, int]) -> bool:
        """Whether this sender is in primary control."""
        return self.primary == sender

    def set_pitch_yaw(
        self,
        flags: int,
        pitch_rad: float,
        yaw_rad: float,
        pitch_rate_rad_s: float = math.nan,
        yaw_rate_rad_s: float = math.nan,
    ) -> None:
        """Sets the angles if both are finite, otherwise the rates.

        Without both angles and without a rate the previous setpoint remains.
        """
        self._apply_flags(flags)
        if flags & (Flag.RETRACT | Flag.NEUTRAL):
            return
        if math.isfinite(pitch_rad) and math.isfinite(yaw_rad):
            self._set_angles(quaternion_of(0.0, pitch_rad, yaw_rad))
        elif math.isfinite(pitch_rate_rad_s) or math.isfinite(yaw_rate_rad_s):
            self._set_rates(pitch_rate_rad_s, yaw_rate_rad_s)

    def set_attitude(self, flags: int, q: Quaternion, rates_rad_s: tuple[float, float, float]) -> None:
        """Handles GIMBAL_MANAGER_SET_ATTITUDE."""
        self._apply_flags(flags)
        if all(math.isfinite(each) for each in q) and any(q):
            self._set_angles(q)
        elif any(math.isfinite(each) for each in rates_rad_s[1:]):
            self._set_rates(rates_rad_s[1], rates_rad_s[2])

    def set_manual(self, flags: int, pitch: float, yaw: float, pitch_rate: float, yaw_rate: float) -> None:
        """Handles GIMBAL_MANAGER_SET_MANUAL_CONTROL: angles up to 1 rad, rates as fractions of MNT_RATE_*."""
        parameter = self._view.parameter
        self.set_pitch_yaw(
            flags,
            pitch,
            yaw,
            pitch_rate * math.radians(parameter("MNT_RATE_PITCH")),
            yaw_rate * math.radians(parameter("MNT_RATE_YAW")),
        )

    def set_mount_angles(self, pitch_deg: float, roll_deg: float, yaw_deg: float) -> None:
        """Handles DO_MOUNT_CONTROL with angles."""
        self.flags = Flag.ROLL_LOCK | Flag.PITCH_LOCK
        self._clear_targets()
        if all(math.isfinite(each) for each in (roll_deg, pitch_deg, yaw_deg)):
            self._set_angles(
                quaternion_of(math.radians(roll_deg), math.radians(pitch_deg), math.radians(yaw_deg))
            )

    def centre(self) -> None:
        """Sets all angles to zero: level, and straight ahead, or to the north with a yaw lock."""
        self._clear_targets()
        self.setpoint = Angles()

    def point_at(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Points at a global position, and keeps pointing at it while the vehicle moves."""
        if not (math.isfinite(lat_deg) and math.isfinite(lon_deg) and math.isfinite(alt_amsl_m)):
            return
        self._clear_targets()
        self._roi = (lat_deg, lon_deg, alt_amsl_m)
        self.flags |= Flag.YAW_LOCK

    def clear_roi(self) -> None:
        """Clears the region of interest, and sets all angles to zero; the yaw lock remains."""
        self.centre()

    def point_at_next_waypoint(self, roll_deg: float, pitch_deg: float, yaw_deg: float) -> None:
        """Points at the next waypoint with offsets and a yaw lock; without a waypoint all angles are zero."""
        self.centre()
        offsets = (
            math.radians(each) if math.isfinite(each) else 0.0 for each in (roll_deg, pitch_deg, yaw_deg)
        )
        self._waypoint_offsets = Angles(*offsets)
        self.flags |= Flag.YAW_LOCK

    def lock_roll_and_pitch(self, *, centred: bool) -> None:
        """Handles DO_MOUNT_CONTROL without angles: locks roll and pitch to the horizon.

        With `centred` the gimbal also points straight ahead.
        """
        self.flags = Flag.ROLL_LOCK | Flag.PITCH_LOCK
        if centred:
            self.centre()

    @property
    def roi(self) -> GlobalPosition | None:
        """The region of interest."""
        return self._roi

    # --- motion ----------------------------------------------------------------------------------------

    def update(self, dt_s: float) -> None:
        """Advances the gimbal by `dt_s`."""
        is_fixed = self._rate_setpoints is None and self._roi is None and self._waypoint_offsets is None
        self.at_rest = is_fixed and self._current_servo_inputs() == self._servo_inputs
        if self.at_rest:
            return
        if self._rate_setpoints is not None:
            pitch_limit = math.radians(90.0)
            pitch = self.setpoint.pitch_rad + self._rate_setpoints[0] * dt_s
            self.setpoint.pitch_rad = max(-pitch_limit, min(pitch_limit, pitch))
            self.setpoint.yaw_rad = wrap_angle(self.setpoint.yaw_rad + self._rate_setpoints[1] * dt_s)
        elif self._roi is not None:
            self._aim_at(self._roi)
        elif self._waypoint_offsets is not None:
            self._aim_at_waypoint(self._waypoint_offsets)
        if self.has_device:
            self._turn_device(dt_s)
        else:
            self._set_servos()

    def _turn_device(self, dt_s: float) -> None:
        goal_yaw_frd = self.setpoint.yaw_rad
        if self.yaw_locked:
            goal_yaw_frd = wrap_angle(goal_yaw_frd - self._view.estimate.yaw_ned_rad)
        actual, rates = self.actual, self.rates
        rates.roll_rad_s = _device_rate(wrap_angle(self.setpoint.roll_rad - actual.roll_rad))
        rates.pitch_rad_s = _device_rate(self.setpoint.pitch_rad - actual.pitch_rad)
        rates.yaw_rad_s = _device_rate(wrap_angle(goal_yaw_frd - actual.yaw_rad))
        actual.roll_rad = wrap_angle(actual.roll_rad + rates.roll_rad_s * dt_s)
        actual.pitch_rad += rates.pitch_rad_s * dt_s
        actual.yaw_rad = wrap_angle(actual.yaw_rad + rates.yaw_rad_s * dt_s)

    def _current_servo_inputs(self) -> tuple[float, ...]:
        """All inputs of the servo angles, except the vehicle's attitude."""
        setpoint, view = self.setpoint, self._view
        landed = view.simulation.setpoints.landed.item(view.row)
        return setpoint.roll_rad, setpoint.pitch_rad, setpoint.yaw_rad, landed, view.parameter_changes

    def _set_servos(self) -> None:
        stabilisation, setpoint = self._view.choice("MNT_DO_STAB"), self.setpoint
        inputs = self._current_servo_inputs()
        landed = bool(inputs[3])
        depends_on_attitude = stabilisation in (STABILISE_ALL, STABILISE_YAW)
        self._servo_inputs = None if depends_on_attitude or self._rate_setpoints is not None else inputs
        estimate = self._view.estimate
        vehicle_angles = (estimate.roll_rad, estimate.pitch_rad, estimate.yaw_ned_rad)
        relative_to_earth = [
            self._roi is not None or self._waypoint_offsets is not None or bool(self.flags & flag)
            for flag in AXIS_LOCKS
        ]
        stabilised = (
            stabilisation == STABILISE_ALL,
            stabilisation == STABILISE_ALL,
            stabilisation in (STABILISE_ALL, STABILISE_YAW),
        )
        angles = [
            wrap_angle(angle - vehicle_angles[k] if stabilised[k] and relative_to_earth[k] else angle)
            for k, angle in enumerate((setpoint.roll_rad, setpoint.pitch_rad, setpoint.yaw_rad))
        ]
        roll, pitch, yaw = (
            max(-limit, min(limit, angle))
            for angle, limit in zip(angles, self._half_ranges_rad(), strict=True)
        )
        if landed:
            lowest, highest = (
                math.radians(self._view.parameter(name)) for name in ("MNT_LND_P_MIN", "MNT_LND_P_MAX")
            )
            pitch = max(lowest, min(highest, pitch))
        if self._rate_setpoints is not None:
            setpoint.pitch_rad += pitch - angles[1]
            setpoint.yaw_rad += yaw - angles[2]
        self.actual, self.rates = Angles(roll, pitch, yaw), AngleRates()

    def _half_ranges_rad(self) -> tuple[float, float, float]:
        roll, pitch, yaw = (math.radians(self._view.parameter(f"MNT_RANGE_{axis}")) / 2.0 for axis in AXES)
        return (roll, pitch, yaw)

    def servo_controls(self) -> tuple[float, float, float] | None:
        """Roll, pitch and yaw of the servo functions 420 to 422, -1..1; None: the gimbal drives no servos."""
        if not self.running or self.has_device:
            return None
        angles = (self.actual.roll_rad, self.actual.pitch_rad, self.actual.yaw_rad)
        offsets = (math.radians(self._view.parameter(f"MNT_OFF_{axis}")) for axis in AXES)
        roll, pitch, yaw = (
            max(-1.0, min(1.0, (angle + offset) / half_range)) if half_range > 0.0 else 0.0
            for angle, offset, half_range in zip(angles, offsets, self._half_ranges_rad(), strict=True)
        )
        return (roll, pitch, yaw)

    @property
    def yaw_ned_rad(self) -> float:
        """Yaw of the gimbal relative to north."""
        return wrap_angle(self.actual.yaw_rad + self._view.estimate.yaw_ned_rad)

    def device_quaternion(self) -> Quaternion:
        """Attitude for GIMBAL_DEVICE_ATTITUDE_STATUS; a locked yaw is relative to north."""
        yaw = self.yaw_ned_rad if self.yaw_locked and self.has_device else self.actual.yaw_rad
        return quaternion_of(self.actual.roll_rad, self.actual.pitch_rad, yaw)

    def _apply_flags(self, flags: int) -> None:
        self._clear_targets()
        if flags & (Flag.RETRACT | Flag.NEUTRAL):
            # As in PX4, the locks remain, except the yaw lock of a separate device.
            self.setpoint = Angles()
            if self.has_device:
                self.flags &= ~Flag.YAW_LOCK
            return
        was_locked, is_locked = self.yaw_locked, bool(flags & Flag.YAW_LOCK)
        heading = self._view.estimate.yaw_ned_rad
        if self.has_device and is_locked != was_locked:
            self.setpoint.yaw_rad = wrap_angle(self.setpoint.yaw_rad + (heading if is_locked else -heading))
        self.flags = Flag(flags & 0x1F)

    def _clear_targets(self) -> None:
        """Clears rates, region of interest and waypoint offsets; called by each command that moves the
        gimbal."""
        self.at_rest = False
        self._rate_setpoints = None
        self._roi = self._waypoint_offsets = None

    def _set_angles(self, q: Quaternion) -> None:
        norm = math.sqrt(sum(each * each for each in q))
        if math.isfinite(norm) and norm > 1e-6:
            w, x, y, z = q
            self.setpoint = Angles(*angles_of((w / norm, x / norm, y / norm, z / norm)))

    def _set_rates(self, pitch_rate_rad_s: float, yaw_rate_rad_s: float) -> None:
        self._rate_setpoints = (_limited_rate(pitch_rate_rad_s), _limited_rate(yaw_rate_rad_s))

    def _aim_at_waypoint(self, offsets: Angles) -> None:
        position = self._get_waypoint()
        if position is None:
            return
        self._aim_at(position)
        self.setpoint.roll_rad += offsets.roll_rad
        self.setpoint.pitch_rad += offsets.pitch_rad
        self.setpoint.yaw_rad = wrap_angle(self.setpoint.yaw_rad + offsets.yaw_rad)

    def _aim_at(self, position: GlobalPosition) -> None:
        estimate = self._view.estimate
        if not math.isfinite(estimate.lat_deg):
            return
        n, e = to_local(position[0], position[1], estimate.lat_deg, estimate.lon_deg)  # type: ignore[arg-type]
        north, east = float(n), float(e)
        up = position[2] - estimate.alt_amsl_m
        self.setpoint = Angles(0.0, math.atan2(up, math.hypot(north, east)), math.atan2(east, north))


def _limited_rate(rate_rad_s: float) -> float:
    if not math.isfinite(rate_rad_s):
        return 0.0
    return max(-RATE_LIMIT_RAD_S, min(RATE_LIMIT_RAD_S, rate_rad_s))


def _device_rate(error_rad: float) -> float:
    return max(-RATE_LIMIT_RAD_S, min(RATE_LIMIT_RAD_S, error_rad / TIME_CONSTANT_S))
