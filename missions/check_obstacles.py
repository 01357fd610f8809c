"""Checks of a plan's straight paths against its obstacles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from missions.check_context import Context, Finding, item_name
from missions.items import Land, ReturnHome, Takeoff
from missions.obstacles import Clearance, ObstacleShapes, is_valid, obstacle_name
from missions.route import FlightLine, GeoPosition, flight_lines

ADD_WAYPOINT = "Add a waypoint around the obstacle, or fly above it."


def _obstacles(context: Context) -> Iterator[Finding]:
    plan, origin = context.plan, context.origin
    if not plan.obstacles or origin is None:
        return
    for index, obstacle in enumerate(plan.obstacles):
        if not is_valid(obstacle, origin):
            subject = obstacle_name(obstacle, index)
            message = f"The sides of {subject} cross, or it has no area."
            yield Finding("obstacle_invalid", message, obstacle=index, fix="Draw the obstacle again.")
    shapes = ObstacleShapes(plan.obstacles, origin, context.home_amsl_m)
    reported: set[tuple[int, int]] = set()
    for line in flight_lines(plan, context.vehicle.return_alt_m):
        positions = [origin.to_ned(*position) for position in _flown_path(line, context)]
        for clearance in shapes.clearances(np.array(positions)):
            if (line.step.seq, clearance.index) not in reported:
                reported.add((line.step.seq, clearance.index))
                yield _finding(line, clearance)


def _flown_path(line: FlightLine, context: Context) -> list[GeoPosition]:
    """The straight path, with the climb or the descent at its ends."""
    item, home = line.step.item, context.plan.planned_home
    ground_m = line.end[2] if home is None else home.alt_amsl_m
    path = [line.start, line.end]
    if line.from_home or isinstance(item, Takeoff):
        path.insert(0, (*line.start[:2], ground_m))
    if isinstance(item, Land):
        touchdown_m = item.altitude.amsl_m(context.home_amsl_m)
        path.append((*line.end[:2], ground_m if touchdown_m is None else touchdown_m))
    elif isinstance(item, ReturnHome):
        path.append((*line.end[:2], ground_m))
    return path


def _finding(line: FlightLine, clearance: Clearance) -> Finding:
    step = line.step
    subject = f"The straight path to {item_name(step.row, step.item).lower()}"
    if isinstance(step.item, ReturnHome):
        subject = f"The straight path home of {item_name(step.row, step.item).lower()}"
    if clearance.passes_through:
        message = f"{subject} passes through {clearance.name}."
        return Finding("obstacle_hit", message, step.row, obstacle=clearance.index, fix=ADD_WAYPOINT)
    message = f"{subject} comes within {clearance.distance_m:.1f} m of {clearance.name}."
    return Finding("obstacle_near", message, step.row, obstacle=clearance.index, fix=ADD_WAYPOINT)


RULES = (_obstacles,)
