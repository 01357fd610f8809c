"""Aligns a flown path with the nominal path, independently of the times: dynamic time warping."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
OpenEnd = Literal["nominal", "flown"]


def align(nominal: Array, flown: Array, open_end: OpenEnd | None = None) -> tuple[Indices, Indices]:
    """Pairs of points of two paths with the least sum of squared distances.

    The first pair is the first points of both paths. From pair to pair, one index or both indices increase by
    one. So both paths are followed forwards only, each point has a partner, and two passes of a path that
    crosses or retraces itself have different partners.

    Args:
        nominal: (N, 3) points at even distances along the path.
        flown: (M, 3) points at about the same distances.
        open_end: the path whose last points may have no partner, because the other path ends before them;
            None: the last pair is the last points of both paths.

    Returns:
        (P,) indices in both paths.
    """
    sums = _least_sums(nominal, flown)
    i, j = len(nominal) - 1, len(flown) - 1
    if open_end == "nominal":
        i = int(sums[:, -1].argmin())
    elif open_end == "flown":
        j = int(sums[-1, 1:].argmin())
    return _pairs(sums, i, j)


def _least_sums(nominal: Array, flown: Array) -> Array:
    """(N, 1 + M) least sum of all pairs up to each pair; the first column is infinite.

    The pairs of a row begin at one column, reached from the previous row, and continue to the right. The sum
    of these pairs is a difference of two cumulative sums, so a running minimum finds the best first column
    for each pair.
    """
    products = nominal @ flown.T
    squares = (nominal**2).sum(axis=1)[:, None] + (flown**2).sum(axis=1) - 2.0 * products
    squares = np.maximum(squares, 0.0)
    row_sums = np.cumsum(squares, axis=1)
    row_sums_before = row_sums - squares
    sums = np.empty((len(nominal), len(flown) + 1))
    sums[:, 0], sums[0, 1:] = np.inf, row_sums[0]
    for row in range(1, len(nominal)):
        reached = np.minimum(sums[row - 1, 1:], sums[row - 1, :-1])
        reached -= row_sums_before[row]
        np.minimum.accumulate(reached, out=reached)
        np.add(reached, row_sums[row], out=sums[row, 1:])
    return sums


def _pairs(sums: Array, i: int, j: int) -> tuple[Indices, Indices]:
    """The pairs with the least sum, from the first one to (i, j)."""
    pairs = [(i, j)]
    while i > 0 or j > 0:
        if i == 0:
            j -= 1
        else:
            diagonal, from_previous_row, from_previous_column = sums[i - 1, j], sums[i - 1, j + 1], sums[i, j]
            i, j = (
                (i - 1, j - 1)
                if diagonal <= min(from_previous_row, from_previous_column)
                else ((i - 1, j) if from_previous_row <= from_previous_column else (i, j - 1))
            )
        pairs.append((i, j))
    index_pairs = np.array(pairs[::-1])
    return index_pairs[:, 0], index_pairs[:, 1]
