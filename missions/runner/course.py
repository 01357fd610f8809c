"""The path through a mission: the segments of the chosen branches, and the next decision."""

from __future__ import annotations

from dataclasses import replace

from missions.offboard.segments import Decision, Segment, WaitSegment
from missions.offboard.timeline import Timeline
from missions.runner.reading import Reading


class Course:
    """The path of one flight through the mission's branches."""

    def __init__(self, timeline: Timeline) -> None:
        self._last_timeline = timeline
        """The timeline of the last chosen branch."""
        self.segments = list(timeline.segments)
        self._cache_start, self._cached_index = 0, -1
        """First index for which the cached result of `next_px4_segment` is valid, and the cached result."""

    @property
    def decision(self) -> Decision | None:
        """The decision after the last segment; None: the mission ends after the last segment."""
        return self._last_timeline.decision

    def remaining_timeline(self, index: int) -> Timeline:
        """The segments from `index` on, with both continuations of the next decision."""
        starts_s, now_s = list[float](), 0.0
        for segment in self.segments[index:]:
            starts_s.append(now_s)
            now_s += segment.duration_s
        return replace(self._last_timeline, segments=tuple(self.segments[index:]), starts_s=tuple(starts_s))

    def choose(self, fulfilled: bool) -> None:
        """Continues with the timeline `then` if the condition is fulfilled, or else with `otherwise`."""
        continuation = self._last_timeline.then if fulfilled else self._last_timeline.otherwise
        if continuation is not None:  # a decision always has both continuations
            self._last_timeline = continuation
            self.segments.extend(continuation.segments)
            self._cached_index = -1

    def next_px4_segment(self, index: int) -> int:
        """Index of the first take-off or landing at or after `index`; without one, the number of segments."""
        # Cached, because a mission can have many segments.
        if not self._cache_start <= index <= self._cached_index:
            indices = range(index, len(self.segments))
            found = next(
                (candidate for candidate in indices if flown_by_px4(self.segments[candidate])),
                len(self.segments),
            )
            self._cache_start, self._cached_index = index, found
        return self._cached_index

    def flown_by_px4(self, index: int) -> bool:
        """Whether PX4 flies the segment in one of its own modes (take-off or landing)."""
        return index < len(self.segments) and flown_by_px4(self.segments[index])

    def next_step(self, index: int) -> int:
        """Index of the first segment of the next step, or of the next round of a repeat."""
        if index >= len(self.segments):
            return len(self.segments)
        executed_step = self.segments[index].executed_step
        while index < len(self.segments) and self.segments[index].executed_step == executed_step:
            index += 1
        return index

    def remaining_s(self, index: int, t_s: float) -> float:
        """Planned remaining time [s] on the longest continuation."""
        remaining_s = sum(segment.duration_s for segment in self.segments[index:])
        if index < len(self.segments):
            remaining_s -= min(t_s, self.segments[index].duration_s)
        return remaining_s + self._last_timeline.duration_s - self._last_timeline.own_duration_s


def flown_by_px4(segment: Segment) -> bool:
    """Whether PX4 flies the segment in one of its own modes (take-off or landing)."""
    return isinstance(segment, WaitSegment) and segment.kind in ("take_off", "land")


class ConditionWatch:
    """Checks whether a value has been above or below a limit for long enough."""

    def __init__(self, value: str, above: float | None, below: float | None, for_s: float) -> None:
        self._value, self._above, self._below, self._for_s = value, above, below, for_s
        self._since_s: float | None = None

    def is_true(self, reading: Reading) -> bool:
        """Whether the condition is true at this time; false if the value is unknown."""
        value = reading.value(self._value)
        if value is None:
            return False
        return (self._above is None or value > self._above) and (self._below is None or value < self._below)

    def is_fulfilled(self, now_s: float, reading: Reading) -> bool:
        """Whether the condition has been true for `for_s` seconds without interruption."""
        if not self.is_true(reading):
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= self._for_s
