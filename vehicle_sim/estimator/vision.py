"""Fusion of external position, velocity and heading (camera, motion capture) for vehicles without GNSS.

EKF2_EV_CTRL selects the measurements: bit 0 horizontal position, 1 vertical position, 2 velocity, 3 heading.
While PX4 fuses GNSS, it fuses only the change of an external position. This simulator drops samples that
arrive while GNSS is fused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.kalman import Kalman
from vehicle_sim.estimator.kalman_loops import POSITION, VELOCITY
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]

EV_HPOS, EV_VPOS, EV_VEL, EV_YAW = 1, 2, 4, 8
"""Bits of EKF2_EV_CTRL."""
SAMPLE_TIMEOUT_S = 1.0
"""After this time without an accepted sample the filter is reset to the next sample."""
Vector = tuple[float, float, float]
UNKNOWN: Vector = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class VisionSample:
    """One external measurement; NaN: not measured."""

    position_ned_m: Vector = UNKNOWN
    velocity_ned_m_s: Vector = UNKNOWN
    heading_rad: float = math.nan
    position_variance_m2: float = math.nan
    velocity_variance_m2_s2: float = math.nan


@dataclass(frozen=True, slots=True)
class VisionResult:
    """Which parts of a vehicle's sample were fused."""

    row: int
    horizontal_fused: bool
    """The horizontal position or velocity was fused."""
    vertical_fused: bool
    """The vertical position was fused."""
    heading_rad: float
    """The measured heading, which the caller fuses; NaN: not measured."""


@dataclass(frozen=True, slots=True)
class _Settings:
    """EKF2_EV* of one vehicle."""

    control: int
    position_noise_m: float
    velocity_noise_m_s: float
    heading_noise_rad: float
    position_gate: float
    velocity_gate: float


class Vision:
    """Stores the newest sample of each vehicle, and fuses the samples into the filters."""

    def __init__(self, count: int) -> None:
        self._settings: list[_Settings | None] = [None] * count
        self._samples: dict[int, VisionSample] = {}
        self._accepted_at_s = np.full(count, -math.inf)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads EKF2_EV* of vehicle `i`."""
        value = parameters.finite_value
        self._settings[i] = _Settings(
            int(parameters.get("EKF2_EV_CTRL")),
            max(value("EKF2_EVP_NOISE"), 0.01),
            max(value("EKF2_EVV_NOISE"), 0.01),
            max(value("EKF2_EVA_NOISE"), 0.01),
            max(value("EKF2_EVP_GATE"), 1.0),
            max(value("EKF2_EVV_GATE"), 1.0),
        )

    def add_sample(self, i: int, sample: VisionSample) -> None:
        """Stores a sample of vehicle `i`; ignored if EKF2_EV_CTRL is zero."""
        settings = self._settings[i]
        if settings is not None and settings.control:
            self._samples[i] = sample

    @property
    def has_samples(self) -> bool:
        """Whether there are samples to fuse."""
        return bool(self._samples)

    def aided(self, now_s: float) -> NDArray[np.bool_]:
        """(N,) vehicles that were aided within the last second."""
        return now_s - self._accepted_at_s <= SAMPLE_TIMEOUT_S

    def fuse(self, kalman: Kalman, gnss_aided: NDArray[np.bool_], now_s: float) -> list[VisionResult]:
        """Fuses the samples of vehicles without GNSS; returns one result for each vehicle."""
        samples, self._samples = self._samples, {}
        return [
            self._fuse_sample(i, sample, kalman, now_s) for i, sample in samples.items() if not gnss_aided[i]
        ]

    def heading_variance(self, i: int) -> float:
        """Variance of a heading of vehicle `i` [rad²]; infinite if EKF2_EV_CTRL does not select the
        heading."""
        settings = self._settings[i]
        if settings is None or not settings.control & EV_YAW:
            return math.inf
        return settings.heading_noise_rad**2

    def _fuse_sample(self, i: int, sample: VisionSample, kalman: Kalman, now_s: float) -> VisionResult:
        settings = self._settings[i]
        if settings is None:
            return VisionResult(i, False, False, math.nan)
        is_reset = now_s - self._accepted_at_s[i] > SAMPLE_TIMEOUT_S
        use_horizontal, use_vertical = bool(settings.control & EV_HPOS), bool(settings.control & EV_VPOS)
        position_accepted, height_accepted = self._fuse_axes(
            i, kalman, POSITION, sample.position_ned_m, (use_horizontal, use_horizontal, use_vertical),
            settings.position_gate,
            max(settings.position_noise_m**2, _variance_or_zero(sample.position_variance_m2)), is_reset,
        )  # fmt: skip
        velocity_accepted, _ = self._fuse_axes(
            i, kalman, VELOCITY, sample.velocity_ned_m_s, (bool(settings.control & EV_VEL),) * 3,
            settings.velocity_gate,
            max(settings.velocity_noise_m_s**2, _variance_or_zero(sample.velocity_variance_m2_s2)), is_reset,
        )  # fmt: skip
        if position_accepted or velocity_accepted:
            self._accepted_at_s[i] = now_s
        return VisionResult(i, position_accepted or velocity_accepted, height_accepted, sample.heading_rad)

    def _fuse_axes(
        self, i: int, kalman: Kalman, first: int, measured: Vector, selected: tuple[bool, ...], gate: float,
        variance: float, is_reset: bool,
    ) -> tuple[bool, bool]:  # fmt: skip
        """Fuses the selected axes. Returns whether both horizontal axes were fused, and whether the
        vertical axis was fused."""
        count = len(kalman.vector)
        accepted = [False, False, False]
        mask = np.zeros(count, dtype=np.bool_)
        mask[i] = True
        for axis in range(3):
            if not selected[axis] or not math.isfinite(measured[axis]):
                continue
            index = first + axis
            innovation = measured[axis] - float(kalman.vector[i, index - VELOCITY])
            sigma = math.sqrt(float(kalman.variance(index)[i]) + variance)
            if is_reset:
                kalman.reset_state(mask, index, measured[axis], np.full(count, variance))
            elif abs(innovation) <= gate * sigma:
                kalman.fuse(index, np.where(mask, innovation, 0.0), np.where(mask, variance, np.inf))
            else:
                continue
            accepted[axis] = True
        return accepted[0] and accepted[1], accepted[2]


def _variance_or_zero(value: float) -> float:
    return value if math.isfinite(value) and value > 0.0 else 0.0
