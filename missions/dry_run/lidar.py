"""The simulated obstacle sensors of a dry run: a lidar that measures to all sides, and one that points
down."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from missions.avoidance.scans import Scan
from missions.dry_run.fleet import TICK_S, Vehicle
from missions.frames import Quaternion, Vector3, rotate
from vehicle_sim.world.lidar import SECTOR_DEG, SECTORS

SCAN_EVERY_TICKS = 10
"""5 Hz, the rate that the server requests from a real vehicle."""
_ANGLES = np.radians(SECTOR_DEG) * np.arange(SECTORS)
_FORWARD, _RIGHT = np.cos(_ANGLES)[:, None], np.sin(_ANGLES)[:, None]


class ObstacleLidar:
    """The sensors of one vehicle. All vehicles of a fleet measure at the same ticks, because the rays of all
    are computed at once."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._view = vehicle.autopilot.view
        self._steps_per_tick = round(TICK_S / self._view.simulation.dt_s)
        self._scans: tuple[Scan, ...] = ()

    def scans(self, now_s: float) -> tuple[Scan, ...]:
        """The newest scan of each sensor."""
        tick = self._view.simulation.steps // self._steps_per_tick
        if not self._scans or tick % SCAN_EVERY_TICKS == 0:
            self._scans = (self._around(now_s), self._down(now_s))
        return self._scans

    def _around(self, now_s: float) -> Scan:
        simulation, row = self._view.simulation, self._view.row
        measured_m = simulation.distances_around_m(row).tolist()
        distances_m = tuple(each if math.isfinite(each) else None for each in measured_m)
        directions = _sector_directions(self._view.estimate.q_ned_frd)
        half_sector_rad = math.radians(SECTOR_DEG / 2.0)
        return Scan(now_s, directions, distances_m, simulation.world.lidars.range_m, half_sector_rad)

    def _down(self, now_s: float) -> Scan:
        measured_m = self._view.simulation.distance_down_m(self._view.row)
        direction = rotate(self._view.estimate.q_ned_frd, (0.0, 0.0, 1.0))
        distance_m = measured_m if math.isfinite(measured_m) else None
        return Scan(now_s, (direction,), (distance_m,), self._view.parameter("SIH_DISTSNSR_MAX"))


def _sector_directions(q_ned_frd: Quaternion) -> tuple[Vector3, ...]:
    """Directions of the sectors, clockwise from the nose."""
    forward = np.array(rotate(q_ned_frd, (1.0, 0.0, 0.0)))
    right = np.array(rotate(q_ned_frd, (0.0, 1.0, 0.0)))
    rows: NDArray[np.float64] = _FORWARD * forward + _RIGHT * right
    return tuple((n, e, d) for n, e, d in rows.tolist())
