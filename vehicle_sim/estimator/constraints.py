"""Constraints that replace missing measurements: a vehicle at rest does not move, and gravity points down.

These are PX4's zero-velocity, zero-rotation, constant-position, constant-height and gravity updates.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.fusion import Fusion
from vehicle_sim.estimator.kalman import Kalman
from vehicle_sim.estimator.kalman_loops import GYRO_BIAS, POSITION, SIZE, TILT, UNUSED, VELOCITY, YAW
from vehicle_sim.frames import GRAVITY_M_S2, row_norm
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

UPDATE_INTERVAL_S = 0.2
AT_REST_AFTER_S = 2.5
"""A vehicle that has been disarmed on the ground for this time counts as at rest, as in PX4's recorded
flags."""
_ALIGNING_SPEED_VARIANCE, _REST_SPEED_VARIANCE = 0.001**2, 0.2**2
"""Variance of the zero velocity of a vehicle at rest, before and after its tilt is known."""
_TILT_KNOWN_RAD = math.radians(3.0)
"""The tilt counts as known after its standard deviation was below this value."""
_FAKE_HEIGHT_VARIANCE = 10.0**2
_FAKE_POSITION_VARIANCE = 0.01**2
_FAKE_SPEED_VARIANCE = 10.0
_GRAVITY_BIT = 4
"""Bit of EKF2_IMU_CTRL."""
_GRAVITY_TOLERANCE = 0.1
"""Specific force that differs from 1 g by less than this fraction counts as gravity."""
_GRAVITY_GATE = 0.25
"""Largest accepted innovation of the direction of gravity, in standard deviations."""


class Constraints:
    """Constraints of N vehicles.

    Args:
        count: N.
        kalman: the filter.
        fusion: flags of the filter.
    """

    def __init__(self, count: int, kalman: Kalman, fusion: Fusion) -> None:
        self._kalman, self._fusion = kalman, fusion
        self._rest_time_s = np.full(count, AT_REST_AFTER_S)
        self._gravity_variance = np.full(count, np.inf)
        """(N,) variance of one sample's direction, as a fraction of 1 g; infinite: gravity is not used."""
        self._peak_decay_per_s = np.full(count, math.inf)
        self._rest_gyro_variance = np.ones(count)
        """(N,) variance of the mean body rate of a vehicle at rest, which is fused every
        UPDATE_INTERVAL_S."""
        self._peak_m_s2 = np.zeros(count)
        """(N,) decaying maximum of the specific force."""
        self._tilt_known = np.zeros(count, dtype=np.bool_)
        self._kept_position = np.zeros((count, 3))
        self._sensitivity = np.zeros((count, 2, SIZE))
        """(N, 2, SIZE) derivatives of the measured direction of gravity (body x and y) by the states."""
        self._correctable = np.ones((count, SIZE))
        self.active = True
        """Whether any vehicle is at rest or unaided, so that `add` must be called with each IMU sample."""
        self._constrained = np.ones(count, dtype=np.bool_)
        """(N,) vehicles that were at rest or unaided at the last update. Only their sums are used: `add` is
        called for all vehicles together, so the sums of other vehicles may be incomplete."""
        self._gravity_force_sum = np.zeros((count, 3))
        """(N, 3) sum of the specific forces that count as gravity [m/s²]."""
        self._gravity_samples = np.zeros(count, dtype=np.int64)
        """(N,) number of samples in `_gravity_force_sum`."""
        self._angle_sum = np.zeros((count, 3))

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads EKF2_GRAV_NOISE, EKF2_GYR_NOISE, EKF2_ABL_TAU and EKF2_IMU_CTRL of vehicle `i`."""
        used = int(parameters.get("EKF2_IMU_CTRL")) & _GRAVITY_BIT
        noise = max(parameters.finite_value("EKF2_GRAV_NOISE"), 0.01)
        self._gravity_variance[i] = noise**2 if used else math.inf
        self._rest_gyro_variance[i] = max(parameters.finite_value("EKF2_GYR_NOISE"), 1e-4) ** 2
        self._peak_decay_per_s[i] = 1.0 / max(parameters.finite_value("EKF2_ABL_TAU"), 0.1)

    def add(self, delta_angle: FloatArray, delta_velocity: FloatArray, dt_s: float) -> None:
        """Adds the IMU's measurements of one prediction step (N, 3).

        A specific force counts as gravity while the recent peak of the specific force is within 0.9 to 1.1 g.
        With running motors, vibration exceeds this range about twenty times per second.
        """
        self._angle_sum += delta_angle
        force_m_s2 = row_norm(delta_velocity)[:, 0] / dt_s
        np.maximum(self._peak_m_s2 * (1.0 - self._peak_decay_per_s * dt_s), force_m_s2, out=self._peak_m_s2)
        near_gravity = (
            np.abs(self._peak_m_s2 - GRAVITY_M_S2) < _GRAVITY_TOLERANCE * GRAVITY_M_S2
        ) | self._fusion.vehicle_at_rest
        self._gravity_force_sum += np.where(near_gravity[:, None], delta_velocity / dt_s, 0.0)
        self._gravity_samples += near_gravity

    def update(self, aided: BoolArray, moving: BoolArray, ready: BoolArray) -> None:
        """Applies the constraints, every UPDATE_INTERVAL_S.

        Args:
            aided: (N,) vehicles with a measured position or velocity.
            moving: (N,) vehicles that are armed or in the air.
            ready: (N,) vehicles with a known attitude.
        """
        kalman, fusion = self._kalman, self._fusion
        self._rest_time_s = np.where(moving, 0.0, self._rest_time_s + UPDATE_INTERVAL_S)
        at_rest = ready & (self._rest_time_s >= AT_REST_AFTER_S)
        np.copyto(fusion.vehicle_at_rest, at_rest)
        kalman.restore_symmetry()
        unaided = ready & ~aided
        if self.active:
            self._constrain(unaided & self._constrained, at_rest & self._constrained)
            self._gravity_force_sum.fill(0.0)
            self._gravity_samples.fill(0)
            self._angle_sum.fill(0.0)
        self._keep_height(ready)
        self._constrained = unaided | ~moving
        self._peak_m_s2[~self._constrained] = 0.0
        self.active = bool(self._constrained.any())

    def _constrain(self, unaided: BoolArray, at_rest: BoolArray) -> None:
        unaided_at_rest = unaided & at_rest
        if at_rest.any():
            self._fuse_rest(at_rest, unaided_at_rest)
        if unaided_at_rest.any() or self._fusion.valid_fake_pos.any():
            self._keep_position(unaided_at_rest)
        self._fuse_gravity(unaided)

    def _fuse_rest(self, at_rest: BoolArray, unaided_at_rest: BoolArray) -> None:
        """Fuses zero rotation for vehicles at rest, and zero velocity for vehicles at rest without aiding."""
        kalman = self._kalman
        innovation = np.where(unaided_at_rest[:, None], -kalman.velocity, 0.0)
        self._tilt_known |= (kalman.variances(TILT, YAW) < _TILT_KNOWN_RAD**2).all(axis=1)
        speed_variance = np.where(self._tilt_known, _REST_SPEED_VARIANCE, _ALIGNING_SPEED_VARIANCE)
        variance = np.where(unaided_at_rest, speed_variance, UNUSED)
        kalman.fuse_states(VELOCITY, innovation, np.repeat(variance[:, None], 3, axis=1))
        innovation = np.where(at_rest[:, None], self._angle_sum / UPDATE_INTERVAL_S - kalman.gyro_bias, 0.0)
        gyro_variance = np.where(at_rest, self._rest_gyro_variance, UNUSED)
        kalman.fuse_states(GYRO_BIAS, innovation, np.repeat(gyro_variance[:, None], 3, axis=1))

    def _keep_position(self, unaided_at_rest: BoolArray) -> None:
        """Keeps the estimated position of a vehicle at rest without aiding."""
        kalman, fusion = self._kalman, self._fusion
        starting = unaided_at_rest & ~fusion.valid_fake_pos
        np.copyto(self._kept_position, kalman.position, where=starting[:, None])
        if starting.any():
            for k in range(2):
                kalman.reset_state(starting, VELOCITY + k, 0.0, np.full(len(starting), _REST_SPEED_VARIANCE))
            fusion.xy_reset_counter += starting & fusion.aided_once
            fusion.vxy_reset_counter += starting & fusion.aided_once
        np.copyto(fusion.valid_fake_pos, unaided_at_rest)
        variance = np.where(unaided_at_rest, _FAKE_POSITION_VARIANCE, np.inf)
        for k in range(2):
            innovation = np.where(unaided_at_rest, self._kept_position[:, k] - kalman.position[:, k], 0.0)
            kalman.fuse(POSITION + k, innovation, variance)

    def _keep_height(self, ready: BoolArray) -> None:
        """Keeps the height constant and marks it invalid while no height source is fused."""
        kalman, fusion = self._kalman, self._fusion
        without_source = ready & ~fusion.gps_hgt & ~fusion.baro_hgt & ~fusion.vision_hgt
        starting = without_source & ~fusion.fake_hgt
        if starting.any():
            np.copyto(self._kept_position[:, 2], kalman.position[:, 2], where=starting)
            kalman.reset_state(starting, VELOCITY + 2, 0.0, np.full(len(starting), _FAKE_SPEED_VARIANCE))
            fusion.z_reset_counter += starting
            fusion.vz_reset_counter += starting
        np.copyto(fusion.fake_hgt, without_source)
        if without_source.any():
            innovation = np.where(without_source, self._kept_position[:, 2] - kalman.position[:, 2], 0.0)
            kalman.fuse(POSITION + 2, innovation, np.where(without_source, _FAKE_HEIGHT_VARIANCE, np.inf))

    def _fuse_gravity(self, unaided: BoolArray) -> None:
        """Fuses the direction of gravity for unaided vehicles that measure about 1 g, which corrects their
        tilt."""
        kalman, fusion = self._kalman, self._fusion
        candidates = unaided & (self._gravity_samples > 0) & np.isfinite(self._gravity_variance)
        np.copyto(fusion.gravity_vector, candidates)
        if not candidates.any():
            return
        samples = np.maximum(self._gravity_samples, 1)
        force = self._gravity_force_sum / samples[:, None] - kalman.accel_bias
        measured = force / np.maximum(row_norm(force), 1.0)
        sensitivity = self._sensitivity
        # Derivatives by rotations about north and east: minus gravity (1 g) crossed with the axis.
        sensitivity[:, :, TILT] = -kalman.matrix[:, 1, :2]
        sensitivity[:, :, TILT + 1] = kalman.matrix[:, 0, :2]
        innovation = measured[:, :2] + kalman.matrix[:, 2, :2]
        variance = np.where(candidates, self._gravity_variance, 1.0)
        cross_covariance, innovation_covariance = kalman.measurement_covariances(
            sensitivity, variance / samples
        )
        # The gate applies to a single sample, not to the mean.
        sigma = np.sqrt(
            np.einsum("nii->ni", innovation_covariance) + (variance - variance / samples)[:, None]
        )
        accepted = (candidates & (np.abs(innovation) <= _GRAVITY_GATE * sigma).all(axis=1))[:, None]
        kalman.fuse_measurements(
            cross_covariance,
            innovation_covariance,
            np.where(accepted, innovation, 0.0),
            self._correctable * accepted,
        )
