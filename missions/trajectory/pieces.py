"""A path as polynomial pieces, and bounds of its derivatives that are valid everywhere, not only at samples.

Each piece has degree five in Bernstein form, with four coordinates: north, east, down [m] and yaw [rad]. The
parameter of piece n runs from 0 to `spans[n]`, roughly the distance along the path in metres. A polynomial is
inside the convex hull of its control points, so the longest control point of a derivative is an upper bound
(G. Farin, Curves and Surfaces for CAGD, chapter 5). Each piece is first cut in four, which makes the bounds
tighter.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DEGREE = 5
BOUND_PARTS = 4
"""Number of parts into which a piece is cut to compute its bounds."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """N successive pieces."""

    points: Array
    """Control points, (N, 6, 4)."""
    spans: Array
    """Length of each piece in the path parameter, (N,)."""
    stops: NDArray[np.bool_]
    """Whether the vehicle stops before each piece, and after the last one, (N + 1,)."""
    marks: NDArray[np.int64]
    """For each given point, the number of pieces before the point, 0 to N."""

    def split(self, counts: NDArray[np.int64]) -> Pieces:
        """The same path, with piece n cut into `counts[n]` equal parts."""
        piece_index = np.repeat(np.arange(len(self.spans)), counts)
        first = np.concatenate(([0], np.cumsum(counts)))
        part_index = np.arange(len(piece_index)) - first[piece_index]
        points = np.empty((len(piece_index), DEGREE + 1, 4))
        for count in np.unique(counts):
            for index in range(count):
                chosen = (counts[piece_index] == count) & (part_index == index)
                matrix = _part_matrix(DEGREE, index / count, (index + 1) / count)
                points[chosen] = np.einsum("ij,njk->nik", matrix, self.points[piece_index[chosen]])
        stops = np.zeros(len(piece_index) + 1, dtype=bool)
        stops[first] = self.stops
        return Pieces(points, (self.spans / counts)[piece_index], stops, first[self.marks])

    def ends(self, order: int) -> tuple[Array, Array]:
        """Position (order 0) or derivative by the path parameter (1, 2) at start and end of each piece, (N,
        4)."""
        points = self.derivative(order)
        return points[:, 0], points[:, -1]

    def derivative(self, order: int) -> Array:
        """Control points of a derivative by the path parameter, (N, 6 - order, 4)."""
        points = self.points
        for lower_order in range(order):
            points = np.diff(points, axis=1) * ((DEGREE - lower_order) / self.spans)[:, None, None]
        return points


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """Upper bounds of each piece's derivatives by the path parameter; all (N,)."""

    horizontal: tuple[Array, Array, Array]
    """First, second and third derivative, horizontal."""
    up: Array
    """First derivative upwards."""
    down: Array
    """First derivative downwards."""
    vertical: tuple[Array, Array, Array]
    """First, second and third derivative, vertical."""
    magnitude: tuple[Array, Array, Array]
    """First, second and third derivative: magnitude of the vector of all three axes."""
    yaw: tuple[Array, Array, Array]
    """First, second and third derivative of the yaw."""

    @classmethod
    def from_pieces(cls, pieces: Pieces) -> Bounds:
        """The bounds of all pieces."""
        first, second, third = (_control_points_of_parts(pieces.derivative(order)) for order in (1, 2, 3))
        horizontal, vertical, magnitude, yaw = (
            (measure(first), measure(second), measure(third))
            for measure in (_horizontal_size, _vertical_size, _vector_size, _yaw_size)
        )
        up, down = (-first[..., 2]).max(axis=1), first[..., 2].max(axis=1)
        return cls(horizontal, np.maximum(up, 0.0), np.maximum(down, 0.0), vertical, magnitude, yaw)


def _horizontal_size(points: Array) -> Array:
    return np.hypot(points[..., 0], points[..., 1]).max(axis=1)


def _vertical_size(points: Array) -> Array:
    return np.abs(points[..., 2]).max(axis=1)


def _vector_size(points: Array) -> Array:
    return np.sqrt((points[..., :3] ** 2).sum(axis=2)).max(axis=1)


def _yaw_size(points: Array) -> Array:
    return np.abs(points[..., 3]).max(axis=1)


def _control_points_of_parts(points: Array) -> Array:
    """The control points of all parts of each piece, (N, BOUND_PARTS · (degree + 1), 4)."""
    degree = points.shape[1] - 1
    matrix = np.concatenate(
        [_part_matrix(degree, i / BOUND_PARTS, (i + 1) / BOUND_PARTS) for i in range(BOUND_PARTS)]
    )
    return np.einsum("ij,njk->nik", matrix, points)


@functools.cache
def _part_matrix(degree: int, start: float, end: float) -> Array:
    """The matrix for the control points of a polynomial between two parameters (blossoming)."""
    matrix = np.zeros((degree + 1, degree + 1))
    for row in range(degree + 1):
        blossom = np.eye(degree + 1)
        for step in range(degree):
            t = end if step < row else start
            blossom = (1.0 - t) * blossom[:-1] + t * blossom[1:]
        matrix[row] = blossom[0]
    return matrix


def power_basis(pieces: Pieces) -> Array:
    """Polynomial coefficients (N pieces, 6 powers, 4 axes); the variable goes from 0 to 1 in a piece."""
    matrix = np.zeros((DEGREE + 1, DEGREE + 1))
    for power in range(DEGREE + 1):
        for index in range(power + 1):
            matrix[power, index] = comb(DEGREE, power) * comb(power, index) * (-1.0) ** (power - index)
    return np.einsum("ij,njk->nik", matrix, pieces.points)


def hermite(start: Array, end: Array, spans: Array) -> Array:
    """Control points (N, 6, D) from value, first and second derivative (N, 3, D) at both ends."""
    h = spans[:, None]
    return np.stack(
        (
            start[:, 0],
            start[:, 0] + start[:, 1] * h / 5,
            start[:, 0] + start[:, 1] * 2 * h / 5 + start[:, 2] * h**2 / 20,
            end[:, 0] - end[:, 1] * 2 * h / 5 + end[:, 2] * h**2 / 20,
            end[:, 0] - end[:, 1] * h / 5,
            end[:, 0],
        ),
        axis=1,
    )
