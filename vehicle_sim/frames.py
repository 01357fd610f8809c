"""Frame maths of the simulator: products and rotations of (N, …) arrays.

Every product is bilinear, so it is an outer product times a constant table. A product costs two array
operations; formulas for each component would cost twenty. For a single vehicle plain floats are ten times as
fast (`quaternion_of`, `angles_of`, `wrap_angle`). Quaternions are (w, x, y, z); `q_ned_frd` rotates FRD
vectors to NED.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]

GRAVITY_M_S2 = 9.80665
"""Standard gravity, as PX4 uses it."""


def _table(rows: int, columns: int, entries: list[tuple[int, int, float]]) -> FloatArray:
    table = np.zeros((rows, columns))
    for row, column, value in entries:
        table[row, column] += value
    return table


def _hamilton(b_components: tuple[int, ...]) -> FloatArray:
    """Table of the Hamilton product a ⊗ b, where b has only the given components."""
    terms_by_component = {
        0: [(0, 0, 1), (1, 1, -1), (2, 2, -1), (3, 3, -1)],
        1: [(0, 1, 1), (1, 0, 1), (2, 3, 1), (3, 2, -1)],
        2: [(0, 2, 1), (1, 3, -1), (2, 0, 1), (3, 1, 1)],
        3: [(0, 3, 1), (1, 2, 1), (2, 1, -1), (3, 0, 1)],
    }
    width = len(b_components)
    entries = [
        (a * width + b_components.index(b), k, float(sign))
        for k, terms in terms_by_component.items()
        for a, b, sign in terms
        if b in b_components
    ]
    return _table(4 * width, 4, entries)


_QUATERNION_PRODUCT = _hamilton((0, 1, 2, 3))
_HALF_RATE_PRODUCT = 0.5 * _hamilton((1, 2, 3))
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def _rotation_table() -> FloatArray:
    def product_index(i: int, j: int) -> int:
        return 4 * i + j

    entries: list[tuple[int, int, float]] = []
    for row in range(3):
        for column in range(3):
            k = 3 * row + column
            if row == column:
                entries += [(product_index(n, n), k, 1.0 if n in (0, row + 1) else -1.0) for n in range(4)]
            else:
                third_axis = 3 - row - column
                sign = -1.0 if (column - row) % 3 == 1 else 1.0
                entries.append((product_index(row + 1, column + 1), k, 2.0))
                entries.append((product_index(0, third_axis + 1), k, 2.0 * sign))
    return _table(16, 9, entries)


_ROTATION_MATRIX = _rotation_table()
_YAW_FACTORS = np.array([3, 2, 2, 3])
"""For each component of a quaternion, the other factor of the products in the heading formula."""
_CROSS = _table(9, 3, [(5, 0, 1.0), (7, 0, -1.0), (6, 1, 1.0), (2, 1, -1.0), (1, 2, 1.0), (3, 2, -1.0)])
_COMPONENT_SQUARES = 0.25 * _table(
    9, 4, [(4 * axis, k, 1.0 if k in (0, axis + 1) else -1.0) for axis in range(3) for k in range(4)]
)
_COMPONENT_SIGNS = _table(
    9, 3, [(7, 0, 1.0), (5, 0, -1.0), (2, 1, 1.0), (6, 1, -1.0), (3, 2, 1.0), (1, 2, -1.0)]
)
"""From a rotation matrix: the squares of the quaternion's components, and the signs of x, y and z."""


def _outer(a: FloatArray, b: FloatArray) -> FloatArray:
    return (a[:, :, None] * b[:, None, :]).reshape(a.shape[0], -1)


def _times(rows: FloatArray, table: FloatArray) -> FloatArray:
    """rows · table, as a separate product for each row.

    BLAS adds in an order that depends on the number of rows, so with one product for all rows the last bit of
    a vehicle's state would depend on the size of the fleet. A table with two entries per column needs no
    separate products, because the order of two summands does not matter.
    """
    return rows @ table if len(rows) == 1 else (rows[:, None, :] @ table)[:, 0, :]


def quaternion_product(a: FloatArray, b: FloatArray) -> FloatArray:
    """a ⊗ b, (N, 4) each: the rotation b, followed by the rotation a."""
    return _times(_outer(a, b), _QUATERNION_PRODUCT)


def conjugate(q: FloatArray) -> FloatArray:
    """The inverse rotation of unit quaternions (N, 4)."""
    return q * _CONJUGATE


def quaternion_rate(q: FloatArray, rates_frd_rad_s: FloatArray) -> FloatArray:
    """dq/dt of `q_ned_frd` (N, 4) for body rates (N, 3)."""
    return _times(_outer(q, rates_frd_rad_s), _HALF_RATE_PRODUCT)


def rotation_matrix(q: FloatArray) -> FloatArray:
    """(N, 3, 3) for unit quaternions (N, 4)."""
    return _times(_outer(q, q), _ROTATION_MATRIX).reshape(-1, 3, 3)


def rotate(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """matrix · vector for (N, 3, 3) and (N, 3)."""
    return (matrix @ vector[:, :, None])[:, :, 0]


def rotate_back(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """matrixᵀ · vector for (N, 3, 3) and (N, 3)."""
    return (vector[:, None, :] @ matrix)[:, 0, :]


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a × b, (N, 3) each."""
    return _outer(a, b) @ _CROSS


def row_norm(vector: FloatArray) -> FloatArray:
    """Length of each row, (N, 1)."""
    return np.sqrt(np.add.reduce(vector * vector, axis=1))[:, None]


def normalized(q: FloatArray) -> FloatArray:
    """Rows scaled to unit length."""
    return q / row_norm(q)


def yaw_of(q: FloatArray) -> FloatArray:
    """Heading (N,) of `q_ned_frd`, -pi..pi, clockwise from north."""
    products = q * q.take(_YAW_FACTORS, axis=1)
    doubled = 2.0 * (products[:, ::2] + products[:, 1::2])
    return np.arctan2(doubled[:, 0], 1.0 - doubled[:, 1])


def quaternion_from_yaw(yaw_ned_rad: FloatArray) -> FloatArray:
    """Level attitude (N, 4) with the given heading (N,)."""
    q = np.zeros((yaw_ned_rad.shape[0], 4))
    q[:, 0] = np.cos(0.5 * yaw_ned_rad)
    q[:, 3] = np.sin(0.5 * yaw_ned_rad)
    return q


def quaternion_from_matrix(matrix: FloatArray) -> FloatArray:
    """Unit quaternion (N, 4), w ≥ 0, of rotation matrices (N, 3, 3).

    Not valid for half turns about a tilted axis, because the signs are lost; no controller needs them.
    """
    flat = matrix.reshape(-1, 9)
    magnitude = np.sqrt(np.maximum(_times(flat, _COMPONENT_SQUARES) + 0.25, 0.0))
    magnitude[:, 1:] = np.copysign(magnitude[:, 1:], flat @ _COMPONENT_SIGNS)
    return normalized(magnitude)


def quaternion_of(roll_rad: float, pitch_rad: float, yaw_ned_rad: float) -> Quaternion:
    """One `q_ned_frd` from roll, pitch and yaw (the yaw rotation is the first), as plain numbers."""
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_ned_rad), math.sin(0.5 * yaw_ned_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def quaternion_from_euler(roll_rad: float, pitch_rad: float, yaw_ned_rad: float) -> FloatArray:
    """Same as `quaternion_of`, as an array (4,)."""
    return np.array(quaternion_of(roll_rad, pitch_rad, yaw_ned_rad))


def angles_of(q_ned_frd: Quaternion) -> tuple[float, float, float]:
    """Roll, pitch, yaw of one quaternion, as plain numbers."""
    w, x, y, z = q_ned_frd
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def euler_of(q: FloatArray) -> FloatArray:
    """Roll, pitch, yaw (N, 3) of `q_ned_frd` (N, 4)."""
    w, x, y, z = q[:, 0], q[:, 1], q[:, 2], q[:, 3]
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return np.stack([roll, pitch, yaw_of(q)], axis=1)


def wrap_pi(angle_rad: FloatArray) -> FloatArray:
    """The angles within -pi..pi."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def wrap_angle(angle_rad: float) -> float:
    """One angle within -pi..pi."""
    return math.remainder(angle_rad, math.tau)


def cross_table() -> FloatArray:
    """(3, 3, 3): (a × b)_k is the sum over i, j of a_i b_j table[i, j, k]."""
    return _CROSS.reshape(3, 3, 3).copy()
