"""The status of a mission, and the error of a request that is not possible now."""

from __future__ import annotations

from dataclasses import dataclass


class CannotDo(Exception):
    """A request of a client that is not possible now.

    Attributes:
        remedy: what the pilot can do.
    """

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(reason)
        self.remedy = remedy


@dataclass(frozen=True, slots=True)
class RunnerStatus:
    """Status of a mission."""

    state: str
    """ready, taking_off, starting, flying, not_following, waiting, pausing, paused, landing, suspended, done,
    aborted, stopped. While the vehicle does not follow (failsafe, lost link, far behind), the mission's time
    stops; it goes on by itself. A suspended mission sends nothing until an operator resumes it; done,
    aborted and stopped are final."""
    place: str | None
    """Current step: "step 3", "step 4.2"."""
    title: str | None
    step: int | None
    """Index of the segment, from 0."""
    remaining_s: float | None
    """Planned remaining time of the longest path."""
    deviation_m: float | None
    """Distance of the vehicle from the position setpoint."""
    outside_corridor_m: float | None
    """Distance outside the dry run's corridor, 0 inside; None: no corridor was given."""
    question: str | None
    """The question to the pilot."""
    reason: str | None
    """Why the mission is suspended or has ended."""
