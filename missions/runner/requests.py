"""What the runner asks for: whoever drives it carries these out, and tells it which of them failed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from missions.runner.script import Script, Steering

Mode = Literal["hold", "land", "rtl"]
MODE_OF: dict[str, Mode] = {"hold": "hold", "return": "rtl", "land": "land"}
"""By action of a mission."""
NAME_OF = {"hold": "holding here", "return": "returning", "land": "landing"}


@dataclass(frozen=True, slots=True)
class TakeOff:
    """Arm, and climb in PX4's own Takeoff mode."""

    height_m: float
    """Above where the vehicle stands."""


@dataclass(frozen=True, slots=True)
class Play:
    """Stream this script and switch to Offboard; where a script is streamed already, fly this one instead."""

    script: Script


@dataclass(frozen=True, slots=True)
class Steer:
    """Steers the script that is streamed."""

    steering: Steering


@dataclass(frozen=True, slots=True)
class SetMode:
    """A mode that PX4 flies by itself; it ends the stream."""

    mode: Mode


@dataclass(frozen=True, slots=True)
class StopStream:
    """Send no setpoints any more and command nothing: somebody else has the vehicle."""


@dataclass(frozen=True, slots=True)
class Photo:
    """One picture, now."""


@dataclass(frozen=True, slots=True)
class PointGimbal:
    """Point the gimbal; asked for again while it is to move."""

    pitch_rad: float
    """Up is positive."""
    yaw_ned_rad: float


@dataclass(frozen=True, slots=True)
class ReleaseGimbal:
    """The mission has no more use for the gimbal."""


@dataclass(frozen=True, slots=True)
class Tell:
    """Something people are to hear."""

    code: str
    text: str
    warning: bool = False


Request = TakeOff | Play | Steer | SetMode | StopStream | Photo | PointGimbal | ReleaseGimbal | Tell
