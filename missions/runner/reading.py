"""The vehicle's state as input of the mission runner; None means unknown."""

from __future__ import annotations

from typing import Literal, NamedTuple

from missions.frames import Vector3
from missions.runner.script import ScriptProgress
from missions.setpoints import Estimate

StreamPhase = Literal["idle", "starting", "flying", "interrupted", "ending"]


class Reading(NamedTuple):
    """The vehicle's state at one time. A named tuple is fast to make; a dry run makes ten a second for each
    vehicle."""

    mode: str | None = None
    """The vehicle's mode, as in the API's `Status.mode`: offboard, hold, land, rtl, takeoff, position, …"""
    mode_source: str | None = None
    """Source of the mode change: command, vehicle, failsafe, pilot, station, unknown."""
    mode_text: str | None = None
    """Source of the mode change as a text for messages."""
    armed: bool | None = None
    landed: str | None = None
    """on_ground, in_air, taking_off, landing."""
    position_ned_m: Vector3 | None = None
    velocity_ned_m_s: Vector3 | None = None
    yaw_ned_rad: float | None = None
    estimates: frozenset[Estimate] | None = None
    """The valid estimates."""
    executor_in_charge: bool | None = None
    """Whether PX4 accepts commands of the executor of the mission's mode; None: the mode has no executor."""
    take_off_complete: bool = False
    """Whether PX4 has reported to the executor that its take-off is complete."""
    link_active: bool = True
    control_holder: str | None = None
    """Unique id of the client in control; None: no client has control."""
    control_holder_name: str | None = None
    """Name of the client in control, for messages."""
    battery_share: float | None = None
    """Battery charge, 0 to 1."""
    wind_speed_m_s: float | None = None
    distance_m: float | None = None
    """Value of the distance sensor."""
    satellites: int | None = None
    horizontal_error_m: float | None = None
    """Standard deviation of the position estimate."""
    stream: StreamPhase = "idle"
    """Phase of the mission's setpoint stream; `flying` when the vehicle is in Offboard, `interrupted` when it
    has not followed its setpoints, which then keep it at its place."""
    stream_text: str | None = None
    """Reason for the end of the stream."""
    progress: ScriptProgress | None = None
    """Progress of the script that is being streamed."""

    @property
    def on_ground(self) -> bool:
        """Whether the vehicle is on the ground; False if unknown."""
        return self.armed is False or self.landed == "on_ground"

    @property
    def in_air(self) -> bool:
        """Whether the vehicle is in the air; False if unknown."""
        return self.armed is True and self.landed in ("in_air", "taking_off", "landing")

    def value(self, name: str) -> float | None:
        """The value of a condition, by name."""
        if name == "ground_speed_m_s":
            if self.velocity_ned_m_s is None:
                return None
            north, east, _ = self.velocity_ned_m_s
            return (north * north + east * east) ** 0.5
        value = getattr(self, name)
        return None if value is None else float(value)
