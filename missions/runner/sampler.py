"""Samples the setpoint of a script for each transmission, without I/O; time and position are inputs.

A wait holds the position until it ends. If the vehicle is too far behind on its path, or its position or the
link for its setpoints is lost, mission time stops until the vehicle has caught up. A pause slows mission time
down to zero, so that the vehicle stays on its path; resuming speeds mission time up again. Velocity and
attitude segments have no path: on a pause the vehicle brakes and holds its position, and a new script
continues from this position. After the last segment the vehicle holds the end position.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

from missions.avoidance.values import AvoidanceWay
from missions.frames import Vector3
from missions.offboard.segments import (
    AttitudeSegment,
    CurveSegment,
    Segment,
    VelocitySegment,
    WaitSegment,
)
from missions.runner.script import Script, ScriptChange, ScriptProgress
from missions.runner.time_scale import ZERO_VECTOR, TimeScale
from missions.setpoints import (
    Attitude,
    DirectSetpoint,
    Position,
    Setpoint,
    Trajectory,
    Velocity,
    complete_vector,
    zeros_for_none,
)

MAX_STEP_S = 0.3
"""Maximum step of mission time after a gap in transmission, so that the setpoint does not jump ahead."""
RETURNED_WITHIN_M = 1.0
"""After a segment without position control, the vehicle returns to the planned end of this segment. Within
this distance of the planned end, the next segment starts [m]."""
RETURN_TIMEOUT_S = 15.0
"""Time after which the next segment starts even if the vehicle is farther away [s]."""
WITH_POSITION = (Trajectory, Position)
"""Setpoints with a position. A tuple, because Python would create a union again for each `isinstance`."""
HELD_BACK_M = 8.0
"""Horizontal distance behind the setpoint (obstacle, limit, wind) at which mission time stops."""
ARRIVED_M = 1.0
"""Horizontal distance to the end of a path below which the path is complete [m]."""


class ScriptSampler:
    """Samples one script.

    Args:
        script: the script to fly.
        now_s: monotonic time.
    """

    def __init__(self, script: Script, now_s: float) -> None:
        self._number = script.number
        self._segments = list(script.segments)
        self._approach: Segment | None = script.approach
        self._change = ScriptChange()
        self._index = 0
        self._t_s = script.begin_s if script.approach is None else 0.0
        self._begin_s = script.begin_s
        resting_rate = 0.0 if self._t_s > 0.0 else 1.0
        begin_rate = resting_rate if script.begin_rate is None else script.begin_rate
        self._scale = TimeScale(script.time_scale_limits, begin_rate)
        self._last_s = now_s
        self._returning_s: float | None = None
        """Time for which the vehicle has been returning to the path; None: it is not returning."""
        self._braking_ned_m_s: Vector3 | None = None
        """Velocity of the vehicle when a velocity or attitude segment was interrupted."""
        self._stop_setpoint: Position | None = None
        """Position at which the vehicle stopped away from its path."""
        self._setpoint_ned_m: Vector3 | None = None
        self._held_back = self._was_seen = False
        self.received = True
        """Whether the link accepts the setpoints."""
        self.fence = script.fence

    def change_script(self, change: ScriptChange) -> None:
        """Pauses or resumes the script, ends waits, or appends segments, from the next setpoint on."""
        self._segments.extend(change.appended)
        self._change = replace(change, appended=())

    def restart_time(self, now_s: float) -> None:
        """Starts mission time at `now_s`. Before this call, the vehicle holds the first setpoint."""
        self._last_s = now_s

    def at(
        self,
        now_s: float,
        position_ned_m: Vector3 | None = None,
        velocity_ned_m_s: Vector3 | None = None,
        *,
        waiting: bool = False,
    ) -> DirectSetpoint:
        """The setpoint to send.

        Args:
            now_s: monotonic time.
            position_ned_m: position of the vehicle; None: unknown.
            velocity_ned_m_s: velocity of the vehicle; None: unknown.
            waiting: whether Offboard is not active yet; the first setpoint is then repeated.
        """
        dt_s = 0.0 if waiting else min(max(now_s - self._last_s, 0.0), MAX_STEP_S)
        self._last_s, self._held_back = now_s, False
        if self._leaves_path(velocity_ned_m_s):
            setpoint = self._stop_off_path(dt_s, position_ned_m)
        else:
            self._advance(dt_s, position_ned_m)
            setpoint = self._at_rate(self._sample())
        position = setpoint.position_ned_m if isinstance(setpoint, WITH_POSITION) else None
        self._setpoint_ned_m = None if position is None else complete_vector(position)
        return setpoint

    def setpoint_ahead(self, by_s: float) -> DirectSetpoint | None:
        """The planned setpoint `by_s` later, at most up to the next wait; None: unknown."""
        diverted = self._stop_setpoint is not None or self._braking_ned_m_s is not None
        if self._change.paused or diverted:
            return None
        t_s, setpoint = self._t_s + by_s, None
        segments = itertools.islice(self._segments, self._index, None)
        if self._approach is not None:
            setpoint = self._approach.at(min(t_s, self._approach.duration_s))
            if t_s <= self._approach.duration_s:
                segments = iter(())
            t_s += self._begin_s - self._approach.duration_s
        for segment in segments:
            if isinstance(segment, WaitSegment):
                break
            setpoint = segment.at(min(t_s, segment.duration_s))
            if t_s <= segment.duration_s:
                break
            t_s -= segment.duration_s
        return setpoint if isinstance(setpoint, WITH_POSITION) else None

    @property
    def avoidance(self) -> AvoidanceWay | None:
        """What obstacle avoidance tries first in the current segment; None: avoidance is off."""
        segment = self._segment()
        return None if segment is None else segment.avoidance

    @property
    def progress(self) -> ScriptProgress:
        """Progress at the last setpoint."""
        segment = self._segment()
        return ScriptProgress(
            self._number,
            self._index,
            self._begin_s if self._approach is not None else self._t_s,
            self._scale.rate,
            self._approach is not None,
            isinstance(segment, WaitSegment),
            self._stop_setpoint is not None or self._braking_ned_m_s is not None,
            self._setpoint_ned_m,
            self._held_back,
        )

    # --- along the path ---------------------------------------------------------------------------

    def _segment(self) -> Segment | None:
        if self._approach is not None:
            return self._approach
        return self._segments[self._index] if self._index < len(self._segments) else None

    def _sample(self) -> Setpoint:
        segment = self._segment()
        if segment is not None:
            return segment.at(self._t_s)
        if not self._segments:
            return Velocity(ZERO_VECTOR)
        last = self._segments[-1]
        if isinstance(last, VelocitySegment):
            return Position(last.end_ned_m, last.end_yaw_ned_rad)
        return last.at(math.inf)

    def _advance(self, dt_s: float, position_ned_m: Vector3 | None) -> None:
        self._was_seen = self._was_seen or position_ned_m is not None
        is_unseen = not self.received or (self._was_seen and position_ned_m is None)
        distance_m = self._horizontal_distance_m(self._setpoint_ned_m, position_ned_m)
        self._held_back = is_unseen or distance_m > HELD_BACK_M
        goal = 0.0 if self._change.paused or self._held_back else 1.0
        motion = (ZERO_VECTOR, ZERO_VECTOR) if self._scale.is_at(goal) else self._motion()
        self._t_s += self._scale.step(dt_s, goal, *motion)
        while (segment := self._segment()) is not None:
            if isinstance(segment, WaitSegment):
                self._t_s = 0.0
                if self._index >= self._change.first_open_wait:
                    return
            elif self._t_s < segment.duration_s or not self._has_arrived(segment, dt_s, position_ned_m):
                return
            else:
                self._t_s -= segment.duration_s
            if self._approach is not None:
                self._approach = None
                self._t_s += self._begin_s
                if self._begin_s > 0.0:
                    self._scale = TimeScale(self._scale.time_scale_limits, 0.0)
            else:
                self._index += 1
        self._t_s = 0.0

    def _motion(self) -> tuple[Vector3, Vector3]:
        """Velocity and acceleration of the path at rate 1."""
        setpoint = self._sample()
        velocity = setpoint.velocity_ned_m_s if isinstance(setpoint, Trajectory | Velocity) else ZERO_VECTOR
        acceleration = setpoint.acceleration_ned_m_s2 if isinstance(setpoint, Trajectory) else ZERO_VECTOR
        return zeros_for_none(velocity), zeros_for_none(acceleration)

    def _has_arrived(self, segment: Segment, dt_s: float, position_ned_m: Vector3 | None) -> bool:
        """Whether the next segment may start: the vehicle has arrived at the end of the current segment.

        After a segment without position control the vehicle first returns to the planned end of this segment.
        """
        if isinstance(segment, CurveSegment):
            self._held_back = self._horizontal_distance_m(segment.end_ned_m, position_ned_m) > ARRIVED_M
            if self._held_back:
                self._t_s = segment.duration_s
            return not self._held_back
        if not isinstance(segment, VelocitySegment | AttitudeSegment) or position_ned_m is None:
            return True
        self._returning_s = (self._returning_s or 0.0) + dt_s
        is_far = math.dist(position_ned_m, segment.end_ned_m) > RETURNED_WITHIN_M
        if is_far and self._returning_s < RETURN_TIMEOUT_S:
            self._t_s = segment.duration_s
            return False
        self._returning_s = None
        return True

    @staticmethod
    def _horizontal_distance_m(target_ned_m: Vector3 | None, position_ned_m: Vector3 | None) -> float:
        """Horizontal distance between two positions. The altitude does not count, because a detour over an
        obstacle changes the altitude."""
        if target_ned_m is None or position_ned_m is None:
            return 0.0
        return math.dist(target_ned_m[:2], position_ned_m[:2])

    def _at_rate(self, setpoint: Setpoint) -> DirectSetpoint:
        """A setpoint of the path at the current rate of mission time."""
        rate, change = self._scale.rate, self._scale.rate_change
        if isinstance(setpoint, Trajectory):
            if rate == 1.0 and change == 0.0:
                return setpoint
            velocity, acceleration = (
                zeros_for_none(setpoint.velocity_ned_m_s),
                zeros_for_none(setpoint.acceleration_ned_m_s2),
            )
            north, east, down = (acceleration[k] * rate * rate + velocity[k] * change for k in range(3))
            yaw_rate = setpoint.yaw_rate_ned_rad_s
            return replace(
                setpoint,
                velocity_ned_m_s=(velocity[0] * rate, velocity[1] * rate, velocity[2] * rate),
                acceleration_ned_m_s2=(north, east, down),
                yaw_rate_ned_rad_s=None if yaw_rate is None else yaw_rate * rate,
            )
        if isinstance(setpoint, Velocity) and self._returning_s is not None:
            segment = self._segment()
            assert segment is not None
            return Position(segment.end_ned_m, segment.end_yaw_ned_rad)
        assert isinstance(setpoint, Position | Velocity | Attitude)
        return setpoint

    # --- off the path -----------------------------------------------------------------------------

    def _leaves_path(self, velocity_ned_m_s: Vector3 | None) -> bool:
        """Whether a velocity or attitude segment is or becomes interrupted, so that the vehicle stops off its
        path."""
        if self._stop_setpoint is not None or self._braking_ned_m_s is not None:
            return True
        segment = self._segment()
        if not self._change.paused or self._returning_s is not None:
            return False
        if isinstance(segment, VelocitySegment):
            self._braking_ned_m_s = zeros_for_none(segment.line.at(self._t_s).velocity_ned_m_s)
        elif isinstance(segment, AttitudeSegment):
            self._braking_ned_m_s = velocity_ned_m_s or ZERO_VECTOR
        return self._braking_ned_m_s is not None

    def _stop_off_path(self, dt_s: float, position_ned_m: Vector3 | None) -> DirectSetpoint:
        segment = self._segment()
        yaw_rad = None if segment is None else segment.end_yaw_ned_rad
        if self._stop_setpoint is not None:
            return self._stop_setpoint
        velocity = self._braking_ned_m_s or ZERO_VECTOR
        self._scale.step(dt_s, 0.0, velocity, ZERO_VECTOR)
        rate = self._scale.rate
        if rate > 0.0 or position_ned_m is None:
            return Velocity((velocity[0] * rate, velocity[1] * rate, velocity[2] * rate), yaw_rad)
        self._stop_setpoint = Position(position_ned_m, yaw_rad)
        return self._stop_setpoint
