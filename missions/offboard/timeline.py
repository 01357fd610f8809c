"""A compiled mission: segments in order, and totals that are known before the flight.

Timelines are frozen values, so that another process can receive them.
"""

from __future__ import annotations

import bisect
from dataclasses import dataclass

from missions.avoidance.values import AvoidanceWay
from missions.fence import FenceArea
from missions.offboard.findings import MissionFinding
from missions.offboard.segments import Decision, Segment
from missions.setpoints import Estimate, Setpoint


@dataclass(frozen=True, slots=True)
class FlightActions:
    """Actions of the mission runner on errors: continue, hold, return or land."""

    failure: str
    low_battery: str
    link_loss: str
    control_lost: str = "hold"


@dataclass(frozen=True, slots=True)
class TimedEvent:
    """An event with its planned time in the mission."""

    t_s: float
    kind: str
    place: str
    """Label of the step, such as "step 4.2"."""


@dataclass(frozen=True, slots=True)
class Timeline:
    """Segments in order. A decision at the end selects `then` or `otherwise` as the continuation."""

    segments: tuple[Segment, ...]
    starts_s: tuple[float, ...]
    """Planned start of each segment, if no wait takes longer than planned."""
    findings: tuple[MissionFinding, ...]
    needs: tuple[Estimate, ...]
    """The estimates that the vehicle must have."""
    actions: FlightActions
    decision: Decision | None = None
    then: Timeline | None = None
    otherwise: Timeline | None = None
    energy_wh: float | None = None
    """Energy of the longest path; None without a power model."""
    fence: FenceArea | None = None
    """The mission's own geofence; None: no geofence, or the origin of the local frame is unknown."""

    @property
    def own_duration_s(self) -> float:
        """Duration of the segments, without a continuation."""
        return self.starts_s[-1] + self.segments[-1].duration_s if self.segments else 0.0

    @property
    def duration_s(self) -> float:
        """Planned duration of the longest path."""
        return self.own_duration_s + max((each.duration_s for each in self._continuations), default=0.0)

    @property
    def length_m(self) -> float:
        """Length of the longest path, including take-off and landing."""
        segments_m = sum(segment.length_m for segment in self.segments)
        return segments_m + max((each.length_m for each in self._continuations), default=0.0)

    @property
    def photos(self) -> int:
        """Number of photos on the path with the most photos."""
        segment_photos = sum(event.kind == "photo" for segment in self.segments for event in segment.events)
        return segment_photos + max((each.photos for each in self._continuations), default=0)

    @property
    def events(self) -> tuple[TimedEvent, ...]:
        """The events of the segments, in order."""
        return tuple(
            TimedEvent(start_s + event.t_s, event.kind, segment.place)
            for start_s, segment in zip(self.starts_s, self.segments, strict=True)
            for event in segment.events
        )

    @property
    def avoidance(self) -> AvoidanceWay | None:
        """What obstacle avoidance tries first, in the first step that requests it; None: no step does."""
        for part in (*self.segments, *self._continuations):
            if part.avoidance is not None:
                return part.avoidance
        return None

    @property
    def _continuations(self) -> tuple[Timeline, ...]:
        return tuple(each for each in (self.then, self.otherwise) if each is not None)

    def segment_at(self, t_s: float) -> tuple[Segment, float] | None:
        """The segment at a planned time, and the time since its start; None: there are no segments."""
        if not self.segments:
            return None
        index = max(0, bisect.bisect_right(self.starts_s, t_s) - 1)
        return self.segments[index], t_s - self.starts_s[index]

    def at(self, t_s: float) -> Setpoint | None:
        """The setpoint at a planned time; None: there are no segments."""
        segment_and_time = self.segment_at(t_s)
        return None if segment_and_time is None else segment_and_time[0].at(segment_and_time[1])
