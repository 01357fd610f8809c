"""Follow Target: follows the sender of FOLLOW_TARGET at the distance, angle and altitude of FLW_TGT_*.

The target's position passes a second-order filter (time constant FLW_TGT_RS). The vehicle keeps its angle to
the target's course, and moves around the target no faster than FLW_TGT_MAX_VEL. Without a target the vehicle
keeps its position. Altitude has priority: with a large altitude error the vehicle moves only vertically.
Below a height of 1 m above ground the vehicle climbs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from vehicle_sim.autopilot.path import TICK_S, Path
from vehicle_sim.autopilot.setpoint_writer import SetpointWriter
from vehicle_sim.frames import wrap_angle
from vehicle_sim.geodesy import is_position, to_local
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import VehicleView

LOST_AFTER_S = 3.0
"""The target is lost after this time without a message."""
MIN_COURSE_SPEED_M_S = 1.0
"""A target below this speed keeps its last course."""
MIN_HEIGHT_M = 1.0
"""Below this height above ground the vehicle stops and climbs."""
CLIMB_FROM_GROUND_M_S = 0.5
"""Climb speed below the minimum height."""
MAX_ALTITUDE_ERROR_M = 3.0
"""With a larger altitude error, the vehicle does not move horizontally."""
ABOVE_HOME, ABOVE_TERRAIN, ABOVE_TARGET = range(3)
"""Values of FLW_TGT_ALT_M."""
NAN3 = (math.nan, math.nan, math.nan)
MIN_FACE_DISTANCE_M = 1.0
"""The nose points to the target at horizontal distances greater than this."""


@dataclass(frozen=True, slots=True)
class TargetMessage:
    """The newest FOLLOW_TARGET."""

    received_at_s: float
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    velocity_ned_m_s: tuple[float, float, float]


class _FilteredAxis:
    """One axis of the target's filtered position and speed."""

    def __init__(self, position_m: float, velocity_m_s: float) -> None:
        self.position_m = position_m
        self.velocity_m_s = velocity_m_s

    def update(self, position_m: float, velocity_m_s: float, time_constant_s: float) -> None:
        frequency_rad_s = 1.0 / max(time_constant_s, 2.0 * TICK_S)
        stiffness = frequency_rad_s * frequency_rad_s * (position_m - self.position_m)
        damping = 2.0 * frequency_rad_s * (velocity_m_s - self.velocity_m_s)
        self.velocity_m_s += (stiffness + damping) * TICK_S
        self.position_m += self.velocity_m_s * TICK_S


class Follow:
    """The flight task of mode Follow Target."""

    def __init__(self, view: VehicleView, path: Path, setpoints: SetpointWriter, home: Home) -> None:
        self._view, self._path, self._setpoints, self._home = view, path, setpoints, home
        self._message: TargetMessage | None = None
        self._target: tuple[_FilteredAxis, _FilteredAxis, _FilteredAxis] | None = None
        self._course_rad = math.nan
        self._angle_rad = 0.0
        """Current direction from the target to the setpoint of the vehicle; its rate is limited."""

    def receive(
        self, lat_deg: float, lon_deg: float, alt_amsl_m: float, velocity_ned_m_s: tuple[float, float, float]
    ) -> None:
        """Stores a message; a message without a position is ignored."""
        if is_position(lat_deg, lon_deg) and math.isfinite(alt_amsl_m):
            vn, ve, vd = (each if math.isfinite(each) else 0.0 for each in velocity_ned_m_s)
            self._message = TargetMessage(self._view.time_s, lat_deg, lon_deg, alt_amsl_m, (vn, ve, vd))

    def enter(self) -> None:
        """Clears the target; the task starts from the newest message."""
        self._target, self._course_rad = None, math.nan

    @property
    def has_target(self) -> bool:
        """Whether a message was received in the last LOST_AFTER_S."""
        return self._message is not None and self._view.time_s - self._message.received_at_s < LOST_AFTER_S

    def run(self) -> None:
        """Runs one tick: follows the target, or keeps the position while there is no target."""
        if self._message is None or not self.has_target:
            if self._target is not None:
                self._target = None
                self._path.restart(in_air=True, continue_setpoint=True)
            self._path.fly_to_target()
            return
        north, east, down = self._target_position(self._message)
        self._update_course(north, east)
        parameter = self._view.parameter
        distance_m = parameter("FLW_TGT_DST")
        direction_ne = (math.cos(self._angle_rad), math.sin(self._angle_rad))
        angle_rate_rad_s = self._step_angle(distance_m) / TICK_S
        setpoint_ne_m = (
            north.position_m + distance_m * direction_ne[0],
            east.position_m + distance_m * direction_ne[1],
        )
        velocity_ne_m_s = (
            north.velocity_m_s - angle_rate_rad_s * distance_m * direction_ne[1],
            east.velocity_m_s + angle_rate_rad_s * distance_m * direction_ne[0],
        )
        self._face(north.position_m, east.position_m)
        yaw = self._path.yaw
        current_n, current_e, current_d = self._view.estimate.position_ned_m
        setpoint_down_m = self._setpoint_down_m(down.position_m)
        if self._height_m < MIN_HEIGHT_M:
            position, velocity = (math.nan, math.nan, current_d), (0.0, 0.0, -CLIMB_FROM_GROUND_M_S)
        elif abs(setpoint_down_m - current_d) >= MAX_ALTITUDE_ERROR_M:
            position, velocity = (current_n, current_e, setpoint_down_m), (0.0, 0.0, math.nan)
        else:
            position, velocity = (*setpoint_ne_m, setpoint_down_m), (*velocity_ne_m_s, math.nan)
        self._setpoints.trajectory(position, velocity, NAN3, yaw.yaw_ned_rad, yaw.rate_rad_s)

    @property
    def _height_m(self) -> float:
        """Height from the range finder; without a range measurement, the altitude above home."""
        estimate = self._view.estimate
        if math.isfinite(estimate.height_above_ground_m):
            return estimate.height_above_ground_m
        return self._home.position_ned_m[2] - estimate.position_ned_m[2]

    def _setpoint_down_m(self, target_down_m: float) -> float:
        """Setpoint of the position down: FLW_TGT_HT above the reference that FLW_TGT_ALT_M selects."""
        height_m, choice = self._view.parameter("FLW_TGT_HT"), self._view.choice("FLW_TGT_ALT_M")
        if choice == ABOVE_TARGET:
            return target_down_m - height_m
        if choice == ABOVE_TERRAIN:
            return self._view.estimate.position_ned_m[2] + self._height_m - height_m
        return self._home.position_ned_m[2] - height_m

    def _target_position(self, message: TargetMessage) -> tuple[_FilteredAxis, _FilteredAxis, _FilteredAxis]:
        """Current target position, extrapolated from its last message."""
        lat, lon, alt = self._view.origin
        n, e = to_local(message.lat_deg, message.lon_deg, lat, lon)  # type: ignore[arg-type]
        age_s = self._view.time_s - message.received_at_s
        position_ned_m = [
            position + age_s * speed
            for position, speed in zip(
                (float(n), float(e), alt - message.alt_amsl_m), message.velocity_ned_m_s, strict=True
            )
        ]
        if self._target is None:
            (vn, ve, vd), (tn, te, td) = message.velocity_ned_m_s, position_ned_m
            self._target = (_FilteredAxis(tn, vn), _FilteredAxis(te, ve), _FilteredAxis(td, vd))
            x, y, _ = self._view.estimate.position_ned_m
            self._angle_rad = math.atan2(y - te, x - tn)
            self._path.yaw.reset(self._view.estimate.yaw_ned_rad)
        time_constant_s = self._view.parameter("FLW_TGT_RS")
        for axis, position, speed in zip(self._target, position_ned_m, message.velocity_ned_m_s, strict=True):
            axis.update(position, speed, time_constant_s)
        return self._target

    def _update_course(self, north: _FilteredAxis, east: _FilteredAxis) -> None:
        speed = math.hypot(north.velocity_m_s, east.velocity_m_s)
        if speed > MIN_COURSE_SPEED_M_S:
            self._course_rad = math.atan2(east.velocity_m_s, north.velocity_m_s)

    def _step_angle(self, distance_m: float) -> float:
        """Turns the angle towards the desired angle, if the target has a course. Returns the change [rad]."""
        if math.isnan(self._course_rad):
            return 0.0
        desired_rad = self._course_rad + math.radians(self._view.parameter("FLW_TGT_FA"))
        max_step_rad = self._view.parameter("FLW_TGT_MAX_VEL") / max(distance_m, 1.0) * TICK_S
        step_rad = max(-max_step_rad, min(max_step_rad, wrap_angle(desired_rad - self._angle_rad)))
        self._angle_rad = wrap_angle(self._angle_rad + step_rad)
        return step_rad

    def _face(self, north_m: float, east_m: float) -> None:
        x, y, _ = self._view.estimate.position_ned_m
        if math.hypot(north_m - x, east_m - y) > MIN_FACE_DISTANCE_M:
            self._path.yaw_target_rad = math.atan2(east_m - y, north_m - x)
        self._path.turn()
