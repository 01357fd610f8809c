"""Sensors that are stuck or wrong: what PX4's simulation has no switch for.

A stuck sensor repeats its last sample, offsets are added to what it measures.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Driver(Enum):
    """Simulated sensor drivers that can be stopped, by the names of PX4's modules."""

    GPS = "sensor_gps_sim"
    BARO = "sensor_baro_sim"
    MAG = "sensor_mag_sim"


class SensorFaults:
    """The faults of N vehicles; write the arrays as you like.

    Args:
        count: N.
    """

    def __init__(self, count: int) -> None:
        self.stuck = {driver: np.zeros(count, dtype=np.bool_) for driver in Driver}
        """(N,) whose sensor repeats its last sample."""
        self.gps_offset_ned_m = np.zeros((count, 3))
        self.gps_offset_ned_m_s = np.zeros((count, 3))
        self.imu_offset = np.zeros((count, 6))
        """(N, 6) added to gyroscopes [rad/s] and accelerometers [m/s²], FRD."""

    def set_imu_offset(self, i: int, gyro_frd_rad_s: FloatArray, accel_frd_m_s2: FloatArray) -> None:
        """Shift gyroscopes and accelerometers of vehicle `i` by these (3,)."""
        self.imu_offset[i, :3], self.imu_offset[i, 3:] = gyro_frd_rad_s, accel_frd_m_s2

    def clear(self, i: int) -> None:
        """Nothing of this is wrong with vehicle `i` any more."""
        for mask in self.stuck.values():
            mask[i] = False
        self.gps_offset_ned_m[i] = self.gps_offset_ned_m_s[i] = 0.0
        self.set_imu_offset(i, np.zeros(3), np.zeros(3))
