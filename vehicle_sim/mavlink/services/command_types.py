"""A command as the services see it, whether it came as COMMAND_LONG or COMMAND_INT."""

from __future__ import annotations

from dataclasses import dataclass

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
"""MAV_RESULT."""


@dataclass(frozen=True, slots=True)
class Command:
    """Number and parameters; p5 and p6 are degrees also where COMMAND_INT carried 1e7 degrees."""

    number: int
    p1: float
    p2: float
    p3: float
    p4: float
    p5: float
    p6: float
    p7: float
    sender: tuple[int, int]
    link: str
