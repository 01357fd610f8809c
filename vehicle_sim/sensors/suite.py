"""IMU, magnetometer, barometer and GPS of N vehicles, with noise, faults, calibrations and drivers.

Rates and noise (one sigma) were measured on PX4's SIH, disarmed and armed: magnetometer 50 Hz, barometer
20 Hz, GPS 8 Hz; while motors run, the IMU has 3 to 17 times the noise. The noise is white, and independent
for each vehicle (`noise.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import GRAVITY_M_S2, quaternion_of, rotation_matrix
from vehicle_sim.geodesy import to_global
from vehicle_sim.kernels import Blocks, Column, Flags, Rows, kernel
from vehicle_sim.magnetic_field import field_ned_gauss
from vehicle_sim.masks import any_nonzero, any_of
from vehicle_sim.noise import NoisePurpose, WhiteNoise
from vehicle_sim.parameters import Parameters
from vehicle_sim.rotations import rotated, rotated_back
from vehicle_sim.state import SensorState, SimulationOrigin, TruthState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

GYRO_NOISE_REST_RAD_S = (0.01, 0.01, 0.01)
GYRO_NOISE_ARMED_RAD_S = (0.14, 0.07, 0.03)
ACCEL_NOISE_REST_M_S2 = (0.1, 0.1, 0.1)
ACCEL_NOISE_ARMED_M_S2 = (0.52, 1.73, 1.41)
MAG_NOISE_GAUSS = (0.0115, 0.0115, 0.0175)
BARO_NOISE_M = 0.09
GPS_POSITION_NOISE_M = (0.2, 0.2, 0.5)
GPS_VELOCITY_NOISE_M_S = (0.06, 0.077, 0.158)

MAG_EVERY_STEPS = 5
BARO_EVERY_STEPS = 12
GPS_EVERY_STEPS = 31

GPS_HORIZONTAL_ACCURACY_M = 0.9
GPS_VERTICAL_ACCURACY_M = 1.78
GPS_SPEED_ACCURACY_M_S = 0.4
GPS_HDOP = 0.7
GPS_VDOP = 1.1
SATELLITES_FOR_A_FIX = 4
ACCEL_RANGE_M_S2 = 16.0 * GRAVITY_M_S2
"""Range of the usual accelerometers. A simulated PX4 does not limit its samples, nor does this simulator."""
BARO_TEMPERATURE_DEG_C = 11.82
"""Temperature in SCALED_PRESSURE at home: 15 °C at sea level, minus 6.5 °C per kilometre."""

_SEA_LEVEL_PA = 101325.0
_SEA_LEVEL_K = 288.15
_LAPSE_K_M = 0.0065
_PRESSURE_EXPONENT = 5.2558797


class Driver(Enum):
    """Simulated sensor drivers that can be stopped, by the names of PX4's modules."""

    GPS = "sensor_gps_sim"
    BARO = "sensor_baro_sim"
    MAG = "sensor_mag_sim"


STALE_SAMPLES = {Driver.BARO: 34, Driver.MAG: 334}
"""Number of equal samples after which a sensor is stale. PX4 counts three values per sample, and accepts 100
equal values of a barometer (1.7 s in a recording) and 1000 of a magnetometer (6.7 s)."""


class SensorFaults:
    """Faults of N vehicles' sensors that PX4's SIH cannot simulate; callers may write the arrays. A stuck
    sensor repeats its last sample; offsets are added to the measurements.

    Args:
        count: N.
    """

    def __init__(self, count: int) -> None:
        self.stuck = {driver: np.zeros(count, dtype=np.bool_) for driver in Driver}
        """For each sensor: (N,) whether the sensor repeats its last sample."""
        self.gps_offset_ned_m = np.zeros((count, 3))
        self.gps_offset_ned_m_s = np.zeros((count, 3))
        self.gps_jamming = np.zeros(count, dtype=np.int64)
        """(N,) the receivers' jamming indicator, 0..255."""
        self.vibration_m_s2 = np.zeros(count)
        """(N,) standard deviation that running motors add to each accelerometer sample."""
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
        self.gps_jamming[i] = self.vibration_m_s2[i] = 0.0
        self.set_imu_offset(i, np.zeros(3), np.zeros(3))


def pressure_hpa(alt_amsl_m: FloatArray) -> FloatArray:
    """Static pressure of the standard atmosphere."""
    return (
        0.01
        * _SEA_LEVEL_PA
        * (1.0 - _LAPSE_K_M * np.asarray(alt_amsl_m) / _SEA_LEVEL_K) ** _PRESSURE_EXPONENT
    )


class SensorSuite:
    """The sensors of N vehicles; `state` contains the newest sample of each sensor.

    Args:
        dt_s: step.
        origin: global position of the local NED origin.
        seed: seed of the noise.
        vehicles: number of each vehicle, which selects the vehicle's noise (`WhiteNoise`).
        noise: False: sensors without noise.
    """

    def __init__(
        self, dt_s: float, origin: SimulationOrigin, *, seed: int, vehicles: Sequence[int], noise: bool
    ) -> None:
        count = len(vehicles)
        self._dt_s, self._origin = dt_s, origin
        self._imu_noise = WhiteNoise(seed, vehicles, NoisePurpose.IMU, 6)
        self._mag_noise = WhiteNoise(seed, vehicles, NoisePurpose.MAG, 3)
        self._baro_noise = WhiteNoise(seed, vehicles, NoisePurpose.BARO, 1)
        self._gps_noise = WhiteNoise(seed, vehicles, NoisePurpose.GPS, 6)
        self._noise_factor = np.zeros(count)
        """(N,) factor on the noise of PX4's SIH."""
        self._mag_sigma_gauss, self._gps_sigma = np.zeros((count, 3)), np.zeros((count, 6))
        self._baro_sigma_m = np.zeros((count, 1))
        self._steps = 0
        self._gps_enabled = np.ones(count, dtype=np.bool_)
        self.faults = SensorFaults(count)
        self._satellites = np.full(count, 10, dtype=np.int64)
        self._mag_offset, self._previous_imu = np.zeros((count, 3)), np.zeros((count, 6))
        self._baro_offset_hpa, self._baro_offset_deg_c = np.zeros(count), np.zeros(count)
        self._equal_samples = {driver: np.zeros(count, dtype=np.int64) for driver in STALE_SAMPLES}
        """For each driver: (N,) number of equal samples since the sensor became stuck."""
        self._driver_runs = {driver: np.ones(count, dtype=np.bool_) for driver in Driver}
        """For each driver: (N,) whether the driver runs; a sensor without a driver keeps its last sample."""
        self._gyro_cal_offset, self._accel_cal_offset = np.zeros((count, 3)), np.zeros((count, 3))
        self._accel_cal_scale = np.ones((count, 3))
        self._mag_cal_offset, self._mag_cal_scale = np.zeros((count, 3)), np.ones((count, 3))
        self._baro_cal_offset_hpa = np.zeros(count)
        self._board_matrix = np.tile(np.eye(3), (count, 1, 1))
        """(N, 3, 3) rotation from sensor board to body (SENS_BOARD_X_OFF, SENS_BOARD_Y_OFF)."""
        self._board_rotated = np.zeros(count, dtype=np.bool_)
        """(N,) vehicles whose sensor board is rotated."""
        self._imu_sigma_rest = np.array(GYRO_NOISE_REST_RAD_S + ACCEL_NOISE_REST_M_S2)
        self._imu_sigma_armed = np.array(GYRO_NOISE_ARMED_RAD_S + ACCEL_NOISE_ARMED_M_S2)
        self._set_noise_factor(1.0 if noise else 0.0)
        self._field_ned_gauss = np.array(field_ned_gauss())
        self.state = SensorState(
            gyro_frd_rad_s=np.zeros((count, 3)),
            accel_frd_m_s2=np.zeros((count, 3)),
            gyro_vibration_rad_s=np.zeros(count),
            accel_vibration_m_s2=np.zeros(count),
            accel_clipping=np.zeros((count, 3)),
            mag_frd_gauss=np.zeros((count, 3)),
            mag_fresh=np.ones(count, dtype=np.bool_),
            mag_count=0,
            baro_pressure_hpa=np.zeros(count),
            baro_alt_amsl_m=np.zeros(count),
            baro_temperature_deg_c=np.full(count, BARO_TEMPERATURE_DEG_C),
            baro_fresh=np.ones(count, dtype=np.bool_),
            baro_stale=np.zeros(count, dtype=np.bool_),
            mag_stale=np.zeros(count, dtype=np.bool_),
            baro_count=0,
            gps_lat_deg=np.zeros(count),
            gps_lon_deg=np.zeros(count),
            gps_alt_amsl_m=np.zeros(count),
            gps_velocity_ned_m_s=np.zeros((count, 3)),
            gps_horizontal_accuracy_m=np.full(count, GPS_HORIZONTAL_ACCURACY_M),
            gps_vertical_accuracy_m=np.full(count, GPS_VERTICAL_ACCURACY_M),
            gps_speed_accuracy_m_s=np.full(count, GPS_SPEED_ACCURACY_M_S),
            gps_hdop=np.full(count, GPS_HDOP),
            gps_vdop=np.full(count, GPS_VDOP),
            gps_satellites=np.zeros(count, dtype=np.int64),
            gps_fix_type=np.zeros(count, dtype=np.int64),
            gps_fresh=np.ones(count, dtype=np.bool_),
            gps_count=0,
        )

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads SIM_GPS_USED, SIM_MAG_OFFSET_*, SIM_BARO_OFF_* and the calibrations of vehicle `i`."""
        self._satellites[i] = int(parameters.get("SIM_GPS_USED"))
        self._mag_offset[i] = [parameters.finite_value(f"SIM_MAG_OFFSET_{axis}") for axis in "XYZ"]
        self._baro_offset_hpa[i] = 0.01 * parameters.finite_value("SIM_BARO_OFF_P")
        self._baro_offset_deg_c[i] = parameters.finite_value("SIM_BARO_OFF_T")
        self._gyro_cal_offset[i] = [parameters.finite_value(f"CAL_GYRO0_{axis}OFF") for axis in "XYZ"]
        self._accel_cal_offset[i] = [parameters.finite_value(f"CAL_ACC0_{axis}OFF") for axis in "XYZ"]
        self._accel_cal_scale[i] = [parameters.finite_value(f"CAL_ACC0_{axis}SCALE") for axis in "XYZ"]
        self._mag_cal_offset[i] = [parameters.finite_value(f"CAL_MAG0_{axis}OFF") for axis in "XYZ"]
        self._mag_cal_scale[i] = [parameters.finite_value(f"CAL_MAG0_{axis}SCALE") for axis in "XYZ"]
        self._baro_cal_offset_hpa[i] = 0.01 * parameters.finite_value("CAL_BARO0_OFF")
        roll, pitch = (math.radians(parameters.finite_value(f"SENS_BOARD_{axis}_OFF")) for axis in "XY")
        self._board_matrix[i] = rotation_matrix(np.array([quaternion_of(roll, pitch, 0.0)]))[0]
        self._board_rotated[i] = bool((self._board_matrix[i] != np.eye(3)).any())

    def set_noise(self, i: int, noise_factor: float) -> None:
        """Multiplies the noise of PX4's SIH by a factor for vehicle `i`; 0: no noise.

        Raises:
            ValueError: the factor is negative or not a number.
        """
        if not (math.isfinite(noise_factor) and noise_factor >= 0.0):
            raise ValueError(f"sensor noise is {noise_factor}; give a factor of 0 or more (1: as PX4's SIH)")
        self._set_noise_factor(noise_factor, i)

    def _set_noise_factor(self, noise_factor: float, i: int | None = None) -> None:
        rows = slice(None) if i is None else i
        self._noise_factor[rows] = noise_factor
        self._mag_sigma_gauss[rows] = noise_factor * np.array(MAG_NOISE_GAUSS)
        self._baro_sigma_m[rows] = noise_factor * BARO_NOISE_M
        self._gps_sigma[rows] = noise_factor * np.array(GPS_POSITION_NOISE_M + GPS_VELOCITY_NOISE_M_S)

    def set_gps_enabled(self, i: int, enabled: bool) -> None:
        """Connects or disconnects the GPS antenna of vehicle `i`; a receiver without antenna has no fix."""
        self._gps_enabled[i] = enabled

    def set_gps_stuck(self, i: int, stuck: bool) -> None:
        """Makes the GPS receiver of vehicle `i` repeat its last fix (`stuck`), or measure again."""
        self.faults.stuck[Driver.GPS][i] = stuck

    def set_gps_offset(self, i: int, offset_ned_m: FloatArray) -> None:
        """Adds an offset (3,) to the GPS position of vehicle `i`, to simulate a glitch."""
        self.faults.gps_offset_ned_m[i] = offset_ned_m

    def set_driver(self, i: int, driver: Driver, running: bool) -> None:
        """Starts or stops a driver of vehicle `i`; a sensor without a running driver sends nothing."""
        self._driver_runs[driver][i] = running

    def driver_runs(self, i: int, driver: Driver) -> bool:
        """Whether a driver of vehicle `i` runs."""
        return bool(self._driver_runs[driver][i])

    def sample(self, truth: TruthState, attitude_matrix: FloatArray, armed: BoolArray) -> None:
        """Takes the samples of this step.

        Args:
            truth: the true state.
            attitude_matrix: (N, 3, 3) rotation matrices of the true attitudes.
            armed: (N,) vehicles whose motors run and add vibration to the IMU.
        """
        state = self.state
        _measure_imu(
            truth.acceleration_ned_m_s2, truth.rates_frd_rad_s, attitude_matrix, armed,
            self._noise_factor, self._imu_sigma_rest, self._imu_sigma_armed, self._imu_noise.sample(),
            self._gyro_cal_offset, self._accel_cal_offset, self._accel_cal_scale, self._board_rotated,
            self._board_matrix, self.faults.imu_offset, self.faults.vibration_m_s2,
            state.gyro_frd_rad_s, state.accel_frd_m_s2,
        )  # fmt: skip
        _measure_vibration(
            state.gyro_frd_rad_s, state.accel_frd_m_s2, self._previous_imu, state.gyro_vibration_rad_s,
            state.accel_vibration_m_s2, state.accel_clipping,
        )  # fmt: skip
        steps = self._steps
        if steps % MAG_EVERY_STEPS == 0:
            state.mag_fresh[:] = self._driver_runs[Driver.MAG]
            _measure_magnetometer(
                state.mag_fresh, self.faults.stuck[Driver.MAG], self._field_ned_gauss, attitude_matrix,
                self._mag_offset, self._mag_noise.sample(), self._mag_sigma_gauss, self._mag_cal_offset,
                self._mag_cal_scale, self._board_rotated, self._board_matrix, state.mag_frd_gauss,
            )  # fmt: skip
            self._reject_stale(Driver.MAG, state.mag_fresh, state.mag_stale)
            state.mag_count += 1
        if steps % BARO_EVERY_STEPS == 0:
            self._sample_baro(truth)
        if steps % GPS_EVERY_STEPS == 0:
            self._sample_gps(truth)
        self._steps += 1

    def _sample_baro(self, truth: TruthState) -> None:
        state = self.state
        state.baro_fresh[:] = self._driver_runs[Driver.BARO]
        takes_sample = state.baro_fresh & ~self.faults.stuck[Driver.BARO]
        noise_m = (self._baro_noise.sample() * self._baro_sigma_m)[:, 0]
        alt_amsl_m = self._origin.alt_amsl_m - truth.position_ned_m[:, 2] + noise_m
        pressure = pressure_hpa(alt_amsl_m) + (self._baro_offset_hpa - self._baro_cal_offset_hpa)
        np.copyto(state.baro_pressure_hpa, pressure, where=takes_sample)
        temperature_ratio = (100.0 * state.baro_pressure_hpa / _SEA_LEVEL_PA) ** (1.0 / _PRESSURE_EXPONENT)
        state.baro_alt_amsl_m[:] = (1.0 - temperature_ratio) * _SEA_LEVEL_K / _LAPSE_K_M
        temperature = 15.0 - _LAPSE_K_M * alt_amsl_m + self._baro_offset_deg_c
        np.copyto(state.baro_temperature_deg_c, temperature, where=takes_sample)
        self._reject_stale(Driver.BARO, state.baro_fresh, state.baro_stale)
        state.baro_count += 1

    def _reject_stale(self, driver: Driver, fresh: BoolArray, stale: BoolArray) -> None:
        """Marks a stuck sensor as stale after too many equal samples, and rejects its samples.

        Sensors without noise do not become stale, because their samples are equal anyway.
        """
        stuck, equal_samples = self.faults.stuck[driver], self._equal_samples[driver]
        if not (any_of(stuck) or any_nonzero(equal_samples)):
            return
        equal_samples += 1
        equal_samples[~(stuck & fresh & (self._noise_factor > 0.0))] = 0
        np.greater_equal(equal_samples, STALE_SAMPLES[driver], out=stale)
        fresh &= ~stale

    def _sample_gps(self, truth: TruthState) -> None:
        state = self.state
        noise = self._gps_noise.sample() * self._gps_sigma
        position = truth.position_ned_m + noise[:, :3] + self.faults.gps_offset_ned_m
        lat, lon = to_global(
            position[:, 0], position[:, 1], np.asarray(self._origin.lat_deg), np.asarray(self._origin.lon_deg)
        )
        fresh = state.gps_fresh
        fresh[:] = self._driver_runs[Driver.GPS]
        has_fix = self._gps_enabled & (self._satellites >= SATELLITES_FOR_A_FIX)
        # As in PX4, a simulated receiver with too few satellites measures positions, but reports no fix.
        has_position = fresh & self._gps_enabled & ~self.faults.stuck[Driver.GPS]
        np.copyto(state.gps_lat_deg, lat, where=has_position)
        np.copyto(state.gps_lon_deg, lon, where=has_position)
        np.copyto(state.gps_alt_amsl_m, self._origin.alt_amsl_m - position[:, 2], where=has_position)
        velocity = truth.velocity_ned_m_s + noise[:, 3:] + self.faults.gps_offset_ned_m_s
        velocity = np.where(self._gps_enabled[:, None], velocity, 0.0)
        has_velocity = has_position | (fresh & ~self._gps_enabled)
        np.copyto(state.gps_velocity_ned_m_s, velocity, where=has_velocity[:, None])
        for values, value_with_fix, value_without_fix in (
            (state.gps_satellites, self._satellites, np.where(self._gps_enabled, self._satellites, 0)),
            (state.gps_fix_type, 3, 0),
            (state.gps_horizontal_accuracy_m, GPS_HORIZONTAL_ACCURACY_M, 100.0),
            (state.gps_vertical_accuracy_m, GPS_VERTICAL_ACCURACY_M, 100.0),
            (state.gps_speed_accuracy_m_s, GPS_SPEED_ACCURACY_M_S, 100.0),
            (state.gps_hdop, GPS_HDOP, 100.0),
            (state.gps_vdop, GPS_VDOP, 100.0),
        ):
            np.copyto(values, np.where(has_fix, value_with_fix, value_without_fix), where=fresh)
        state.gps_count += 1


@kernel
def _measure_imu(
    acceleration: Rows, true_rates: Rows, attitude_matrix: Blocks, armed: Flags, noise_factor: Column,
    sigma_rest: Column, sigma_armed: Column, noise: Rows, gyro_cal_offset: Rows, accel_cal_offset: Rows,
    accel_cal_scale: Rows, board_rotated: Flags, board_matrix: Blocks, fault_offset: Rows, vibration: Column,
    gyro: Rows, accel: Rows,
) -> None:  # fmt: skip
    """Writes `gyro` and `accel`: adds noise, then applies calibration, rotation of the board and faults."""
    for i in range(gyro.shape[0]):
        specific_force = rotated_back(
            attitude_matrix[i], acceleration[i, 0], acceleration[i, 1], acceleration[i, 2] - GRAVITY_M_S2
        )
        for k in range(3):
            gyro_sigma, accel_sigma = sigma_rest[k], sigma_rest[3 + k]
            if armed[i]:
                gyro_sigma, accel_sigma = sigma_armed[k], sigma_armed[3 + k]
            rate = true_rates[i, k] + noise[i, k] * (gyro_sigma * noise_factor[i])
            gyro[i, k] = rate - gyro_cal_offset[i, k]
            if armed[i]:
                accel_sigma += vibration[i]
            force = specific_force[k] + noise[i, 3 + k] * (accel_sigma * noise_factor[i])
            accel[i, k] = (force - accel_cal_offset[i, k]) * accel_cal_scale[i, k]
        if board_rotated[i]:
            gyro[i, 0], gyro[i, 1], gyro[i, 2] = rotated(board_matrix[i], gyro[i, 0], gyro[i, 1], gyro[i, 2])
            accel[i, 0], accel[i, 1], accel[i, 2] = rotated(
                board_matrix[i], accel[i, 0], accel[i, 1], accel[i, 2]
            )
        for k in range(3):
            gyro[i, k] += fault_offset[i, k]
            accel[i, k] += fault_offset[i, 3 + k]


@kernel
def _measure_vibration(
    gyro: Rows, accel: Rows, previous: Rows, gyro_metric: Column, accel_metric: Column, clipping: Rows
) -> None:
    """Updates PX4's vibration metrics, a low-pass of the change from sample to sample, and the number of
    samples beyond the accelerometer's range in each axis (vehicle_imu)."""
    for i in range(gyro.shape[0]):
        turned = moved = 0.0
        for k in range(3):
            turned += (gyro[i, k] - previous[i, k]) ** 2
            moved += (accel[i, k] - previous[i, 3 + k]) ** 2
            previous[i, k], previous[i, 3 + k] = gyro[i, k], accel[i, k]
            if abs(accel[i, k]) > ACCEL_RANGE_M_S2:
                clipping[i, k] += 1.0
        gyro_metric[i] = 0.99 * gyro_metric[i] + 0.01 * math.sqrt(turned)
        accel_metric[i] = 0.99 * accel_metric[i] + 0.01 * math.sqrt(moved)


@kernel
def _measure_magnetometer(
    fresh: Flags, stuck: Flags, field_ned: Column, attitude_matrix: Blocks, offset: Rows, noise: Rows,
    sigma: Rows, cal_offset: Rows, cal_scale: Rows, board_rotated: Flags, board_matrix: Blocks, mag: Rows,
) -> None:  # fmt: skip
    """Writes `mag` for each vehicle with a new sample that is not stuck."""
    for i in range(mag.shape[0]):
        if not fresh[i] or stuck[i]:
            continue
        field_frd = rotated_back(attitude_matrix[i], field_ned[0], field_ned[1], field_ned[2])
        for k in range(3):
            measured = field_frd[k] + offset[i, k] + noise[i, k] * sigma[i, k]
            mag[i, k] = (measured - cal_offset[i, k]) * cal_scale[i, k]
        if board_rotated[i]:
            mag[i, 0], mag[i, 1], mag[i, 2] = rotated(board_matrix[i], mag[i, 0], mag[i, 1], mag[i, 2])


class RangeFinder:
    """The downward range finders of N vehicles, along the body's down axis (SIH_DISTSNSR_*)."""

    def __init__(self, count: int) -> None:
        self._override_m = np.full(count, -1.0)
        """(N,) distance that replaces the true distance; negative: no replacement."""
        self._min_m = np.zeros(count)
        self._max_m = np.full(count, np.inf)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads SIH_DISTSNSR_OVR, _MIN and _MAX of vehicle `i`."""
        self._override_m[i] = parameters.finite_value("SIH_DISTSNSR_OVR")
        self._min_m[i] = parameters.finite_value("SIH_DISTSNSR_MIN")
        self._max_m[i] = parameters.finite_value("SIH_DISTSNSR_MAX")

    def measure_m(self, distance_m: FloatArray) -> FloatArray:
        """Measured distances (N,) for true distances (N,); NaN: out of range."""
        measured = np.where(self._override_m >= 0.0, self._override_m, distance_m)
        return np.where((measured >= self._min_m) & (measured <= self._max_m), measured, np.nan)
