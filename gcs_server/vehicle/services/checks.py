"""Checks before anything is sent, because PX4 accepts invalid values without an error."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from gcs_server.errors import InvalidRequest, Refused
from gcs_server.vehicle.samples import GlobalPosition, Home
from gcs_server.vehicle.services.port import VehiclePort
from missions.floor import LANDING_HEIGHT_M, Floor
from missions.geodesy import distance_m
from missions.terrain.ground import Ground

MAX_POSITION_AGE_S = 3.0
MIN_CLIMB_M = 0.2
"""PX4 does not climb if the take-off altitude is less than this above the vehicle [m]."""


def check_range(field: str, value: float, low: float, high: float) -> float:
    """Returns `value` if it is a number within the range.

    Raises:
        InvalidRequest: the value is invalid; the error names the field.
    """
    if not math.isfinite(value):
        raise InvalidRequest(field, f"{field} must be a number, not {value}.")
    if not low <= value <= high:
        raise InvalidRequest(field, f"{field} must be from {low:g} to {high:g}, not {value:g}.")
    return float(value)


def position_of(vehicle: VehiclePort) -> GlobalPosition:
    """The vehicle's current position.

    Raises:
        Refused: the vehicle has no global position estimate.
    """
    sample = vehicle.topic("global_position")
    age_s = None if sample is None else vehicle.clock.monotonic_s() - sample.received_monotonic_s
    if sample is None or age_s is None or age_s > MAX_POSITION_AGE_S:
        raise Refused(
            f"Vehicle {vehicle.id} reports no global position now.",
            remedy="Wait until GPS and estimator are ready (a clear view of the sky).",
        )
    assert isinstance(sample.value, GlobalPosition)
    return sample.value


def home_of(vehicle: VehiclePort) -> Home:
    """The vehicle's home position.

    Raises:
        Refused: the vehicle has no home position yet, so that an altitude above home is undefined.
    """
    sample = vehicle.topic("home")
    if sample is None:
        raise Refused(
            f"Vehicle {vehicle.id} has no home position yet, so an altitude above home is undefined.",
            remedy="Wait until GPS and estimator are ready.",
        )
    assert isinstance(sample.value, Home)
    return sample.value


def require_climb(vehicle: VehiclePort, alt_home_m: float, home_alt_amsl_m: float) -> float:
    """Checks that a take-off makes the vehicle climb; returns the take-off altitude above mean sea level [m].

    PX4 also accepts a take-off altitude below the vehicle ("Already higher than takeoff altitude"). PX4
    then arms without climbing: it disarms after some seconds, or the vehicle hovers just above the ground.

    Args:
        vehicle: the vehicle, on the ground.
        alt_home_m: the take-off altitude above home [m].
        home_alt_amsl_m: altitude of home above mean sea level [m].

    Raises:
        InvalidRequest: the vehicle would not climb.
        Refused: the vehicle has no global position estimate.
    """
    vehicle_alt_home_m = position_of(vehicle).alt_amsl_m - home_alt_amsl_m
    if alt_home_m < vehicle_alt_home_m + MIN_CLIMB_M:
        lowest_alt_home_m = math.ceil(vehicle_alt_home_m + 1.0)
        raise InvalidRequest(
            "alt_home_m",
            f"alt_home_m {alt_home_m:g} is not above vehicle {vehicle.id}, which is "
            f"{vehicle_alt_home_m:.1f} m above home: PX4 would arm without climbing.",
            remedy=f"Use at least {lowest_alt_home_m} m, or arm first: PX4 then sets home to the vehicle's "
            "position.",
        )
    return home_alt_amsl_m + alt_home_m


def require_above_ground(
    vehicle: VehiclePort, floor: Floor, lat_deg: float, lon_deg: float, alt_amsl_m: float
) -> None:
    """Checks that a target is not below the ground.

    Raises:
        Refused: the target is lower than `floor` allows.
    """
    position = position_of(vehicle)
    now = (position.lat_deg, position.lon_deg, position.alt_amsl_m)
    too_low = floor.too_low(np.array([lat_deg]), np.array([lon_deg]), np.array([alt_amsl_m]), now)
    if too_low is not None:
        raise Refused(f"The target is {too_low.text}.", remedy=too_low.remedy)


def require_near(
    vehicle: VehiclePort, lat_deg: float, lon_deg: float, alt_amsl_m: float, max_m: float
) -> None:
    """Checks that a target is at most `max_m` away from the vehicle [m].

    Raises:
        Refused: the target is farther, or the vehicle has no global position estimate.
    """
    position = position_of(vehicle)
    horizontal_m = distance_m(position.lat_deg, position.lon_deg, lat_deg, lon_deg)
    target_distance_m = math.hypot(horizontal_m, alt_amsl_m - position.alt_amsl_m)
    if target_distance_m > max_m:
        raise Refused(
            f"The target is {target_distance_m:.0f} m away, more than the allowed {max_m:.0f} m.",
            remedy="Check the coordinates, or raise max_distance_m if this is intended.",
        )


LANDING_HEIGHT_PARAMETER = "MPC_LAND_ALT3"
MAX_LANDING_HEIGHT_M = 10.0


class VehicleFloor:
    """The floor of one vehicle. `grounds` is the known ground around the vehicle and its targets; the server
    reads it from the elevation files."""

    def __init__(self, vehicle: VehiclePort, parameter: Callable[[str], float | None]) -> None:
        """
        Args:
            vehicle: the vehicle.
            parameter: the newest known value of a parameter; None: unknown.
        """
        self._vehicle = vehicle
        self._parameter = parameter
        self.grounds: Sequence[Ground] = ()

    def now(self) -> Floor:
        """The lowest altitudes now."""
        sample = self._vehicle.topic("home")
        home = sample.value if sample is not None and isinstance(sample.value, Home) else None
        landing_height_m = self._parameter(LANDING_HEIGHT_PARAMETER)
        if landing_height_m is None or not 0.0 <= landing_height_m <= MAX_LANDING_HEIGHT_M:
            landing_height_m = LANDING_HEIGHT_M
        position = None if home is None else (home.lat_deg, home.lon_deg, home.alt_amsl_m)
        return Floor(position, self.grounds, landing_height_m)
