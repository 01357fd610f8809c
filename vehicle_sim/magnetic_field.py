"""The earth's magnetic field at the start position of PX4's simulation.

Strength and inclination are from PX4's world magnetic model.
"""

from __future__ import annotations

import math

STRENGTH_GAUSS = 0.4826
INCLINATION_RAD = math.radians(63.15)
DECLINATION_RAD = math.radians(2.96)
"""Declination of the simulated field: the mean of recordings at rest with heading north."""


def field_ned_gauss(declination_rad: float = DECLINATION_RAD) -> tuple[float, float, float]:
    """The field in NED for a declination."""
    horizontal_gauss = STRENGTH_GAUSS * math.cos(INCLINATION_RAD)
    return (
        horizontal_gauss * math.cos(declination_rad),
        horizontal_gauss * math.sin(declination_rad),
        STRENGTH_GAUSS * math.sin(INCLINATION_RAD),
    )
