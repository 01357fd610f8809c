"""Height of a flight above the ground: findings about a waypoint plan and about an offboard mission."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from missions.check_context import Finding, item_name
from missions.floor import HOME_TOLERANCE_M, LANDING_HEIGHT_M
from missions.geodesy import LocalOrigin
from missions.items import PlacedItem, ReturnHome
from missions.offboard.findings import MissionFinding
from missions.offboard.samples import Leg
from missions.plan import Plan
from missions.route import FlightLine, Step, flight_lines
from missions.terrain.ground import Ground, line_positions

CLEARANCE_M = 10.0
"""Minimum clearance [m]: elevation models have errors of a few metres, and most do not include trees."""
OUTDATED_M = 1.0
"""A resolved altitude that differs more from the elevation data is outdated."""
MIN_LEG_M = 1.0
"""Shortest horizontal length of a checked leg [m]; on a shorter leg the vehicle climbs, descends or holds."""


def plan_findings(plan: Plan, ground: Ground, return_alt_m: float) -> Iterator[Finding]:
    """Findings about a waypoint plan from the elevation data, at most one for each item.

    Args:
        plan: a plan with resolved terrain altitudes; paths with an unknown altitude are skipped.
        ground: ground of the plan's area.
        return_alt_m: the vehicle's RTL_RETURN_ALT, above home.
    """
    home = plan.planned_home
    if home is not None:
        ground_m = ground.altitude_amsl_m(home.lat_deg, home.lon_deg)
        if ground_m is not None and abs(ground_m - home.alt_amsl_m) > HOME_TOLERANCE_M:
            message = (
                f"Home is planned at {home.alt_amsl_m:.0f} m AMSL; in the elevation data, the ground there "
                f"is at {ground_m:.0f} m AMSL."
            )
            yield Finding("home_off_ground", message, fix="Check the altitude of the planned home.")
    for line in flight_lines(plan, return_alt_m):
        if isinstance(line.step.item, PlacedItem):
            yield from _outdated_altitude(line.step, line.step.item, ground)
        yield from _low_clearance(line, ground)


def _outdated_altitude(step: Step, item: PlacedItem, ground: Ground) -> Iterator[Finding]:
    altitude = item.altitude
    if altitude.reference != "terrain" or altitude.resolved_amsl_m is None:
        return
    ground_m = ground.altitude_amsl_m(item.lat_deg, item.lon_deg)
    if ground_m is None:
        return
    above_m = altitude.resolved_amsl_m - ground_m
    if abs(above_m - altitude.value_m) > OUTDATED_M:
        message = (
            f"{item_name(step.row, step.item)} would be {above_m:.0f} m above the ground, not "
            f"{altitude.value_m:.0f} m: the item was moved, or the elevation data changed."
        )
        yield Finding("terrain_outdated", message, step.row, fix="Resolve the altitudes again.")


def _low_clearance(flight_line: FlightLine, ground: Ground) -> Iterator[Finding]:
    step, start, end = flight_line.step, flight_line.start, flight_line.end
    line = line_positions(start[:2], end[:2], ground.spacing_m)
    path_amsl_m = start[2] + (end[2] - start[2]) * line[:, 2]
    above_m = path_amsl_m - ground.altitudes_amsl_m(line[:, 0], line[:, 1])
    if np.isnan(above_m).all():
        return
    lowest_m = float(np.nanmin(above_m))
    subject = f"The straight path to {item_name(step.row, step.item).lower()}"
    if isinstance(step.item, ReturnHome):
        subject = f"The straight path home of {item_name(step.row, step.item).lower()}"
    code_and_message = _code_and_message(lowest_m, subject)
    if code_and_message is not None:
        yield Finding(
            *code_and_message,
            step.row,
            fix="Increase the altitude of this item, or set its altitude above terrain.",
        )


def mission_findings(legs: Sequence[Leg], origin: LocalOrigin, ground: Ground) -> Iterator[MissionFinding]:
    """Findings about an offboard mission from the elevation data, at most one for each step.

    Args:
        legs: legs of the compiled mission.
        origin: origin of the local frame of the legs.
        ground: ground of the mission's area.
    """
    lowest_m: dict[str, float] = {}
    for leg in legs:
        positions_ned_m = np.array(leg.points)[:, 1:]
        if np.hypot(*np.ptp(positions_ned_m[:, :2], axis=0)) < MIN_LEG_M:
            continue
        lat_deg, lon_deg, amsl_m = origin.to_geodetic_arrays(positions_ned_m)
        above_m = amsl_m - ground.altitudes_amsl_m(lat_deg, lon_deg)
        if not np.isnan(above_m).all():
            lowest_m[leg.place] = min(lowest_m.get(leg.place, math.inf), float(np.nanmin(above_m)))
    for place, height_m in lowest_m.items():
        code_and_message = _code_and_message(height_m, "The path")
        if code_and_message is not None:
            yield MissionFinding(
                *code_and_message, place, fix="Increase the altitude of the points of this step."
            )


def rows_on_known_ground(plan: Plan, ground: Ground) -> Iterator[int]:
    """Rows of the items below which the ground is known, so that home says nothing about it."""
    for row, item in plan.simple_items():
        if isinstance(item, PlacedItem) and ground.altitude_amsl_m(item.lat_deg, item.lon_deg) is not None:
            yield row


def steps_on_known_ground(legs: Sequence[Leg], origin: LocalOrigin, ground: Ground) -> Iterator[str]:
    """Steps below whose whole path the ground is known and below the path."""
    lowest_m: dict[str, float] = {}
    for leg in legs:
        lat_deg, lon_deg, amsl_m = origin.to_geodetic_arrays(np.array(leg.points)[:, 1:])
        above_m = amsl_m - ground.altitudes_amsl_m(lat_deg, lon_deg)
        above_m[np.isnan(above_m)] = -math.inf
        lowest_m[leg.place] = min(lowest_m.get(leg.place, math.inf), float(above_m.min()))
    return (place for place, height_m in lowest_m.items() if height_m >= -LANDING_HEIGHT_M)


def _code_and_message(lowest_m: float, subject: str) -> tuple[str, str] | None:
    """Code and message of the finding about the lowest height above the ground; None: no finding."""
    if lowest_m <= 0.0:
        return "terrain_hit", f"{subject} goes {-lowest_m:.0f} m below the ground."
    if lowest_m < CLEARANCE_M:
        return "terrain_near", f"{subject} comes within {lowest_m:.0f} m of the ground."
    return None
