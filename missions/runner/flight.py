"""What all parts of one flight share: its course, where it is on it, how it goes on from there."""

from __future__ import annotations

import math

from missions.errors import PlanError
from missions.frames import Vector3, wrap_pi
from missions.offboard.segments import CurveSegment, HoldSegment, Segment, TableSegment
from missions.offboard.timeline import Timeline
from missions.runner.course import Course
from missions.runner.reading import Reading
from missions.runner.script import Pace, Script
from missions.setpoints import Position, Trajectory, complete
from missions.trajectory.limits import MotionLimits
from missions.trajectory.points import PassPoint
from missions.trajectory.solve import through

ON_PATH_M = 0.3
"""A vehicle so near to its path needs no approach."""
ON_PATH_RAD = math.radians(5.0)
MAX_AT_ONCE_BYTES = 400_000
"""Of segments handed over in one message: the streams' process takes it between two setpoints."""
MAX_AT_ONCE_S = 120.0
ROW_BYTES = 150
"""Of a table's row."""


class Flight:
    """One mission in one flight.

    Args:
        timeline: compiled for where the vehicle is.
        name: of the mission.
        motion: what approaches and pauses keep to, its speed the one wanted.
    """

    def __init__(self, timeline: Timeline, name: str, motion: MotionLimits) -> None:
        self.course = Course(timeline)
        self.actions = timeline.actions
        self.needs = timeline.needs
        self.fence = timeline.fence
        self.name = name
        self.motion = motion
        self.pace = Pace(
            motion.horizontal_acceleration_m_s2, motion.vertical_acceleration_m_s2, motion.jerk_m_s3
        )
        self.index = 0
        """Of the segment that is flown, in `course.segments`."""
        self.t_s = 0.0
        """The mission's own time in it."""
        self.paused = False
        self.photo_index = 0
        """Pictures before this segment …"""
        self.photos_taken = 0
        """… and so many of its own have been taken."""
        self.pointed: tuple[float, float, float] | None = None
        """Where the gimbal was last pointed (pitch, yaw from north [rad]), and when; None: not at all."""
        self._scripts = 0

    @property
    def segment(self) -> Segment | None:
        """The present one; None after the last."""
        segments = self.course.segments
        return segments[self.index] if self.index < len(segments) else None

    def move_to(self, index: int) -> None:
        """Goes on with another segment; the pictures of those between are not taken."""
        self.index, self.t_s = index, 0.0
        self.photo_index, self.photos_taken = index, 0

    def chunk_end(self, first: int, cut: int) -> int:
        """Index after the segments that are handed over at once."""
        size, duration_s, end = 0, 0.0, first
        while end < cut and (end == first or (size < MAX_AT_ONCE_BYTES and duration_s < MAX_AT_ONCE_S)):
            size += _size(self.course.segments[end])
            duration_s += self.course.segments[end].duration_s
            end += 1
        return end

    def script(self, reading: Reading, cut: int) -> tuple[Script, int, int]:
        """From the present place on: the script, the index of its first segment, and the one after its last.

        Raises:
            PlanError: The way to the path cannot be flown, or it is not known where the vehicle is.
        """
        here = reading.position_ned_m
        self._scripts += 1
        if (
            self.index >= cut or self.segment is None
        ):  # nothing to fly: hold here until it is known what follows
            end = here or (0.0, 0.0, 0.0)
            yaw_rad = reading.yaw_ned_rad or 0.0
            held = HoldSegment("the end", "Hold", 0.0, end, yaw_rad)
            script = Script(self.name, (held,), pace=self.pace, number=self._scripts, fence=self.fence)
            return script, self.index - 1, self.index
        end = self.chunk_end(self.index, cut)
        segments = tuple(self.course.segments[self.index : end])
        begin_s = self.t_s if isinstance(segments[0], CurveSegment | TableSegment | HoldSegment) else 0.0
        approach = self._approach(reading, segments[0], begin_s)
        script = Script(self.name, segments, begin_s, approach, self.pace, self._scripts, self.fence)
        return script, self.index, end

    def _approach(self, reading: Reading, segment: Segment, begin_s: float) -> CurveSegment | None:
        here, yaw_rad = reading.position_ned_m, reading.yaw_ned_rad
        if here is None:
            raise PlanError(segment.place, "the vehicle's position is not known", "Wait for its estimate.")
        begin, begin_yaw_rad = _begin_of(self.course.segments, self.index, segment, begin_s)
        if begin is None:
            return None
        if begin_yaw_rad is None or yaw_rad is None:
            turn_rad, ends = 0.0, (PassPoint(here), PassPoint(begin))
        else:
            turn_rad = abs(wrap_pi(begin_yaw_rad - yaw_rad))
            ends = (PassPoint(here, yaw_rad), PassPoint(begin, begin_yaw_rad))
        if math.dist(here, begin) < ON_PATH_M and turn_rad < ON_PATH_RAD:
            return None
        if self.fence is not None and self.fence.is_left_between(here[:2], begin[:2]):
            raise PlanError(
                segment.place,
                "the straight way there leaves the mission's geofence",
                "Fly to where the straight way stays inside, then resume.",
            )
        curve = through(ends, self.motion)
        end_yaw_rad = (yaw_rad or 0.0) if begin_yaw_rad is None else begin_yaw_rad
        return CurveSegment(
            segment.place, "Approach", curve.duration_s, begin, end_yaw_rad, curve.length_m,
            avoidance=segment.avoidance, visit=segment.visit, curve=curve,
        )  # fmt: skip


def _begin_of(
    segments: list[Segment], index: int, segment: Segment, begin_s: float
) -> tuple[Vector3 | None, float | None]:
    """Place and heading where a segment begins."""
    setpoint = segment.at(begin_s)
    if isinstance(setpoint, Trajectory | Position):
        return complete(setpoint.position_ned_m), setpoint.yaw_ned_rad
    if index > 0:  # a velocity or an attitude begins where the one before it ends
        return segments[index - 1].end_ned_m, segment.end_yaw_ned_rad
    return None, segment.end_yaw_ned_rad


def _size(segment: Segment) -> int:
    """About how many bytes its arrays have."""
    if isinstance(segment, CurveSegment):
        return segment.curve.coefficients.nbytes + 5 * segment.curve.phase_start_s.nbytes
    if isinstance(segment, TableSegment):
        return ROW_BYTES * segment.path.rows
    return 0
