"""Records the flown and the planned positions of a mission."""

from __future__ import annotations

import math
from dataclasses import dataclass

from missions.frames import Vector3
from missions.runner.reading import Reading
from missions.runner.status import RunnerStatus

PERIOD_S = 0.5
MAX_SAMPLES = 4000
"""Half an hour at 2 Hz; after that every second sample is deleted and the period doubled."""


@dataclass(frozen=True, slots=True)
class FlownSample:
    """One sample."""

    t_s: float
    """Time since the start of the mission."""
    place: str | None
    """Current step: "step 3", "step 4.2"."""
    flown_ned_m: Vector3
    """The vehicle's position estimate, in its local frame."""
    planned_ned_m: Vector3 | None
    """The position setpoint; null: PX4 flew in one of its own modes, or no position was sent."""
    deviation_m: float | None
    """Distance between the two."""
    outside_corridor_m: float | None
    """Distance outside the dry run's corridor, 0 inside; null: no corridor was given at the start."""


class FlownTrack:
    """The samples of one mission, at most MAX_SAMPLES."""

    def __init__(self) -> None:
        self.samples: list[FlownSample] = []
        self._period_s = PERIOD_S
        self._next_s = 0.0

    def record(self, t_s: float, reading: Reading, status: RunnerStatus) -> None:
        """Adds a sample if one is due and the vehicle's position is known."""
        here, played = reading.position_ned_m, reading.played
        if here is None or t_s < self._next_s:
            return
        planned = played.position_ned_m if played is not None and reading.stream == "flying" else None
        off_m = None if planned is None else round(math.dist(here, planned), 3)
        self.samples.append(
            FlownSample(
                round(t_s, 2), status.place, _millimetres(here),
                None if planned is None else _millimetres(planned), off_m, status.outside_corridor_m,
            )
        )  # fmt: skip
        if len(self.samples) >= MAX_SAMPLES:
            self.samples = self.samples[::2]
            self._period_s *= 2.0
        self._next_s = t_s + self._period_s


def _millimetres(position_ned_m: Vector3) -> Vector3:
    n, e, d = position_ned_m
    return (round(n, 3), round(e, 3), round(d, 3))
