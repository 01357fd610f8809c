"""The part of a logged flight that is flown again, at the steps of the simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3
from missions.geodesy import LocalOrigin

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]

LEAD_S = 4.0
"""Length of the flight before the rerun that is also read: the controllers' integrals are found from it."""


class NotFlyable(ValueError):
    """This part of the log cannot be flown again; the text says why.

    Args:
        text: the reason, as a sentence.
        field: the field of the request that would have to be different.
    """

    def __init__(self, text: str, field: str = "from_s") -> None:
        super().__init__(text)
        self.field = field


@dataclass(frozen=True, slots=True)
class LoggedFlight:
    """N samples, one for each simulation step; NED metres and radians, body axes FRD, NaN: not controlled."""

    t_s: Values
    """(N,) time since the log's start, in equal steps."""
    position_ned_m: Values
    """(N, 3) estimated by the vehicle."""
    velocity_ned_m_s: Values
    """(N, 3)."""
    q_ned_frd: Values
    """(N, 4) w, x, y, z."""
    rates_frd_rad_s: Values
    """(N, 3)."""
    angular_acceleration_frd_rad_s2: Values
    """(N, 3)."""
    force_frd_m_s2: Values
    """(N, 3) specific force that the accelerometer measured."""
    motors: Values
    """(N, 4) motor signals, 0..1."""
    level: NDArray[np.int64]
    """(N,) `vehicle_sim.control.setpoints.ControlLevel`: which controller got the setpoint."""
    landed: Flags
    """(N,)."""
    target_position_ned_m: Values
    """(N, 3) trajectory setpoint."""
    target_velocity_ned_m_s: Values
    """(N, 3)."""
    target_acceleration_ned_m_s2: Values
    """(N, 3)."""
    target_yaw_ned_rad: Values
    """(N,)."""
    target_yaw_rate_ned_rad_s: Values
    """(N,)."""
    commanded_acceleration_ned_m_s2: Values
    """(N, 3) output of the position controller; NaN: not logged."""
    target_q_ned_frd: Values
    """(N, 4) attitude setpoint."""
    target_rates_frd_rad_s: Values
    """(N, 3)."""
    thrust: Values
    """(N,) collective thrust setpoint, 0..1."""
    rate_integral: Values
    """(N, 3) integral of the rate controllers."""
    hover_thrust: Values
    """(N,) the vehicle's estimate; NaN: not logged."""
    parameters: Mapping[str, float]
    """The vehicle's parameters at the start of this part."""
    notes: tuple[str, ...] = ()
    """What the log does not have, as sentences."""

    def first_after(self, t_s: float) -> int:
        """Index of the first sample at or after a time."""
        return int(np.searchsorted(self.t_s, t_s - 1e-9))

    def landing_after(self, start: int) -> int:
        """Index of the first landed sample after `start`; without one, the number of samples."""
        landed = np.flatnonzero(self.landed[start:])
        return start + int(landed[0]) if len(landed) else len(self.t_s)


@dataclass(frozen=True, slots=True)
class Battery:
    """A battery at one moment."""

    share: float
    """Charge, 0 to 1."""
    endurance_s: float | None
    """Time from full to empty at its mean discharge afterwards; None: it hardly discharges."""


@dataclass(frozen=True, slots=True)
class LoggedAutopilot:
    """What the autopilot of a logged flight was doing at one moment."""

    nav_state: int
    """`vehicle_sim.autopilot.modes.NavState`."""
    home_lat_deg: float
    home_lon_deg: float
    home_alt_amsl_m: float
    home_ned_m: Values
    """(3,) in the local frame of the log."""
    battery: Battery | None
    """None: not logged."""
    mission_item: int | None
    """Index of the mission's current item, in the order of the upload; None: not logged."""
    release: tuple[int, int] | None
    """Major and minor number of its PX4; None: not known."""
    switched: tuple[float, int] | None
    """Time [s since the log's start] and nav state of the first later mode that the autopilot did not select
    itself; None: there is none."""
    target_ned_m: tuple[float, float, float] | None = None
    """Where it holds, or flies to in Hold, in the local frame of the log; None: not logged."""
    next_target_s: float | None = None
    """When it got another one in Hold [s since the log's start]; None: it did not."""


STREAM_STEP_S = 0.2


@dataclass(frozen=True, slots=True)
class MissionBegin:
    """Where a mission of a logged flight may have begun, in the local frame of the log."""

    t_s: float
    """Time since the log's start at which its Offboard began."""
    position_ned_m: Vector3
    yaw_ned_rad: float
    in_air: bool


@dataclass(frozen=True, slots=True)
class LoggedStream:
    """The setpoints that a logged vehicle followed in Offboard until a moment, each `STREAM_STEP_S`."""

    t_s: Values
    """(N,) times since the log's start; the last one is the moment. Times in other modes are left out."""
    setpoint_ned_m: Values
    """(N, 3) NaN: it followed no position."""
    velocity_ned_m_s: Vector3
    """Velocity setpoint at the moment; NaN: none."""
    begins: tuple[MissionBegin, ...]
    """Oldest first."""
    origin: LocalOrigin
    """Of the local frame."""
