"""The estimator runs with the samples of a real PX4's onboard log; its estimate is compared with PX4's
estimate and the truth.

The log has all samples of IMU, GPS, barometer and compass, so only the filters differ and not the noise.
"""

from __future__ import annotations

import gzip
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pyulog import ULog

from vehicle_sim.estimator.estimator import RANGE_EVERY_STEPS, Estimator
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import V1_16
from vehicle_sim.sensors.suite import SensorSuite
from vehicle_sim.simulation import STEP_S
from vehicle_sim.state import SimulationOrigin

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

STATES = 21
"""Standard deviations compared: tilt and heading, velocity, position, gyroscope and accelerometer offsets,
magnetic field and compass offset."""
MAG_SAMPLES = 4
"""PX4 logs the average of this number of samples, and the estimator averages again."""


@dataclass(frozen=True, slots=True)
class Replay:
    """The simulated estimate, PX4's estimate and the truth at the same times."""

    t_s: FloatArray
    """(T,) time since boot."""
    velocity: FloatArray
    """(T, 3) of the simulated estimator [m/s], NED."""
    recorded_velocity: FloatArray
    """(T, 3) of PX4's estimator."""
    true_velocity: FloatArray
    """(T, 3) true velocity."""
    sigma: FloatArray
    """(T, 21) standard deviations of the simulated estimator's states."""
    recorded_sigma: FloatArray
    """(T, 21) standard deviations of PX4's states."""
    declination: BoolArray
    """(T,) the simulated estimator fuses the declination."""
    recorded_declination: BoolArray
    """(T,) PX4's estimator fuses the declination."""


class _Log:
    def __init__(self, path: Path) -> None:
        topics = ULog(io.BytesIO(gzip.decompress(path.read_bytes()))).data_list
        self._topics = {topic.name: topic.data for topic in topics if topic.multi_id == 0}

    def times_s(self, topic: str) -> FloatArray:
        return 1e-6 * self._topics[topic]["timestamp"].astype(float)

    def columns(self, topic: str, *names: str) -> FloatArray:
        return np.stack([self._topics[topic][name].astype(float) for name in names], axis=1)

    def at(self, t_s: FloatArray, topic: str, *names: str) -> FloatArray:
        times, values = self.times_s(topic), self.columns(topic, *names)
        return np.stack([np.interp(t_s, times, column) for column in values.T], axis=1)

    def latest(self, t_s: float, topic: str, name: str) -> float:
        row = max(int(np.searchsorted(self.times_s(topic), t_s)) - 1, 0)
        return float(self._topics[topic][name][row])


def _axes(name: str, count: int = 3) -> list[str]:
    return [f"{name}[{k}]" for k in range(count)]


def replay_log(log: _Log) -> Replay:
    """Runs the estimator with the log's samples; each sample is used in the first prediction after its
    time."""
    imu = log.columns("sensor_combined", *_axes("gyro_rad"), *_axes("accelerometer_m_s2"))
    times = log.times_s("sensor_combined")
    fixes = log.columns(
        "vehicle_gps_position",
        "latitude_deg", "longitude_deg", "altitude_msl_m", "vel_n_m_s", "vel_e_m_s", "vel_d_m_s",
    )  # fmt: skip
    baro_alts_m = log.columns("vehicle_air_data", "baro_alt_meter")
    mag_fields = log.columns("vehicle_magnetometer", *_axes("magnetometer_ga"))
    sample_times = {
        name: log.times_s(name)
        for name in ("vehicle_gps_position", "vehicle_air_data", "vehicle_magnetometer")
    }
    fix_counts, baro_counts, mag_counts = (np.searchsorted(each, times) for each in sample_times.values())
    true_down_m = log.at(times, "vehicle_local_position_groundtruth", "z")[:, 0]
    sensors = SensorSuite(STEP_S, SimulationOrigin(*fixes[0, :3]), seed=0, vehicles=[0], noise=False).state
    sensors.gps_satellites[:], sensors.gps_fix_type[:] = 10, 3
    estimator = Estimator(1, STEP_S)
    estimator.configure(0, Parameters(px4=V1_16))
    velocity, sigma, declination, mag_samples_left = [], [], [], 0
    for k, t_s in enumerate(times):
        sensors.gyro_frd_rad_s[:], sensors.accel_frd_m_s2[:] = imu[k, :3], imu[k, 3:]
        if k % 2 and k > 1:
            if fix_counts[k] > fix_counts[k - 2]:
                fix = fixes[fix_counts[k] - 1]
                sensors.gps_lat_deg[:], sensors.gps_lon_deg[:], sensors.gps_alt_amsl_m[:] = fix[:3]
                sensors.gps_velocity_ned_m_s[:] = fix[3:]
                sensors.gps_count += 1
            if baro_counts[k] > baro_counts[k - 2]:
                sensors.baro_alt_amsl_m[:] = baro_alts_m[baro_counts[k] - 1]
                sensors.baro_count += 2
            if mag_counts[k] > mag_counts[k - 2]:
                sensors.mag_frd_gauss[:] = mag_fields[mag_counts[k] - 1]
                mag_samples_left = MAG_SAMPLES
            if mag_samples_left:
                sensors.mag_count += 1
                mag_samples_left -= 1
        if k % RANGE_EVERY_STEPS == 0:
            in_air = log.latest(t_s, "vehicle_land_detected", "landed") == 0.0
            armed = log.latest(t_s, "vehicle_status", "arming_state") == 2.0
            estimator.update_range(np.array([-true_down_m[k]]), np.array([in_air]), np.array([armed]))
        estimator.update(sensors)
        velocity.append(estimator.state.velocity_ned_m_s[0].copy())
        sigma.append(np.sqrt(estimator.kalman.variances(0, STATES)[0]))
        declination.append(bool(estimator.fusion.mag_dec[0]))
    return Replay(
        times,
        np.array(velocity),
        log.at(times, "vehicle_local_position", "vx", "vy", "vz"),
        log.at(times, "vehicle_local_position_groundtruth", "vx", "vy", "vz"),
        np.array(sigma),
        np.sqrt(log.at(times, "estimator_states", *_axes("covariances", STATES))),
        np.array(declination),
        np.array([log.latest(t_s, "estimator_status_flags", "cs_mag_dec") == 1.0 for t_s in times]),
    )


@pytest.fixture(scope="module")
def replay(reference_data: Path) -> Replay:
    return replay_log(_Log(reference_data / "px4/logs/flight-short.ulg.gz"))


def rms(values: FloatArray) -> FloatArray:
    return np.sqrt((values**2).mean(axis=0))


def test_the_velocity_matches_the_velocity_of_px4s_estimator(replay):
    hover = (replay.t_s > 16.0) & (replay.t_s < 42.0)
    difference = rms((replay.velocity - replay.recorded_velocity)[hover])
    assert (difference <= [0.03, 0.08, 0.03]).all(), difference
    error = rms((replay.velocity - replay.true_velocity)[hover])
    recorded_error = rms((replay.recorded_velocity - replay.true_velocity)[hover])
    assert (error <= 1.2 * recorded_error).all(), (error, recorded_error)
    assert (error >= recorded_error / 1.2).all(), (error, recorded_error)


@pytest.mark.parametrize(
    ("t_s", "phase"), [(6.0, "at rest"), (12.0, "before arming"), (22.0, "holding"), (40.0, "landing")]
)
def test_the_standard_deviations_match_px4(replay, t_s, phase):
    index = int(np.searchsorted(replay.t_s, t_s))
    ratio = replay.sigma[index] / replay.recorded_sigma[index]
    assert (ratio <= 1.25).all(), (phase, ratio)
    assert (ratio >= 0.75).all(), (phase, ratio)


def test_the_declination_is_fused_at_rest_although_gnss_is_fused(replay):
    at_rest = (replay.t_s > 4.0) & (replay.t_s < 12.0)
    assert replay.recorded_declination[at_rest].all()
    assert replay.declination[at_rest].all()
    armed = (replay.t_s > 13.0) & (replay.t_s < 44.0)
    assert not replay.recorded_declination[armed].any()
    assert not replay.declination[armed].any()
