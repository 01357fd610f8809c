"""Checks of a compiled mission against the obstacles of its document."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from missions.obstacles import Clearance, ObstacleShapes, is_valid, obstacle_name
from missions.offboard.findings import MissionFinding
from missions.offboard.segments import CurveSegment, HoldSegment, Segment, TableSegment
from missions.offboard.state import Compilation

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
