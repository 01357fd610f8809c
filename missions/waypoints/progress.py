"""Finds the position of a vehicle along the planned path of its waypoint plan."""

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
"""If the vehicle is farther than this from the start of the next item's path, the vehicle skipped the
previous item [m]."""
EQUALLY_NEAR_M = 0.5
"""Points of the path whose distances differ by less than this are equally near; the point with the expected
time is used."""
LATE_S = 3.0
"""The vehicle reports its item about once a second. So the first seconds of the next item's path and the last
seconds of the previous item's path also count [s]."""


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
        on_path: whether the vehicle begins on the path; False: the vehicle first has to fly to the path.
    """

    def __init__(self, planned: PlannedPasses, *, on_path: bool) -> None:
        self._passes = planned.passes
        rows = [np.array(each.leg.points) for each in self._passes]
        self._rows = rows
        self._starts = [_part_between(each, each[0, 0], each[0, 0] + LATE_S) for each in rows]
        self._ends = [_part_between(each, each[-1, 0] - LATE_S, each[-1, 0]) for each in rows]
        self._index: int | None = None
        self._updated_s: float | None = None
        self.t_s = 0.0
        """Planned time of the vehicle's position, since the start."""
        self.first = 0
        """Index of the pass with which the flight began."""
        self.on_path = on_path
        """Whether the vehicle is on the path; False: it is flying to the path."""

    @property
    def current(self) -> Pass | None:
        """The current pass; None: the vehicle has not reported an item of the path."""
        return None if self._index is None else self._passes[self._index]

    def index_and_time(self, now_s: float) -> tuple[int, float] | None:
        """Index of the current pass, and the planned time, extrapolated from the last update; None: the
        vehicle has not reported an item of the path."""
        if self._index is None:
            return None
        passed_s = 0.0 if self._updated_s is None else now_s - self._updated_s
        return self._index, self.t_s + passed_s

    @property
    def is_at_last_item(self) -> bool:
        """Whether the vehicle is flying the last item."""
        return self._index == len(self._passes) - 1

    def leave(self) -> None:
        """Records that the vehicle has left the path (Hold, another mode) and has to fly back to the path."""
        self.on_path, self._updated_s = False, None

    def update(self, now_s: float, item: int | None, position_ned_m: Vector3 | None) -> Match | None:
        """The nearest point of the path; None: the vehicle is flying to the path, or PX4 chooses the path.

        Args:
            now_s: time on any clock; the same clock for all updates.
            item: index of the current item, as reported.
            position_ned_m: the vehicle's position; None: not known.
        """
        self._advance(item, None if position_ned_m is None else np.array(position_ned_m))
        if self._index is None or position_ned_m is None:
            return None
        passed_s = 0.0 if self._updated_s is None else now_s - self._updated_s
        self._updated_s = now_s
        index, t_s, nearest = self._nearest(np.array(position_ned_m), self.t_s + passed_s)
        offset = np.array(position_ned_m) - nearest
        if not self.on_path and float(np.linalg.norm(offset)) > JOINED_M:
            return None
        self.on_path, self.t_s = True, t_s
        if not self._passes[index].compared:
            return None
        north, east, down = (float(each) for each in nearest)
        horizontal_m = float(np.hypot(offset[0], offset[1]))
        return Match(self._passes[index].leg.place, (north, east, down), horizontal_m, -float(offset[2]))

    def _advance(self, item: int | None, position_ned_m: NDArray[np.float64] | None) -> None:
        """Finds the pass of the reported item: the current or the next pass of this item. After a jump that
        the plan does not contain: the first pass of this item."""
        current = self.current
        if item is None or (current is not None and item in current.items):
            return
        passes = [index for index, each in enumerate(self._passes) if item in each.items]
        if not passes:
            return
        chosen = next((each for each in passes if self._index is None or each > self._index), passes[0])
        if self._index is not None:
            away_m = (
                0.0
                if position_ned_m is None
                else float(np.linalg.norm(self._rows[chosen][0, 1:] - position_ned_m))
            )
            self.on_path = chosen == self._index + 1 and away_m < SKIPPED_M
        else:
            self.first = chosen
        self._index, self.t_s = chosen, self._passes[chosen].leg.start_s

    def _nearest(
        self, position_ned_m: NDArray[np.float64], expected_s: float
    ) -> tuple[int, float, NDArray[np.float64]]:
        """Index of the pass of the nearest point, the planned time, and the position of the nearest point."""
        assert self._index is not None
        candidates = [(self._index, self._rows[self._index])]
        if self.on_path and self._index > 0:
            candidates.append((self._index - 1, self._ends[self._index - 1]))
        if self.on_path and not self.is_at_last_item:
            candidates.append((self._index + 1, self._starts[self._index + 1]))
        found = [
            (index, _nearest_points(rows, position_ned_m, self._passes[index].leg.start_s, expected_s))
            for index, rows in candidates
        ]
        points = np.vstack([each for _, each in found])
        indices = np.concatenate([np.full(len(each), index) for index, each in found])
        nearest = int(points[:, 4].argmin())
        equally_near = np.flatnonzero(points[:, 4] <= points[nearest, 4] + EQUALLY_NEAR_M)
        chosen = equally_near[int(np.abs(points[equally_near, 0] - expected_s).argmin())]
        return int(indices[nearest]), float(points[chosen, 0]), points[nearest, 1:4]


def _part_between(rows: NDArray[np.float64], from_s: float, to_s: float) -> NDArray[np.float64]:
    """The part of a path (N, 4) between two times; the ends of the part are interpolated."""
    times = rows[:, 0]
    inside = times[(times > from_s) & (times < to_s)]
    kept = np.concatenate(([max(from_s, times[0])], inside, [min(to_s, times[-1])]))
    return np.column_stack((kept, *(np.interp(kept, times, rows[:, axis]) for axis in (1, 2, 3))))


def _nearest_points(
    rows: NDArray[np.float64], position_ned_m: NDArray[np.float64], start_s: float, expected_s: float
) -> NDArray[np.float64]:
    """Nearest point of each segment of a path (N, 4): (M, 5) time, position, distance. In a segment in which
    the vehicle waits, the point has the time nearest to the expected time."""
    begin, step = rows[:-1], np.diff(rows, axis=0)
    length_2 = (step[:, 1:] ** 2).sum(axis=1)
    along = np.clip(
        ((position_ned_m - begin[:, 1:]) * step[:, 1:]).sum(axis=1) / np.maximum(length_2, 1e-9), 0.0, 1.0
    )
    points = begin + along[:, None] * step
    is_waiting = length_2 < 1e-6
    points[is_waiting, 0] = np.clip(
        expected_s - start_s, begin[is_waiting, 0], begin[is_waiting, 0] + step[is_waiting, 0]
    )
    distance_m = np.linalg.norm(points[:, 1:] - position_ned_m, axis=1)
    return np.column_stack((points[:, 0] + start_s, points[:, 1:], distance_m))
