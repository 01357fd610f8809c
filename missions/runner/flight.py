"""State of one offboard mission in flight: its path, its progress, and the scripts (setpoints of the next
segments) that continue it."""

from __future__ import annotations

import math

from missions.errors import PlanError
from missions.frames import Vector3, wrap_pi
from missions.offboard.segments import CurveSegment, HoldSegment, Segment, TableSegment
from missions.offboard.timeline import Timeline
from missions.runner.course import Course
from missions.runner.reading import Reading
from missions.runner.script import Script, TimeScaleLimits
from missions.setpoints import Position, Trajectory, complete_vector
from missions.trajectory.limits import MotionLimits
from missions.trajectory.points import PassPoint
from missions.trajectory.solve import curve_through_points

ON_PATH_M = 0.3
ON_PATH_RAD = math.radians(5.0)
"""A vehicle whose distance and heading are within these tolerances of the path needs no approach."""
MAX_MESSAGE_BYTES = 400_000
"""Maximum size of the segments in one message, because the stream process reads the message between two
setpoints."""
MAX_MESSAGE_S = 120.0
"""Maximum duration of the segments in one message."""
ROW_BYTES = 150
"""Approximate bytes of one row of a table."""


class Flight:
    """The state of one offboard mission during one flight.

    Args:
        timeline: the mission, compiled for the vehicle's position.
        name: name of the mission.
        motion: limits for approaches and pauses, including the speed.
        mode: mode in which the vehicle follows the setpoints, as in the API's `Status.mode`.
    """

    def __init__(self, timeline: Timeline, name: str, motion: MotionLimits, mode: str = "offboard") -> None:
        self.course = Course(timeline)
        """The path through the mission's branches."""
        self.actions = timeline.actions
        self.needs = timeline.needs
        self.fence = timeline.fence
        self.name, self.mode = name, mode
        self.motion = motion
        self.time_scale_limits = TimeScaleLimits(
            motion.horizontal_acceleration_m_s2, motion.vertical_acceleration_m_s2, motion.jerk_m_s3
        )
        self.index = 0
        """Index of the current segment in `course.segments`."""
        self.t_s = 0.0
        """Mission time since the start of the segment."""
        self.begin_rate: float | None = None
        """Rate of mission time at which the vehicle already flies along the path when its next script begins;
        None: the script begins with an approach from its position."""
        self.paused = False
        self.started_by_pilot = True
        """Whether a pilot or another station started the mission by selecting its flight mode; valid after
        the start of the mission."""
        self.photo_index = 0
        """Index of the first segment whose photos are not all taken."""
        self.photos_taken = 0
        """Number of photos taken in the segment `photo_index`."""
        self.last_gimbal_request: tuple[float, float, float] | None = None
        """Last gimbal request: pitch, yaw relative to north [rad], and its time; None: no request."""
        self._script_count = 0

    @property
    def segment(self) -> Segment | None:
        """The current segment; None: the last segment has ended."""
        segments = self.course.segments
        return segments[self.index] if self.index < len(segments) else None

    def move_to(self, index: int) -> None:
        """Continues with another segment; photos of skipped segments are not taken."""
        self.index, self.t_s = index, 0.0
        self.photo_index, self.photos_taken = index, 0

    def chunk_end(self, first: int, end_index: int) -> int:
        """End index (exclusive) of the segments, starting at `first`, that fit into one message."""
        total_bytes, duration_s, end = 0, 0.0, first
        while end < end_index and (
            end == first or (total_bytes < MAX_MESSAGE_BYTES and duration_s < MAX_MESSAGE_S)
        ):
            total_bytes += _segment_bytes(self.course.segments[end])
            duration_s += self.course.segments[end].duration_s
            end += 1
        return end

    def script(self, reading: Reading, end_index: int) -> tuple[Script, int, int]:
        """The script from the current position, the index of its first segment, and the index after its last
        segment.

        Raises:
            PlanError: The approach to the path cannot be flown, or the vehicle's position is unknown.
        """
        position_ned_m = reading.position_ned_m
        self._script_count += 1
        if self.index >= end_index or self.segment is None:
            # No segment to fly: hold the position until the next segment is known.
            end = position_ned_m or (0.0, 0.0, 0.0)
            yaw_rad = reading.yaw_ned_rad or 0.0
            hold = HoldSegment("the end", "Hold", 0.0, end, yaw_rad)
            script = Script(
                self.name,
                (hold,),
                time_scale_limits=self.time_scale_limits,
                number=self._script_count,
                fence=self.fence,
            )
            # The hold takes the index before `self.index`, so that the mission is at `self.index` after it.
            return script, self.index - 1, self.index
        end = self.chunk_end(self.index, end_index)
        segments = tuple(self.course.segments[self.index : end])
        begin_rate, self.begin_rate = self.begin_rate, None
        if begin_rate is None:
            begin_s = self.t_s if isinstance(segments[0], CurveSegment | TableSegment | HoldSegment) else 0.0
            approach = self._approach(reading, segments[0], begin_s)
        else:
            begin_s, approach = self.t_s, None
        script = Script(
            self.name, segments, begin_s, approach, self.time_scale_limits, self._script_count, begin_rate,
            self.fence,
        )  # fmt: skip
        return script, self.index, end

    def _approach(self, reading: Reading, segment: Segment, begin_s: float) -> CurveSegment | None:
        position_ned_m, yaw_rad = reading.position_ned_m, reading.yaw_ned_rad
        if position_ned_m is None:
            raise PlanError(segment.place, "the vehicle's position is unknown", "Wait for a valid estimate.")
        start_ned_m, start_yaw_rad = _start_of(self.course.segments, self.index, segment, begin_s)
        if start_ned_m is None:
            return None
        if start_yaw_rad is None or yaw_rad is None:
            turn_rad, ends = 0.0, (PassPoint(position_ned_m), PassPoint(start_ned_m))
        else:
            turn_rad = abs(wrap_pi(start_yaw_rad - yaw_rad))
            ends = (PassPoint(position_ned_m, yaw_rad), PassPoint(start_ned_m, start_yaw_rad))
        if math.dist(position_ned_m, start_ned_m) < ON_PATH_M and turn_rad < ON_PATH_RAD:
            return None
        if self.fence is not None and self.fence.line_leaves(position_ned_m[:2], start_ned_m[:2]):
            raise PlanError(
                segment.place,
                "the straight path to this step leaves the mission's geofence",
                "Fly to a position from which the straight path stays inside, then resume the mission.",
            )
        curve = curve_through_points(ends, self.motion)
        end_yaw_rad = (yaw_rad or 0.0) if start_yaw_rad is None else start_yaw_rad
        return CurveSegment(
            segment.place, "Approach", curve.duration_s, start_ned_m, end_yaw_rad, curve.length_m,
            avoidance=segment.avoidance, executed_step=segment.executed_step, curve=curve,
        )  # fmt: skip


def _start_of(
    segments: list[Segment], index: int, segment: Segment, begin_s: float
) -> tuple[Vector3 | None, float | None]:
    """Position and heading at the start of a segment."""
    setpoint = segment.at(begin_s)
    if isinstance(setpoint, Trajectory | Position):
        return complete_vector(setpoint.position_ned_m), setpoint.yaw_ned_rad
    if index > 0:  # a segment of velocities or attitudes starts where the previous segment ends
        return segments[index - 1].end_ned_m, segment.end_yaw_ned_rad
    return None, segment.end_yaw_ned_rad


def _segment_bytes(segment: Segment) -> int:
    """Approximate size of a segment's arrays in bytes."""
    if isinstance(segment, CurveSegment):
        return segment.curve.coefficients.nbytes + 5 * segment.curve.phase_start_s.nbytes
    if isinstance(segment, TableSegment):
        return ROW_BYTES * segment.path.point_count
    return 0
