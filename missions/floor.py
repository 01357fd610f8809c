"""How low a target may be: not below the ground.

**The rule.** Where elevation data show the ground, a target may be at most the vehicle's landing height
(`MPC_LAND_ALT3`) below it, whether the ground there is higher or lower than home. Everywhere else the ground
counts as level at home. A landing is no target: it ends where the vehicle touches the ground. Where neither
home nor the ground is known, nothing is refused.

Elevation data and the altitudes of GPS differ by some metres, while their differences from place to place
agree. So the data are shifted to the altitude of home, if they agree with it within `HOME_TOLERANCE_M`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from missions.geodesy import distance_m
from missions.terrain.ground import Floats, Ground

LANDING_HEIGHT_M = 1.0
"""Default of MPC_LAND_ALT3, below which PX4 descends slowly to touch the ground [m]."""
HOME_TOLERANCE_M = 10.0
"""Greatest plausible difference between the altitude of home and the elevation data [m]."""
Position = tuple[float, float, float]
"""Latitude, longitude [deg], altitude AMSL [m]."""
_ROUNDING_M = 0.01


@dataclass(frozen=True, slots=True)
class TooLow:
    """A target below the floor."""

    index: int
    """Index of the target."""
    text: str
    """`20.0 m below home`."""
    remedy: str


@dataclass(frozen=True, slots=True)
class Floor:
    """The lowest altitudes for the targets of one vehicle."""

    home: Position | None = None
    """None: unknown."""
    grounds: Sequence[Ground] = ()
    """Known ground; the first one that covers a position counts."""
    landing_height_m: float = LANDING_HEIGHT_M

    @property
    def knows_nothing(self) -> bool:
        """Whether neither home nor any ground is known, so that no target can be refused."""
        return self.home is None and not self.grounds

    def is_clear(self, alt_amsl_m: float) -> bool:
        """Whether a target at this altitude is high enough anywhere [m]; False: its position decides."""
        lowest_m = -math.inf if self.home is None else self.home[2] - self.landing_height_m - _ROUNDING_M
        return not self.grounds and alt_amsl_m >= lowest_m

    def lowest_amsl_m(self, lat_deg: float, lon_deg: float) -> float | None:
        """The lowest altitude of a target at a position [m]; None: unknown."""
        ground_m = float(self._ground_amsl_m(np.array([lat_deg]), np.array([lon_deg]))[0])
        if not math.isnan(ground_m):
            return ground_m - self.landing_height_m
        return None if self.home is None else self.home[2] - self.landing_height_m

    def too_low(
        self, lat_deg: Floats, lon_deg: Floats, alt_amsl_m: Floats, vehicle: Position | None = None
    ) -> TooLow | None:
        """The first target that is too low; None: no target is.

        Args:
            lat_deg: (N,) latitudes of the targets.
            lon_deg: (N,) longitudes.
            alt_amsl_m: (N,) altitudes AMSL.
            vehicle: position of the vehicle. A target at or above the vehicle's own position (within the
                landing height horizontally) is not too low, because it leads no further down.
        """
        if self.knows_nothing:
            return None
        ground_m = self._ground_amsl_m(lat_deg, lon_deg)
        home_m = -math.inf if self.home is None else self.home[2]
        surface_m = np.where(np.isnan(ground_m), home_m, ground_m)
        for index in np.flatnonzero(alt_amsl_m < surface_m - self.landing_height_m - _ROUNDING_M).tolist():
            target = (float(lat_deg[index]), float(lon_deg[index]), float(alt_amsl_m[index]))
            if vehicle is None or not self._is_at_vehicle(target, vehicle):
                return self._result(index, target[2], float(surface_m[index]), not np.isnan(ground_m[index]))
        return None

    def _is_at_vehicle(self, target: Position, vehicle: Position) -> bool:
        away_m = distance_m(*target[:2], *vehicle[:2])
        return away_m <= self.landing_height_m and target[2] >= vehicle[2] - _ROUNDING_M

    def _result(self, index: int, alt_amsl_m: float, surface_m: float, on_ground: bool) -> TooLow:
        what = "the ground there, according to the elevation data" if on_ground else "home"
        remedy = f"Choose an altitude of at least {surface_m:.0f} m AMSL"
        if self.home is not None:
            remedy += f", which is {surface_m - self.home[2]:.0f} m above home"
        if not on_ground:
            remedy += ", or add elevation data that show lower ground there"
        return TooLow(index, f"{surface_m - alt_amsl_m:.1f} m below {what}", f"{remedy}.")

    def _ground_amsl_m(self, lat_deg: Floats, lon_deg: Floats) -> Floats:
        """Altitude of the known ground; NaN: unknown."""
        altitudes_m = np.full(np.shape(lat_deg), np.nan)
        for ground in self.grounds:
            shifted_m = ground.altitudes_amsl_m(lat_deg, lon_deg) + self._shift_m(ground)
            altitudes_m = np.where(np.isnan(altitudes_m), shifted_m, altitudes_m)
        return altitudes_m

    def _shift_m(self, ground: Ground) -> float:
        at_home_m = None if self.home is None else ground.altitude_amsl_m(*self.home[:2])
        if self.home is None or at_home_m is None:
            return 0.0
        shift_m = self.home[2] - at_home_m
        return shift_m if abs(shift_m) <= HOME_TOLERANCE_M else 0.0
