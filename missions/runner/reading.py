"""What the runner knows of the vehicle at one moment; None is not known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from missions.frames import Vector3
from missions.runner.script import Played
from missions.setpoints import Estimate

StreamPhase = Literal["idle", "starting", "flying", "ending"]


@dataclass(frozen=True, slots=True)
class Reading:
    """One moment."""

    mode: str | None = None
    """As `Status.mode` of the API: offboard, hold, land, rtl, takeoff, position, …"""
    mode_source: str | None = None
    """Who brought the vehicle into it: command, vehicle, failsafe, pilot, station, unknown."""
    mode_text: str | None = None
    """The same for people."""
    armed: bool | None = None
    landed: str | None = None
    """on_ground, in_air, taking_off, landing."""
    position_ned_m: Vector3 | None = None
    velocity_ned_m_s: Vector3 | None = None
    yaw_ned_rad: float | None = None
    estimates: frozenset[Estimate] | None = None
    """Those that are valid."""
    link_heard: bool = True
    holder: str | None = None
    """Who has control: any name that tells one client from another; None: nobody."""
    holder_name: str | None = None
    """The same for people."""
    battery_share: float | None = None
    """0 to 1."""
    wind_speed_m_s: float | None = None
    distance_m: float | None = None
    """Of the distance sensor."""
    satellites: int | None = None
    horizontal_error_m: float | None = None
    """Of the position estimate, one sigma."""
    stream: StreamPhase = "idle"
    """Of the mission's own setpoint stream; `flying` once the vehicle is in Offboard."""
    stream_text: str | None = None
    """Why the stream ends or has ended."""
    played: Played | None = None
    """How far the stream has flown its script."""

    @property
    def on_ground(self) -> bool:
        """As far as known."""
        return self.armed is False or self.landed == "on_ground"

    @property
    def in_air(self) -> bool:
        """For certain."""
        return self.armed is True and self.landed in ("in_air", "taking_off", "landing")

    def value(self, name: str) -> float | None:
        """The value that a condition names."""
        if name == "ground_speed_m_s":
            if self.velocity_ned_m_s is None:
                return None
            north, east, _ = self.velocity_ned_m_s
            return (north * north + east * east) ** 0.5
        found = getattr(self, name)
        return None if found is None else float(found)
