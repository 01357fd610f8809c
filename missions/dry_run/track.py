"""Recordings of the flights of a batch: positions of all vehicles, and the full motion of some."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.fleet import TICK_S, Fleet
from missions.dry_run.pilot import Pilot, Step

Array = NDArray[np.float64]
SAMPLE_EVERY_TICKS = 5
"""A sample is taken every so many ticks: 10 Hz."""
SAMPLE_PERIOD_S = SAMPLE_EVERY_TICKS * TICK_S


@dataclass(frozen=True, slots=True)
class Track:
    """One flight, from its start to its end; N samples."""

    t_s: Array
    """(N,) time since the start."""
    position_ned_m: Array
    """(N, 3) position relative to home."""
    battery_share: Array
    """(N,) battery charge, 0 to 1."""
    step: NDArray[np.int64]
    """(N,) index in `steps`; -1: no step."""
    steps: tuple[Step, ...]
    """The flown steps, in the order of their first sample."""
    velocity_ned_m_s: Array | None = None
    """(N, 3). Velocity, attitude and gimbal are None unless the flight is recorded in detail."""
    q_ned_frd: Array | None = None
    """(N, 4)."""
    gimbal_rad: Array | None = None
    """(N, 2) pitch (up is positive) and yaw relative to north."""
    finished: bool = True
    """Whether the flight completed the plan."""

    @property
    def length_m(self) -> float:
        """Length of the path."""
        return float(np.linalg.norm(np.diff(self.position_ned_m, axis=0), axis=1).sum())


class Recorder:
    """Records one batch.

    Args:
        fleet: the vehicles.
        pilots: one for each vehicle.
        detailed: number of vehicles, from the first, whose velocity, attitude and gimbal are recorded too.
    """

    def __init__(self, fleet: Fleet, pilots: Sequence[Pilot], detailed: int = 1) -> None:
        self._fleet, self._pilots, self._detailed = fleet, pilots, detailed
        count = len(pilots)
        self._times: list[float] = []
        self._positions: list[NDArray[np.float32]] = []
        self._batteries: list[NDArray[np.float32]] = []
        self._velocities: list[Array] = []
        self._attitudes: list[Array] = []
        self._gimbals: list[Array] = []
        self._steps: list[NDArray[np.int32]] = []
        self._step_indices: list[dict[Step, int]] = [{} for _ in range(count)]
        self._first_sample = np.full(count, -1)
        self._last_sample = np.full(count, -1)

    def sample(self) -> None:
        """Adds one sample of all vehicles."""
        simulation, count = self._fleet.sim.simulation, len(self._pilots)
        truth, sample_index = simulation.truth, len(self._times)
        self._times.append(self._fleet.time_s)
        self._positions.append(truth.position_ned_m.astype(np.float32))
        self._batteries.append(simulation.battery.remaining.astype(np.float32))
        self._velocities.append(truth.velocity_ned_m_s[: self._detailed].copy())
        self._attitudes.append(truth.q_ned_frd[: self._detailed].copy())
        gimbals = [vehicle.autopilot.gimbal for vehicle in self._fleet.vehicles[: self._detailed]]
        self._gimbals.append(np.array([(each.actual.pitch_rad, each.yaw_ned_rad) for each in gimbals]))
        steps = np.full(count, -1, dtype=np.int32)
        for row, pilot in enumerate(self._pilots):
            if pilot.started_s is None or (pilot.ended and self._last_sample[row] >= 0):
                continue
            if self._first_sample[row] < 0:
                self._first_sample[row] = sample_index
            if pilot.ended:
                self._last_sample[row] = sample_index
            if pilot.step is not None:
                step_indices = self._step_indices[row]
                steps[row] = step_indices.setdefault(pilot.step, len(step_indices))
        self._steps.append(steps)

    def track(self, row: int) -> Track | None:
        """The flight of one vehicle; None: the flight did not start."""
        first, last = int(self._first_sample[row]), int(self._last_sample[row])
        if first < 0:
            return None
        samples = slice(first, (last if last >= 0 else len(self._times) - 1) + 1)
        start_s = self._pilots[row].started_s or 0.0
        in_detail = row < self._detailed
        return Track(
            np.array(self._times[samples]) - start_s,
            np.array([each[row] for each in self._positions[samples]], dtype=float),
            np.array([each[row] for each in self._batteries[samples]], dtype=float),
            np.array([each[row] for each in self._steps[samples]]),
            tuple(self._step_indices[row]),
            np.array([each[row] for each in self._velocities[samples]]) if in_detail else None,
            np.array([each[row] for each in self._attitudes[samples]]) if in_detail else None,
            np.array([each[row] for each in self._gimbals[samples]]) if in_detail else None,
            self._pilots[row].finished,
        )
