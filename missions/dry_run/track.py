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
    """(N, 3); None where only places were recorded."""
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
        fleet: whose vehicles.
        pilots: one each.
        whole: also velocity, attitude and gimbal.
    """

    def __init__(self, fleet: Fleet, pilots: list[Pilot], *, whole: bool) -> None:
        self._fleet, self._pilots, self._whole = fleet, pilots, whole
        count = len(pilots)
        self._times: list[float] = []
        self._arrays: dict[str, list[NDArray[np.float32]]] = {"position": [], "battery": []}
        if whole:
            self._arrays |= {"velocity": [], "attitude": [], "gimbal": []}
        self._steps: list[NDArray[np.int32]] = []
        self._indices: list[dict[Step, int]] = [{} for _ in range(count)]
        self._first = np.full(count, -1)
        self._last = np.full(count, -1)

    def sample(self) -> None:
        """Now."""
        simulation, count = self._fleet.sim.simulation, len(self._pilots)
        truth, at = simulation.truth, len(self._times)
        self._times.append(self._fleet.time_s)
        self._arrays["position"].append(truth.position_ned_m.astype(np.float32))
        self._arrays["battery"].append(simulation.battery.remaining.astype(np.float32))
        if self._whole:
            self._arrays["velocity"].append(truth.velocity_ned_m_s.astype(np.float32))
            self._arrays["attitude"].append(truth.q_ned_frd.astype(np.float32))
            gimbals = [vehicle.autopilot.gimbal for vehicle in self._fleet.vehicles]
            angles = [(each.actual.pitch_rad, each.yaw_ned_rad) for each in gimbals]
            self._arrays["gimbal"].append(np.array(angles, dtype=np.float32))
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
        times = np.array(self._times[part])

        def rows(name: str) -> Array | None:
            kept = self._arrays.get(name)
            return None if kept is None else np.array([each[row] for each in kept[part]], dtype=float)

        position, battery = rows("position"), rows("battery")
        assert position is not None
        assert battery is not None
        start_s = self._pilots[row].started_s or 0.0
        return Track(
            times - start_s, position, battery, np.array([each[row] for each in self._steps[part]]),
            tuple(self._indices[row]), rows("velocity"), rows("attitude"), rows("gimbal"),
        )  # fmt: skip
