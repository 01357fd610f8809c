"""Checks that a vehicle's numbers are finite and plausible before they are used.

MAVLink's floats may be NaN ("not set"), infinite, or of any size. Each number is checked once, when it is
decoded. For numbers up to `MAX_MAGNITUDE`, later squares, sums and conversions to integers cannot overflow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from missions.frames import Quaternion, Vector3

MAX_MAGNITUDE = 1e7
"""Maximum valid value in m, m/s, rad or degrees; a flight has no larger one (pole to equator: 10,000 km)."""
LENGTH_TOLERANCE = 0.1
"""Tolerance of a quaternion's length, which should be one."""


class Unusable(Exception):
    """Values of a message cannot be used; the text names them."""


def number(value: float) -> float | None:
    """The value; None if it is not finite or implausibly large."""
    return value if -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE else None


def require_valid(field: str, *values: float) -> None:
    """Raises Unusable if one of the values is invalid; `field` names the message and its fields."""
    for value in values:
        if not -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE:
            problem = (
                "is not a finite number"
                if not math.isfinite(value)
                else f"is {value:.3g}, which is not plausible"
            )
            raise Unusable(f"{field} {problem}")


def vector(values: Sequence[float]) -> Vector3 | None:
    """Three values; None if one of them is invalid."""
    x, y, z = values
    low, high = -MAX_MAGNITUDE, MAX_MAGNITUDE
    return (x, y, z) if low <= x <= high and low <= y <= high and low <= z <= high else None


def rotation(values: Sequence[float]) -> Quaternion | None:
    """A unit quaternion (w, x, y, z); None if the values are not a rotation, such as four zeros."""
    w, x, y, z = values
    length = math.hypot(w, x, y, z)
    return (w, x, y, z) if abs(length - 1.0) <= LENGTH_TOLERANCE else None


def require_on_earth(field: str, lat_deg: float, lon_deg: float) -> None:
    """Raises Unusable if the position does not exist on the earth."""
    if not (-90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0):
        raise Unusable(f"{field} is not a position on the earth ({lat_deg:.7g}°, {lon_deg:.7g}°)")
