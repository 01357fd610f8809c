"""Where the vehicle returns to."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vehicle_sim.autopilot.body import Vector


@dataclass(slots=True)
class Home:
    """Where the vehicle returns to, in its local frame and on the globe."""

    lat_deg: float = math.nan
    lon_deg: float = math.nan
    alt_amsl_m: float = math.nan
    position_ned_m: Vector = (0.0, 0.0, 0.0)
    yaw_ned_rad: float = 0.0
    set_at_us: int = 0
    manual: bool = False

    @property
    def valid(self) -> bool:
        """Whether it was ever set."""
        return math.isfinite(self.lat_deg)
