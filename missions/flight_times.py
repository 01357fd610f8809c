"""Times of the parts of a PX4 flight: legs, climbs, landings.

The model follows PX4 v1.16's multicopter controllers, with PX4's parameters (names in `missions/vehicle.py`):

- The trajectory of a leg accelerates with limited jerk, and brakes so that the speed at distance d from the
  target is at most v with v² + 4·a²/j·v = 2·a·d + v_end² (the jerk phase is accounted for as a delay). v_end
  is 0 where the vehicle stops, √(s·a·r·tan(α/2)) at a corner with the angle α between its legs (s is
  MPC_XY_TRAJ_P), and the cruise speed on a straight line; r is the acceptance radius, within which the next
  leg begins.
- The vehicle lags behind the trajectory, because drag needs an acceleration that the velocity controller's
  integrator learns only slowly, and again after each turn. PX4 slows the trajectory down by the share that
  the lag has of MPC_XY_ERR_MAX. The speed is therefore V − c·exp(−t/τ); see `_Lag`.
- Near the ground climbs and descents are slower, and after touching down PX4 needs time to detect it.

The total times of recorded flights of a real PX4 are right within 10 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from missions.vehicle import VehicleModel

DRAG_1_S = 1.0
"""Deceleration by drag per speed [1/s], of the vehicle in the recordings. No PX4 parameter describes it. For
a vehicle with less drag the times are up to a tenth too long."""
LIFT_OFF_S = 0.4
"""Time from the end of the take-off ramp until the vehicle climbs [s]; recorded: 0.2 to 0.7."""
SWITCH_S = 0.5
"""Time from the end of a phase until the vehicle moves again from a hover [s]; recorded: 0.4 to 0.9."""
TOUCHDOWN_S = 5.3
"""Time from touching the ground until PX4 reports "landed" [s]; recorded: 4.4 to 8.5."""
_MIN_SPEED_M_S = 0.05


# --- one axis -----------------------------------------------------------------------------------------


def braking_distance_m(speed_m_s: float, end_m_s: float, acceleration_m_s2: float, jerk_m_s3: float) -> float:
    """Distance from the target at which PX4 begins to brake."""
    if speed_m_s <= end_m_s:
        return 0.0
    ramp_m_s = 4.0 * acceleration_m_s2**2 / jerk_m_s3
    return (speed_m_s**2 + ramp_m_s * speed_m_s - end_m_s**2) / (2.0 * acceleration_m_s2)


def braking_speed_m_s(distance_m: float, end_m_s: float, acceleration_m_s2: float, jerk_m_s3: float) -> float:
    """Greatest speed at a distance from the target."""
    ramp_m_s = 4.0 * acceleration_m_s2**2 / jerk_m_s3
    square = ramp_m_s**2 + 4.0 * (2.0 * acceleration_m_s2 * distance_m + end_m_s**2)
    return max(end_m_s, (math.sqrt(square) - ramp_m_s) / 2.0)


def _braking(
    speed_m_s: float, end_m_s: float, radius_m: float, acceleration_m_s2: float, jerk_m_s3: float
) -> tuple[float, float, float]:
    """Braking towards a target, until `radius_m` before it.

    Returns:
        Distance from the target at which it begins, its time, and the speed at its end.
    """
    begins_m = braking_distance_m(speed_m_s, end_m_s, acceleration_m_s2, jerk_m_s3)
    if begins_m <= radius_m:
        return radius_m, 0.0, speed_m_s
    final_m_s = braking_speed_m_s(radius_m, end_m_s, acceleration_m_s2, jerk_m_s3)
    final_m_s = max(min(final_m_s, speed_m_s), _MIN_SPEED_M_S)
    ramp_s = 2.0 * acceleration_m_s2 / jerk_m_s3
    time_s = (speed_m_s - final_m_s) / acceleration_m_s2 + ramp_s * math.log(speed_m_s / final_m_s)
    if end_m_s > 0.0:
        time_s += max(0.0, ramp_s * end_m_s - radius_m) / end_m_s  # already with the speed of the corner
    return begins_m, time_s, final_m_s


def ramp_time_s(change_m_s: float, acceleration_m_s2: float, jerk_m_s3: float) -> float:
    """Time of a change of speed with limited acceleration and jerk; it covers the mean of both speeds."""
    change_m_s = max(0.0, change_m_s)
    if change_m_s >= acceleration_m_s2**2 / jerk_m_s3:
        return change_m_s / acceleration_m_s2 + acceleration_m_s2 / jerk_m_s3
    return 2.0 * math.sqrt(change_m_s / jerk_m_s3)


def _peak_speed_m_s(
    length_m: float,
    start_m_s: float,
    cruise_m_s: float,
    end_m_s: float,
    radius_m: float,
    acceleration_m_s2: float,
    jerk_m_s3: float,
) -> float:
    """Greatest speed up to `cruise_m_s` for which the length suffices to speed up and brake."""  # fmt: skip

    def fits(speed_m_s: float) -> bool:
        ramp_s = ramp_time_s(speed_m_s - start_m_s, acceleration_m_s2, jerk_m_s3)
        braking_m, _, _ = _braking(speed_m_s, end_m_s, radius_m, acceleration_m_s2, jerk_m_s3)
        return (start_m_s + speed_m_s) / 2.0 * ramp_s + braking_m <= length_m

    if fits(cruise_m_s):
        return cruise_m_s
    low_m_s, high_m_s = _MIN_SPEED_M_S, cruise_m_s
    for _ in range(8):
        middle_m_s = (low_m_s + high_m_s) / 2.0
        if fits(middle_m_s):
            low_m_s = middle_m_s
        else:
            high_m_s = middle_m_s
    return low_m_s


# --- legs ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Lag:
    """The constants of the lag at one speed.

    With the lag e [m] the trajectory's speed is V·(1 − e/E), and the controller accelerates with
    P·(V + p·e − v) + I, where I grows with i·(V + p·e − v). The fast balance with the drag D·v gives
    e = (D·V − I)/k with k = p·P + V·(P + D)/E, and e decreases with the time constant k/(i·(p + V/E)).
    """

    speed_m_s: float
    vehicle: VehicleModel

    @property
    def stiffness(self) -> float:
        """k [1/s²]."""
        v = self.vehicle
        slowed = self.speed_m_s * (v.velocity_p_1_s + DRAG_1_S) / v.position_error_max_m
        return v.position_p_1_s * v.velocity_p_1_s + slowed

    @property
    def time_constant_s(self) -> float:
        """τ [s]."""
        v = self.vehicle
        return self.stiffness / (
            v.velocity_i_1_s2 * (v.position_p_1_s + self.speed_m_s / v.position_error_max_m)
        )

    def missing_m_s(self, integrator_m_s2: float) -> float:
        """c: by how much the vehicle is too slow at first."""
        lag_m = (DRAG_1_S * self.speed_m_s - integrator_m_s2) / self.stiffness
        return self.speed_m_s * min(1.0, max(0.0, lag_m / self.vehicle.position_error_max_m))


class LegTimer:
    """Times of successive horizontal legs of one flight.

    It remembers the speed at the last corner, and the acceleration that the velocity controller has learnt.
    """

    def __init__(self, vehicle: VehicleModel) -> None:
        self._vehicle = vehicle
        self._learnt_m_s2 = (0.0, 0.0)
        """The integrator of the velocity controller, north and east."""
        self._speed_m_s = 0.0
        self._course_rad = 0.0

    def wait(self, time_s: float) -> None:
        """The vehicle hovers."""
        self._speed_m_s = 0.0
        self._forget(time_s)

    def fly(
        self, length_m: float, course_rad: float, speed_m_s: float, next_course_rad: float | None
    ) -> float:
        """Time of one leg, until the vehicle is within the acceptance radius of its end [s].

        Args:
            length_m: length of the leg.
            course_rad: direction of the leg, from north.
            speed_m_s: set speed.
            next_course_rad: direction of the next leg; None: the vehicle stops.
        """
        v = self._vehicle
        north, east = math.cos(course_rad), math.sin(course_rad)
        along = self._learnt_m_s2[0] * north + self._learnt_m_s2[1] * east
        lag = _Lag(speed_m_s, v)
        missing_m_s, constant_s = lag.missing_m_s(along), lag.time_constant_s
        start_m_s = min(speed_m_s, max(0.0, self._speed_m_s * math.cos(course_rad - self._course_rad)))
        end_m_s = (
            0.0 if next_course_rad is None else corner_speed_m_s(next_course_rad - course_rad, speed_m_s, v)
        )
        cruise_m_s = max(speed_m_s - missing_m_s, start_m_s, _MIN_SPEED_M_S)
        limits = v.acceleration_m_s2, v.jerk_m_s3
        peak_m_s = _peak_speed_m_s(length_m, start_m_s, cruise_m_s, end_m_s, v.acceptance_m, *limits)
        ramp_s = ramp_time_s(peak_m_s - start_m_s, *limits)
        ramp_m = (start_m_s + peak_m_s) / 2.0 * ramp_s
        braking_m, braking_s, final_m_s = _braking(peak_m_s, end_m_s, v.acceptance_m, *limits)
        cruise_s = 0.0
        if peak_m_s == cruise_m_s:
            for _ in range(2):  # the faster the vehicle becomes, the earlier it brakes
                cruise_m = max(0.0, length_m - ramp_m - braking_m)
                cruise_s = _cruise_time_s(cruise_m, speed_m_s, missing_m_s, constant_s)
                peak_m_s = max(peak_m_s, speed_m_s - missing_m_s * math.exp(-cruise_s / constant_s))
                braking_m, braking_s, final_m_s = _braking(peak_m_s, end_m_s, v.acceptance_m, *limits)
            cruise_m = max(0.0, length_m - ramp_m - braking_m)
            cruise_s = _cruise_time_s(cruise_m, speed_m_s, missing_m_s, constant_s)
        response_s = (1.0 - start_m_s / speed_m_s) / (v.velocity_p_1_s + DRAG_1_S)
        time_s = ramp_s + response_s + cruise_s + braking_s
        self._learn(north, east, along, speed_m_s, time_s, constant_s)
        self._speed_m_s = 0.0 if next_course_rad is None else final_m_s
        self._course_rad = course_rad
        return time_s

    def _learn(
        self, north: float, east: float, along: float, speed_m_s: float, time_s: float, constant_s: float
    ) -> None:
        """Along the leg the integrator approaches the drag, across it is forgotten."""
        self._forget(time_s)
        across = -self._learnt_m_s2[0] * east + self._learnt_m_s2[1] * north
        drag_m_s2 = DRAG_1_S * speed_m_s
        along = drag_m_s2 - (drag_m_s2 - along) * math.exp(-time_s / constant_s)
        self._learnt_m_s2 = (along * north - across * east, along * east + across * north)

    def _forget(self, time_s: float) -> None:
        share = math.exp(-time_s * self._vehicle.velocity_i_1_s2 / self._vehicle.velocity_p_1_s)
        self._learnt_m_s2 = (self._learnt_m_s2[0] * share, self._learnt_m_s2[1] * share)


def corner_speed_m_s(turn_rad: float, speed_m_s: float, vehicle: VehicleModel) -> float:
    """Speed at a corner; `turn_rad` is 0 for a straight line."""
    half_rad = (math.pi - abs((turn_rad + math.pi) % math.tau - math.pi)) / 2.0
    if half_rad > math.radians(89.0):
        return speed_m_s
    acceleration_m_s2 = max(0.0, vehicle.corner_share) * vehicle.acceleration_m_s2
    return min(speed_m_s, math.sqrt(acceleration_m_s2 * vehicle.acceptance_m * math.tan(half_rad)))


def _cruise_time_s(length_m: float, speed_m_s: float, missing_m_s: float, constant_s: float) -> float:
    """Solves length = V·t − c·τ·(1 − exp(−t/τ)) for t by Newton's method."""
    time_s = length_m / max(_MIN_SPEED_M_S, speed_m_s - missing_m_s)
    for _ in range(6):
        decay = math.exp(-time_s / constant_s)
        error_m = speed_m_s * time_s - missing_m_s * constant_s * (1.0 - decay) - length_m
        time_s -= error_m / max(_MIN_SPEED_M_S, speed_m_s - missing_m_s * decay)
    return max(0.0, time_s)


# --- up and down --------------------------------------------------------------------------------------


def change_altitude_time_s(change_m: float, vehicle: VehicleModel) -> float:
    """Time to climb (positive) or descend in flight, until within NAV_MC_ALT_RAD [s]."""
    up = change_m > 0.0
    speed_m_s = vehicle.climb_m_s if up else vehicle.descent_m_s
    acceleration_m_s2 = vehicle.climb_acceleration_m_s2 if up else vehicle.descent_acceleration_m_s2
    return _vertical_time_s(abs(change_m), speed_m_s, acceleration_m_s2, vehicle)


def _vertical_time_s(
    height_m: float, speed_m_s: float, acceleration_m_s2: float, vehicle: VehicleModel
) -> float:
    radius_m = vehicle.altitude_acceptance_m
    if height_m <= radius_m:
        return 0.0
    limits = acceleration_m_s2, vehicle.jerk_m_s3
    peak_m_s = _peak_speed_m_s(height_m, 0.0, speed_m_s, 0.0, radius_m, *limits)
    ramp_s = ramp_time_s(peak_m_s, *limits)
    braking_m, braking_s, _ = _braking(peak_m_s, 0.0, radius_m, *limits)
    return ramp_s + max(0.0, height_m - peak_m_s / 2.0 * ramp_s - braking_m) / peak_m_s + braking_s


def takeoff_time_s(height_m: float, vehicle: VehicleModel) -> float:
    """Time from arming until the vehicle has climbed to `height_m` above the ground [s].

    Below MPC_LAND_ALT1 it climbs with MPC_TKO_SPEED.
    """
    slow_m = min(height_m, vehicle.land_fast_m)
    time_s = vehicle.spoolup_s + vehicle.takeoff_ramp_s + LIFT_OFF_S
    if height_m - vehicle.land_fast_m <= vehicle.altitude_acceptance_m:
        climb_m_s2 = vehicle.climb_acceleration_m_s2
        return time_s + _vertical_time_s(height_m, vehicle.takeoff_m_s, climb_m_s2, vehicle)
    return time_s + slow_m / vehicle.takeoff_m_s + change_altitude_time_s(height_m - slow_m, vehicle)


def land_time_s(height_m: float, vehicle: VehicleModel) -> float:
    """Time to descend from `height_m` above the ground, land and disarm [s].

    From MPC_LAND_ALT1 to MPC_LAND_ALT2 the speed decreases from MPC_Z_V_AUTO_DN to MPC_LAND_SPEED.
    """
    fast_m_s = max(vehicle.descent_m_s, vehicle.land_m_s)
    slow_m_s = vehicle.land_m_s
    low_m, high_m = min(vehicle.land_slow_m, vehicle.land_fast_m), vehicle.land_fast_m
    time_s = ramp_time_s(slow_m_s, vehicle.descent_acceleration_m_s2, vehicle.jerk_m_s3) / 2.0
    time_s += max(0.0, height_m - high_m) / fast_m_s
    time_s += min(height_m, low_m) / slow_m_s
    if low_m < height_m and high_m > low_m:
        slope_1_s = (fast_m_s - slow_m_s) / (high_m - low_m)
        start_m_s = slow_m_s + slope_1_s * (min(height_m, high_m) - low_m)
        time_s += (
            math.log(start_m_s / slow_m_s) / slope_1_s
            if slope_1_s > 0.0
            else (min(height_m, high_m) - low_m) / slow_m_s
        )
    return time_s + TOUCHDOWN_S + max(0.0, vehicle.disarm_s)


def return_height_m(height_m: float, distance_m: float, vehicle: VehicleModel) -> float:
    """Height above home at which PX4 returns, from `height_m` above home and this distance."""
    lowest_m = 2.0 * vehicle.acceptance_m
    target_m = vehicle.return_alt_m
    if 0.0 < vehicle.return_cone_deg < 90.0:
        if distance_m <= vehicle.acceptance_m:
            target_m = 2.0 * distance_m
        else:
            if distance_m <= vehicle.return_min_m:
                target_m = min(target_m, distance_m / math.tan(math.radians(vehicle.return_cone_deg)))
            target_m = max(target_m, lowest_m)
    return max(height_m, min(target_m, vehicle.return_alt_m))
