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
    """North and east of at least three corners, clockwise or counterclockwise."""
    roof_alt_home_m: float
    """Altitude of the roof above home."""


class PrismShape:
    """The shape of one prism; its methods take many positions or rays at once."""

    def __init__(self, prism: Prism) -> None:
        self.name = prism.name
        self.roof_down_m = -prism.roof_alt_home_m
        self._corners = np.array(prism.corners_ne_m, dtype=float)
        self._edges = np.roll(self._corners, -1, axis=0) - self._corners
        self._min_ne, self._max_ne = self._corners.min(axis=0), self._corners.max(axis=0)

    def any_near(self, position_ne_m: FloatArray, distance_m: float) -> bool:
        """Whether any of the positions (M, 2) is within this distance of the outline's bounding box."""
        lowest, highest = self._min_ne - distance_m, self._max_ne + distance_m
        return bool(((position_ne_m >= lowest) & (position_ne_m <= highest)).all(axis=1).any())

    def covers(self, position_ne_m: FloatArray) -> BoolArray:
        """(M,) whether positions (M, 2) are inside the outline (even-odd rule)."""
        north, east = position_ne_m[:, :1], position_ne_m[:, 1:]
        start_east, end_east = self._corners[:, 1], self._corners[:, 1] + self._edges[:, 1]
        crosses = (start_east > east) != (end_east > east)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing_north = self._corners[:, 0] + (east - start_east) / self._edges[:, 1] * self._edges[:, 0]
        return ((crosses & (north < crossing_north)).sum(axis=1) % 2).astype(np.bool_)

    def nearest_on_outline(self, position_ne_m: FloatArray) -> FloatArray:
        """(M, 2) nearest positions on the outline to positions (M, 2)."""
        from_corner = position_ne_m[:, None] - self._corners
        squared_length = np.maximum((self._edges**2).sum(axis=1), 1e-12)
        fraction = np.clip((from_corner * self._edges).sum(axis=2) / squared_length, 0.0, 1.0)
        on_edge = self._corners + fraction[..., None] * self._edges
        nearest_edge = ((position_ne_m[:, None] - on_edge) ** 2).sum(axis=2).argmin(axis=1)
        return on_edge[np.arange(len(position_ne_m)), nearest_edge]

    def cast(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """(M,) distances along rays (M, 3) in NED; infinite: the ray misses, 0: the ray starts inside."""
        to_corner = self._corners - origin[:, None, :2]
        horizontal = direction[:, None, :2]
        with np.errstate(divide="ignore", invalid="ignore"):
            denominator = _cross(horizontal, self._edges)
            to_edge = _cross(to_corner, self._edges) / denominator
            fraction = _cross(to_corner, horizontal) / denominator
            below_roof = origin[:, 2:] + to_edge * direction[:, 2:] >= self.roof_down_m
            to_roof = (self.roof_down_m - origin[:, 2]) / direction[:, 2]
        hits_side = (to_edge >= 0.0) & (fraction >= 0.0) & (fraction <= 1.0) & below_roof
        to_side = np.where(hits_side, to_edge, np.inf).min(axis=1)
        hits_roof = (direction[:, 2] > 0.0) & (to_roof >= 0.0)
        finite_to_roof = np.where(hits_roof, to_roof, 0.0)
        hits_roof &= self.covers(origin[:, :2] + finite_to_roof[:, None] * direction[:, :2])
        distance = np.minimum(to_side, np.where(hits_roof, to_roof, np.inf))
        inside = (origin[:, 2] > self.roof_down_m) & self.covers(origin[:, :2])
        return np.where(inside, 0.0, distance)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Vertical component of the cross product of horizontal vectors."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
