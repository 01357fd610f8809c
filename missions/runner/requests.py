"""Requests of the mission runner; the caller executes them and reports those that failed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from missions.runner.script import Script, ScriptChange

Mode = Literal["hold", "land", "rtl"]
MODE_OF: dict[str, Mode] = {"hold": "hold", "return": "rtl", "land": "land"}
"""PX4 mode for each action of a mission."""
NAME_OF = {"hold": "holding here", "return": "returning", "land": "landing"}


@dataclass(frozen=True, slots=True)
class TakeOff:
    """Arm, and climb in PX4's own Takeoff mode."""

    height_m: float
    """Height above the ground position."""


@dataclass(frozen=True, slots=True)
class Play:
    """Stream this script and switch to Offboard; it replaces a script that is being streamed."""

    script: Script


@dataclass(frozen=True, slots=True)
class ChangeScript:
    """Pause or resume the current script, end its waits, or append segments to it."""

    change: ScriptChange


@dataclass(frozen=True, slots=True)
class SetMode:
    """Switch to one of PX4's own modes; this ends the stream."""

    mode: Mode


@dataclass(frozen=True, slots=True)
class StopStream:
    """Stop the setpoint stream without a mode change, because someone else controls the vehicle."""


@dataclass(frozen=True, slots=True)
class Photo:
    """Take one picture now."""

    component: int | None = None
    """Component id of the camera; None: the lowest that is connected."""


@dataclass(frozen=True, slots=True)
class PointGimbal:
    """Point the gimbal; repeated while it moves."""

    pitch_rad: float
    """Up is positive."""
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


Request = TakeOff | Play | ChangeScript | SetMode | StopStream | Photo | PointGimbal | ReleaseGimbal | Notify
