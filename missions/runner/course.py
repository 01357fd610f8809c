"""The way through a mission: the segments of the branches taken so far, and the decision that comes next."""

from __future__ import annotations

from missions.offboard.segments import Decision, Segment, WaitSegment
from missions.offboard.timeline import Timeline
from missions.runner.reading import Reading


class Course:
    """Of one flight."""

    def __init__(self, timeline: Timeline) -> None:
        self._node = timeline
        self.segments = list(timeline.segments)

    @property
    def decision(self) -> Decision | None:
        """What is to be decided after the last segment."""
        return self._node.decision

    def choose(self, fulfilled: bool) -> None:
        """Goes on in one of the two timelines."""
        way = self._node.then if fulfilled else self._node.otherwise
        if way is not None:  # a decision has both
            self._node = way
            self.segments.extend(way.segments)

    def cut_after(self, index: int) -> int:
        """The first take-off or landing from there on, or the end of what is known."""
        for at in range(index, len(self.segments)):
            if _is_cut(self.segments[at]):
                return at
        return len(self.segments)

    def is_cut(self, index: int) -> bool:
        """Whether PX4 flies that segment in a mode of its own."""
        return index < len(self.segments) and _is_cut(self.segments[index])

    def next_step(self, index: int) -> int:
        """The first segment of the step after that of a segment; of a repeat, the next round's."""
        if index >= len(self.segments):
            return len(self.segments)
        visit = self.segments[index].visit
        while index < len(self.segments) and self.segments[index].visit == visit:
            index += 1
        return index

    def remaining_s(self, index: int, t_s: float) -> float:
        """By plan, on the longest way."""
        left_s = sum(segment.duration_s for segment in self.segments[index:])
        if index < len(self.segments):
            left_s -= min(t_s, self.segments[index].duration_s)
        return left_s + self._node.duration_s - self._node.own_duration_s


def _is_cut(segment: Segment) -> bool:
    return isinstance(segment, WaitSegment) and segment.kind in ("take_off", "land")


class ConditionWatch:
    """Whether a value has been above or below a bound for long enough."""

    def __init__(self, value: str, above: float | None, below: float | None, for_s: float) -> None:
        self._value, self._above, self._below, self._for_s = value, above, below, for_s
        self._since_s: float | None = None

    def holds_now(self, reading: Reading) -> bool:
        """At this moment; an unknown value is none."""
        value = reading.value(self._value)
        if value is None:
            return False
        return (self._above is None or value > self._above) and (self._below is None or value < self._below)

    def fulfilled(self, now_s: float, reading: Reading) -> bool:
        """Whether it has held without a break."""
        if not self.holds_now(reading):
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= self._for_s
