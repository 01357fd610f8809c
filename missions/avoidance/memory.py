"""Recently measured obstacles, kept as columns with a top in the local frame.

A lidar measures the front of an obstacle, not its depth or height. So the space below a measured point counts
as solid, and the space above the point as free until a sensor measures a higher point. A point is kept for
`KEPT_S`, also after the vehicle has climbed above it or turned away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.avoidance.scans import Scan
from missions.frames import Vector3

CELL_M = 0.3
KEPT_S = 30.0
"""A point that was not measured again for this time is no longer used, because the obstacle may have moved
[s]."""
MAX_COLUMNS = 4096
NorthEast = tuple[float, float]


@dataclass(frozen=True, slots=True)
class ColumnsAlongLine:
    """Positions of columns relative to one line."""

    along_m: NDArray[np.float64]
    """(N,) distance from the start, along the line."""
    across_m: NDArray[np.float64]
    """(N,) distance from the line, to either side."""
    from_start_m: NDArray[np.float64]
    """(N,) distance from the start of the line."""
    from_end_m: NDArray[np.float64]
    """(N,) distance from the end of the line."""
    top_m: NDArray[np.float64]
    """(N,) altitude of the top, above the local origin."""


class ObstacleMemory:
    """Remembered obstacles of one vehicle; at most MAX_COLUMNS."""

    def __init__(self) -> None:
        self._rows: dict[tuple[int, int], int] = {}
        """Row in `_columns` of each cell (north, east)."""
        self._columns = np.full((MAX_COLUMNS, 4), -math.inf)
        """North, east, altitude of the top [m], time of the measurement [s]."""
        self._next = 0
        """Row that the next new cell gets."""
        self._keys: list[tuple[int, int] | None] = [None] * MAX_COLUMNS
        """Cell of each row; None: the row is unused."""

    def add(self, scan: Scan, at_ned_m: Vector3, lowest_m: float) -> None:
        """Stores the points of a scan.

        Args:
            scan: the measurement.
            at_ned_m: the vehicle's position at that time.
            lowest_m: lower points are ignored [m above the local origin].
        """
        for (n, e, d), distance_m in zip(scan.directions_ned, scan.distances_m, strict=True):
            if distance_m is None:
                continue
            top_m = -(at_ned_m[2] + d * distance_m)
            if top_m >= lowest_m:
                self._store(
                    at_ned_m[0] + n * distance_m, at_ned_m[1] + e * distance_m, top_m, scan.measured_s
                )

    def _store(self, north_m: float, east_m: float, top_m: float, now_s: float) -> None:
        key = (math.floor(north_m / CELL_M), math.floor(east_m / CELL_M))
        row = self._rows.get(key)
        if row is None:
            row = self._next
            self._next = (self._next + 1) % MAX_COLUMNS
            replaced_key = self._keys[row]
            if replaced_key is not None:  # replaces the oldest column
                del self._rows[replaced_key]
            self._rows[key], self._keys[row] = row, key
        else:
            stored = self._columns[row]
            if now_s - stored[3] <= KEPT_S and stored[2] > top_m:
                stored[3] = now_s
                return
        self._columns[row] = (north_m, east_m, top_m, now_s)

    def columns_above(self, altitude_m: float, now_s: float) -> NDArray[np.float64]:
        """(N, 3) north, east and top of the columns that reach above an altitude (above the local origin)
        [m]."""
        stored = self._columns
        return stored[(stored[:, 2] > altitude_m) & (now_s - stored[:, 3] <= KEPT_S)][:, :3]


def along_line(columns: NDArray[np.float64], start: NorthEast, end: NorthEast) -> ColumnsAlongLine:
    """Positions of columns (N, 3) relative to the line from `start` to `end`."""
    north, east = columns[:, 0] - start[0], columns[:, 1] - start[1]
    length_m = math.dist(start, end)
    un, ue = (
        (1.0, 0.0) if length_m < 1e-6 else ((end[0] - start[0]) / length_m, (end[1] - start[1]) / length_m)
    )
    return ColumnsAlongLine(
        north * un + east * ue,
        np.abs(east * un - north * ue),
        np.hypot(north, east),
        np.hypot(columns[:, 0] - end[0], columns[:, 1] - end[1]),
        columns[:, 2],
    )


def nearest_m(columns: NDArray[np.float64], position: NorthEast) -> float:
    """Horizontal distance from a position to the nearest column; infinite without columns."""
    if not len(columns):
        return math.inf
    return float(np.hypot(columns[:, 0] - position[0], columns[:, 1] - position[1]).min())
