"""Keeps a sent setpoint finite, within the vehicle's and the operator's limits, and inside the fence.

`apply_limits` does no I/O: it converts the requested setpoint to one that may be sent, with a note on each
reduction. A speed from which the vehicle could not stop before the edge is reduced.
Setpoints that control neither position nor velocity (acceleration, attitude, rates) cannot be reduced in this
way. For these, `stop_reason` says why the stream must take over.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, fields, replace
from typing import TypeVar

from gcs_server.streamer.limits.brake import ObstacleBrake, Surroundings
from gcs_server.streamer.limits.region import RegionLimiter, VehicleMotion
from gcs_server.streamer.values.limit_values import Bounds
from missions.fence import NorthEast
from missions.frames import Vector3, limit_rotation, limit_tilt, ned_from_heading
from missions.setpoints import (
    Acceleration,
    Actuators,
    Attitude,
    DirectSetpoint,
    Partial3,
    Position,
    PositionGlobal,
    Rates,
    ThrustTorque,
    Trajectory,
    Velocity,
    VelocityBody,
)

S = TypeVar(
    "S", bound=Position | PositionGlobal | Velocity | VelocityBody | Acceleration | Trajectory | Attitude
)
GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True)
class LimitResult:
    """The setpoint that may be sent."""

    setpoint: DirectSetpoint | None
    """None if no part of the request may be sent."""
    notes: tuple[str, ...] = ()
    """One text for each reduction."""
    stop_reason: str | None = None
    """Why the stream must take over instead of sending the setpoint; None: the setpoint may be sent."""
    braked: bool = False
    """Whether the obstacle brake reduced the setpoint."""
    track_point_ne_m: NorthEast | None = None
    """Point of the track on which the brake keeps the target position [m]; None: the brake limits no
    position."""


def apply_limits(
    requested: DirectSetpoint,
    bounds: Bounds,
    motion: VehicleMotion | None,
    last_sent: DirectSetpoint | None = None,
    dt_s: float = 0.0,
    surroundings: Surroundings | None = None,
) -> LimitResult:
    """Applies all limits to a setpoint.

    Args:
        requested: the requested setpoint, resolved for this time.
        bounds: the limits, in the vehicle's local frame.
        motion: motion of the vehicle; None if its position is unknown.
        last_sent: the last sent setpoint, for the slew rates; None: no slew limit.
        dt_s: time since the last sent setpoint.
        surroundings: measured surroundings; None: nothing is measured, or the brake is off.
    """
    if not is_finite(requested):
        return LimitResult(None, stop_reason="The setpoint contains a value that is not a finite number")
    limiter = _Limiter(bounds, motion, last_sent, dt_s, surroundings)
    setpoint = limiter.limit(requested)
    stop_reason = (
        limiter.stop_reason
        if limiter.stop_reason or is_finite(setpoint)
        else "The setpoint contains a value that is not a finite number"
    )
    notes = tuple(dict.fromkeys(limiter.notes))
    return LimitResult(setpoint, notes, stop_reason, limiter.brake.acted, limiter.brake.track_point_ne_m)


def is_finite(setpoint: DirectSetpoint) -> bool:
    """Whether all numbers of the setpoint are finite."""
    for name in _field_names(type(setpoint)):
        value = getattr(setpoint, name)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and not math.isfinite(number):
                return False
    return True


@functools.cache
def _field_names(kind: type[DirectSetpoint]) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))


class _Limiter:
    def __init__(
        self,
        bounds: Bounds,
        motion: VehicleMotion | None,
        last_sent: DirectSetpoint | None,
        dt_s: float,
        surroundings: Surroundings | None,
    ) -> None:
        self._bounds = bounds
        self._motion = motion
        self._last_sent = last_sent
        self._dt_s = dt_s
        self.notes: list[str] = []
        self._region = RegionLimiter(bounds, motion, self.notes)
        self.brake = ObstacleBrake(surroundings, self.notes)
        self._brake_stop_reason: str | None = None

    @property
    def stop_reason(self) -> str | None:
        return self._region.stop_reason or self._brake_stop_reason

    def limit(self, s: DirectSetpoint) -> DirectSetpoint:
        if isinstance(s, Rates):
            return self._limit_rates(s)
        if isinstance(s, ThrustTorque | Actuators):
            return self._pass_through(s)
        if isinstance(s, Attitude):
            return self._limit_attitude(s)
        if isinstance(s, PositionGlobal):
            return self._limit_global(s)
        if isinstance(s, VelocityBody):
            return self._limit_velocity_body(s)
        s = self._limit_yaw_rate(s)
        if isinstance(s, Position):
            position, _, _ = self._limit_motion(s.position_ned_m, _NONE, _NONE)
            return s if position == s.position_ned_m else replace(s, position_ned_m=position)
        if isinstance(s, Velocity):
            velocity = self._limit_slew(s.velocity_ned_m_s)
            _, velocity, _ = self._limit_motion(_NONE, velocity, _NONE)
            return s if velocity == s.velocity_ned_m_s else replace(s, velocity_ned_m_s=velocity)
        if isinstance(s, Acceleration):
            _, _, acceleration = self._limit_motion(_NONE, _NONE, s.acceleration_ned_m_s2)
            return replace(s, acceleration_ned_m_s2=acceleration)
        position, velocity, acceleration = self._limit_motion(
            s.position_ned_m, s.velocity_ned_m_s, s.acceleration_ned_m_s2
        )
        return replace(
            s, position_ned_m=position, velocity_ned_m_s=velocity, acceleration_ned_m_s2=acceleration
        )

    # --- the kinds ----------------------------------------------------------------------------------

    def _limit_global(self, s: PositionGlobal) -> DirectSetpoint:
        """Limits a global position; a changed position becomes a local position."""
        s = self._limit_yaw_rate(s)
        origin = self._bounds.origin
        if origin is None or s.alt_amsl_m is None:
            return s
        unlimited = origin.to_ned(s.lat_deg, s.lon_deg, s.alt_amsl_m)
        position, _, _ = self._limit_motion(unlimited, _NONE, _NONE)
        return s if position == unlimited else Position(position, s.yaw_ned_rad, s.yaw_rate_ned_rad_s)

    def _limit_velocity_body(self, s: VelocityBody) -> VelocityBody:
        s = self._limit_yaw_rate(s)
        yaw = None if self._motion is None else self._motion.yaw_ned_rad
        if yaw is None:  # only the speed can be limited
            n, e, d = self._limit_speed(s.velocity_frd_m_s)
            if self._bounds.region.is_limited_horizontally or self._bounds.region.is_limited_vertically:
                self.notes.append(
                    "velocity set to zero: no valid position and heading estimate, and a geofence is set"
                )
                n = e = d = 0.0
            return replace(s, velocity_frd_m_s=(n, e, d))
        ned: Partial3 = ned_from_heading(s.velocity_frd_m_s, yaw)
        slewed = self._limit_slew(ned)
        _, velocity, _ = self._limit_motion(_NONE, slewed, _NONE)
        if velocity == ned:
            return s
        n, e, d = velocity
        return replace(s, velocity_frd_m_s=ned_from_heading((n or 0.0, e or 0.0, d or 0.0), -yaw))

    def _limit_attitude(self, s: Attitude) -> Attitude:
        self._region.check_stoppable()
        self._brake_stop_reason = self.brake.stop_reason()
        q, tilted = limit_tilt(s.q_ned_frd, self._bounds.tilt_rad)
        if tilted:
            self.notes.append(f"tilt limited to {math.degrees(self._bounds.tilt_rad):.0f}°")
        last = self._last_sent.q_ned_frd if isinstance(self._last_sent, Attitude) else None
        if last is None and self._motion is not None:
            last = self._motion.q_ned_frd
        if last is not None and math.isfinite(self._bounds.slew_attitude_rad_s):
            q, slewed = limit_rotation(last, q, self._bounds.slew_attitude_rad_s * self._dt_s)
            if slewed:
                q, _ = limit_tilt(q, self._bounds.tilt_rad)
                self.notes.append("attitude change limited by the slew rate")
        return replace(self._limit_yaw_rate(s), q_ned_frd=q, thrust=min(1.0, max(0.0, s.thrust)))

    def _limit_rates(self, s: Rates) -> Rates:
        self._region.check_stoppable()
        self._brake_stop_reason = self.brake.stop_reason()
        pairs = zip(s.rates_frd_rad_s, self._bounds.rates_rad_s, strict=True)
        p, q, r = (min(limit, max(-limit, rate)) for rate, limit in pairs)
        if (p, q, r) != s.rates_frd_rad_s:
            self.notes.append("body rates limited to the vehicle's limits")
        return Rates((p, q, r), min(1.0, max(0.0, s.thrust)))

    def _pass_through(self, s: ThrustTorque | Actuators) -> DirectSetpoint:
        """Thrust, torque and actuator setpoints bypass all controllers, so they are not limited; only
        `stop_reason` can protect the vehicle."""
        self._region.check_stoppable()
        self._brake_stop_reason = self.brake.stop_reason()
        return s

    def _limit_yaw_rate(self, s: S) -> S:
        rate, limit = s.yaw_rate_ned_rad_s, self._bounds.rates_rad_s[2]
        if rate is None or abs(rate) <= limit:
            return s
        self.notes.append("yaw rate limited to the vehicle's limit")
        return replace(s, yaw_rate_ned_rad_s=math.copysign(limit, rate))

    # --- position, velocity, acceleration -----------------------------------------------------------

    def _limit_motion(
        self, position: Partial3, velocity: Partial3, acceleration: Partial3
    ) -> tuple[Partial3, Partial3, Partial3]:
        position_ne, velocity_ne = _horizontal(position), _horizontal(velocity)
        current = None if self._motion is None else self._motion.position_ned_m
        if position_ne is not None:
            goal = self._region.limit_position_ne(position_ne)
            position_ne, velocity_ne = self._limit_approach(goal, velocity_ne)
            position_ne, velocity_ne = self.brake.limit_position_ne(
                position_ne, velocity_ne, current, self._bounds.position_gain, goal
            )
        if velocity_ne is not None:
            velocity_ne = self._region.limit_velocity_ne(
                self._limit_size(velocity_ne, self._bounds.speed_m_s, "speed")
            )
            if position_ne is None:
                velocity_ne = self.brake.limit_velocity_ne(self._region.keep_margin(velocity_ne))
        down, velocity_down_m_s = position[2], velocity[2]
        if down is not None:
            down, velocity_down_m_s = self._limit_approach_down(
                self._region.limit_down(down), velocity_down_m_s
            )
            down = self.brake.limit_down(down, current)
        if velocity_down_m_s is not None:
            velocity_down_m_s = self._region.limit_velocity_down(
                self.brake.limit_climb(self._limit_climb(velocity_down_m_s)), keep_margin=down is None
            )
        if (position_ne is None and velocity_ne is None) or (down is None and velocity_down_m_s is None):
            self._region.check_stoppable(
                horizontal=position_ne is None and velocity_ne is None,
                vertical=down is None and velocity_down_m_s is None,
            )
        if position_ne is None and velocity_ne is None:
            self._brake_stop_reason = self.brake.stop_reason()
        acceleration_ne = self._limit_acceleration_ne(_horizontal(acceleration))
        acceleration_down = acceleration[2]
        if acceleration_down is not None:
            limit_up, limit_down = self._bounds.acceleration_up_m_s2, self._bounds.acceleration_down_m_s2
            limited = min(limit_down, max(-limit_up, acceleration_down))
            if limited != acceleration_down:
                self.notes.append(f"acceleration limited to {abs(limited):.1f} m/s²")
            acceleration_down = limited
        return (
            _partial(position_ne, down),
            _partial(velocity_ne, velocity_down_m_s),
            _partial(acceleration_ne, acceleration_down),
        )

    def _limit_approach(
        self, position_ne: NorthEast, velocity_ne: NorthEast | None
    ) -> tuple[NorthEast, NorthEast | None]:
        """Moves the target closer to the vehicle, so that PX4's position controller commands at most the
        operator's speed limit."""
        limit = self._bounds.approach_m_s
        if self._motion is None or not math.isfinite(limit):
            return position_ne, velocity_ne
        current, gain = self._motion.position_ned_m, self._bounds.position_gain
        offset = (position_ne[0] - current[0], position_ne[1] - current[1])
        feed = velocity_ne or (0.0, 0.0)
        commanded_m_s = math.hypot(gain * offset[0] + feed[0], gain * offset[1] + feed[1])
        if commanded_m_s <= limit:
            return position_ne, velocity_ne
        scale = limit / commanded_m_s
        self.notes.append(f"speed limited to {limit:g} m/s")
        nearer = (current[0] + offset[0] * scale, current[1] + offset[1] * scale)
        return nearer, None if velocity_ne is None else (feed[0] * scale, feed[1] * scale)

    def _limit_approach_down(
        self, down_m: float, velocity_down_m_s: float | None
    ) -> tuple[float, float | None]:
        if self._motion is None:
            return down_m, velocity_down_m_s
        offset = down_m - self._motion.position_ned_m[2]
        commanded_m_s = self._bounds.vertical_gain * offset + (velocity_down_m_s or 0.0)
        limit = self._bounds.approach_descent_m_s if commanded_m_s > 0 else self._bounds.approach_climb_m_s
        if abs(commanded_m_s) <= limit:
            return down_m, velocity_down_m_s
        scale = limit / abs(commanded_m_s)
        self.notes.append(f"climb and descent limited to {limit:g} m/s")
        feed = None if velocity_down_m_s is None else velocity_down_m_s * scale
        return self._motion.position_ned_m[2] + offset * scale, feed

    def _limit_speed(self, velocity: Vector3) -> Vector3:
        n, e = self._limit_size((velocity[0], velocity[1]), self._bounds.speed_m_s, "speed")
        return (n, e, self._limit_climb(velocity[2]))

    def _limit_climb(self, velocity_down_m_s: float) -> float:
        limited = min(self._bounds.descent_m_s, max(-self._bounds.climb_m_s, velocity_down_m_s))
        if limited != velocity_down_m_s:
            self.notes.append(f"climb and descent limited to {abs(limited):g} m/s")
        return limited

    def _limit_size(self, vector: NorthEast, limit: float, quantity: str) -> NorthEast:
        size = math.hypot(*vector)
        if size <= limit:
            return vector
        self.notes.append(f"{quantity} limited to {limit:g} m/s")
        return (vector[0] * limit / size, vector[1] * limit / size)

    def _limit_acceleration_ne(self, acceleration_ne: NorthEast | None) -> NorthEast | None:
        if acceleration_ne is None:
            return None
        limit = self._bounds.acceleration_m_s2
        if self._bounds.tilt_rad < math.pi / 2 - 0.01:
            limit = min(limit, GRAVITY_M_S2 * math.tan(self._bounds.tilt_rad))
        size = math.hypot(*acceleration_ne)
        if size > limit:
            self.notes.append(f"acceleration limited to {limit:.1f} m/s²")
            acceleration_ne = (acceleration_ne[0] * limit / size, acceleration_ne[1] * limit / size)
        return acceleration_ne

    def _limit_slew(self, velocity: Partial3) -> Partial3:
        limit = self._bounds.slew_velocity_m_s2 * self._dt_s
        if not math.isfinite(limit) or any(axis is None for axis in velocity):
            return velocity
        last = self._last_velocity()
        if last is None:
            return velocity
        step = [(axis or 0.0) - last_axis for axis, last_axis in zip(velocity, last, strict=True)]
        size = math.hypot(*step)
        if size <= limit:
            return velocity
        self.notes.append(f"velocity change limited to {self._bounds.slew_velocity_m_s2:g} m/s²")
        n, e, d = (
            last_axis + step_axis * limit / size for last_axis, step_axis in zip(last, step, strict=True)
        )
        return (n, e, d)

    def _last_velocity(self) -> Vector3 | None:
        last_sent = self._last_sent
        if isinstance(last_sent, Velocity):
            n, e, d = last_sent.velocity_ned_m_s
            return (n or 0.0, e or 0.0, d or 0.0)
        if (
            isinstance(last_sent, VelocityBody)
            and self._motion is not None
            and self._motion.yaw_ned_rad is not None
        ):
            return ned_from_heading(last_sent.velocity_frd_m_s, self._motion.yaw_ned_rad)
        return None if self._motion is None else self._motion.velocity_ned_m_s


_NONE: Partial3 = (None, None, None)


def _horizontal(vector: Partial3) -> NorthEast | None:
    return None if vector[0] is None or vector[1] is None else (vector[0], vector[1])


def _partial(horizontal: NorthEast | None, down: float | None) -> Partial3:
    return (None, None, down) if horizontal is None else (*horizontal, down)
