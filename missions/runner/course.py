"""The path through a mission: the segments of the branches chosen so far, and the next decision."""

from __future__ import annotations

from dataclasses import replace

from missions.offboard.segments import Decision, Segment, WaitSegment
from missions.offboard.timeline import Timeline
from missions.runner.reading import Reading


class Course:
    """The path of one flight through the mission's branches."""

    def __init__(self, timeline: Timeline) -> None:
        self._node = timeline
        self.segments = list(timeline.segments)
        self._cached_from, self._cached_px4 = 0, -1
        """Cache of `next_px4_segment`: the first index for which the result is valid, and the result."""

    @property
    def decision(self) -> Decision | None:
        """The decision after the last segment; None: there is none."""
        return self._node.decision

    def rest(self, index: int) -> Timeline:
        """The segments from `index` on, with both continuations of the next decision."""
        starts_s, now_s = list[float](), 0.0
        for segment in self.segments[index:]:
            starts_s.append(now_s)
            now_s += segment.duration_s
        return replace(self._node, segments=tuple(self.segments[index:]), starts_s=tuple(starts_s))

    def choose(self, fulfilled: bool) -> None:
        """Continues in one of the two timelines."""
        continuation = self._node.then if fulfilled else self._node.otherwise
        if continuation is not None:  # a decision always has both continuations
            self._node = continuation
            self.segments.extend(continuation.segments)
            self._cached_px4 = -1

    def next_px4_segment(self, index: int) -> int:
        """Index of the first take-off or landing at or after `index`, or of the end of the segments."""
        if not self._cached_from <= index <= self._cached_px4:  # a mission can have many segments
            rest = range(index, len(self.segments))
            found = next((at for at in rest if flown_by_px4(self.segments[at])), len(self.segments))
            self._cached_from, self._cached_px4 = index, found
        return self._cached_px4

    def flown_by_px4(self, index: int) -> bool:
        """Whether PX4 flies the segment in one of its own modes (take-off or landing)."""
        return index < len(self.segments) and flown_by_px4(self.segments[index])

    def next_step(self, index: int) -> int:
        """Index of the first segment of the next step, or of the next round of a repeat."""
        if index >= len(self.segments):
            return len(self.segments)
        visit = self.segments[index].visit
        while index < len(self.segments) and self.segments[index].visit == visit:
            index += 1
        return index

    def remaining_s(self, index: int, t_s: float) -> float:
        """Planned remaining time [s] on the longest continuation."""
        left_s = sum(segment.duration_s for segment in self.segments[index:])
        if index < len(self.segments):
            left_s -= min(t_s, self.segments[index].duration_s)
        return left_s + self._node.duration_s - self._node.own_duration_s


def flown_by_px4(segment: Segment) -> bool:
    """Whether PX4 flies the segment in one of its own modes (take-off or landing)."""
    return isinstance(segment, WaitSegment) and segment.kind in ("take_off", "land")


class ConditionWatch:
    """Checks whether a value has been above or below a limit for long enough."""

    def __init__(self, value: str, above: float | None, below: float | None, for_s: float) -> None:
        self._value, self._above, self._below, self._for_s = value, above, below, for_s
        self._since_s: float | None = None

    def true_now(self, reading: Reading) -> bool:
        """Whether the condition is true now; false if the value is unknown."""
        value = reading.value(self._value)
        if value is None:
            return False
        return (self._above is None or value > self._above) and (self._below is None or value < self._below)

    def fulfilled(self, now_s: float, reading: Reading) -> bool:
        """Whether the condition has been true for `for_s` seconds without interruption."""
        if not self.true_now(reading):
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= self._for_s
