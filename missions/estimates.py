"""Length, time, photos and energy of a plan.

The time of a leg is the longer of its horizontal and its vertical part. Horizontally the vehicle accelerates
and brakes with `acceleration_m_s2` and stops at every waypoint (trapezoidal speed profile). PX4 flies gentle
corners without stopping, so the real flight takes less time. The vertical speed is constant. Wind is not
included.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from missions.camera_items import PhotoStart, TriggerDistance
from missions.geodesy import distance_m
from missions.items import ChangeSpeed, Delay, Land, LoiterTime, PlacedItem, ReturnHome, Takeoff, Waypoint
from missions.plan import Plan, SimpleItem
from missions.route import Leg, Route, Step, legs, route_of
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
    speed_m_s = plan.hover_speed_m_s or vehicle.cruise_m_s
    last_placed: SimpleItem | None = None
    for step in route.steps:
        item = step.item
        leg = remaining_legs.popleft() if remaining_legs and remaining_legs[0].step is step else None
        length_m = time_s = climbed_m = 0.0
        if leg is not None:
            altitude_change_m = leg.altitude_change_m or 0.0
            length_m = math.hypot(leg.length_m, altitude_change_m)
            time_s = leg_time_s(leg, min(speed_m_s, vehicle.speed_max_m_s), vehicle)
            climbed_m = max(0.0, altitude_change_m)
        if isinstance(item, ChangeSpeed) and item.speed_type in GROUND_SPEED_TYPES:
            speed_m_s = item.speed_m_s if (item.speed_m_s or 0.0) > 0.0 else speed_m_s
            speed_m_s = speed_m_s or vehicle.cruise_m_s
        if isinstance(item, ReturnHome):
            length_m, time_s, climbed_m = _return_estimate(plan, last_placed, speed_m_s, vehicle)
        if isinstance(item, PlacedItem) and leg is not None:
            last_placed = item
        wait_s = _wait_s(item)
        yield StepEstimate(step, leg, time_s + wait_s, wait_s, length_m, climbed_m)


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


def leg_time_s(leg: Leg, speed_m_s: float, vehicle: VehicleModel) -> float:
    """Time of one leg [s], from rest to rest."""
    horizontal_s = travel_time_s(leg.length_m, speed_m_s, vehicle.acceleration_m_s2)
    altitude_change_m = leg.altitude_change_m or 0.0
    if isinstance(leg.step.item, Takeoff):
        return horizontal_s + max(0.0, altitude_change_m) / vehicle.takeoff_m_s
    if isinstance(leg.step.item, Land):
        return horizontal_s + land_time_s(max(0.0, -altitude_change_m), vehicle)
    vertical_m_s = vehicle.climb_m_s if altitude_change_m >= 0.0 else vehicle.descent_m_s
    return max(horizontal_s, abs(altitude_change_m) / vertical_m_s)


def travel_time_s(length_m: float, speed_m_s: float, acceleration_m_s2: float) -> float:
    """Time from rest to rest with a trapezoidal speed profile [s]."""
    ramp_m = speed_m_s**2 / acceleration_m_s2
    if length_m >= ramp_m:
        return length_m / speed_m_s + speed_m_s / acceleration_m_s2
    return 2.0 * math.sqrt(length_m / acceleration_m_s2)


def land_time_s(height_m: float, vehicle: VehicleModel) -> float:
    """Time to descend to the ground and land [s]."""
    slow_m = min(height_m, vehicle.land_slow_m)
    return (height_m - slow_m) / vehicle.descent_m_s + slow_m / vehicle.land_m_s


def _wait_s(item: SimpleItem) -> float:
    if isinstance(item, Waypoint | LoiterTime):
        return max(0.0, item.hold_s or 0.0)
    return max(0.0, item.delay_s or 0.0) if isinstance(item, Delay) else 0.0


def _return_estimate(
    plan: Plan, last_placed: SimpleItem | None, speed_m_s: float, vehicle: VehicleModel
) -> tuple[float, float, float]:
    """Length, time and climb of a return: climb to the return altitude, fly home, land. All are zero if the
    plan has no home."""
    home = plan.planned_home
    if home is None or not isinstance(last_placed, PlacedItem):
        return 0.0, 0.0, 0.0
    amsl_m = last_placed.altitude.amsl_m(home.alt_amsl_m)
    altitude_home_m = vehicle.return_alt_m if amsl_m is None else amsl_m - home.alt_amsl_m
    return_m = max(altitude_home_m, vehicle.return_alt_m)
    horizontal_m = distance_m(last_placed.lat_deg, last_placed.lon_deg, home.lat_deg, home.lon_deg)
    time_s = (return_m - altitude_home_m) / vehicle.climb_m_s + land_time_s(return_m, vehicle)
    time_s += travel_time_s(horizontal_m, speed_m_s, vehicle.acceleration_m_s2)
    return horizontal_m + 2.0 * return_m - altitude_home_m, time_s, return_m - altitude_home_m
