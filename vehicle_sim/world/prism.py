"""Upright prisms: obstacles with a polygon as outline, from below the ground to a flat roof."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Prism:
    """An upright prism; the last corner joins the first."""

    name: str
    corners_ne_m: tuple[tuple[float, float], ...]
    """North and east of the corners; at least three, in either direction."""
    roof_alt_home_m: float
    """Altitude of the roof above home."""


class PrismShape:
    """The sides and the roof of one prism, for many positions or rays at once."""

    def __init__(self, prism: Prism) -> None:
        self.name = prism.name
        self.roof_down_m = -prism.roof_alt_home_m
        self._corners = np.array(prism.corners_ne_m, dtype=float)
        self._edges = np.roll(self._corners, -1, axis=0) - self._corners
        self._low, self._high = self._corners.min(axis=0), self._corners.max(axis=0)

    def any_near(self, position_ne_m: FloatArray, within_m: float) -> bool:
        """Whether any of the positions (M, 2) is within this distance of the bounding box of the outline."""
        low, high = self._low - within_m, self._high + within_m
        return bool(((position_ne_m >= low) & (position_ne_m <= high)).all(axis=1).any())

    def covers(self, position_ne_m: FloatArray) -> BoolArray:
        """(M,) whether positions (M, 2) are inside the outline (even-odd rule)."""
        north, east = position_ne_m[:, :1], position_ne_m[:, 1:]
        start, end = self._corners[:, 1], self._corners[:, 1] + self._edges[:, 1]
        spans = (start > east) != (end > east)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = self._corners[:, 0] + (east - start) / self._edges[:, 1] * self._edges[:, 0]
        return ((spans & (north < crossing)).sum(axis=1) % 2).astype(np.bool_)

    def nearest_on_outline(self, position_ne_m: FloatArray) -> FloatArray:
        """(M, 2) nearest positions on the outline to positions (M, 2)."""
        offset = position_ne_m[:, None] - self._corners
        length2 = np.maximum((self._edges**2).sum(axis=1), 1e-12)
        fraction = np.clip((offset * self._edges).sum(axis=2) / length2, 0.0, 1.0)
        on_side = self._corners + fraction[..., None] * self._edges
        nearest = ((position_ne_m[:, None] - on_side) ** 2).sum(axis=2).argmin(axis=1)
        return on_side[np.arange(len(position_ne_m)), nearest]

    def cast(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """(M,) distances along rays (M, 3) in NED; infinite for a ray that misses, 0 for a ray that starts
        inside."""
        to_corner = self._corners - origin[:, None, :2]
        along = direction[:, None, :2]
        with np.errstate(divide="ignore", invalid="ignore"):
            parallel = _cross(along, self._edges)
            distance = _cross(to_corner, self._edges) / parallel
            fraction = _cross(to_corner, along) / parallel
            is_wall = origin[:, 2:] + distance * direction[:, 2:] >= self.roof_down_m
            to_roof = (self.roof_down_m - origin[:, 2]) / direction[:, 2]
        hits = (distance >= 0.0) & (fraction >= 0.0) & (fraction <= 1.0) & is_wall
        walls = np.where(hits, distance, np.inf).min(axis=1)
        from_above = (direction[:, 2] > 0.0) & (to_roof >= 0.0)
        reach = np.where(from_above, to_roof, 0.0)
        from_above &= self.covers(origin[:, :2] + reach[:, None] * direction[:, :2])
        nearest = np.minimum(walls, np.where(from_above, to_roof, np.inf))
        inside = (origin[:, 2] > self.roof_down_m) & self.covers(origin[:, :2])
        return np.where(inside, 0.0, nearest)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The third component of the cross product of horizontal vectors."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
