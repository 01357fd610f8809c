"""Sensor readings for calibrations of one vehicle, and the parameters in which results are stored.

A "raw" reading has no correction by earlier calibrations (CAL_*, SENS_BOARD_*).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import quaternion_of, rotation_matrix
from vehicle_sim.magnetic_field import field_ned_gauss
from vehicle_sim.sensors.suite import pressure_hpa
from vehicle_sim.vehicle_view import VehicleView

MIN_CHANGE = 0.01
"""A result is stored only if its difference from the stored values is larger; in the parameters' unit."""
PRIORITY = 50
"""Priority of a calibrated sensor whose priority is not set."""
LEVEL_DURATION_S, LEVEL_STILL_RAD, LEVEL_MAX_RAD = 0.5, math.radians(0.5), 0.8
"""Duration of the level calibration, range of the angles that counts as still, and largest level angle."""
BARO_DURATION_S, BARO_INTERVAL_S = 3.0, 0.1
MAG_TIMEOUT_S, MAG_INTERVAL_S = 100.0, 0.02
"""Time limit for turning the vehicle on one side, and the sampling period."""
MAG_TURNED_RAD, MAG_SAMPLES_PER_SIDE, MAG_SEPARATION = 0.5, 40, 0.03
"""Rotation of the field before sampling starts, samples for each side, and the minimum distance between
samples as a fraction of the field strength."""
FIX_2D, VERTICAL_ACCURACY_M = 2, 100.0
"""Minimum GPS fix type and accuracy for a barometer calibration."""
FloatArray = NDArray[np.float64]
SendParameters = Callable[[Iterable[str]], None]


class Readings:
    """The sensors of one vehicle, and their calibration parameters."""

    def __init__(self, view: VehicleView, send_parameters: SendParameters) -> None:
        self._view = view
        self._send_parameters = send_parameters

    def accel(self) -> FloatArray:
        """(3,) raw specific force [m/s², FRD]."""
        reading = self._view.simulation.sensors.accel_frd_m_s2[self._view.row]
        return self._unrotated(reading) / self._axis_values("CAL_ACC0_", "SCALE") + self._axis_values(
            "CAL_ACC0_", "OFF"
        )

    def gyro(self) -> FloatArray:
        """(3,) raw body rates [rad/s, FRD]."""
        reading = self._view.simulation.sensors.gyro_frd_rad_s[self._view.row]
        return self._unrotated(reading) + self._axis_values("CAL_GYRO0_", "OFF")

    def mag(self) -> FloatArray:
        """(3,) raw magnetic field [gauss, FRD]."""
        reading = self._view.simulation.sensors.mag_frd_gauss[self._view.row]
        return self._unrotated(reading) / self._axis_values("CAL_MAG0_", "SCALE") + self._axis_values(
            "CAL_MAG0_", "OFF"
        )

    def expected_field(self, yaw_ned_rad: float) -> FloatArray:
        """(3,) expected compass reading at this heading and the estimated roll and pitch [gauss]."""
        estimate = self._view.estimate
        matrix = board_matrix(estimate.roll_rad, estimate.pitch_rad, yaw_ned_rad)
        return matrix.T @ np.array(field_ned_gauss())

    def fields_while_turning(self) -> Generator[float, None, list[FloatArray]]:
        """Raw compass readings during a rotation of the vehicle; empty: no rotation within MAG_TIMEOUT_S."""
        view, first_field = self._view, self.mag()
        fields: list[FloatArray] = []
        strength, end_s = float(np.linalg.norm(first_field)), view.simulation.time_s + MAG_TIMEOUT_S
        while view.simulation.time_s < end_s:
            yield MAG_INTERVAL_S
            field = self.mag()
            if not fields and float(np.linalg.norm(field - first_field)) < MAG_TURNED_RAD * strength:
                continue
            if all(float(np.linalg.norm(field - each)) > MAG_SEPARATION * strength for each in fields):
                fields.append(field)
            if len(fields) == MAG_SAMPLES_PER_SIDE:
                return fields
        return []

    @staticmethod
    def mean(read: Callable[[], FloatArray], samples: int) -> Generator[float, None, FloatArray]:
        """Mean of a number of readings; yields 0 (wait for the next sample) before each reading."""
        total = np.zeros(3)
        for _ in range(samples):
            yield 0.0
            total += read()
        return total / samples

    def store(self, prefix: str, suffix: str, values: FloatArray, *, send: bool = True) -> None:
        """Stores a result in the parameters of three axes; with `send`, also sends the sensor's
        parameters."""
        names = [f"{prefix}{axis}{suffix}" for axis in "XYZ"]
        if float(np.linalg.norm(values - self._axis_values(prefix, suffix))) > MIN_CHANGE:
            for name, value in zip(names, values.tolist(), strict=True):
                self._view.parameters.set(name, value)
        if send:
            self._send_sensor_parameters(prefix)

    def _send_sensor_parameters(self, prefix: str) -> None:
        """Sets the priority of a sensor without one, then sends the sensor's parameters to every ground
        station."""
        store = self._view.parameters
        if store.get(f"{prefix}PRIO") < 0:
            store.set(f"{prefix}PRIO", PRIORITY)
        self._send_parameters([name for name in store.names if name.startswith(prefix)])

    def calibrate_level(self) -> Generator[float, None, str]:
        """Stores the mean attitude over LEVEL_DURATION_S as level (SENS_BOARD_*_OFF); returns an error text
        or ""."""
        view = self._view
        rolls, pitches = list[float](), list[float]()
        end_s = view.simulation.time_s + LEVEL_DURATION_S
        while view.simulation.time_s < end_s:
            yield 0.0
            rolls.append(view.estimate.roll_rad)
            pitches.append(view.estimate.pitch_rad)
        if max(max(angles) - min(angles) for angles in (rolls, pitches)) >= LEVEL_STILL_RAD:
            return "motion during calibration"
        roll, pitch = self._angles_without_board(
            math.fsum(rolls) / len(rolls), math.fsum(pitches) / len(pitches)
        )
        for name, angle in (("roll", roll), ("pitch", pitch)):
            if abs(angle) > LEVEL_MAX_RAD:
                return f"excess {name} angle"
        view.parameters.set("SENS_BOARD_X_OFF", math.degrees(roll))
        view.parameters.set("SENS_BOARD_Y_OFF", math.degrees(pitch))
        self._send_parameters(("SENS_BOARD_X_OFF", "SENS_BOARD_Y_OFF"))
        return ""

    def calibrate_baro(self) -> Generator[float, None, bool]:
        """Sets CAL_BARO0_OFF [Pa] from the mean difference to GPS over BARO_DURATION_S; False: no fix."""
        view, sensors, i = self._view, self._view.simulation.sensors, self._view.row
        pressures_hpa, altitudes_m = list[float](), list[float]()
        for _ in range(round(BARO_DURATION_S / BARO_INTERVAL_S)):
            yield BARO_INTERVAL_S
            pressures_hpa.append(float(sensors.baro_pressure_hpa[i]))
            accurate = sensors.gps_vertical_accuracy_m[i] < VERTICAL_ACCURACY_M
            if sensors.gps_fix_type[i] >= FIX_2D and accurate:
                altitudes_m.append(float(sensors.gps_alt_amsl_m[i]))
        if not altitudes_m:
            return False
        expected_hpa = float(pressure_hpa(np.asarray(math.fsum(altitudes_m) / len(altitudes_m))))
        bias_pa = 100.0 * (math.fsum(pressures_hpa) / len(pressures_hpa) - expected_hpa)
        view.parameters.set("CAL_BARO0_OFF", view.parameter("CAL_BARO0_OFF") + bias_pa)
        return True

    def _axis_values(self, prefix: str, suffix: str) -> FloatArray:
        return np.array([self._view.parameter(f"{prefix}{axis}{suffix}") for axis in "XYZ"])

    def _board_angles(self) -> tuple[float, float]:
        parameter = self._view.parameter
        return math.radians(parameter("SENS_BOARD_X_OFF")), math.radians(parameter("SENS_BOARD_Y_OFF"))

    def _unrotated(self, reading: FloatArray) -> FloatArray:
        return board_matrix(*self._board_angles()).T @ reading

    def _angles_without_board(self, roll_rad: float, pitch_rad: float) -> tuple[float, float]:
        """Roll and pitch that would be estimated without the board rotation."""
        matrix = board_matrix(*self._board_angles()) @ board_matrix(roll_rad, pitch_rad)
        return math.atan2(matrix[2, 1], matrix[2, 2]), math.asin(max(-1.0, min(1.0, -matrix[2, 0])))


def board_matrix(roll_rad: float, pitch_rad: float, yaw_rad: float = 0.0) -> FloatArray:
    """(3, 3) rotation matrix from roll, pitch and yaw; the yaw rotation is the first."""
    return rotation_matrix(np.array([quaternion_of(roll_rad, pitch_rad, yaw_rad)]))[0]


def sphere_centre(points: FloatArray) -> FloatArray:
    """(3,) centre of the sphere that fits the points (M, 3) best (least squares): a compass's offset.

    Raises:
        numpy.linalg.LinAlgError: the points lie in a plane.
    """
    system = np.column_stack((2.0 * points, np.ones(len(points))))
    if np.linalg.matrix_rank(system) < system.shape[1]:
        raise np.linalg.LinAlgError("all points in a plane")
    solution, *_ = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)
    return solution[:3]
