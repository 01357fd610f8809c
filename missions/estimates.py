"""Length, time, photos and energy of a plan.

The times are those of PX4 without wind (`missions/flight_times.py`), from arming until the motors stop after
a landing. The time of a leg is the longer of its horizontal and its vertical part.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from missions.camera_items import PhotoStart, TriggerDistance
from missions.flight_times import (
    SWITCH_S,
    LegTimer,
    change_altitude_time_s,
    land_time_s,
    return_height_m,
    takeoff_time_s,
)
from missions.geodesy import distance_m
from missions.items import ChangeSpeed, Delay, Land, LoiterTime, PlacedItem, ReturnHome, Takeoff, Waypoint
from missions.plan import Plan, SimpleItem
from missions.route import Leg, Route, Step, is_flown_to, legs, route_of
from missions.vehicle import PowerModel, VehicleModel

GROUND_SPEED_TYPES = (0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimates for one flight."""

    length_m: float
    """Length of the path, horizontal and vertical."""
    time_s: float
    climb_m: float
    """Sum of all climbs."""
    photos: int
    """Number of photos; an endless series counts as one."""
    energy_wh: float | None
    """None without a power model."""
    endless: bool
    """Whether a jump repeats without end or the plan has too many steps, so that the flight is longer than
    estimated."""
    known_altitudes: bool
    """False if an altitude could not be compared with home; the leg to this altitude counts as level."""


@dataclass(frozen=True, slots=True)
class StepEstimate:
    """Estimates for one execution of an item."""

    step: Step
    leg: Leg | None
    """The leg to the item's position; None: the item has no leg."""
    time_s: float
    """Time of the leg and of the wait."""
    wait_s: float
    length_m: float
    climb_m: float
    """Altitude gained; 0 for a descent."""


def step_estimates(plan: Plan, vehicle: VehicleModel, route: Route) -> Iterator[StepEstimate]:
    """Estimates for each step of the plan's route."""
    remaining_legs = deque(legs(plan, route))
    courses = _courses(plan, route)
    speed_m_s = plan.hover_speed_m_s or vehicle.cruise_m_s
    timer = LegTimer(vehicle)
    last_placed: PlacedItem | None = None
    for step in route.steps:
        item = step.item
        leg = remaining_legs.popleft() if remaining_legs and remaining_legs[0].step is step else None
        length_m = time_s = climbed_m = 0.0
        set_m_s = min(speed_m_s, vehicle.speed_max_m_s)
        if leg is not None:
            altitude_change_m = leg.altitude_change_m or 0.0
            length_m = math.hypot(leg.length_m, altitude_change_m)
            course_rad = courses.popleft()
            next_leg = remaining_legs[0] if remaining_legs else None
            passes = next_leg is not None and _is_passed(leg, next_leg, vehicle)
            time_s = _leg_time_s(leg, timer, course_rad, set_m_s, courses[0] if passes else None, vehicle)
            climbed_m = max(0.0, altitude_change_m)
        if isinstance(item, ChangeSpeed) and item.speed_type in GROUND_SPEED_TYPES:
            speed_m_s = item.speed_m_s if (item.speed_m_s or 0.0) > 0.0 else speed_m_s
            speed_m_s = speed_m_s or vehicle.cruise_m_s
        if isinstance(item, ReturnHome):
            length_m, time_s, climbed_m = _return_estimate(plan, last_placed, timer, vehicle)
        if isinstance(item, PlacedItem) and leg is not None:
            last_placed = item
        wait_s = _wait_s(item)
        if wait_s > 0.0:
            timer.wait(wait_s)
        yield StepEstimate(step, leg, time_s + wait_s, wait_s, length_m, climbed_m)


def _courses(plan: Plan, route: Route) -> deque[float]:
    """The directions of the route's legs, from north [rad]."""
    home = plan.planned_home
    position = None if home is None else (home.lat_deg, home.lon_deg)
    courses: deque[float] = deque()
    for step in route.steps:
        item = step.item
        if not isinstance(item, PlacedItem) or not is_flown_to(item):
            continue
        if position is not None:
            north, east = item.lat_deg - position[0], item.lon_deg - position[1]
            courses.append(math.atan2(east * math.cos(math.radians(position[0])), north))
        position = item.lat_deg, item.lon_deg
    return courses


def _is_passed(leg: Leg, following: Leg, vehicle: VehicleModel) -> bool:
    """Whether PX4 flies on at the end of a leg: at a waypoint without a hold, and on a level path."""
    item = leg.step.item
    return (
        isinstance(item, Waypoint)
        and not item.hold_s
        and following.length_m >= vehicle.acceptance_m
        and abs(following.altitude_change_m or 0.0) < vehicle.altitude_acceptance_m
    )


def estimate(plan: Plan, vehicle: VehicleModel, power: PowerModel | None = None) -> Estimate:
    """Estimates a whole flight."""
    route = route_of(plan)
    length_m = time_s = climbed_m = 0.0
    photos, spacing_m, since_photo_m = 0, 0.0, 0.0
    known_altitudes = True
    for each in step_estimates(plan, vehicle, route):
        item = each.step.item
        length_m, time_s = length_m + each.length_m, time_s + each.time_s
        climbed_m += each.climb_m
        if each.leg is not None:
            known_altitudes &= each.leg.altitude_change_m is not None
            if spacing_m > 0.0:
                since_photo_m += each.leg.length_m
                photos += int(since_photo_m // spacing_m)
                since_photo_m %= spacing_m
        if isinstance(item, TriggerDistance):
            spacing_m, since_photo_m = item.distance_m or 0.0, 0.0
            photos += int(bool(item.at_once) and spacing_m > 0.0)
        if isinstance(item, PhotoStart):
            photos += max(1, int(item.count or 0))
    energy_wh = None if power is None else power.energy_wh(time_s, climbed_m)
    endless = route.endless or route.truncated or route.stalled_row is not None
    return Estimate(length_m, time_s, climbed_m, photos, energy_wh, endless, known_altitudes)


def _leg_time_s(
    leg: Leg,
    timer: LegTimer,
    course_rad: float,
    speed_m_s: float,
    next_course_rad: float | None,
    vehicle: VehicleModel,
) -> float:
    """Time of one leg [s]; `next_course_rad` is None if the vehicle stops at its end."""  # fmt: skip
    altitude_change_m = leg.altitude_change_m or 0.0
    horizontal_s = 0.0
    if leg.length_m > vehicle.acceptance_m:
        horizontal_s = timer.fly(leg.length_m, course_rad, speed_m_s, next_course_rad)
    if isinstance(leg.step.item, Takeoff):
        return horizontal_s + takeoff_time_s(max(0.0, altitude_change_m), vehicle)
    if isinstance(leg.step.item, Land):
        return horizontal_s + land_time_s(max(0.0, -altitude_change_m), vehicle)
    return max(horizontal_s, change_altitude_time_s(altitude_change_m, vehicle))


def _wait_s(item: SimpleItem) -> float:
    if isinstance(item, Waypoint | LoiterTime):
        return max(0.0, item.hold_s or 0.0)
    return max(0.0, item.delay_s or 0.0) if isinstance(item, Delay) else 0.0


def _return_estimate(
    plan: Plan, last_placed: PlacedItem | None, timer: LegTimer, vehicle: VehicleModel
) -> tuple[float, float, float]:
    """Length, time and climb of a return: climb to the return altitude, fly home, land. All are zero if the
    plan has no home. PX4 returns with MPC_XY_CRUISE, whatever speed the plan has set."""
    home = plan.planned_home
    if home is None or last_placed is None:
        return 0.0, 0.0, 0.0
    amsl_m = last_placed.altitude.amsl_m(home.alt_amsl_m)
    distance_home_m = distance_m(last_placed.lat_deg, last_placed.lon_deg, home.lat_deg, home.lon_deg)
    height_m = vehicle.return_alt_m if amsl_m is None else amsl_m - home.alt_amsl_m
    return_m = return_height_m(height_m, distance_home_m, vehicle)
    time_s = land_time_s(return_m, vehicle) + max(0.0, vehicle.return_delay_s)
    if return_m > height_m:
        time_s += change_altitude_time_s(return_m - height_m, vehicle) + SWITCH_S
        timer.wait(time_s)
    if distance_home_m > vehicle.acceptance_m:
        speed_m_s = min(vehicle.cruise_m_s, vehicle.speed_max_m_s)
        time_s += timer.fly(distance_home_m, 0.0, speed_m_s, None) + SWITCH_S
    return distance_home_m + 2.0 * return_m - height_m, time_s, return_m - height_m
