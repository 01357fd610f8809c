"""Follow Target: follows the sender of FOLLOW_TARGET at the distance, angle and altitude of FLW_TGT_*.

The target's position passes a second-order filter (time constant FLW_TGT_RS). The vehicle keeps its angle to
the target's course, and moves around the target no faster than FLW_TGT_MAX_VEL. Without a target the vehicle
keeps its position. Altitude has priority: with a large altitude error the vehicle moves only vertically.
Below 1 m above the ground the vehicle climbs, whatever its target altitude.
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
"""Below this speed of the target its last course is kept."""
MIN_HEIGHT_M = 1.0
"""Below this height above ground the vehicle stops and climbs."""
CLIMB_FROM_GROUND_M_S = 0.5
"""Climb speed below the minimum height."""
MAX_ALTITUDE_ERROR_M = 3.0
"""With a larger altitude error, the vehicle does not move horizontally."""
ABOVE_HOME, ABOVE_TERRAIN, ABOVE_TARGET = range(3)
"""Values of FLW_TGT_ALT_M."""
NAN3 = (math.nan, math.nan, math.nan)
YAW_FROM_M = 1.0


@dataclass(frozen=True, slots=True)
class TargetMessage:
    """The newest FOLLOW_TARGET."""

    received_at_s: float
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    velocity_ned_m_s: tuple[float, float, float]


class _Filtered:
    """One axis of the target's filtered position and speed."""

    def __init__(self, position_m: float, velocity_m_s: float) -> None:
        self.position_m = position_m
        self.velocity_m_s = velocity_m_s

    def update(self, position_m: float, velocity_m_s: float, time_constant_s: float) -> None:
        frequency = 1.0 / max(time_constant_s, 2.0 * TICK_S)
        stiffness = frequency * frequency * (position_m - self.position_m)
        damping = 2.0 * frequency * (velocity_m_s - self.velocity_m_s)
        self.velocity_m_s += (stiffness + damping) * TICK_S
        self.position_m += self.velocity_m_s * TICK_S


class Follow:
    """The flight task of mode Follow Target."""

    def __init__(self, view: VehicleView, path: Path, setpoints: SetpointWriter, home: Home) -> None:
        self._view, self._path, self._setpoints, self._home = view, path, setpoints, home
        self._message: TargetMessage | None = None
        self._target: tuple[_Filtered, _Filtered, _Filtered] | None = None
        self._course_rad = math.nan
        self._angle_rad = 0.0
        """Current angle from the target to the vehicle; it changes to the desired angle at a limited
        speed."""

    def receive(
        self, lat_deg: float, lon_deg: float, alt_amsl_m: float, velocity_ned_m_s: tuple[float, float, float]
    ) -> None:
        """Stores a message; a message without a position is ignored."""
        if is_position(lat_deg, lon_deg) and math.isfinite(alt_amsl_m):
            vn, ve, vd = (each if math.isfinite(each) else 0.0 for each in velocity_ned_m_s)
            self._message = TargetMessage(self._view.time_s, lat_deg, lon_deg, alt_amsl_m, (vn, ve, vd))

    def enter(self) -> None:
        """Clears the target; the task starts with the next message."""
        self._target, self._course_rad = None, math.nan

    @property
    def has_target(self) -> bool:
        """Whether a message was received within LOST_AFTER_S."""
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
        to_vehicle = (math.cos(self._angle_rad), math.sin(self._angle_rad))
        angle_rate_rad_s = self._step_angle(distance_m) / TICK_S
        goal_ne_m = (
            north.position_m + distance_m * to_vehicle[0],
            east.position_m + distance_m * to_vehicle[1],
        )
        velocity_ne_m_s = (
            north.velocity_m_s - angle_rate_rad_s * distance_m * to_vehicle[1],
            east.velocity_m_s + angle_rate_rad_s * distance_m * to_vehicle[0],
        )
        self._face(north.position_m, east.position_m)
        yaw = self._path.yaw
        current_n, current_e, current_d = self._view.estimate.position_ned_m
        goal_down_m = self._goal_down_m(down.position_m)
        if self._above_ground_m < MIN_HEIGHT_M:
            position, velocity = (math.nan, math.nan, current_d), (0.0, 0.0, -CLIMB_FROM_GROUND_M_S)
        elif abs(goal_down_m - current_d) >= MAX_ALTITUDE_ERROR_M:
            position, velocity = (current_n, current_e, goal_down_m), (0.0, 0.0, math.nan)
        else:
            position, velocity = (*goal_ne_m, goal_down_m), (*velocity_ne_m_s, math.nan)
        self._setpoints.trajectory(position, velocity, NAN3, yaw.yaw_ned_rad, yaw.rate_rad_s)

    @property
    def _above_ground_m(self) -> float:
        """Height from the range finder; without a range measurement, the altitude above home."""
        estimate = self._view.estimate
        if math.isfinite(estimate.height_above_ground_m):
            return estimate.height_above_ground_m
        return self._home.position_ned_m[2] - estimate.position_ned_m[2]

    def _goal_down_m(self, target_down_m: float) -> float:
        """Target position down: FLW_TGT_HT above the reference that FLW_TGT_ALT_M selects."""
        height_m, choice = self._view.parameter("FLW_TGT_HT"), self._view.choice("FLW_TGT_ALT_M")
        if choice == ABOVE_TARGET:
            return target_down_m - height_m
        if choice == ABOVE_TERRAIN:
            return self._view.estimate.position_ned_m[2] + self._above_ground_m - height_m
        return self._home.position_ned_m[2] - height_m

    def _target_position(self, message: TargetMessage) -> tuple[_Filtered, _Filtered, _Filtered]:
        """Current target position, extrapolated from its last message."""
        lat, lon, alt = self._view.origin
        n, e = to_local(message.lat_deg, message.lon_deg, lat, lon)  # type: ignore[arg-type]
        age_s = self._view.time_s - message.received_at_s
        now = [
            position + age_s * speed
            for position, speed in zip(
                (float(n), float(e), alt - message.alt_amsl_m), message.velocity_ned_m_s, strict=True
            )
        ]
        if self._target is None:
            vn, ve, vd = message.velocity_ned_m_s
            self._target = (_Filtered(now[0], vn), _Filtered(now[1], ve), _Filtered(now[2], vd))
            x, y, _ = self._view.estimate.position_ned_m
            self._angle_rad = math.atan2(y - now[1], x - now[0])
            self._path.yaw.reset(self._view.estimate.yaw_ned_rad)
        time_constant_s = self._view.parameter("FLW_TGT_RS")
        for axis, position, speed in zip(self._target, now, message.velocity_ned_m_s, strict=True):
            axis.update(position, speed, time_constant_s)
        return self._target

    def _update_course(self, north: _Filtered, east: _Filtered) -> None:
        speed = math.hypot(north.velocity_m_s, east.velocity_m_s)
        if speed > MIN_COURSE_SPEED_M_S:
            self._course_rad = math.atan2(east.velocity_m_s, north.velocity_m_s)

    def _step_angle(self, distance_m: float) -> float:
        """Turns the angle towards the desired angle; it is kept until the target has moved."""
        if math.isnan(self._course_rad):
            return 0.0
        desired_rad = self._course_rad + math.radians(self._view.parameter("FLW_TGT_FA"))
        max_step = self._view.parameter("FLW_TGT_MAX_VEL") / max(distance_m, 1.0) * TICK_S
        step = max(-max_step, min(max_step, wrap_angle(desired_rad - self._angle_rad)))
        self._angle_rad = wrap_angle(self._angle_rad + step)
        return step

    def _face(self, north_m: float, east_m: float) -> None:
        x, y, _ = self._view.estimate.position_ned_m
        if math.hypot(north_m - x, east_m - y) > YAW_FROM_M:
            self._path.yaw_target_rad = math.atan2(east_m - y, north_m - x)
        self._path.turn()
