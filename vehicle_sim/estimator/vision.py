"""Position, velocity and heading from outside (cameras, motion capture), for vehicles that GPS does not help.

EKF2_EV_CTRL says what is taken: bit 0 horizontal position, 1 vertical position, 2 velocity, 3 heading. As
long as GPS is fused, PX4 takes such positions only as changes; here they wait until GPS is gone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.kalman import POSITION, VELOCITY, Kalman
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]

HORIZONTAL, VERTICAL, SPEED, HEADING = 1, 2, 4, 8
"""Bits of EKF2_EV_CTRL."""
LOST_S = 1.0
"""After so long without a sample inside its gate the next one is believed as it is."""
Vector = tuple[float, float, float]
UNKNOWN: Vector = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class VisionSample:
    """One measurement; NaN where there is none."""

    position_ned_m: Vector = UNKNOWN
    velocity_ned_m_s: Vector = UNKNOWN
    heading_rad: float = math.nan
    position_variance_m2: float = math.nan
    velocity_variance_m2_s2: float = math.nan


@dataclass(frozen=True, slots=True)
class Aid:
    """What a measurement did for a vehicle."""

    row: int
    horizontal: bool
    """Position or velocity is known by it."""
    vertical: bool
    """And the height."""
    heading_rad: float
    """NaN: none was given."""


@dataclass(frozen=True, slots=True)
class _Limits:
    """EKF2_EV* of one vehicle."""

    control: int
    position_noise_m: float
    velocity_noise_m_s: float
    heading_noise_rad: float
    position_gate: float
    velocity_gate: float


class Vision:
    """What was measured since the last look, and how it enters the filters."""

    def __init__(self, count: int) -> None:
        self._limits: list[_Limits | None] = [None] * count
        self._waiting: dict[int, VisionSample] = {}
        self._taken_at_s = np.full(count, -math.inf)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read EKF2_EV* of vehicle `i`."""
        value = parameters.usable
        self._limits[i] = _Limits(
            int(parameters.get("EKF2_EV_CTRL")),
            max(value("EKF2_EVP_NOISE"), 0.01),
            max(value("EKF2_EVV_NOISE"), 0.01),
            max(value("EKF2_EVA_NOISE"), 0.01),
            max(value("EKF2_EVP_GATE"), 1.0),
            max(value("EKF2_EVV_GATE"), 1.0),
        )

    def put(self, i: int, sample: VisionSample) -> None:
        """A measurement of vehicle `i`; dropped where EKF2_EV_CTRL wants none."""
        limits = self._limits[i]
        if limits is not None and limits.control:
            self._waiting[i] = sample

    @property
    def waits(self) -> bool:
        """Whether there is anything to fuse."""
        return bool(self._waiting)

    def fresh(self, now_s: float) -> NDArray[np.bool_]:
        """(N,) who has been aided within the last second."""
        return now_s - self._taken_at_s <= LOST_S

    def fuse(self, kalman: Kalman, gps_aided: NDArray[np.bool_], now_s: float) -> list[Aid]:
        """Correct the filters of those whom GPS does not aid, and say whose they were."""
        waiting, self._waiting = self._waiting, {}
        return [self._fuse_one(i, sample, kalman, now_s) for i, sample in waiting.items() if not gps_aided[i]]

    def reset(self, i: int) -> None:
        """Vehicle `i` starts anew."""
        self._waiting.pop(i, None)
        self._taken_at_s[i] = -math.inf

    def heading_variance(self, i: int) -> float:
        """Of a heading of vehicle `i` [rad²]; infinite where EKF2_EV_CTRL takes none."""
        limits = self._limits[i]
        if limits is None or not limits.control & HEADING:
            return math.inf
        return limits.heading_noise_rad**2

    def _fuse_one(self, i: int, sample: VisionSample, kalman: Kalman, now_s: float) -> Aid:
        limits = self._limits[i]
        if limits is None:
            return Aid(i, False, False, math.nan)
        new = now_s - self._taken_at_s[i] > LOST_S
        level, upright = bool(limits.control & HORIZONTAL), bool(limits.control & VERTICAL)
        placed, raised = self._take(
            i, kalman, POSITION, sample.position_ned_m, (level, level, upright), limits.position_gate,
            max(limits.position_noise_m**2, _finite(sample.position_variance_m2)), new,
        )  # fmt: skip
        moved, _ = self._take(
            i, kalman, VELOCITY, sample.velocity_ned_m_s, (bool(limits.control & SPEED),) * 3,
            limits.velocity_gate, max(limits.velocity_noise_m_s**2, _finite(sample.velocity_variance_m2_s2)),
            new,
        )  # fmt: skip
        if placed or moved:
            self._taken_at_s[i] = now_s
        return Aid(i, placed or moved, raised, sample.heading_rad)

    def _take(
        self, i: int, kalman: Kalman, first: int, measured: Vector, wanted: tuple[bool, ...], gate: float,
        variance: float, new: bool,
    ) -> tuple[bool, bool]:  # fmt: skip
        """Fuse the wanted axes; whether both horizontal ones were believed, and the vertical one."""
        count = len(kalman.vector)
        believed = [False, False, False]
        one = np.zeros(count, dtype=np.bool_)
        one[i] = True
        for axis in range(3):
            if not wanted[axis] or not math.isfinite(measured[axis]):
                continue
            index = first + axis
            off = measured[axis] - float(kalman.vector[i, index - VELOCITY])
            sigma = math.sqrt(float(kalman.variance(index)[i]) + variance)
            if new:
                kalman.reset_one(one, index, measured[axis], np.full(count, variance))
            elif abs(off) <= gate * sigma:
                kalman.fuse(index, np.where(one, off, 0.0), np.where(one, variance, np.inf))
            else:
                continue
            believed[axis] = True
        return believed[0] and believed[1], believed[2]


def _finite(value: float) -> float:
    return value if math.isfinite(value) and value > 0.0 else 0.0
