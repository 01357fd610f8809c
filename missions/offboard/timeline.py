"""A compiled mission: segments in order, and totals that are known before the flight.

Plain frozen values: a timeline can be sent to another process, which needs NumPy at most.
"""

from __future__ import annotations

import bisect
from dataclasses import dataclass

from missions.fence import FenceArea
from missions.offboard.findings import MissionFinding
from missions.offboard.segments import Decision, Segment
from missions.setpoints import Estimate, Setpoint


@dataclass(frozen=True, slots=True)
class FlightActions:
    """The runner's action when something goes wrong: continue, hold, return or land."""

    failure: str
    low_battery: str
    link_loss: str
    control_lost: str = "hold"


@dataclass(frozen=True, slots=True)
class TimedEvent:
    """An event of the whole mission, by plan."""

    t_s: float
    kind: str
    place: str


@dataclass(frozen=True, slots=True)
class Timeline:
    """Segments one after the other; after a decision the mission goes on in one of two timelines."""

    segments: tuple[Segment, ...]
    starts_s: tuple[float, ...]
    """When each segment begins by plan; waits take no longer than planned."""
    findings: tuple[MissionFinding, ...]
    needs: tuple[Estimate, ...]
    """The estimates that the vehicle must have."""
    actions: FlightActions
    decision: Decision | None = None
    then: Timeline | None = None
    otherwise: Timeline | None = None
    energy_wh: float | None = None
    """Of the longest way; None without a power model."""
    fence: FenceArea | None = None
    """The mission's own geofence; None where it has none, or its place is not known."""

    @property
    def own_duration_s(self) -> float:
        """Of the segments here, without what follows a decision."""
        return self.starts_s[-1] + self.segments[-1].duration_s if self.segments else 0.0

    @property
    def duration_s(self) -> float:
        """By plan, on the longest way."""
        return self.own_duration_s + max((way.duration_s for way in self._ways), default=0.0)

    @property
    def length_m(self) -> float:
        """Along the longest way, take-off and landing included."""
        own_m = sum(segment.length_m for segment in self.segments)
        return own_m + max((way.length_m for way in self._ways), default=0.0)

    @property
    def photos(self) -> int:
        """Pictures on the way with the most."""
        own = sum(event.kind == "photo" for segment in self.segments for event in segment.events)
        return own + max((way.photos for way in self._ways), default=0)

    @property
    def events(self) -> tuple[TimedEvent, ...]:
        """Those of the segments here, in order."""
        return tuple(
            TimedEvent(start_s + event.t_s, event.kind, segment.place)
            for start_s, segment in zip(self.starts_s, self.segments, strict=True)
            for event in segment.events
        )

    @property
    def avoids(self) -> bool:
        """Whether a step on any way is to be led past obstacles."""
        return any(segment.avoidance for segment in self.segments) or any(way.avoids for way in self._ways)

    @property
    def _ways(self) -> tuple[Timeline, ...]:
        return tuple(way for way in (self.then, self.otherwise) if way is not None)

    def segment_at(self, t_s: float) -> tuple[Segment, float] | None:
        """The segment at a time of the plan, and the time since it began; None: there are none here."""
        if not self.segments:
            return None
        index = max(0, bisect.bisect_right(self.starts_s, t_s) - 1)
        return self.segments[index], t_s - self.starts_s[index]

    def at(self, t_s: float) -> Setpoint | None:
        """The setpoint at a time of the plan; None: there are no segments here."""
        found = self.segment_at(t_s)
        return None if found is None else found[0].at(found[1])
