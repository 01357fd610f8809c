"""Finds where a vehicle is on the planned path of its waypoint plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3
from missions.waypoints.planned import Pass, PlannedPasses

JOINED_M = 2.0
"""A vehicle that flies to the path (after Hold, or to a later first item) counts as on the path within this
distance [m]."""
SKIPPED_M = 20.0
"""If the vehicle is farther than this from the start of the next item's path, the previous item was skipped,
not reached [m]."""
SAME_M = 0.5
"""Points of the path that are farther away by less than this are equally near; the one with the expected
time is used."""
LATE_S = 3.0
"""The vehicle reports its item about once a second, so the start of the next item's path and the end of the
previous item's path also count, for this time."""


@dataclass(frozen=True, slots=True)
class Match:
    """The nearest point of the planned path."""

    place: str
    nearest_ned_m: Vector3
    horizontal_m: float
    vertical_m: float
    """Positive: the vehicle is above the path."""


class Progress:
    """Follows one flight along the planned path.

    Args:
        planned: the planned flight.
        on_path: whether the vehicle begins on the path; otherwise it first has to fly to it.
    """

    def __init__(self, planned: PlannedPasses, *, on_path: bool) -> None:
        self._passes = planned.passes
        rows = [np.array(each.leg.points) for each in self._passes]
        self._rows = rows
        self._begins = [_cut(each, each[0, 0], each[0, 0] + LATE_S) for each in rows]
        self._ends = [_cut(each, each[-1, 0] - LATE_S, each[-1, 0]) for each in rows]
        self._index: int | None = None
        self._updated_s: float | None = None
        self.t_s = 0.0
        """Planned time of the vehicle's position, since the start."""
        self.first = 0
        """Index of the pass with which the flight began."""
        self.on_path = on_path
        """Whether the vehicle is on the path, and not on the way to it."""

    @property
    def current(self) -> Pass | None:
        """The current execution of an item; None: the vehicle has not reported an item of the path."""
        return None if self._index is None else self._passes[self._index]

    def now(self, now_s: float) -> tuple[int, float] | None:
        """Index of the pass that is flown, and the planned time, also if the last update was some time ago;
        None: the vehicle has not reported an item of the path."""
        if self._index is None:
            return None
        passed_s = 0.0 if self._updated_s is None else now_s - self._updated_s
        return self._index, self.t_s + passed_s

    @property
    def at_last(self) -> bool:
        """Whether the last item is being flown."""
        return self._index == len(self._passes) - 1

    def leave(self) -> None:
        """The vehicle has left the path (Hold, another mode): it has to fly back to it."""
        self.on_path, self._updated_s = False, None

    def update(self, now_s: float, item: int | None, here: Vector3 | None) -> Match | None:
        """The position on the path; None: the vehicle is on its way to the path, or PX4 chooses the path.

        Args:
            now_s: time of any clock.
            item: index of the current item, as reported.
            here: the vehicle's position; None: not known.
        """
        self._advance(item, None if here is None else np.array(here))
        if self._index is None or here is None:
            return None
        passed_s = 0.0 if self._updated_s is None else now_s - self._updated_s
        self._updated_s = now_s
        index, t_s, nearest = self._nearest(np.array(here), self.t_s + passed_s)
        offset = np.array(here) - nearest
        if not self.on_path and float(np.linalg.norm(offset)) > JOINED_M:
            return None
        self.on_path, self.t_s = True, t_s
        if not self._passes[index].compared:
            return None
        north, east, down = (float(each) for each in nearest)
        sideways_m = float(np.hypot(offset[0], offset[1]))
        return Match(self._passes[index].leg.place, (north, east, down), sideways_m, -float(offset[2]))

    def _advance(self, item: int | None, here: NDArray[np.float64] | None) -> None:
        """Finds the execution of the reported item: the present one, or the next one, or, after a jump that
        the plan does not contain, the first one."""
        current = self.current
        if item is None or (current is not None and item in current.items):
            return
        executions = [index for index, each in enumerate(self._passes) if item in each.items]
        if not executions:
            return
        chosen = next(
            (each for each in executions if self._index is None or each > self._index), executions[0]
        )
        if self._index is not None:
            away_m = 0.0 if here is None else float(np.linalg.norm(self._rows[chosen][0, 1:] - here))
            self.on_path = chosen == self._index + 1 and away_m < SKIPPED_M
        else:
            self.first = chosen
        self._index, self.t_s = chosen, self._passes[chosen].leg.start_s

    def _nearest(
        self, here: NDArray[np.float64], expected_s: float
    ) -> tuple[int, float, NDArray[np.float64]]:
        """Index of the pass of the nearest point, the planned time, and the position of the nearest point."""
        assert self._index is not None
        parts = [(self._index, self._rows[self._index])]
        if self.on_path and self._index > 0:
            parts.append((self._index - 1, self._ends[self._index - 1]))
        if self.on_path and not self.at_last:
            parts.append((self._index + 1, self._begins[self._index + 1]))
        found = [(at, _projected(rows, here, self._passes[at].leg.start_s, expected_s)) for at, rows in parts]
        points = np.vstack([each for _, each in found])
        indices = np.concatenate([np.full(len(each), at) for at, each in found])
        nearest = int(points[:, 4].argmin())
        near = np.flatnonzero(points[:, 4] <= points[nearest, 4] + SAME_M)
        chosen = near[int(np.abs(points[near, 0] - expected_s).argmin())]
        return int(indices[nearest]), float(points[chosen, 0]), points[nearest, 1:4]


def _cut(rows: NDArray[np.float64], from_s: float, to_s: float) -> NDArray[np.float64]:
    """The part of a path (N, 4) between two times; its ends are interpolated."""
    times = rows[:, 0]
    inside = times[(times > from_s) & (times < to_s)]
    kept = np.concatenate(([max(from_s, times[0])], inside, [min(to_s, times[-1])]))
    return np.column_stack((kept, *(np.interp(kept, times, rows[:, axis]) for axis in (1, 2, 3))))


def _projected(
    rows: NDArray[np.float64], here: NDArray[np.float64], start_s: float, expected_s: float
) -> NDArray[np.float64]:
    """Nearest point of each segment of (N, 4) time and position: (M, 5) time, position, distance. Where the
    vehicle waits, the time is the nearest to the expected one."""
    begin, step = rows[:-1], np.diff(rows, axis=0)
    length_2 = (step[:, 1:] ** 2).sum(axis=1)
    along = np.clip(((here - begin[:, 1:]) * step[:, 1:]).sum(axis=1) / np.maximum(length_2, 1e-9), 0.0, 1.0)
    at = begin + along[:, None] * step
    waits = length_2 < 1e-6
    at[waits, 0] = np.clip(expected_s - start_s, begin[waits, 0], begin[waits, 0] + step[waits, 0])
    distance_m = np.linalg.norm(at[:, 1:] - here, axis=1)
    return np.column_stack((at[:, 0] + start_s, at[:, 1:], distance_m))
