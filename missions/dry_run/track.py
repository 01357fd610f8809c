"""What is recorded of the flights of a batch: places, and of single ones all that a picture of them needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.fleet import Fleet
from missions.dry_run.pilot import Pilot, Step

Array = NDArray[np.float64]
EVERY_TICKS = 5
"""10 Hz."""


@dataclass(frozen=True, slots=True)
class Track:
    """One flight, from its start to its end; N samples."""

    t_s: Array
    """(N,) since the start."""
    position_ned_m: Array
    """(N, 3) from home."""
    battery_share: Array
    """(N,)."""
    step: NDArray[np.int64]
    """(N,) index in `steps`; -1: none."""
    steps: tuple[Step, ...]
    """Those that were flown, in the order of their first sample."""
    velocity_ned_m_s: Array | None = None
    """(N, 3); these three only of a batch's first flight."""
    q_ned_frd: Array | None = None
    """(N, 4)."""
    gimbal_rad: Array | None = None
    """(N, 2) pitch (up is positive), and yaw from north."""

    @property
    def length_m(self) -> float:
        """Along the path."""
        return float(np.linalg.norm(np.diff(self.position_ned_m, axis=0), axis=1).sum())


class Recorder:
    """Of one batch.

    Args:
        fleet: whose vehicles; of the first one velocity, attitude and gimbal are recorded as well.
        pilots: one each.
    """

    def __init__(self, fleet: Fleet, pilots: list[Pilot]) -> None:
        self._fleet, self._pilots = fleet, pilots
        count = len(pilots)
        self._times: list[float] = []
        self._positions: list[NDArray[np.float32]] = []
        self._batteries: list[NDArray[np.float32]] = []
        self._velocities: list[Array] = []
        self._attitudes: list[Array] = []
        self._gimbals: list[tuple[float, float]] = []
        self._steps: list[NDArray[np.int32]] = []
        self._indices: list[dict[Step, int]] = [{} for _ in range(count)]
        self._first = np.full(count, -1)
        self._last = np.full(count, -1)

    def sample(self) -> None:
        """Now."""
        simulation, count = self._fleet.sim.simulation, len(self._pilots)
        truth, at = simulation.truth, len(self._times)
        self._times.append(self._fleet.time_s)
        self._positions.append(truth.position_ned_m.astype(np.float32))
        self._batteries.append(simulation.battery.remaining.astype(np.float32))
        self._velocities.append(truth.velocity_ned_m_s[0].copy())
        self._attitudes.append(truth.q_ned_frd[0].copy())
        gimbal = self._fleet.vehicles[0].autopilot.gimbal
        self._gimbals.append((gimbal.actual.pitch_rad, gimbal.yaw_ned_rad))
        steps = np.full(count, -1, dtype=np.int32)
        for row, pilot in enumerate(self._pilots):
            if pilot.started_s is None or (pilot.done and self._last[row] >= 0):
                continue
            if self._first[row] < 0:
                self._first[row] = at
            if pilot.done:
                self._last[row] = at
            if pilot.step is not None:
                known = self._indices[row]
                steps[row] = known.setdefault(pilot.step, len(known))
        self._steps.append(steps)

    def track(self, row: int) -> Track | None:
        """The flight of one vehicle; None: it never began."""
        first, last = int(self._first[row]), int(self._last[row])
        if first < 0:
            return None
        part = slice(first, (last if last >= 0 else len(self._times) - 1) + 1)
        start_s = self._pilots[row].started_s or 0.0
        is_first = row == 0
        return Track(
            np.array(self._times[part]) - start_s,
            np.array([each[row] for each in self._positions[part]], dtype=float),
            np.array([each[row] for each in self._batteries[part]], dtype=float),
            np.array([each[row] for each in self._steps[part]]),
            tuple(self._indices[row]),
            np.array(self._velocities[part]) if is_first else None,
            np.array(self._attitudes[part]) if is_first else None,
            np.array(self._gimbals[part]) if is_first else None,
        )
