"""Samples a script at each sending. Pure: it is told the time and where the vehicle is.

A wait holds until it is over. A vehicle that is held back on its path is waited for. Paused, the mission's
own time slows down to a standstill, so that the vehicle stays on its path, and speeds up again. A velocity or
an attitude has no path: paused, the vehicle brakes and holds where it has stopped, and the flight goes on
from there with another script. After the last segment its end is held.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

from missions.frames import Vector3
from missions.offboard.segments import (
    AttitudeSegment,
    CurveSegment,
    Segment,
    VelocitySegment,
    WaitSegment,
)
from missions.runner.script import Played, Script, Steering
from missions.runner.time_scale import TimeScale
from missions.setpoints import Attitude, DirectSetpoint, Position, Setpoint, Trajectory, Velocity, complete
from missions.setpoints import zeros_for_none as whole

LONGEST_STEP_S = 0.3
"""Where sending stood still for longer, the mission's time did, too: a setpoint must not run ahead."""
BACK_WITHIN_M = 1.0
"""After a segment that holds no place: so near must the vehicle be to where the next one begins."""
BACK_WITHIN_S = 15.0
HELD_BACK_M = 8.0
"""A vehicle so far behind over the ground (an obstacle, a limit, wind) is waited for."""
ARRIVED_M = 2.0
"""So near to its end, over the ground, is a path flown to its end."""
STILL: Vector3 = (0.0, 0.0, 0.0)


class Player:
    """One script.

    Args:
        script: what is flown.
        now_s: monotonic time.
    """

    def __init__(self, script: Script, now_s: float) -> None:
        self._number = script.number
        self._segments = list(script.segments)
        self._approach: Segment | None = script.approach
        self._steering = Steering()
        self._index = 0
        self._t_s = script.begin_s if script.approach is None else 0.0
        self._begin_s = script.begin_s
        self._scale = TimeScale(script.pace, 0.0 if self._t_s > 0.0 else 1.0)
        self._last_s = now_s
        self._returning_s: float | None = None
        """For how long the vehicle has been on its way back to the path."""
        self._braking_ned_m_s: Vector3 | None = None
        """The velocity at which an interrupted attitude left the vehicle."""
        self._held: Position | None = None
        """Where the vehicle stopped off its path."""
        self._position: Vector3 | None = None
        self._held_back = False
        self.fence = script.fence

    def steer(self, steering: Steering) -> None:
        """Takes effect at the next sampling."""
        self._segments.extend(steering.appended)
        self._steering = replace(steering, appended=())

    def begin_anew(self, now_s: float) -> None:
        """The flight begins now; the first setpoint was held so far."""
        self._last_s = now_s

    def at(
        self,
        now_s: float,
        position_ned_m: Vector3 | None = None,
        velocity_ned_m_s: Vector3 | None = None,
        *,
        waiting: bool = False,
    ) -> DirectSetpoint:
        """What to send.

        Args:
            now_s: the moment.
            position_ned_m: where the vehicle is, as far as known.
            velocity_ned_m_s: its velocity, as far as known.
            waiting: the flight has not begun: the first setpoint is held.
        """
        dt_s = 0.0 if waiting else min(max(now_s - self._last_s, 0.0), LONGEST_STEP_S)
        self._last_s, self._held_back = now_s, False
        if self._diverts(velocity_ned_m_s):
            setpoint = self._stop_off_path(dt_s, position_ned_m)
        else:
            self._advance(dt_s, position_ned_m)
            setpoint = self._slowed(self._sample())
        place = setpoint.position_ned_m if isinstance(setpoint, Position | Trajectory) else None
        self._position = None if place is None else complete(place)
        return setpoint

    def ahead(self, by_s: float) -> DirectSetpoint | None:
        """The setpoint so much later by plan, at most up to the next wait; None: it is not known."""
        diverted = self._held is not None or self._braking_ned_m_s is not None
        if self._steering.paused or diverted:
            return None
        t_s, found = self._t_s + by_s, None
        ways = itertools.islice(self._segments, self._index, None)
        if self._approach is not None:
            found = self._approach.at(min(t_s, self._approach.duration_s))
            if t_s <= self._approach.duration_s:
                ways = iter(())
            t_s += self._begin_s - self._approach.duration_s
        for segment in ways:
            if isinstance(segment, WaitSegment):
                break
            found = segment.at(min(t_s, segment.duration_s))
            if t_s <= segment.duration_s:
                break
            t_s -= segment.duration_s
        return found if isinstance(found, Position | Trajectory) else None

    @property
    def avoids(self) -> bool:
        """Whether the segment that is flown is to be led past obstacles."""
        segment = self._segment()
        return segment is not None and segment.avoidance

    @property
    def played(self) -> Played:
        """As of the last sampling."""
        segment = self._segment()
        return Played(
            self._number,
            self._index,
            self._begin_s if self._approach is not None else self._t_s,
            self._scale.rate,
            self._approach is not None,
            isinstance(segment, WaitSegment),
            self._held is not None or self._braking_ned_m_s is not None,
            self._position,
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
            return Velocity(STILL)
        last = self._segments[-1]
        if isinstance(last, VelocitySegment):
            return Position(last.end_ned_m, last.end_yaw_ned_rad)
        return last.at(math.inf)

    def _advance(self, dt_s: float, position_ned_m: Vector3 | None) -> None:
        setpoint = self._sample()
        velocity, acceleration = STILL, STILL
        if isinstance(setpoint, Trajectory | Velocity):
            velocity = whole(setpoint.velocity_ned_m_s)
        if isinstance(setpoint, Trajectory):
            acceleration = whole(setpoint.acceleration_ned_m_s2)
        self._held_back = self._away_m(self._position, position_ned_m) > HELD_BACK_M
        goal = 0.0 if self._steering.paused or self._held_back else 1.0
        self._t_s += self._scale.step(dt_s, goal, velocity, acceleration)
        while (segment := self._segment()) is not None:
            if isinstance(segment, WaitSegment):
                self._t_s = 0.0
                if self._index >= self._steering.go_past:
                    return
            elif self._t_s < segment.duration_s or not self._is_back(segment, dt_s, position_ned_m):
                return
            else:
                self._t_s -= segment.duration_s
            if self._approach is not None:
                self._approach = None
                self._t_s += self._begin_s
                if self._begin_s > 0.0:
                    self._scale = TimeScale(self._scale.pace, 0.0)
            else:
                self._index += 1
        self._t_s = 0.0

    def _is_back(self, segment: Segment, dt_s: float, position_ned_m: Vector3 | None) -> bool:
        """Whether the next segment may begin: the vehicle has arrived where the present one ends.

        After one that holds no place it returns there first.
        """
        if isinstance(segment, CurveSegment):
            self._held_back = self._away_m(segment.end_ned_m, position_ned_m) > ARRIVED_M
            if self._held_back:
                self._t_s = segment.duration_s
            return not self._held_back
        if not isinstance(segment, VelocitySegment | AttitudeSegment) or position_ned_m is None:
            return True
        self._returning_s = (self._returning_s or 0.0) + dt_s
        far = math.dist(position_ned_m, segment.end_ned_m) > BACK_WITHIN_M
        if far and self._returning_s < BACK_WITHIN_S:
            self._t_s = segment.duration_s
            return False
        self._returning_s = None
        return True

    @staticmethod
    def _away_m(place: Vector3 | None, position_ned_m: Vector3 | None) -> float:
        """Over the ground; a detour over an obstacle changes the height only."""
        return 0.0 if place is None or position_ned_m is None else math.dist(place[:2], position_ned_m[:2])

    def _slowed(self, setpoint: Setpoint) -> DirectSetpoint:
        """A setpoint of the path at the present rate."""
        rate, change = self._scale.rate, self._scale.change
        if isinstance(setpoint, Trajectory):
            if rate == 1.0 and change == 0.0:
                return setpoint
            v, a = whole(setpoint.velocity_ned_m_s), whole(setpoint.acceleration_ned_m_s2)
            n, e, d = (a[k] * rate * rate + v[k] * change for k in range(3))
            turning = setpoint.yaw_rate_ned_rad_s
            return replace(
                setpoint,
                velocity_ned_m_s=(v[0] * rate, v[1] * rate, v[2] * rate),
                acceleration_ned_m_s2=(n, e, d),
                yaw_rate_ned_rad_s=None if turning is None else turning * rate,
            )
        if isinstance(setpoint, Velocity) and self._returning_s is not None:
            segment = self._segment()
            assert segment is not None
            return Position(segment.end_ned_m, segment.end_yaw_ned_rad)
        assert isinstance(setpoint, Position | Velocity | Attitude)
        return setpoint

    # --- off the path -----------------------------------------------------------------------------

    def _diverts(self, velocity_ned_m_s: Vector3 | None) -> bool:
        """Whether a velocity or an attitude was interrupted."""
        if self._held is not None or self._braking_ned_m_s is not None:
            return True
        segment = self._segment()
        if not self._steering.paused or self._returning_s is not None:
            return False
        if isinstance(segment, VelocitySegment):
            self._braking_ned_m_s = whole(segment.line.at(self._t_s).velocity_ned_m_s)
        elif isinstance(segment, AttitudeSegment):
            self._braking_ned_m_s = velocity_ned_m_s or STILL
        return self._braking_ned_m_s is not None

    def _stop_off_path(self, dt_s: float, position_ned_m: Vector3 | None) -> DirectSetpoint:
        segment = self._segment()
        yaw_rad = None if segment is None else segment.end_yaw_ned_rad
        if self._held is not None:
            return self._held
        velocity = self._braking_ned_m_s or STILL
        self._scale.step(dt_s, 0.0, velocity, STILL)
        rate = self._scale.rate
        if rate > 0.0 or position_ned_m is None:
            return Velocity((velocity[0] * rate, velocity[1] * rate, velocity[2] * rate), yaw_rad)
        self._held = Position(position_ned_m, yaw_rad)
        return self._held
