"""Sensor faults that PX4's SIH cannot simulate (stuck sensors, measurement offsets), and the sensor drivers.

A stuck sensor repeats its last sample; offsets are added to the measurements.
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
    """The sensor faults of N vehicles; callers may write the arrays.

    Args:
        count: N.
    """

    def __init__(self, count: int) -> None:
        self.stuck = {driver: np.zeros(count, dtype=np.bool_) for driver in Driver}
        """For each sensor: (N,) whether the sensor repeats its last sample."""
        self.gps_offset_ned_m = np.zeros((count, 3))
        self.gps_offset_ned_m_s = np.zeros((count, 3))
        self.imu_offset = np.zeros((count, 6))
        """(N, 6) added to gyroscopes [rad/s] and accelerometers [m/s²], FRD."""

    def set_imu_offset(self, i: int, gyro_frd_rad_s: FloatArray, accel_frd_m_s2: FloatArray) -> None:
        """Sets the offsets (3,) of gyroscopes and accelerometers of vehicle `i`."""
        self.imu_offset[i, :3], self.imu_offset[i, 3:] = gyro_frd_rad_s, accel_frd_m_s2

    def clear(self, i: int) -> None:
        """Removes all sensor faults of vehicle `i`."""
        for stuck in self.stuck.values():
            stuck[i] = False
        self.gps_offset_ned_m[i] = self.gps_offset_ned_m_s[i] = 0.0
        self.set_imu_offset(i, np.zeros(3), np.zeros(3))
