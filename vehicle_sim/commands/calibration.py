"""PREFLIGHT_CALIBRATION as in PX4: status texts, acknowledgements and stored parameters.

All calibrations use the readings of the simulated sensors (`readings.py`). The compass and the accelerometer
are calibrated by sides: the pilot places the vehicle on each of its six sides.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.commands.command import (
    ACCEPTED,
    DENIED,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Command,
    CommandHost,
    Handler,
)
from vehicle_sim.commands.readings import Readings, SendParameters, sphere_centre
from vehicle_sim.commands.sides import Rest, RestDetector, Side, offset_and_scale
from vehicle_sim.frames import GRAVITY_M_S2

CALIBRATION, MAG_QUICK = 241, 42006
INFO, CRITICAL, EMERGENCY = 6, 2, 0
"""MAV_SEVERITY."""
ACCELEROMETER_FULL, LEVEL, ACCELEROMETER_QUICK = 1, 2, 4
"""Values of param5."""
HOLD_STILL_TEXT = "[cal] hold vehicle still on a pending side"
REST_TEXT = "[cal] detected rest position, hold still..."
MOTION_TEXT = "[cal] detected motion, hold still..."
PROGRESS_EVERY_S = 0.1
TEXT_INTERVAL_S = 0.05
"""Delay between two texts."""
SIDE_PAUSE_S = 0.136
ACCEL_STILL_S, MAG_STILL_S, MAG_TOLERANCE = 1.3, 0.5, 3.0
"""Required durations of rest, and factor on the motion that counts as rest."""
ACCEL_SAMPLES, GYRO_SAMPLES, QUICK_SAMPLES = 750, 250, 7
REST_TIMEOUT_S = 90.0
MAX_FAILURES = 4
"""Allowed number of failed attempts in a row (side already measured, or no side detected)."""
RUNNING_AFTER_S = 0.6
"""A calibration counts as running until this time after its last text."""
Callback = Callable[[], None]
FloatArray = NDArray[np.float64]
Steps = Generator[float, None, None]
"""Steps of a calibration: each yielded value is the time to wait [s]; 0: until the next sample."""
PartialSteps = Generator[float, None, bool]
"""Steps of a part of a calibration; returns whether it succeeded."""


class CalibrationCommands:
    """Commands 241 and 42006; one calibration at a time.

    Args:
        host: the vehicle.
        send_parameters: sends parameters to every ground station, even if they did not change.
    """

    def __init__(self, host: CommandHost, send_parameters: SendParameters) -> None:
        self._host = host
        self._readings = Readings(host.view, send_parameters)
        self._announcer = host.autopilot.announcer
        self._current_name = ""
        self._measuring = False
        """Whether a side is being measured; a cancel command waits until the measurement ends."""
        self._cancelled_by: Command | None = None
        self._calibration_number = 0
        """Number of the current calibration; delayed callbacks of an earlier calibration are dropped."""
        self._means: dict[Side, FloatArray] = {}
        """Mean reading of each side [m/s²]."""
        self._field_readings: list[FloatArray] = []
        """Compass readings during the rotation of the vehicle [gauss]."""
        self.commands: dict[int, Handler] = {CALIBRATION: self.calibrate, MAG_QUICK: self.calibrate_mag_quick}

    def calibrate(self, c: Command) -> int | None:
        """Starts the calibration that the parameters select; cancels the current one if all are zero."""
        if self._host.autopilot.commander.armed:
            return TEMPORARILY_REJECTED
        requested = [int(p) if math.isfinite(p) else 0 for p in (c.p1, c.p2, c.p3, c.p4, c.p5, c.p6, c.p7)]
        if not any(requested):
            return self._cancel(c)
        if self._current:
            return TEMPORARILY_REJECTED
        if requested[0] == 1:
            return self._begin(self._gyro)
        if requested[1] == 1:
            return self._begin(self._mag)
        if requested[2] == 1:
            return self._begin(self._baro)
        if requested[3] in (1, 2):
            return self._begin(self._remote)
        if requested[4] in (ACCELEROMETER_FULL, LEVEL, ACCELEROMETER_QUICK):
            starts = {ACCELEROMETER_FULL: self._accelerometer, LEVEL: self._level,
                      ACCELEROMETER_QUICK: self._accelerometer_quick}  # fmt: skip
            return self._begin(starts[requested[4]])
        if requested[5] in (1, 2):
            return self._begin(self._airspeed)
        if requested[6] == 1:
            self._text("[cal] calibration failed: Disconnect battery and try again", CRITICAL)
            return DENIED
        return None if requested[0] or requested[2] else UNSUPPORTED

    def calibrate_mag_quick(self, c: Command) -> int:
        """FIXED_MAG_CAL_YAW: calibrates the compass with the heading in param1 and the known field."""
        if self._host.autopilot.commander.armed:
            return TEMPORARILY_REJECTED
        heading_deg = c.p1 if math.isfinite(c.p1) else 0.0
        if self._current:
            return TEMPORARILY_REJECTED
        self._calibration_number += 1
        self._current = "mag quick"
        self._text(f"Assuming vehicle is facing heading {heading_deg:.1f} degrees")
        self._run(self._mag_quick_steps(math.radians(heading_deg)))
        return ACCEPTED

    def _mag_quick_steps(self, yaw_ned_rad: float) -> Steps:
        yield 0.02
        readings = self._readings
        readings.store("CAL_MAG0_", "OFF", readings.mag() - readings.expected_field(yaw_ned_rad))
        yield 0.05
        self._text("Mag quick calibration finished")
        yield RUNNING_AFTER_S
        self._current = ""

    @property
    def _current(self) -> str:
        return self._current_name

    @_current.setter
    def _current(self, name: str) -> None:
        self._current_name = name
        self._host.autopilot.commander.calibrating = bool(name)

    # --- the calibrations ------------------------------------------------------------------------------

    def _begin(self, start_calibration: Callback) -> int:
        self._calibration_number += 1
        start_calibration()
        return ACCEPTED

    def _announce_start(self, name: str) -> None:
        self._current = name
        self._text(f"[cal] calibration started: 2 {name}")

    def _succeed(self, name: str) -> None:
        self._text(f"[cal] calibration done: {name}")
        self._call_later(RUNNING_AFTER_S, lambda: setattr(self, "_current", ""))

    def _fail(self, name: str, reason: str = "") -> None:
        if reason:
            self._text(f"[cal] {reason}", CRITICAL)
        self._current = ""
        self._text(f"[cal] calibration failed: {name}", CRITICAL)

    def _gyro(self) -> None:
        self._announce_start("gyro")
        self._call_later(TEXT_INTERVAL_S, lambda: self._progress(0))
        for step in range(1, 11):
            self._call_later(0.02 + PROGRESS_EVERY_S * step, lambda step=step: self._progress(10 * step))
        self._run(self._gyro_steps())

    def _gyro_steps(self) -> Steps:
        offset = yield from self._readings.mean(self._readings.gyro, GYRO_SAMPLES)
        yield 0.04
        self._readings.store("CAL_GYRO0_", "OFF", offset)
        yield 0.04
        self._succeed("gyro")

    def _mag(self) -> None:
        self._announce_start("mag")
        self._field_readings.clear()
        measure = self._measure_rotation
        self._run(self._calibrate_sides("mag", MAG_STILL_S, MAG_TOLERANCE, measure, self._store_mag))

    def _measure_rotation(self, _side: Side) -> PartialSteps:
        """Samples the magnetic field while the vehicle rests on one side and is rotated."""
        self._text("[cal] Rotate vehicle")
        fields = yield from self._readings.fields_while_turning()
        self._field_readings += fields
        if not fields:
            self._text("Failed: This calibration requires rotation.", CRITICAL)
        return bool(fields)

    def _store_mag(self) -> bool:
        try:
            offset = sphere_centre(np.array(self._field_readings))
        except np.linalg.LinAlgError:
            return False
        self._readings.store("CAL_MAG0_", "OFF", offset)
        return True

    def _accelerometer(self) -> None:
        self._announce_start("accel")
        self._means.clear()
        self._run(
            self._calibrate_sides("accel", ACCEL_STILL_S, 1.0, self._measure_side, self._store_accelerometer)
        )

    def _measure_side(self, side: Side) -> PartialSteps:
        self._measuring = True
        self._text(f"[cal] Hold still, measuring {side.value} side")
        mean = yield from self._readings.mean(self._readings.accel, ACCEL_SAMPLES)
        if not mean[side.axis] * side.sign > 0.0:
            self._text(f"[cal] accel 0 invalid {'XYZ'[side.axis]}-axis, check rotation", EMERGENCY)
            return False
        self._means[side] = mean
        x, y, z = mean.tolist()
        self._text(f"[cal] {side.value} side result: [{x:.3f} {y:.3f} {z:.3f}]")
        yield TEXT_INTERVAL_S
        self._progress(17 * len(self._means))
        yield TEXT_INTERVAL_S
        return True

    def _store_accelerometer(self) -> bool:
        result = offset_and_scale(self._means)
        if result is None:
            return False
        self._readings.store("CAL_ACC0_", "OFF", result[0], send=False)
        self._readings.store("CAL_ACC0_", "SCALE", result[1])
        return True

    # --- calibrations by sides -------------------------------------------------------------------------

    def _calibrate_sides(
        self,
        name: str,
        still_s: float,
        tolerance: float,
        measure: Callable[[Side], PartialSteps],
        store_result: Callable[[], bool] = lambda: True,
    ) -> Steps:
        """A complete calibration by sides."""
        succeeded = yield from self._measure_sides(still_s, tolerance, measure)
        self._measuring = False
        command, self._cancelled_by = self._cancelled_by, None
        if command is not None:
            self._host.acknowledge(command, ACCEPTED)
            self._text("[cal] calibration cancelled", CRITICAL)
            self._current = ""
            yield TEXT_INTERVAL_S
        elif succeeded and store_result():
            yield TEXT_INTERVAL_S
            self._succeed(name)
            return
        self._fail(name)

    def _measure_sides(
        self, still_s: float, tolerance: float, measure: Callable[[Side], PartialSteps]
    ) -> PartialSteps:
        measured: list[Side] = []
        failures = 0
        while len(measured) < len(Side) and self._cancelled_by is None:
            self._measuring = False
            if failures > MAX_FAILURES:
                self._text("[cal] calibration failed: timeout: no motion", CRITICAL)
                return False
            yield TEXT_INTERVAL_S
            self._text("[cal] pending: " + " ".join(side.value for side in Side if side not in measured))
            yield TEXT_INTERVAL_S
            self._text(HOLD_STILL_TEXT)
            side = yield from self._wait_for_rest(RestDetector(still_s, tolerance))
            if side is None or side in measured:
                failures += 1
                self._text(MOTION_TEXT if side is None else f"[cal] {side.value} side already completed")
                continue
            failures = 0
            for _ in range(2):
                self._text(f"[cal] {side.value} orientation detected")
                yield TEXT_INTERVAL_S
            if not (yield from measure(side)):
                return False
            measured.append(side)
            for _ in range(2):
                self._text(f"[cal] {side.value} side done, rotate to a different side")
                yield TEXT_INTERVAL_S
            yield SIDE_PAUSE_S - TEXT_INTERVAL_S
        return self._cancelled_by is None

    def _wait_for_rest(self, detector: RestDetector) -> Generator[float, None, Side | None]:
        """Waits for rest; returns the side that points down. None: between two sides, or no rest in time."""
        simulation = self._host.view.simulation
        started_at_s = simulation.time_s
        while simulation.time_s - started_at_s < REST_TIMEOUT_S:
            yield 0.0
            x, y, z = self._readings.accel().tolist()
            rest = detector.feed((x, y, z), simulation.dt_s)
            if rest is Rest.BEGAN:
                started_at_s = simulation.time_s
                self._text(REST_TEXT)
            elif rest is Rest.BROKEN:
                self._text(MOTION_TEXT)
            elif rest is Rest.STILL:
                if detector.side is None:
                    self._text("ERROR: invalid orientation", CRITICAL)
                return detector.side
        self._text("[cal] calibration failed: reading sensor", CRITICAL)
        return None

    # --- other calibrations ----------------------------------------------------------------------------

    def _baro(self) -> None:
        self._announce_start("baro")
        self._run(self._baro_steps())

    def _baro_steps(self) -> Steps:
        has_fix = yield from self._readings.calibrate_baro()
        if has_fix:
            self._succeed("baro")
        else:
            self._fail("GPS required for baro cal")

    def _remote(self) -> None:
        self._current = "rc"
        self._announcer.announce(INFO, "Calibration: Disabling RC input", "commander_calib_rc_off")

    def _level(self) -> None:
        self._announce_start("level")
        for step in range(6):
            delay_s = TEXT_INTERVAL_S + PROGRESS_EVERY_S * step
            self._call_later(delay_s, lambda step=step: self._progress(20 * step))
        self._run(self._level_steps())

    def _level_steps(self) -> Steps:
        yield TEXT_INTERVAL_S
        problem = yield from self._readings.calibrate_level()
        yield 0.03
        self._progress(100)
        yield TEXT_INTERVAL_S
        if problem:
            self._fail("level", problem)
        else:
            self._succeed("level")

    def _accelerometer_quick(self) -> None:
        self._run(self._accelerometer_quick_steps())

    def _accelerometer_quick_steps(self) -> Steps:
        """Calibrates the accelerometer; assumes that the vehicle is level."""
        mean = yield from self._readings.mean(self._readings.accel, QUICK_SAMPLES)
        self._readings.store("CAL_ACC0_", "OFF", mean + np.array([0.0, 0.0, GRAVITY_M_S2]))

    def _airspeed(self) -> None:
        self._announce_start("airspeed")
        self._call_later(
            TEXT_INTERVAL_S / 2, lambda: self._text("[cal] Ensure sensor is not measuring wind", CRITICAL)
        )

    # --- cancelling and helpers ------------------------------------------------------------------------

    def _cancel(self, c: Command) -> int | None:
        running = self._current
        if running == "baro":
            return None  # a barometer calibration cannot be cancelled
        if self._measuring:
            self._cancelled_by = c  # handled when the side has been measured
            return TEMPORARILY_REJECTED
        if not running:
            return ACCEPTED
        self._calibration_number += 1
        self._current = ""
        if running == "rc":
            self._announcer.announce(INFO, "Calibration: Restoring RC input", "commander_calib_rc_on")
            return ACCEPTED
        self._host.acknowledge(c, ACCEPTED)
        self._text("[cal] calibration cancelled", CRITICAL)
        return TEMPORARILY_REJECTED

    def _text(self, text: str, severity: int = INFO) -> None:
        self._announcer.text(severity, text)

    def _progress(self, percent: int) -> None:
        self._text(f"[cal] progress <{percent}>")

    def _call_later(self, seconds: float, action: Callback) -> None:
        number = self._calibration_number

        def run() -> None:
            if number == self._calibration_number:
                action()

        self._host.call_later(seconds, run)

    def _run(self, steps: Steps) -> None:
        """Runs the steps until another calibration starts."""
        number = self._calibration_number

        def run_next() -> None:
            if number != self._calibration_number:
                return
            wait_s = next(steps, None)
            if wait_s is not None:
                self._host.call_later(wait_s, run_next)

        run_next()
