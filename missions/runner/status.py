"""What the runner answers: how the mission stands, or why a request is not possible now."""

from __future__ import annotations

from dataclasses import dataclass


class CannotDo(Exception):
    """A person's request that is not possible now.

    Attributes:
        remedy: what to do.
    """

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(reason)
        self.remedy = remedy


@dataclass(frozen=True, slots=True)
class RunnerStatus:
    """How the mission stands."""

    state: str
    """ready, taking_off, starting, flying, waiting, pausing, paused, landing, suspended, done, aborted,
    stopped. `suspended`: not in charge, to be resumed by a person; the last three are over."""
    place: str | None
    """Which step: "step 3", "step 4.2"."""
    title: str | None
    step: int | None
    """Index of the segment, from 0."""
    remaining_s: float | None
    """By plan, on the longest way."""
    deviation_m: float | None
    """From the position that is sent."""
    outside_corridor_m: float | None
    """How far it is outside the dry run's corridor, 0 inside; None: none was given."""
    question: str | None
    """What a person is asked."""
    reason: str | None
    """Why it is suspended or over."""
