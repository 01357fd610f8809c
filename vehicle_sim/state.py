"""The state of N vehicles as plain arrays: truth, sensors, estimate, battery and controller setpoints.

The estimator reads `SensorState`, and the autopilot reads `EstimateState`, never `TruthState`. Frames are NED
and FRD, units are SI or in the name; quaternions are (w, x, y, z) and rotate FRD to NED. Each step overwrites
the arrays in place; do not keep references to single rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.kernels import Column, Rows, formula, kernel

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

Vector = tuple[float, float, float]

ROTOR_COUNT = 4


@dataclass(frozen=True, slots=True)
class SimulationOrigin:
    """Global position of the origin of the true local NED frame."""

    lat_deg: float = 47.3977432
    lon_deg: float = 8.54559422
    alt_amsl_m: float = 489.399994


@dataclass(slots=True)
class TruthState:
    """The true state; only physics, sensors and tests read it."""

    position_ned_m: FloatArray
    """(N, 3) from `SimulationOrigin`."""
    velocity_ned_m_s: FloatArray
    """(N, 3)."""
    acceleration_ned_m_s2: FloatArray
    """(N, 3) acceleration relative to the ground, including gravity (zero at rest)."""
    q_ned_frd: FloatArray
    """(N, 4)."""
    rates_frd_rad_s: FloatArray
    """(N, 3)."""
    rotor_thrust: FloatArray
    """(N, 4) each rotor's thrust as a fraction of SIH_T_MAX, 0..1, including motor lag."""
    on_ground: BoolArray
    """(N,)."""


@dataclass(slots=True)
class SensorState:
    """The newest sample of each sensor; all vehicles sample together, and `*_count` counts their samples."""

    gyro_frd_rad_s: FloatArray
    """(N, 3) each step, with noise."""
    accel_frd_m_s2: FloatArray
    """(N, 3) specific force, each step, with noise."""
    gyro_vibration_rad_s: FloatArray
    """(N,) low-pass of the change of the angular rate from sample to sample."""
    accel_vibration_m_s2: FloatArray
    """(N,) the same of the specific force."""
    accel_clipping: FloatArray
    """(N, 3) number of samples beyond the accelerometer's range since boot."""
    mag_frd_gauss: FloatArray
    """(N, 3)."""
    mag_fresh: BoolArray
    """(N,) vehicles whose magnetometer sent the newest sample."""
    mag_count: int
    baro_pressure_hpa: FloatArray
    """(N,)."""
    baro_alt_amsl_m: FloatArray
    """(N,) pressure altitude."""
    baro_temperature_deg_c: FloatArray
    """(N,)."""
    baro_fresh: BoolArray
    """(N,)."""
    baro_stale: BoolArray
    """(N,) vehicles whose barometer has repeated one value for so long that the samples are rejected."""
    mag_stale: BoolArray
    """(N,) vehicles whose magnetometer has repeated one value for so long that the samples are rejected."""
    baro_count: int
    gps_lat_deg: FloatArray
    """(N,)."""
    gps_lon_deg: FloatArray
    """(N,)."""
    gps_alt_amsl_m: FloatArray
    """(N,)."""
    gps_velocity_ned_m_s: FloatArray
    """(N, 3)."""
    gps_horizontal_accuracy_m: FloatArray
    """(N,) PX4's eph (h_acc)."""
    gps_vertical_accuracy_m: FloatArray
    """(N,)."""
    gps_speed_accuracy_m_s: FloatArray
    """(N,)."""
    gps_hdop: FloatArray
    """(N,)."""
    gps_vdop: FloatArray
    """(N,)."""
    gps_satellites: IntArray
    """(N,)."""
    gps_fix_type: IntArray
    """(N,) GPS_FIX_TYPE, 0: no GPS, 1: no fix, 3: 3D fix."""
    gps_fresh: BoolArray
    """(N,)."""
    gps_count: int


@dataclass(slots=True)
class EstimateState:
    """The estimated state; the origin of local NED (`origin_*`) is the position of the first good GPS fix."""

    position_ned_m: FloatArray
    """(N, 3)."""
    velocity_ned_m_s: FloatArray
    """(N, 3)."""
    acceleration_ned_m_s2: FloatArray
    """(N, 3) without gravity."""
    q_ned_frd: FloatArray
    """(N, 4)."""
    rates_frd_rad_s: FloatArray
    """(N, 3) low-passed gyro (IMU_GYRO_CUTOFF)."""
    angular_acceleration_frd_rad_s2: FloatArray
    """(N, 3) low-passed (IMU_DGYRO_CUTOFF)."""
    heading_rad: FloatArray
    """(N,) -pi..pi."""
    lat_deg: FloatArray
    """(N,)."""
    lon_deg: FloatArray
    """(N,)."""
    alt_amsl_m: FloatArray
    """(N,)."""
    origin_lat_deg: FloatArray
    """(N,) NaN before the first good GPS fix."""
    origin_lon_deg: FloatArray
    """(N,)."""
    origin_alt_amsl_m: FloatArray
    """(N,)."""
    horizontal_accuracy_m: FloatArray
    """(N,) one sigma (eph of vehicle_local_position)."""
    vertical_accuracy_m: FloatArray
    """(N,) one sigma (epv of vehicle_local_position)."""
    speed_accuracy_m_s: FloatArray
    """(N,)."""
    innovation_ratio_velocity: FloatArray
    """(N,) innovation divided by gate, as ESTIMATOR_STATUS reports it."""
    innovation_ratio_position: FloatArray
    """(N,)."""
    innovation_ratio_height: FloatArray
    """(N,)."""
    innovation_ratio_mag: FloatArray
    """(N,)."""
    gps_rejected: BoolArray
    """(N,) whether the newest GPS sample was outside its gate and was not fused."""
    height_above_ground_m: FloatArray
    """(N,) from the range finder (dist_bottom); NaN: unknown."""
    valid_attitude: BoolArray
    """(N,)."""
    valid_velocity: BoolArray
    """(N,) whether the horizontal velocity may be used."""
    valid_position: BoolArray
    """(N,) whether the horizontal position may be used."""
    valid_altitude: BoolArray
    """(N,) whether altitude and vertical speed may be used."""


class VehicleEstimate(NamedTuple):
    """One vehicle's row of `EstimateState` as plain numbers; NED, FRD, SI."""

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector
    q_ned_frd: tuple[float, float, float, float]
    rates_frd_rad_s: Vector
    roll_rad: float
    pitch_rad: float
    yaw_ned_rad: float
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    height_above_ground_m: float
    """From the range finder; NaN: unknown."""
    valid_position: bool
    valid_velocity: bool
    valid_attitude: bool
    valid_altitude: bool


_to_estimate = cast(Callable[[tuple[Any, ...]], VehicleEstimate], partial(tuple.__new__, VehicleEstimate))
"""Same as `VehicleEstimate._make`, but without a Python function call for each vehicle."""


def vehicle_estimates(state: EstimateState) -> list[VehicleEstimate]:
    """The estimates of all vehicles as plain numbers.

    This conversion takes less time than reading single array elements in each autopilot.
    """
    angles_rad = np.empty((3, len(state.lat_deg)))
    _write_angles(state.q_ned_frd, angles_rad)
    vectors = (
        state.position_ned_m, state.velocity_ned_m_s, state.acceleration_ned_m_s2, state.q_ned_frd,
        state.rates_frd_rad_s,
    )  # fmt: skip
    scalars = (
        *angles_rad, state.lat_deg, state.lon_deg, state.alt_amsl_m, state.height_above_ground_m,
        state.valid_position, state.valid_velocity, state.valid_attitude, state.valid_altitude,
    )  # fmt: skip
    vector_columns = (map(tuple, vector.tolist()) for vector in vectors)
    scalar_columns = (scalar.tolist() for scalar in scalars)
    rows = zip(*vector_columns, *scalar_columns, strict=True)
    return list(map(_to_estimate, rows))


@dataclass(slots=True)
class BatteryState:
    """Each vehicle's battery as SIM_BAT_* defines it."""

    voltage_v: FloatArray
    """(N,)."""
    current_a: FloatArray
    """(N,) -1: not measured, as in PX4's simulated battery."""
    remaining: FloatArray
    """(N,) remaining charge, 0..1."""
    consumed_mah: FloatArray
    """(N,)."""
    cell_count: IntArray
    """(N,)."""


@dataclass(slots=True)
class TargetState:
    """Last setpoints of the controllers, for ATTITUDE_TARGET and POSITION_TARGET_LOCAL_NED."""

    q_ned_frd: FloatArray
    """(N, 4) attitude setpoint; not updated at level RATES, as in PX4."""
    rates_frd_rad_s: FloatArray
    """(N, 3) body rate setpoint."""
    thrust: FloatArray
    """(N,) collective thrust, 0..1."""
    position_ned_m: FloatArray
    """(N, 3) applied position setpoint; NaN: not controlled."""
    velocity_ned_m_s: FloatArray
    """(N, 3) after position control and limits."""
    acceleration_ned_m_s2: FloatArray
    """(N, 3) after velocity control."""
    yaw_ned_rad: FloatArray
    """(N,)."""
    yaw_rate_ned_rad_s: FloatArray
    """(N,)."""
    hover_thrust: FloatArray
    """(N,) hover thrust that the controllers use (estimated if MPC_USE_HTE is set)."""


@dataclass(frozen=True, slots=True)
class FlightMoment:
    """Motion of a vehicle and memory of its controllers at a moment of a flight."""

    position_ned_m: FloatArray
    """(3,)."""
    velocity_ned_m_s: FloatArray
    """(3,)."""
    q_ned_frd: FloatArray
    """(4,)."""
    rates_frd_rad_s: FloatArray
    """(3,)."""
    rotor_thrust: FloatArray
    """(4,) each rotor's thrust, 0..1."""
    velocity_integral: FloatArray
    """(3,) integral of the velocity controller [m/s²]."""
    rate_integral: FloatArray
    """(3,) integral of the rate controllers."""
    hover_thrust: float
    """The controllers' hover thrust, 0..1."""


@formula
def angles_of(q_ned_frd: Column) -> Vector:
    """Roll, pitch and yaw of one vehicle [rad]."""
    w, x, y, z = q_ned_frd[0], q_ned_frd[1], q_ned_frd[2], q_ned_frd[3]
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@kernel
def _write_angles(q_ned_frd: Rows, angles_rad: Rows) -> None:
    """Writes roll, pitch and yaw of all vehicles to the rows of `angles_rad` (3, N)."""
    for i in range(q_ned_frd.shape[0]):
        angles_rad[0, i], angles_rad[1, i], angles_rad[2, i] = angles_of(q_ned_frd[i])
