"""What was flown beside what was sent, kept while a mission flies."""

from __future__ import annotations

import math
from dataclasses import dataclass

from missions.frames import Vector3
from missions.runner.reading import Reading
from missions.runner.status import RunnerStatus

PERIOD_S = 0.5
MAX_SAMPLES = 4000
"""More are thinned to every other one: half an hour at 2 Hz, a longer flight more coarsely."""


@dataclass(frozen=True, slots=True)
class FlownSample:
    """One moment."""

    t_s: float
    """Since the mission was started."""
    place: str | None
    """Which step: "step 3", "step 4.2"."""
    flown_ned_m: Vector3
    """Where the vehicle was, by its own estimate, from its local origin."""
    planned_ned_m: Vector3 | None
    """The place that was sent to it; null: PX4 flew by itself, or no place was sent."""
    deviation_m: float | None
    """Between the two."""
    outside_corridor_m: float | None
    """How far it was outside the dry run's corridor, 0 inside; null: none was given at the start."""


class FlownTrack:
    """Of one mission; bounded."""

    def __init__(self) -> None:
        self.samples: list[FlownSample] = []
        self._period_s = PERIOD_S
        self._next_s = 0.0

    def keep(self, t_s: float, reading: Reading, status: RunnerStatus) -> None:
        """Adds a moment, where one is due and it is known where the vehicle is."""
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


def _millimetres(place: Vector3) -> Vector3:
    return (round(place[0], 3), round(place[1], 3), round(place[2], 3))
