"""Checks of a compiled mission: its positions, the speed of its tables, and its duration."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from missions.check_context import UNKNOWN_PARAMETERS_FIX, unknown_parameters_text
from missions.check_space import allowed_area
from missions.obstacles import Clearance, ObstacleShapes, is_valid, obstacle_name
from missions.offboard import samples
from missions.offboard.findings import MissionFinding
from missions.offboard.segments import CurveSegment, HoldSegment, Segment, TableSegment, VelocitySegment
from missions.offboard.state import Compilation
from missions.offboard.timeline import Timeline
from missions.trajectory.limits import MotionLimits

Array = NDArray[np.float64]
SPACING_S = 0.25
"""Time between two samples of a segment [s]."""
MAX_SAMPLES = 4000
"""Maximum number of samples of one segment."""
GROUND_M = 0.3
"""A path that descends below this altitude above home gets a finding, because it may reach the ground [m]."""
TOLERANCE = 1.01
"""Factor by which tables may exceed a limit."""


def check(timeline: Timeline, compilation: Compilation) -> tuple[MissionFinding, ...]:
    """All findings about all branches of a timeline."""
    allowed = None
    findings: list[MissionFinding] = []
    if compilation.mission.fence:
        if compilation.start.origin is None:
            message = "The geofence requires the global position of the local origin, which is unknown."
            findings.append(MissionFinding("fence_unknown", message, None, "Give the mission a home."))
        else:
            allowed = allowed_area(compilation.mission.fence, compilation.start.origin)
            shapely.prepare(allowed)
    obstacles = ObstacleCheck(compilation, findings)
    for part in samples.parts(timeline, compilation.start.position_ned_m):
        start_ned_m = part.start_ned_m
        for segment in part.timeline.segments:
            count = int(min(MAX_SAMPLES, 2 + segment.duration_s / SPACING_S))
            path = samples.path_along(segment, start_ned_m, np.linspace(0.0, segment.duration_s, count))
            findings += _check_positions(segment, path, compilation)
            if allowed is not None:
                findings += _check_fence(segment, path, allowed)
            findings += obstacles.check_segment(segment, path)
            if isinstance(segment, TableSegment):
                findings += _check_table(segment, compilation.motion)
            start_ned_m = segment.end_ned_m
    findings += _check_totals(timeline, compilation)
    return tuple(findings)


def _check_positions(segment: Segment, path: Array, compilation: Compilation) -> Iterator[MissionFinding]:
    limits, start = compilation.vehicle.limits, compilation.start
    home_down_m = start.reference_ned_m[2]
    if start.origin is not None and start.home_alt_amsl_m is not None:
        home_down_m = start.origin.alt_amsl_m - start.home_alt_amsl_m
    altitudes_home_m = home_down_m - path[:, 2]
    highest_m = float(altitudes_home_m.max())
    max_m, fence_m = limits.altitude_home_max_m, limits.vehicle.fence_height_m
    if max_m is not None and highest_m > max_m + 0.01:
        message = f"{segment.title} climbs to {highest_m:.0f} m above home, the limit is {max_m:.0f} m."
        yield MissionFinding("altitude_too_high", message, segment.place, "Lower the altitude.", max_m)
    if 0.0 < fence_m < highest_m:
        message = (
            f"{segment.title} climbs to {highest_m:.0f} m above home; the geofence limit is {fence_m:.0f} m."
        )
        yield MissionFinding("altitude_fence", message, segment.place, "Lower the altitude.", fence_m)
    lowest_m = float(altitudes_home_m.min())
    if isinstance(segment, CurveSegment | TableSegment | VelocitySegment) and lowest_m < GROUND_M:
        is_target = not isinstance(segment, VelocitySegment)
        yield MissionFinding(
            "altitude_below_home",
            f"{segment.title} descends to {lowest_m:.1f} m above home.",
            segment.place,
            "Increase the altitude; down is negative above the origin.",
            is_error=is_target and lowest_m < -limits.vehicle.landing_height_m,
        )
    radius_m = limits.vehicle.fence_radius_m
    north, east = path[:, 0] - start.reference_ned_m[0], path[:, 1] - start.reference_ned_m[1]
    distance_m = float(np.hypot(north, east).max())
    if 0.0 < radius_m < distance_m:
        message = (
            f"{segment.title} is up to {distance_m:.0f} m from the start; "
            f"the geofence limit is {radius_m:.0f} m."
        )
        yield MissionFinding("radius_exceeded", message, segment.place, "Move the path nearer to the start.")
    for excess, limit_m in _beyond_operator_limits(path, highest_m, distance_m, compilation):
        message = f"{segment.title} {excess}. In flight, the server would keep the vehicle inside this limit."
        fix = "Change the step, or your limits."
        yield MissionFinding("limit_exceeded", message, segment.place, fix, limit_m)


def _beyond_operator_limits(
    path: Array, highest_m: float, distance_m: float, compilation: Compilation
) -> Iterator[tuple[str, float | None]]:
    """Yields a text and the limit for each of the operator's limits that a path exceeds; the limit is None
    unless it is an altitude [m]."""
    operator, start = compilation.vehicle.operator, compilation.start
    if operator.height_max_m is not None and highest_m > operator.height_max_m + 0.01:
        text = f"climbs to {highest_m:.0f} m above home, your limit is {operator.height_max_m:g} m"
        yield text, operator.height_max_m
    if operator.distance_max_m is not None and distance_m > operator.distance_max_m + 0.01:
        text = (
            f"is up to {distance_m:.0f} m from the start, "
            f"your limit is {operator.distance_max_m:g} m from home"
        )
        yield text, None
    if operator.fence is not None and start.origin is not None:
        outside = operator.fence.region(start.origin, "your geofence").are_outside(path[:, :2])
        if outside.any():
            north, east, _ = path[int(outside.argmax())]
            yield f"leaves your geofence near north {north:.0f} m, east {east:.0f} m", None


def _check_fence(
    segment: Segment, path: Array, allowed: shapely.geometry.base.BaseGeometry
) -> Iterator[MissionFinding]:
    line = shapely.LineString(path[:, :2])
    if allowed.covers(line):
        return
    outside = ~shapely.contains_xy(allowed, path[:, 0], path[:, 1])
    first = path[int(outside.argmax())]
    message = f"{segment.title} leaves the geofence near north {first[0]:.0f} m, east {first[1]:.0f} m."
    yield MissionFinding(
        "fence_crossed", message, segment.place, "Move the path inside, or change the geofence."
    )


def _check_table(segment: TableSegment, motion: MotionLimits) -> Iterator[MissionFinding]:
    times = np.linspace(0.0, segment.duration_s, MAX_SAMPLES)
    _, v = segment.path.sample(times)
    horizontal = float(np.hypot(v[:, 0], v[:, 1]).max())
    climb, descent = float(-v[:, 2].min()), float(v[:, 2].max())
    speeds = (
        (horizontal, motion.speed_m_s, "over the ground"),
        (climb, motion.climb_m_s, "up"),
        (descent, motion.descent_m_s, "down"),
    )
    for speed, limit, direction in speeds:
        if speed > limit * TOLERANCE:
            message = f"The table flies up to {speed:.1f} m/s {direction}, the limit is {limit:g} m/s."
            yield MissionFinding("speed_exceeded", message, segment.place, "Give the table more time.")
    a = np.diff(v, axis=0) / np.diff(times)[:, None]
    accelerations = (
        (float(np.hypot(a[:, 0], a[:, 1]).max()), motion.horizontal_acceleration_m_s2, "horizontally"),
        (float(np.abs(a[:, 2]).max()), motion.vertical_acceleration_m_s2, "vertically"),
    )
    for acceleration, limit, direction in accelerations:
        if acceleration > limit * TOLERANCE:
            message = (
                f"The table accelerates at up to {acceleration:.1f} m/s² {direction}, "
                f"the limit is {limit:.1f} m/s²."
            )
            yield MissionFinding("acceleration_exceeded", message, segment.place, "Give the table more time.")


def _check_totals(timeline: Timeline, compilation: Compilation) -> Iterator[MissionFinding]:
    limits = compilation.vehicle.limits
    if limits.unknown_parameters:
        message = unknown_parameters_text(limits.unknown_parameters)
        yield MissionFinding("parameters_unknown", message, None, UNKNOWN_PARAMETERS_FIX)
    power, needed_wh = limits.power, energy_wh(timeline, compilation)
    if power is not None and needed_wh is not None and needed_wh > power.usable_wh:
        message = (
            f"The flight takes {needed_wh:.0f} Wh ({timeline.duration_s / 60:.0f} min), the battery provides "
            f"{power.usable_wh:.0f} Wh with {power.reserve:.0%} in reserve."
        )
        yield MissionFinding("endurance_exceeded", message, None, "Shorten the mission.")


def energy_wh(timeline: Timeline, compilation: Compilation) -> float | None:
    """Energy of the longest path; None without a power model."""
    power = compilation.vehicle.limits.power
    if power is None:
        return None
    return power.energy_wh(timeline.duration_s, climb_m(timeline, compilation.start.position_ned_m[2]))


def climb_m(timeline: Timeline, down_m: float) -> float:
    """The largest total climb of all paths, from segment end to segment end."""
    climbed_m = 0.0
    for segment in timeline.segments:
        climbed_m += max(0.0, down_m - segment.end_ned_m[2])
        down_m = segment.end_ned_m[2]
    continuations = [each for each in (timeline.then, timeline.otherwise) if each is not None]
    return climbed_m + max((climb_m(each, down_m) for each in continuations), default=0.0)


MOVE_POINTS_FIX = "Move the points of this step around the obstacle or above it."
CHECK_SENSOR_FIX = "Plan the path around the obstacle, or make sure that the vehicle's sensor measures it."


class ObstacleCheck:
    """Checks the segments of one mission against its obstacles.

    Args:
        compilation: the mission, the vehicle and the start.
        findings: receives the findings about the obstacles themselves.
    """

    def __init__(self, compilation: Compilation, findings: list[MissionFinding]) -> None:
        obstacles, start = compilation.mission.obstacles, compilation.start
        self._shapes: ObstacleShapes | None = None
        if not obstacles:
            return
        origin = start.origin
        if origin is None:
            message = "The obstacles require the global position of the local origin, which is unknown."
            fix = "Give the mission a home."
            findings.append(MissionFinding("obstacles_unknown", message, None, fix))
            return
        for index, obstacle in enumerate(obstacles):
            if not is_valid(obstacle, origin):
                message = f"The sides of {obstacle_name(obstacle, index)} cross, or it has no area."
                findings.append(
                    MissionFinding(
                        "obstacle_invalid", message, None, "Draw the obstacle again.", obstacle=index
                    )
                )
        home_amsl_m = start.home_alt_amsl_m
        if home_amsl_m is None:
            home_amsl_m = origin.alt_amsl_m - start.reference_ned_m[2]
        self._shapes = ObstacleShapes(obstacles, origin, home_amsl_m)

    def check_segment(self, segment: Segment, path: NDArray[np.float64]) -> Iterator[MissionFinding]:
        """Findings about one segment.

        Args:
            segment: a segment of the timeline.
            path: (N, 3) positions along the segment.
        """
        for clearance in () if self._shapes is None else self._shapes.clearances(path):
            yield _finding(segment, clearance)


def _finding(segment: Segment, clearance: Clearance) -> MissionFinding:
    step, index = segment.place, clearance.index
    where = f"near north {clearance.north_m:.0f} m, east {clearance.east_m:.0f} m"
    if not clearance.passes_through:
        message = f"{segment.title} comes within {clearance.distance_m:.1f} m of {clearance.name} {where}."
        return MissionFinding("obstacle_near", message, step, MOVE_POINTS_FIX, obstacle=index)
    message = f"{segment.title} passes through {clearance.name} {where}"
    if segment.avoidance is None or not isinstance(segment, CurveSegment | HoldSegment | TableSegment):
        return MissionFinding("obstacle_hit", f"{message}.", step, MOVE_POINTS_FIX, obstacle=index)
    message += ": only the obstacle sensor of the vehicle can avoid the obstacle."
    return MissionFinding("obstacle_avoided", message, step, CHECK_SENSOR_FIX, obstacle=index)
