"""Requests of the mission runner; the caller executes them and reports failed requests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from missions.runner.script import Script, ScriptChange

Mode = Literal["hold", "land", "rtl"]
MODE_BY_ACTION: dict[str, Mode] = {"hold": "hold", "return": "rtl", "land": "land"}
"""PX4 mode for each action of a mission."""
ACTION_TEXTS = {"hold": "holding the position", "return": "returning home", "land": "landing"}


@dataclass(frozen=True, slots=True)
class TakeOff:
    """Arm, and climb in PX4's own Takeoff mode."""

    height_m: float
    """Height above the take-off position."""


@dataclass(frozen=True, slots=True)
class StreamScript:
    """Stream the setpoints of this script and switch to Offboard. The script replaces the current script."""

    script: Script


@dataclass(frozen=True, slots=True)
class ChangeScript:
    """Pause or resume the current script, end its waits, or append segments to it."""

    change: ScriptChange


@dataclass(frozen=True, slots=True)
class SetMode:
    """Switch to one of PX4's own modes, and end the stream."""

    mode: Mode


@dataclass(frozen=True, slots=True)
class StopStream:
    """Stop the setpoint stream without a mode change, because another party controls the vehicle."""


@dataclass(frozen=True, slots=True)
class Photo:
    """Take one photo now."""

    component: int | None = None
    """Component id of the camera; None: the connected camera with the lowest id."""


@dataclass(frozen=True, slots=True)
class PointGimbal:
    """Point the gimbal. The runner repeats this request, because one request may be lost."""

    pitch_rad: float
    """Pitch, up is positive."""
    yaw_ned_rad: float


@dataclass(frozen=True, slots=True)
class ReleaseGimbal:
    """Release the gimbal."""


@dataclass(frozen=True, slots=True)
class Notify:
    """Send a message to the pilot and to all clients."""

    code: str
    text: str
    warning: bool = False


Request = (
    TakeOff
    | StreamScript
    | ChangeScript
    | SetMode
    | StopStream
    | Photo
    | PointGimbal
    | ReleaseGimbal
    | Notify
)


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
