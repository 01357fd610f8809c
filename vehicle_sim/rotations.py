"""Rotations of one vehicle, for compiled loops (`frames.py` computes rotations of all vehicles at once).

Quaternions are (w, x, y, z) and rotate FRD vectors to NED. An attitude `q` (4,) or a matrix (3, 3) can be one
row of an array for N vehicles; functions that write then change this array.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.kernels import formula

FloatArray = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


@formula
def quaternion_product(
    aw: float, ax: float, ay: float, az: float, bw: float, bx: float, by: float, bz: float
) -> Quaternion:
    """a ⊗ b: rotation b followed by a."""
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@formula
def rotate_attitude(q: FloatArray, x: float, y: float, z: float) -> None:
    """Rotates the attitude `q` (4,) by small angles x, y and z [rad] about the body's axes."""
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    w1 = w0 + 0.5 * (-x0 * x - y0 * y - z0 * z)
    x1 = x0 + 0.5 * (w0 * x + y0 * z - z0 * y)
    y1 = y0 + 0.5 * (w0 * y - x0 * z + z0 * x)
    z1 = z0 + 0.5 * (w0 * z + x0 * y - y0 * x)
    norm = math.sqrt(w1 * w1 + x1 * x1 + y1 * y1 + z1 * z1)
    q[0], q[1], q[2], q[3] = w1 / norm, x1 / norm, y1 / norm, z1 / norm


@formula
def write_matrix(q: FloatArray, matrix: FloatArray) -> None:
    """Writes the rotation matrix of the attitude `q` (4,) to `matrix` (3, 3)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    matrix[0, 0] = w * w + x * x - y * y - z * z
    matrix[1, 1] = w * w - x * x + y * y - z * z
    matrix[2, 2] = w * w - x * x - y * y + z * z
    matrix[0, 1] = 2.0 * (x * y - w * z)
    matrix[1, 0] = 2.0 * (x * y + w * z)
    matrix[0, 2] = 2.0 * (x * z + w * y)
    matrix[2, 0] = 2.0 * (x * z - w * y)
    matrix[1, 2] = 2.0 * (y * z - w * x)
    matrix[2, 1] = 2.0 * (y * z + w * x)


@formula
def rotated(matrix: FloatArray, x: float, y: float, z: float) -> Vector:
    """The rotated vector: matrix · (x, y, z)."""
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@formula
def rotated_back(matrix: FloatArray, x: float, y: float, z: float) -> Vector:
    """The vector after the inverse rotation: matrixᵀ · (x, y, z)."""
    return (
        matrix[0, 0] * x + matrix[1, 0] * y + matrix[2, 0] * z,
        matrix[0, 1] * x + matrix[1, 1] * y + matrix[2, 1] * z,
        matrix[0, 2] * x + matrix[1, 2] * y + matrix[2, 2] * z,
    )


@formula
def heading(q: FloatArray) -> float:
    """Heading [rad] of the attitude `q` (4,), -pi..pi, clockwise from north."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@formula
def length(x: float, y: float, z: float) -> float:
    """Length of a vector."""
    return math.sqrt(x * x + y * y + z * z)


@formula
def constrain(value: float, lowest: float, highest: float) -> float:
    """The value clipped to the limits; NaN stays NaN."""
    if value < lowest:
        return lowest
    if value > highest:
        return highest
    return value
