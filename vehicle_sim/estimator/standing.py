"""What an estimator may assume where nothing aids it: who rests stands, and gravity points down.

PX4's zero-velocity, zero-rotation, constant-position, constant-height and gravity updates.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.fusion import Fusion
from vehicle_sim.estimator.kalman import GYRO_BIAS, POSITION, SIZE, TILT, UNUSED, VELOCITY, Kalman
from vehicle_sim.frames import GRAVITY_M_S2, row_norm
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

EVERY_S = 0.2
RESTS_AFTER_S = 2.5
"""Disarmed on the ground for so long counts as standing; the recorded flag rises then."""
_STANDING_VARIANCE = 0.001**2
_STANDING_GYRO_VARIANCE = 0.01**2
_FAKE_HEIGHT_VARIANCE = 10.0**2
_FAKE_POSITION_VARIANCE = 0.01**2
_FAKE_SPEED_VARIANCE = 10.0
_GRAVITY_BIT = 4
"""EKF2_IMU_CTRL."""
_NEAR_G = 0.1
"""Specific force may differ by this part of 1 g and still count as gravity."""
_GRAVITY_GATE = 0.25
"""Innovation over its sigma up to which the direction of the specific force counts as that of gravity."""


class Standing:
    """Assumptions about N vehicles.

    Args:
        count: N.
        kalman: the filter.
        fusion: its flags.
    """

    def __init__(self, count: int, kalman: Kalman, fusion: Fusion) -> None:
        self._kalman, self._fusion = kalman, fusion
        self._rested_s = np.full(count, RESTS_AFTER_S)
        self._gravity_variance = np.full(count, np.inf)
        """(N,) of one sample's direction, as a part of 1 g; infinite: gravity is not used."""
        self._forget_per_s = np.full(count, math.inf)
        self._peak_m_s2 = np.zeros(count)
        """(N,) greatest specific force of late."""
        self._place = np.zeros((count, 3))
        self._sensitivity = np.zeros((count, 2, SIZE))
        self._learns = np.ones((count, SIZE))
        self.wanted = True
        """Somebody rests or is not aided: `add` counts."""
        self._watched = np.ones(count, dtype=np.bool_)
        """(N,) who did at the last update: what `add` counted of others depends on the rest of the fleet."""
        self._force = np.zeros((count, 3))
        self._level_samples = np.zeros(count, dtype=np.int64)
        """(N,) samples in `_force`."""
        self._turned = np.zeros((count, 3))

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read EKF2_GRAV_NOISE, EKF2_ABL_TAU and EKF2_IMU_CTRL of vehicle `i`."""
        used = int(parameters.get("EKF2_IMU_CTRL")) & _GRAVITY_BIT
        noise = max(parameters.usable("EKF2_GRAV_NOISE"), 0.01)
        self._gravity_variance[i] = noise**2 if used else math.inf
        self._forget_per_s[i] = 1.0 / max(parameters.usable("EKF2_ABL_TAU"), 0.1)

    def reset(self, i: int) -> None:
        """Vehicle `i` starts anew."""
        self._rested_s[i] = RESTS_AFTER_S
        self._peak_m_s2[i] = 0.0
        self._watched[i] = True

    def add(self, delta_angle: FloatArray, delta_velocity: FloatArray, dt_s: float) -> None:
        """Remember what the IMU measured in one prediction step (N, 3).

        A specific force counts as gravity while none of late was greater or smaller by a tenth; the noise of
        turning motors interrupts that some twenty times a second.
        """
        self._turned += delta_angle
        size = row_norm(delta_velocity)[:, 0] / dt_s
        np.maximum(self._peak_m_s2 * (1.0 - self._forget_per_s * dt_s), size, out=self._peak_m_s2)
        near = (
            np.abs(self._peak_m_s2 - GRAVITY_M_S2) < _NEAR_G * GRAVITY_M_S2
        ) | self._fusion.vehicle_at_rest
        self._force += np.where(near[:, None], delta_velocity / dt_s, 0.0)
        self._level_samples += near

    def update(self, samples: int, aided: BoolArray, moving: BoolArray, ready: BoolArray) -> None:
        """Assume what may be assumed, every EVERY_S.

        Args:
            samples: how many steps were added since the last call.
            aided: (N,) something from outside says where it is or how fast.
            moving: (N,) armed or in the air.
            ready: (N,) whose attitude is known.
        """
        kalman, fusion = self._kalman, self._fusion
        self._rested_s = np.where(moving, 0.0, self._rested_s + EVERY_S)
        rests = ready & (self._rested_s >= RESTS_AFTER_S)
        np.copyto(fusion.vehicle_at_rest, rests)
        kalman.straighten()
        alone = ready & ~aided
        if self.wanted:
            self._assume(samples, alone & self._watched, rests & self._watched)
            self._force.fill(0.0)
            self._level_samples.fill(0)
            self._turned.fill(0.0)
        self._hold_height(ready)
        self._watched = alone | ~moving
        self._peak_m_s2[~self._watched] = 0.0
        self.wanted = bool(self._watched.any())

    def _assume(self, samples: int, alone: BoolArray, rests: BoolArray) -> None:
        fixed = alone & rests
        if rests.any():
            self._rest(rests, fixed, samples)
        if fixed.any() or self._fusion.valid_fake_pos.any():
            self._hold_place(fixed)
        self._fuse_gravity(alone)

    def _rest(self, rests: BoolArray, fixed: BoolArray, samples: int) -> None:
        """Who rests does not turn, and who is not aided besides has no velocity."""
        kalman = self._kalman
        off = np.where(fixed[:, None], -kalman.velocity, 0.0)
        variance = np.where(fixed[:, None], np.full((len(rests), 3), _STANDING_VARIANCE), UNUSED)
        kalman.fuse_states(VELOCITY, off, variance)
        off = np.where(rests[:, None], self._turned / EVERY_S - kalman.gyro_bias, 0.0)
        gyro_variance = np.full((len(rests), 3), _STANDING_GYRO_VARIANCE / samples)
        kalman.fuse_states(GYRO_BIAS, off, np.where(rests[:, None], gyro_variance, UNUSED))

    def _hold_place(self, fixed: BoolArray) -> None:
        """Who rests and is aided by nothing stays where it is believed to be."""
        kalman, fusion = self._kalman, self._fusion
        new = fixed & ~fusion.valid_fake_pos
        np.copyto(self._place, kalman.position, where=new[:, None])
        if new.any():
            for k in range(2):
                kalman.reset_one(new, VELOCITY + k, 0.0, np.full(len(new), _STANDING_VARIANCE))
            fusion.xy_reset_counter += new & fusion.aided_once
            fusion.vxy_reset_counter += new & fusion.aided_once
        np.copyto(fusion.valid_fake_pos, fixed)
        variance = np.where(fixed, _FAKE_POSITION_VARIANCE, np.inf)
        for k in range(2):
            off = np.where(fixed, self._place[:, k] - kalman.position[:, k], 0.0)
            kalman.fuse(POSITION + k, off, variance)

    def _hold_height(self, ready: BoolArray) -> None:
        """Without any height source the height is taken to stay, and is not valid."""
        kalman, fusion = self._kalman, self._fusion
        fake = ready & ~fusion.gps_hgt & ~fusion.baro_hgt & ~fusion.vision_hgt
        new = fake & ~fusion.fake_hgt
        if new.any():
            np.copyto(self._place[:, 2], kalman.position[:, 2], where=new)
            kalman.reset_one(new, VELOCITY + 2, 0.0, np.full(len(new), _FAKE_SPEED_VARIANCE))
            fusion.z_reset_counter += new
            fusion.vz_reset_counter += new
        np.copyto(fusion.fake_hgt, fake)
        if fake.any():
            off = np.where(fake, self._place[:, 2] - kalman.position[:, 2], 0.0)
            kalman.fuse(POSITION + 2, off, np.where(fake, _FAKE_HEIGHT_VARIANCE, np.inf))

    def _fuse_gravity(self, alone: BoolArray) -> None:
        """Who is aided by nothing and feels 1 g takes its direction for gravity's: that keeps it level."""
        kalman, fusion = self._kalman, self._fusion
        counted = alone & (self._level_samples > 0) & np.isfinite(self._gravity_variance)
        np.copyto(fusion.gravity_vector, counted)
        if not counted.any():
            return
        samples = np.maximum(self._level_samples, 1)
        force = self._force / samples[:, None] - kalman.accel_bias
        measured = force / np.maximum(row_norm(force), 1.0)
        sensitivity = self._sensitivity
        # Minus gravity (1 g) crossed with a turn about north and east, seen along the body's first two axes.
        sensitivity[:, :, TILT] = -kalman.matrix[:, 1, :2]
        sensitivity[:, :, TILT + 1] = kalman.matrix[:, 0, :2]
        innovation = measured[:, :2] + kalman.matrix[:, 2, :2]
        variance = np.where(counted, self._gravity_variance, 1.0)
        seen, total = kalman.sight(sensitivity, variance / samples)
        # The gate is that of a single sample.
        sigma = np.sqrt(np.einsum("nii->ni", total) + (variance - variance / samples)[:, None])
        taken = (counted & (np.abs(innovation) <= _GRAVITY_GATE * sigma).all(axis=1))[:, None]
        kalman.fuse_seen(seen, total, np.where(taken, innovation, 0.0), self._learns * taken)
