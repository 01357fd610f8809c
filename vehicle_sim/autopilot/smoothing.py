"""Speed and direction of the trajectory from waypoint to waypoint (PX4's position smoothing).

The speed decreases with the remaining distance, so that the vehicle can stop, or reach the corner speed,
within the jerk and acceleration limits. While the trajectory turns, it does not accelerate, and its direction
is to the L1 point on the line to the target instead of to the target. Altitude and horizontal position are
reached together. If the vehicle lags, the trajectory's time is stretched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from vehicle_sim.autopilot.trajectory import (
    POSITION,
    VELOCITY,
    Axis,
    advance_axis,
    max_speed_for_distance,
    plan,
    synchronise,
)
from vehicle_sim.kernels import Column, Rows, formula, kernel
from vehicle_sim.vehicle_view import Vector, VehicleView

_ALIGNED_COSINE = 0.98
"""A trajectory counts as turning if the cosine of the angle between its velocity and the direction to the
target is smaller."""
_TURNING_MIN_SPEED_M_S = 0.2
"""Up to this speed the trajectory does not count as turning."""
_L1_RADIUS_MIN_M = 5.0
_SLOW_M_S = 0.5
"""If a velocity component and its limit are below this speed, the other component is not slowed down."""
SETTINGS = (
    "MPC_XY_CRUISE", "MPC_XY_VEL_MAX", "MPC_Z_V_AUTO_UP", "MPC_Z_V_AUTO_DN", "MPC_ACC_HOR", "MPC_ACC_UP_MAX",
    "MPC_ACC_DOWN_MAX", "MPC_JERK_AUTO", "MPC_XY_ERR_MAX", "MPC_XY_TRAJ_P", "NAV_MC_ALT_RAD",
    "MPC_LAND_ALT1", "MPC_LAND_ALT2", "MPC_LAND_ALT3", "MPC_LAND_SPEED", "MPC_LAND_CRWL", "MPC_TKO_SPEED",
    "MPC_TKO_RAMP_T", "MPC_YAWRAUTO_MAX", "FD_FAIL_R", "FD_FAIL_P", "MPC_TILTMAX_AIR", "MPC_USE_HTE",
    "MPC_Z_VEL_MAX_UP", "MPC_Z_VEL_P_ACC", "MPC_YAWRAUTO_ACC",
)  # fmt: skip
(
    _CRUISE, _SPEED_MAX, _UP_SPEED, _DOWN_SPEED, _HORIZONTAL_ACCELERATION, _UP_ACCELERATION,
    _DOWN_ACCELERATION, _JERK, _ERROR_MAX, _TRAJECTORY_P, _ALTITUDE_RADIUS, _LAND_ALT1, _LAND_ALT2,
    _LAND_ALT3, _LAND_SPEED, _LAND_CRAWL, _TAKEOFF_SPEED, TAKEOFF_RAMP_S, YAW_RATE_MAX_DEG_S,
    ROLL_FAILURE_DEG, PITCH_FAILURE_DEG, TILT_MAX_DEG, USES_HOVER_ESTIMATE, CLIMB_MAX_M_S, VELOCITY_GAIN,
    YAW_ACCELERATION_DEG_S2,
) = range(len(SETTINGS))  # fmt: skip
"""Columns of the settings; from the failures' limits to the velocity gain they are used by the compiled ticks
only (`steady.py`). No acceleration of the heading (0): it is not limited."""
GROUND_VELOCITY_DOWN_M_S = 0.7
"""On the ground PX4 starts each trajectory with this descent speed. The climb begins after this speed is
braked to zero: 1.4 s into the take-off ramp."""
PREVIOUS, TARGET, NEXT, ACCEPTANCE, TRIPLET_SIZE = 0, 3, 6, 9, 10
"""Columns of a waypoint triplet: the first column of each NED position, and the acceptance radius."""
_X, _Y, _Z = 0, 1, 2


class SpeedLimits(NamedTuple):
    """Speed limits; NaN or infinite: MPC_XY_CRUISE, MPC_Z_V_AUTO_UP, MPC_Z_V_AUTO_DN."""

    cruise_m_s: float
    climb_m_s: float
    descent_m_s: float


@dataclass(frozen=True, slots=True)
class WaypointTriplet:
    """Previous, target and next waypoint; NED metres."""

    previous_ned_m: Vector
    target_ned_m: Vector
    next_ned_m: Vector | None
    """None: stop at the target."""
    acceptance_m: float


class Smoothing:
    """The trajectory of one vehicle: three axes, and the horizontal speed before the current turn.

    Args:
        view: the vehicle.
        axes: (3, `trajectory.SIZE`) rows of the axes.
        settings: (`len(SETTINGS)`,) row that stores the parameters.
        triplet: (`TRIPLET_SIZE`,) row that stores the waypoints; NaN for a missing next waypoint.
        before_turn_m_s: (1,) horizontal speed before the current turn.
    """

    def __init__(
        self, view: VehicleView, axes: Rows, settings: Column, triplet: Column, before_turn_m_s: Column
    ) -> None:
        self._view = view
        self._axes = axes
        self.x, self.y, self.z = (Axis(row) for row in self._axes)
        self._before_turn_m_s = before_turn_m_s
        self._settings = settings
        self._settings_version = -1
        """Value of `parameter_changes` at which the settings were read."""
        self._triplet: WaypointTriplet | None = None
        """The waypoints that `_triplet_row` contains."""
        self._triplet_row = triplet

    def begin(self, before_turn_m_s: float = 0.0) -> None:
        """Sets the stored speed before a turn: with 0 a vehicle not moving towards the target brakes
        first."""
        self._before_turn_m_s[0] = before_turn_m_s

    def fly(self, dt_s: float, triplet: WaypointTriplet, limits: SpeedLimits) -> None:
        """Advances all axes by one tick along the waypoints."""
        x, y, _ = self._view.estimate.position_ned_m
        self._set_triplet(triplet)
        fly_triplet(
            self._axes,
            self.read_settings(),
            self._triplet_row,
            self._before_turn_m_s,
            dt_s,
            x,
            y,
            *limits,
        )

    def follows(self, triplet: WaypointTriplet) -> bool:
        """Whether the trajectory follows these waypoints."""
        return triplet is self._triplet

    def velocity_towards(self, triplet: WaypointTriplet, limits: SpeedLimits) -> Vector:
        """Velocity setpoint along the waypoints, NED, before the acceleration and jerk limits."""
        self._set_triplet(triplet)
        return _velocity_towards(
            self._axes, self.read_settings(), self._triplet_row, self._before_turn_m_s, *limits
        )

    def fly_horizontal(self, dt_s: float, triplet: WaypointTriplet | None, limits: SpeedLimits) -> float:
        """Advances north and east by one tick; without waypoints the trajectory brakes to a stop.

        Returns:
            By how much the trajectory time advanced [s]; less than a tick while the vehicle lags.
        """
        x, y, _ = self._view.estimate.position_ned_m
        if triplet is not None:
            self._set_triplet(triplet)
        return fly_horizontal(
            self._axes, self.read_settings(), self._triplet_row, self._before_turn_m_s,
            dt_s, x, y, triplet is not None, limits.cruise_m_s,
        )  # fmt: skip

    def climb(
        self, dt_s: float, triplet: WaypointTriplet | None, limits: SpeedLimits, target_down_m: float,
        home_down_m: float,
    ) -> None:  # fmt: skip
        """Advances all axes by one tick of a take-off; see the kernel `climb`."""
        if triplet is not None:
            self._set_triplet(triplet)
        climb(
            self._axes, self.read_settings(), self._triplet_row, self._before_turn_m_s, dt_s,
            *self._view.estimate.position_ned_m, triplet is not None, limits.cruise_m_s, target_down_m,
            home_down_m,
        )  # fmt: skip

    def descend(self, dt_s: float, triplet: WaypointTriplet | None, limits: SpeedLimits) -> None:
        """Advances all axes by one tick of a landing; see the kernel `descend`."""
        if triplet is not None:
            self._set_triplet(triplet)
        estimate = self._view.estimate
        descend(
            self._axes, self.read_settings(), self._triplet_row, self._before_turn_m_s, dt_s,
            *estimate.position_ned_m, triplet is not None, limits.cruise_m_s, estimate.height_above_ground_m,
        )  # fmt: skip

    def stay_at_vehicle(self) -> None:
        """Sets the trajectory to the vehicle's position (`stay_at`)."""
        stay_at(self._axes, *self._view.estimate.position_ned_m)

    def plan_vertical(self, velocity_m_s: float) -> None:
        """Plans a vertical speed (down is positive) with the acceleration limit of a climb or descent."""
        plan_vertical(self.z.row, self.read_settings(), velocity_m_s)

    def vertical_speed(self, remaining_m: float, limits: SpeedLimits) -> float:
        """Speed for a climb (negative distance) or descent over this distance; never negative."""
        return _vertical_speed(self.read_settings(), remaining_m, limits.climb_m_s, limits.descent_m_s)

    def read_settings(self) -> Column:
        """Current parameter values."""
        if self._settings_version != self._view.parameter_changes:
            self._settings_version = self._view.parameter_changes
            self._settings[:] = [self._view.parameter(name) for name in SETTINGS]
            if not self._view.px4.smooths_heading:
                self._settings[YAW_ACCELERATION_DEG_S2] = 0.0
        return self._settings

    def _set_triplet(self, triplet: WaypointTriplet) -> None:
        if triplet is not self._triplet:
            self._triplet = triplet
            next_ned_m = triplet.next_ned_m or (math.nan, math.nan, math.nan)
            self._triplet_row[:] = (
                *triplet.previous_ned_m,
                *triplet.target_ned_m,
                *next_ned_m,
                triplet.acceptance_m,
            )


@formula
def _time_stretch(axes: Rows, settings: Column, x: float, y: float) -> float:
    """Factor on the trajectory's time: below 1 if the vehicle lags behind the trajectory. It is 1 if the
    vehicle is ahead, because the trajectory would otherwise stop before its target."""
    lead_n, lead_e = axes[_X, POSITION] - x, axes[_Y, POSITION] - y
    if lead_n * axes[_X, VELOCITY] + lead_e * axes[_Y, VELOCITY] < 0.0:
        return 1.0
    return 1.0 - min(1.0, math.hypot(lead_n, lead_e) / max(0.1, settings[_ERROR_MAX]))


@formula
def _clamp_component(speed_m_s: float, limit_m_s: float) -> tuple[float, float]:
    """A component of the velocity within its limit, and the factor by which the other component must slow
    down.

    Components below _SLOW_M_S are only clipped, so that a small altitude error does not slow the horizontal
    flight.
    """
    if speed_m_s <= limit_m_s:
        return speed_m_s, 1.0
    slow = speed_m_s < _SLOW_M_S and limit_m_s < _SLOW_M_S
    return limit_m_s, 1.0 if slow else limit_m_s / speed_m_s


@formula
def _corner_speed(axes: Rows, settings: Column, triplet: Column) -> float:
    tn, te = triplet[TARGET], triplet[TARGET + 1]
    to_target_n, to_target_e = tn - axes[_X, POSITION], te - axes[_Y, POSITION]
    from_next_n, from_next_e = tn - triplet[NEXT], te - triplet[NEXT + 1]
    product_m2 = math.hypot(to_target_n, to_target_e) * math.hypot(from_next_n, from_next_e)
    dot_m2 = to_target_n * from_next_n + to_target_e * from_next_e
    cosine = dot_m2 / product_m2 if product_m2 > 1e-9 else 0.0
    half_angle = min(math.acos(max(-1.0, min(1.0, cosine))), math.pi - 1e-6) / 2.0
    lateral_m_s2 = settings[_TRAJECTORY_P] * settings[_HORIZONTAL_ACCELERATION]
    return math.sqrt(lateral_m_s2 * triplet[ACCEPTANCE] * math.tan(half_angle))


@formula
def _horizontal_speed(axes: Rows, settings: Column, triplet: Column, cruise_m_s: float) -> float:
    cruise = min(cruise_m_s if math.isfinite(cruise_m_s) else settings[_CRUISE], settings[_SPEED_MAX])
    jerk, acceleration = settings[_JERK], settings[_HORIZONTAL_ACCELERATION]
    tn, te, td = triplet[TARGET], triplet[TARGET + 1], triplet[TARGET + 2]
    nn, ne, nd = triplet[NEXT], triplet[NEXT + 1], triplet[NEXT + 2]
    target_speed = 0.0
    if not math.isnan(nn):
        next_leg_m = math.hypot(nn - tn, ne - te)
        same_altitude = max(abs(td - axes[_Z, POSITION]), abs(nd - td)) < settings[_ALTITUDE_RADIUS]
        if next_leg_m > 0.001 and next_leg_m >= triplet[ACCEPTANCE] and same_altitude:
            exit_speed = max_speed_for_distance(jerk, acceleration, next_leg_m, 0.0)
            target_speed = min(min(_corner_speed(axes, settings, triplet), exit_speed), cruise)
    remaining_m = math.hypot(tn - axes[_X, POSITION], te - axes[_Y, POSITION])
    return min(cruise, max_speed_for_distance(jerk, acceleration, remaining_m, target_speed))


@formula
def _turning(axes: Rows, triplet: Column) -> bool:
    vn, ve = axes[_X, VELOCITY], axes[_Y, VELOCITY]
    dn, de = triplet[TARGET] - axes[_X, POSITION], triplet[TARGET + 1] - axes[_Y, POSITION]
    speed, remaining_m = math.hypot(vn, ve), math.hypot(dn, de)
    if speed <= _TURNING_MIN_SPEED_M_S or remaining_m <= triplet[ACCEPTANCE]:
        return False
    return (vn * dn + ve * de) / (speed * remaining_m) < _ALIGNED_COSINE


@formula
def _l1_point(axes: Rows, triplet: Column) -> tuple[float, float]:
    """The point to which a turning trajectory flies: on the line to the target, at the L1 radius.

    Past the target, the point is the target.
    """
    pn, pe, tn, te = triplet[PREVIOUS], triplet[PREVIOUS + 1], triplet[TARGET], triplet[TARGET + 1]
    leg_m = math.hypot(tn - pn, te - pe)
    if leg_m < 1e-6:
        return tn, te
    un, ue = (tn - pn) / leg_m, (te - pe) / leg_m
    x, y = axes[_X, POSITION], axes[_Y, POSITION]
    along_m = (x - pn) * un + (y - pe) * ue
    if along_m > leg_m:
        return tn, te
    closest_n, closest_e = pn + un * along_m, pe + ue * along_m
    cross_track_m = math.hypot(closest_n - x, closest_e - y)
    radius_m = max(triplet[ACCEPTANCE], _L1_RADIUS_MIN_M)
    square_m2 = radius_m * radius_m - cross_track_m * cross_track_m if radius_m > cross_track_m else 0.0
    ahead_m = math.sqrt(square_m2)
    return closest_n + un * ahead_m, closest_e + ue * ahead_m


@formula
def _speed_and_direction(
    axes: Rows, settings: Column, triplet: Column, before_turn_m_s: Column, cruise_m_s: float
) -> tuple[float, float, float]:
    """The horizontal speed, and the distances north and east to the target or L1 point."""
    speed = _horizontal_speed(axes, settings, triplet, cruise_m_s)
    point_n, point_e = triplet[TARGET], triplet[TARGET + 1]
    if _turning(axes, triplet):
        speed = min(speed, before_turn_m_s[0])
        point_n, point_e = _l1_point(axes, triplet)
    else:
        before_turn_m_s[0] = speed
    return speed, point_n - axes[_X, POSITION], point_e - axes[_Y, POSITION]


@formula
def _plan_horizontal(axes: Rows, settings: Column, north_m_s: float, east_m_s: float) -> None:
    plan(axes[_X], north_m_s, settings[_HORIZONTAL_ACCELERATION], settings[_JERK])
    plan(axes[_Y], east_m_s, settings[_HORIZONTAL_ACCELERATION], settings[_JERK])


@kernel
def _vertical_speed(settings: Column, distance_m: float, climb_m_s: float, descent_m_s: float) -> float:
    up = distance_m < 0.0
    limit = climb_m_s if up else descent_m_s
    if not math.isfinite(limit):
        limit = settings[_UP_SPEED] if up else settings[_DOWN_SPEED]
    acceleration = settings[_UP_ACCELERATION] if up else settings[_DOWN_ACCELERATION]
    return min(limit, max_speed_for_distance(settings[_JERK], acceleration, abs(distance_m), 0.0))


@kernel
def plan_vertical(axis: Column, settings: Column, velocity_m_s: float) -> None:
    """Plans a vertical speed (down is positive) with the acceleration limit of a climb or descent."""
    climbing = velocity_m_s < axis[VELOCITY]
    plan(
        axis,
        velocity_m_s,
        settings[_UP_ACCELERATION] if climbing else settings[_DOWN_ACCELERATION],
        settings[_JERK],
    )


@kernel
def fly_horizontal(
    axes: Rows, settings: Column, triplet: Column, before_turn_m_s: Column, dt_s: float, x: float, y: float,
    has_triplet: bool, cruise_m_s: float,
) -> float:  # fmt: skip
    """Advances north and east by one tick; returns by how much the trajectory time advanced [s]."""
    advanced_s = dt_s * _time_stretch(axes, settings, x, y)
    advance_axis(axes[_X], advanced_s)
    advance_axis(axes[_Y], advanced_s)
    north = east = 0.0
    if has_triplet:
        speed, dn, de = _speed_and_direction(axes, settings, triplet, before_turn_m_s, cruise_m_s)
        length = math.hypot(dn, de)
        if length > 1e-6:
            north, east = speed * dn / length, speed * de / length
    _plan_horizontal(axes, settings, north, east)
    synchronise(axes, 2)
    return advanced_s


@kernel
def _velocity_towards(
    axes: Rows, settings: Column, triplet: Column, before_turn_m_s: Column, cruise_m_s: float,
    climb_m_s: float, descent_m_s: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Velocity setpoint along the waypoints, NED."""
    horizontal_limit, dn, de = _speed_and_direction(axes, settings, triplet, before_turn_m_s, cruise_m_s)
    dd = triplet[TARGET + 2] - axes[_Z, POSITION]
    vertical_limit = _vertical_speed(settings, dd, climb_m_s, descent_m_s)
    horizontal_m, distance_m = math.hypot(dn, de), math.sqrt(dn * dn + de * de + dd * dd)
    if distance_m < 1e-6:
        return 0.0, 0.0, 0.0
    speed = math.hypot(horizontal_limit, vertical_limit)
    horizontal_m_s, vertical_factor = _clamp_component(speed * horizontal_m / distance_m, horizontal_limit)
    vertical_m_s = vertical_factor * speed * abs(dd) / distance_m
    vertical_m_s, horizontal_factor = _clamp_component(vertical_m_s, vertical_limit)
    scale = horizontal_m_s * horizontal_factor / max(horizontal_m, 1e-9)
    return scale * dn, scale * de, math.copysign(vertical_m_s, dd)


@kernel
def fly_triplet(
    axes: Rows, settings: Column, triplet: Column, before_turn_m_s: Column, dt_s: float, x: float, y: float,
    cruise_m_s: float, climb_m_s: float, descent_m_s: float,
) -> None:  # fmt: skip
    """Advances all axes of one vehicle by one tick along its waypoints."""
    advanced_s = dt_s * _time_stretch(axes, settings, x, y)
    for k in range(3):
        advance_axis(axes[k], advanced_s)
    north, east, down = _velocity_towards(
        axes, settings, triplet, before_turn_m_s, cruise_m_s, climb_m_s, descent_m_s
    )
    _plan_horizontal(axes, settings, north, east)
    plan_vertical(axes[_Z], settings, down)
    synchronise(axes, 3)


@kernel
def climb(
    axes: Rows, settings: Column, triplet: Column, before_turn_m_s: Column, dt_s: float, x: float, y: float,
    z: float, has_triplet: bool, cruise_m_s: float, target_down_m: float, home_down_m: float,
) -> None:  # fmt: skip
    """Advances all axes of one vehicle by one tick of a take-off to an altitude (NaN: none yet).

    Up to MPC_LAND_ALT1 above home, the take-off ramp limits the acceleration, and the trajectory starts each
    tick at the vehicle's altitude, so that the trajectory does not descend at first.
    """
    advanced_s = fly_horizontal(axes, settings, triplet, before_turn_m_s, dt_s, x, y, has_triplet, cruise_m_s)
    axis = axes[_Z]
    near_home = home_down_m - z < settings[_LAND_ALT1]
    if near_home:
        axis[POSITION] = z
    remaining_m = 0.0 if math.isnan(target_down_m) else target_down_m - axis[POSITION]
    advance_axis(axis, advanced_s)
    max_speed, acceleration = settings[_UP_SPEED], settings[_UP_ACCELERATION]
    if remaining_m > 0.0:
        max_speed, acceleration = settings[_DOWN_SPEED], settings[_DOWN_ACCELERATION]
    elif near_home:
        max_speed, ramp_s = settings[_TAKEOFF_SPEED], settings[TAKEOFF_RAMP_S]
        if ramp_s > 0.0:
            acceleration = min(acceleration, max_speed / ramp_s)
    speed_m_s = min(max_speed, max_speed_for_distance(settings[_JERK], acceleration, abs(remaining_m), 0.0))
    plan(axis, math.copysign(speed_m_s, remaining_m), acceleration, settings[_JERK])


@formula
def _land_speed(settings: Column, down_m: float, range_m: float) -> float:
    """Speed of a landing at this height above ground; without a range, at this position down, and without
    the crawl speed MPC_LAND_CRWL."""
    height_m = -down_m if math.isnan(range_m) else range_m
    fast, slow = settings[_DOWN_SPEED], settings[_LAND_SPEED]
    high_m, low_m = settings[_LAND_ALT1], settings[_LAND_ALT2]
    if range_m <= settings[_LAND_ALT3]:
        return settings[_LAND_CRAWL]
    if height_m >= high_m:
        return fast
    if height_m > low_m and high_m > low_m:
        return slow + (fast - slow) * (height_m - low_m) / (high_m - low_m)
    return slow


@kernel
def descend(
    axes: Rows, settings: Column, triplet: Column, before_turn_m_s: Column, dt_s: float, x: float, y: float,
    z: float, has_triplet: bool, cruise_m_s: float, range_m: float,
) -> None:  # fmt: skip
    """Advances all axes of one vehicle by one tick of a landing; `range_m` is the height above ground that
    the range finder measures, NaN without a measurement."""
    advanced_s = fly_horizontal(axes, settings, triplet, before_turn_m_s, dt_s, x, y, has_triplet, cruise_m_s)
    advance_axis(axes[_Z], advanced_s)
    plan_vertical(axes[_Z], settings, _land_speed(settings, z, range_m))


@kernel
def stay_at(axes: Rows, x: float, y: float, z: float) -> None:
    """Sets the trajectory to a position, with the descent speed with which PX4 starts on the ground."""
    axes[:] = 0.0
    axes[_X, POSITION], axes[_Y, POSITION], axes[_Z, POSITION] = x, y, z
    axes[_Z, VELOCITY] = GROUND_VELOCITY_DOWN_M_S
