"""The wind along a flight, as its log tells it.

Across the body's thrust only drag acts, so each second of the flight measures the wind: specific force =
-(drag / mass) * (velocity - wind) along the body's x and y. How much of what changes from second to second is
wind and how much is error, these seconds say themselves: the wind is a local level (a random walk observed
with noise), whose ratio of variances is the most likely one of `RATIOS`, and which is smoothed over the whole
flight. (Durbin and Koopman, Time Series Analysis by State Space Methods, chapter 2.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from missions.what_if.flight import LoggedFlight
from vehicle_sim.frames import GRAVITY_M_S2, rotation_matrix

Values = NDArray[np.float64]

BLOCK_S = 1.0
"""Errors of attitude and force last about so long."""
RATIOS = (0.0, 0.03, 0.3, 3.0)
"""Variance of the wind's step from block to block by that of the error of a block; the first: steady."""
MIN_LIKELIER = 3.0
"""By so much the logarithm of the likelihood must rise before a wind is not steady."""
USUAL_WIND_M_S = 3.0
"""Standard deviation of the wind to the north or east before anything is known of it: so a light wind that is
not far above its error counts nearly whole, and one that the flight says nothing of not at all."""
MIN_LEVEL = 0.3
"""A body that is tilted further than about 70° measures nothing of the wind."""


def specific_force(flight: LoggedFlight) -> Values:
    """(N, 3) m/s², FRD: as measured, or from the velocity where no accelerometer is logged."""
    accelerations = np.gradient(flight.velocity_ned_m_s, flight.t_s, axis=0)
    accelerations[:, 2] -= GRAVITY_M_S2
    derived = np.einsum("nji,nj->ni", rotation_matrix(flight.q_ned_frd), accelerations)
    return np.where(np.isfinite(flight.force_frd_m_s2), flight.force_frd_m_s2, derived)


def wind_along(flight: LoggedFlight, drag_per_s: float, air: NDArray[np.bool_]) -> Values:
    """(N, 3) wind [m/s] at each sample, NED; 0 down, and 0 everywhere where nothing is felt of it.

    Args:
        flight: the flight.
        drag_per_s: drag per speed, divided by the mass.
        air: (N,) the samples that are used.
    """
    wind = np.zeros((len(flight.t_s), 3))
    block = max(1, round(BLOCK_S / float(flight.t_s[1] - flight.t_s[0]))) if len(flight.t_s) > 1 else 1
    count = np.count_nonzero(air) // block
    if drag_per_s <= 0.0 or count < 2:
        return wind
    matrix = np.swapaxes(rotation_matrix(flight.q_ned_frd[air]), 1, 2)[:, :2]
    felt = specific_force(flight)[air, :2] / drag_per_s + np.einsum(
        "nij,nj->ni", matrix, flight.velocity_ned_m_s[air]
    )
    across, felt, times_s = (
        values[: count * block].reshape(count, block, *values.shape[1:]).mean(axis=1)
        for values in (matrix[:, :, :2], felt, flight.t_s[air])
    )
    usable = np.abs(np.linalg.det(across)) > MIN_LEVEL
    if np.count_nonzero(usable) < 2:
        return wind
    measured = np.linalg.solve(across[usable], felt[usable][:, :, None])[:, :, 0]
    for axis, found in enumerate(_smoothed(measured).T):
        wind[:, axis] = np.interp(flight.t_s, times_s[usable], found)
    return wind


def _smoothed(measured: Values) -> Values:
    """(N, 2) the wind in each block."""
    courses = [_local_level(measured, ratio) for ratio in RATIOS]
    steady, likeliest = courses[0], max(courses, key=lambda each: each[0])
    _, level, share, noise = likeliest if likeliest[0] > steady[0] + MIN_LIKELIER else steady
    prior = max(USUAL_WIND_M_S**2, float(np.mean(level**2)))
    return level * (prior / (prior + share * noise))[:, None]


def _local_level(measured: Values, ratio: float) -> tuple[float, Values, Values, float]:
    """Filter and smoother.

    Returns:
        Logarithm of the likelihood, without its constant; (N, 2) levels; (N,) their variances by that of a
        block's error; and this variance, the most likely one.
    """
    count = len(measured)
    level, variance = measured.copy(), np.ones(count)
    squares = logs = 0.0
    for k in range(1, count):
        before = variance[k - 1] + ratio
        surprise = measured[k] - level[k - 1]
        squares += float(surprise @ surprise) / (before + 1.0)
        logs += math.log(before + 1.0)
        gain = before / (before + 1.0)
        level[k] = level[k - 1] + gain * surprise
        variance[k] = gain
    noise = squares / (2 * (count - 1))
    for k in range(count - 2, -1, -1):
        gain = variance[k] / (variance[k] + ratio)
        level[k] += gain * (level[k + 1] - level[k])
        variance[k] += gain**2 * (variance[k + 1] - variance[k] - ratio)
    return -math.log(max(noise, 1e-12)) * (count - 1) - logs, level, variance, noise
