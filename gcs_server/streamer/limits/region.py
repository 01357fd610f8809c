"""Limits positions to the allowed region, and velocities so that the vehicle stops before the region's edge.
Setpoints without position or velocity cannot be limited in this way. For these, `check_stoppable` decides
when the stream must stop the vehicle instead of sending the setpoint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs_server.streamer.values.limit_values import Bounds
from missions.avoidance.values import braking_speed
from missions.fence import NorthEast
from missions.frames import Quaternion, Vector3

# These values are more cautious than the braking that was measured with PX4.
BRAKE_M_S2, BRAKE_DELAY_S = 1.2, 0.8
"""PX4's deceleration [m/s²] and delay [s] when a velocity setpoint decreases. The deceleration is less than
PX4's maximum of 5 m/s²: PX4's integrator compensates drag, and still moves the vehicle at about 0.5 m/s for
seconds after the setpoint has become zero.
"""
BRAKE_VERTICAL_M_S2, BRAKE_VERTICAL_DELAY_S = 1.0, 0.6
TAKEOVER_M_S2, TAKEOVER_DELAY_S = 2.0, 0.8
"""Deceleration [m/s²] and delay [s] after the stream has replaced attitude or rate setpoints by position
setpoints; the delay includes PX4's change of controllers."""
BACK_PER_S, MAX_BACK_M_S = 1.0, 1.0
"""Speed at which the vehicle is moved back from an edge nearer than the margin: speed per metre [1/s], and
maximum speed [m/s]."""
MARGIN_M = 1.0
"""Distance from the edge or obstacle at which the vehicle is stopped [m]."""
MARGIN_VERTICAL_M = 0.5


@dataclass(frozen=True, slots=True)
class VehicleMotion:
    """Current position, velocity and attitude of the vehicle."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    yaw_ned_rad: float | None = None
    q_ned_frd: Quaternion | None = None


class RegionLimiter:
    """Applies the allowed region to the setpoint of one moment.

    Args:
        bounds: the limits, in the vehicle's local frame.
        motion: motion of the vehicle; None if its position is unknown.
        notes: receives a text for each reduction.
    """

    def __init__(self, bounds: Bounds, motion: VehicleMotion | None, notes: list[str]) -> None:
        self._bounds = bounds
        self._motion = motion
        self._notes = notes
        self.stop_reason: str | None = None
        """Why the stream must stop the vehicle instead of sending the setpoint; None: it may be sent."""

    def limit_position_ne(self, target: NorthEast) -> NorthEast:
        """Moves the target to the last allowed position on the way to the requested one."""
        region = self._bounds.region
        if not region.is_limited_horizontally:
            return target
        if self._motion is None:
            inside = region.position_inside(target)
        else:
            position_ned = self._motion.position_ned_m
            inside = region.last_position_inside((position_ned[0], position_ned[1]), target)
        if inside is None:
            self.stop_reason = "No way back inside the geofence was found"
            return target
        if inside != target:
            breach = region.breach(target) or "the geofence on the way"
            self._notes.append(f"position limited to stay inside {breach}")
        return inside

    def limit_down(self, down_m: float) -> float:
        """Limits the target altitude."""
        inside = self._bounds.region.clamp_down_m(down_m)
        if inside != down_m:
            self._notes.append("altitude limited to the allowed range")
        return inside

    def limit_velocity_ne(self, velocity: NorthEast) -> NorthEast:
        """Reduces the velocity so that the vehicle can stop inside the region."""
        n, e = velocity
        region, speed = self._bounds.region, math.hypot(n, e)
        if not region.is_limited_horizontally or speed == 0.0:
            return (n, e)
        if self._motion is None:
            self._notes.append("velocity set to zero: no valid position estimate, and a geofence is set")
            return (0.0, 0.0)
        position_ne = (self._motion.position_ned_m[0], self._motion.position_ned_m[1])
        breach = region.breach(position_ne)
        if breach is not None:
            inside = region.position_inside(position_ne)
            if inside is not None and n * (inside[0] - position_ne[0]) + e * (inside[1] - position_ne[1]) > 0:
                return (n, e)
            self._notes.append(f"outside {breach}: only velocities that lead back inside are sent")
            return (0.0, 0.0)
        to_edge_m = region.distance_to_edge_m(position_ne, (n / speed, e / speed)) - MARGIN_M
        max_m_s = braking_speed(to_edge_m, BRAKE_M_S2, BRAKE_DELAY_S)
        if self._cannot_stop_inside(position_ne):
            max_m_s = 0.0
        if speed <= max_m_s:
            return (n, e)
        self._notes.append("speed reduced to stop before the geofence")
        return (n * max_m_s / speed, e * max_m_s / speed)

    def keep_margin(self, velocity: NorthEast) -> NorthEast:
        """Changes the velocity to move the vehicle back from an edge that is nearer than the margin."""
        region = self._bounds.region
        if self._motion is None or not region.is_limited_horizontally:
            return velocity
        n, e = velocity
        for to_edge_m, outward in region.edges(
            (self._motion.position_ned_m[0], self._motion.position_ned_m[1])
        ):
            if to_edge_m >= MARGIN_M:
                continue
            max_m_s = -min(BACK_PER_S * (MARGIN_M - to_edge_m), MAX_BACK_M_S, self._bounds.speed_m_s)
            excess = n * outward[0] + e * outward[1] - max_m_s
            if excess > 0.0:
                n, e = n - excess * outward[0], e - excess * outward[1]
        if (n, e) != velocity:
            self._notes.append("moved back from the geofence")
            speed = math.hypot(n, e)
            scale = min(1.0, self._bounds.speed_m_s / speed) if speed > 0 else 1.0
            n, e = n * scale, e * scale
        return (n, e)

    def limit_velocity_down(self, velocity_down_m_s: float, *, keep_margin: bool) -> float:
        """Reduces the vertical velocity so that the vehicle can stop inside the altitude limits; with
        `keep_margin`, moves the vehicle back from an altitude limit nearer than the margin."""
        region = self._bounds.region
        if not region.is_limited_vertically:
            return velocity_down_m_s
        if self._motion is None:
            self._notes.append(
                "vertical velocity set to zero: no valid altitude estimate, and the altitude is limited"
            )
            return 0.0
        down_m = self._motion.position_ned_m[2]
        to_lowest_m = region.down_max_m - down_m - MARGIN_VERTICAL_M
        to_highest_m = down_m - region.down_min_m - MARGIN_VERTICAL_M
        max_down_m_s = _max_vertical_speed(to_lowest_m, self._bounds.climb_m_s if keep_margin else 0.0)
        max_up_m_s = _max_vertical_speed(to_highest_m, self._bounds.descent_m_s if keep_margin else 0.0)
        limited = max(min(velocity_down_m_s, max_down_m_s), -max_up_m_s)
        if limited != velocity_down_m_s:
            self._notes.append("climb or descent reduced to stay inside the altitude limits")
        return limited

    def check_stoppable(self, *, horizontal: bool = True, vertical: bool = True) -> None:
        """Sets `stop_reason` if the vehicle is outside the region, or must be stopped now to stay inside."""
        region = self._bounds.region
        if not (horizontal and region.is_limited_horizontally) and not (
            vertical and region.is_limited_vertically
        ):
            return
        if self._motion is None:
            self.stop_reason = "No valid position estimate, and a geofence or altitude limit is set"
            return
        n, e, d = self._motion.position_ned_m
        if horizontal and region.is_limited_horizontally:
            breach = region.breach((n, e))
            if breach is not None or self._cannot_stop_inside((n, e)):
                self.stop_reason = f"The vehicle would leave {breach or 'the geofence'}"
        velocity_down_m_s = self._motion.velocity_ned_m_s[2]
        remaining_m = (region.down_max_m - d) if velocity_down_m_s > 0 else (d - region.down_min_m)
        if vertical and (
            remaining_m < 0
            or (
                abs(velocity_down_m_s) > 0.3
                and abs(velocity_down_m_s) > braking_speed(remaining_m, TAKEOVER_M_S2, TAKEOVER_DELAY_S)
            )
        ):
            self.stop_reason = "The vehicle would leave the altitude limits"

    def _cannot_stop_inside(self, position_ne: NorthEast) -> bool:
        """Whether the vehicle is too fast to stop inside the region with the deceleration `TAKEOVER_M_S2`."""
        assert self._motion is not None
        n, e, _ = self._motion.velocity_ned_m_s
        speed = math.hypot(n, e)
        if speed < 0.5:
            return False
        to_edge_m = self._bounds.region.distance_to_edge_m(position_ne, (n / speed, e / speed))
        return speed > braking_speed(to_edge_m, TAKEOVER_M_S2, TAKEOVER_DELAY_S)


def _max_vertical_speed(remaining_m: float, max_back_m_s: float) -> float:
    """Maximum speed towards an altitude limit at which the vehicle can still stop before the limit.

    Negative if the limit is nearer than the margin: the vehicle must move away from it at least this fast.
    """
    if remaining_m >= 0.0:
        return braking_speed(remaining_m, BRAKE_VERTICAL_M_S2, BRAKE_VERTICAL_DELAY_S)
    return max(BACK_PER_S * remaining_m, -MAX_BACK_M_S, -max_back_m_s)
