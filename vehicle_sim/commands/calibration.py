"""PREFLIGHT_CALIBRATION as in PX4: its texts, replies and results.

All calibrations use the readings of the simulated sensors (`readings.py`). A calibration by sides requests
each side of the vehicle, and fails if the vehicle is not turned.
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

CALIBRATION, FIXED_MAG = 241, 42006
INFO, CRITICAL, EMERGENCY = 6, 2, 0
"""MAV_SEVERITY."""
ACCELEROMETER_FULL, LEVEL, ACCELEROMETER_QUICK = 1, 2, 4
"""param5."""
STILL = "[cal] hold vehicle still on a pending side"
REST = "[cal] detected rest position, hold still..."
MOTION = "[cal] detected motion, hold still..."
PROGRESS_S = 0.1
TEXT_INTERVAL_S = 0.05
"""Delay between two texts."""
AFTER_A_SIDE_S = 0.136
ACCEL_STILL_S, MAG_STILL_S, MAG_TOLERANCE = 1.3, 0.5, 3.0
"""Required duration of rest, and tolerance of motion."""
ACCEL_SAMPLES, GYRO_SAMPLES, QUICK_SAMPLES = 750, 250, 7
REST_TIMEOUT_S = 90.0
FAILURES_ALLOWED = 4
"""Number of failed attempts (side already done, or none detected) before the calibration fails."""
RUNNING_AFTER_S = 0.6
"""A calibration still counts as running for this time after its last text."""
Action = Callable[[], None]
FloatArray = NDArray[np.float64]
Steps = Generator[float, None, None]
"""Steps of a calibration: each yielded value is the time to wait [s]; 0: until the next sample."""
Check = Generator[float, None, bool]
"""A part of a calibration; returns whether it succeeded."""


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
        self._running_name = ""
        self._measuring = False
        self._cancelled_by: Command | None = None
        self._token = 0
        """Counter of calibrations; delayed actions of an earlier calibration are dropped."""
        self._means: dict[Side, FloatArray] = {}
        """Mean reading of each side [m/s²]."""
        self._fields: list[FloatArray] = []
        """Compass readings while the vehicle was turned [gauss]."""
        self.commands: dict[int, Handler] = {
            CALIBRATION: self.calibrate,
            FIXED_MAG: self.fixed_mag,
        }

    def calibrate(self, c: Command) -> int | None:
        """Starts the calibration of the first parameter that is set; all zero cancels."""
        if self._host.autopilot.commander.armed:
            return TEMPORARILY_REJECTED
        wanted = [int(p) if math.isfinite(p) else 0 for p in (c.p1, c.p2, c.p3, c.p4, c.p5, c.p6, c.p7)]
        if not any(wanted):
            return self._cancel(c)
        if self._running:
            return TEMPORARILY_REJECTED
        if wanted[0] == 1:
            return self._begin(self._gyro)
        if wanted[1] == 1:
            return self._begin(self._mag)
        if wanted[2] == 1:
            return self._begin(self._baro)
        if wanted[3] in (1, 2):
            return self._begin(self._remote)
        if wanted[4] in (ACCELEROMETER_FULL, LEVEL, ACCELEROMETER_QUICK):
            starts = {ACCELEROMETER_FULL: self._accelerometer, LEVEL: self._level,
                      ACCELEROMETER_QUICK: self._accelerometer_quick}  # fmt: skip
            return self._begin(starts[wanted[4]])
        if wanted[5] in (1, 2):
            return self._begin(self._airspeed)
        if wanted[6] == 1:
            self._text("[cal] calibration failed: Disconnect battery and try again", CRITICAL)
            return DENIED
        return None if wanted[0] or wanted[2] else UNSUPPORTED

    def fixed_mag(self, c: Command) -> int:
        """FIXED_MAG_CAL_YAW: calibrates the compass from a given heading and the known field."""
        if self._host.autopilot.commander.armed:
            return TEMPORARILY_REJECTED
        heading_deg = c.p1 if math.isfinite(c.p1) else 0.0
        if self._running:
            return TEMPORARILY_REJECTED
        self._token += 1
        self._running = "mag quick"
        self._text(f"Assuming vehicle is facing heading {heading_deg:.1f} degrees")
        self._run(self._learn_mag_quickly(math.radians(heading_deg)))
        return ACCEPTED

    def _learn_mag_quickly(self, yaw_ned_rad: float) -> Steps:
        yield 0.02
        readings = self._readings
        readings.store("CAL_MAG0_", "OFF", readings.mag() - readings.known_field(yaw_ned_rad))
        yield 0.05
        self._text("Mag quick calibration finished")
        yield RUNNING_AFTER_S
        self._running = ""

    @property
    def _running(self) -> str:
        return self._running_name

    @_running.setter
    def _running(self, name: str) -> None:
        self._running_name = name
        self._host.autopilot.commander.calibrating = bool(name)

    # --- the calibrations ------------------------------------------------------------------------------

    def _begin(self, start: Action) -> int:
        self._token += 1
        start()
        return ACCEPTED

    def _start(self, name: str) -> None:
        self._running = name
        self._text(f"[cal] calibration started: 2 {name}")

    def _done(self, name: str) -> None:
        self._text(f"[cal] calibration done: {name}")
        self._after(RUNNING_AFTER_S, lambda: setattr(self, "_running", ""))

    def _failed(self, name: str, why: str = "") -> None:
        if why:
            self._text(f"[cal] {why}", CRITICAL)
        self._running = ""
        self._text(f"[cal] calibration failed: {name}", CRITICAL)

    def _gyro(self) -> None:
        self._start("gyro")
        self._after(TEXT_INTERVAL_S, lambda: self._progress(0))
        for step in range(1, 11):
            self._after(0.02 + PROGRESS_S * step, lambda step=step: self._progress(10 * step))
        self._run(self._learn_gyro())

    def _learn_gyro(self) -> Steps:
        offset = yield from self._readings.mean(self._readings.gyro, GYRO_SAMPLES)
        yield 0.04
        self._readings.store("CAL_GYRO0_", "OFF", offset)
        yield 0.04
        self._done("gyro")

    def _mag(self) -> None:
        self._start("mag")
        self._fields.clear()
        self._run(self._calibrate_sides("mag", MAG_STILL_S, MAG_TOLERANCE, self._rotate, self._learn_mag))

    def _rotate(self, _side: Side) -> Check:
        """Samples the field while the vehicle is turned on one side."""
        self._text("[cal] Rotate vehicle")
        taken = yield from self._readings.turned_fields()
        self._fields += taken
        if not taken:
            self._text("Failed: This calibration requires rotation.", CRITICAL)
        return bool(taken)

    def _learn_mag(self) -> bool:
        try:
            offset = sphere_centre(np.array(self._fields))
        except np.linalg.LinAlgError:
            return False
        self._readings.store("CAL_MAG0_", "OFF", offset)
        return True

    def _accelerometer(self) -> None:
        self._start("accel")
        self._means.clear()
        self._run(
            self._calibrate_sides("accel", ACCEL_STILL_S, 1.0, self._measure_side, self._learn_accelerometer)
        )

    def _measure_side(self, side: Side) -> Check:
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

    def _learn_accelerometer(self) -> bool:
        found = offset_and_scale(self._means)
        if found is None:
            return False
        self._readings.store("CAL_ACC0_", "OFF", found[0], send=False)
        self._readings.store("CAL_ACC0_", "SCALE", found[1])
        return True

    # --- sides -----------------------------------------------------------------------------------------

    def _calibrate_sides(
        self,
        name: str,
        still_s: float,
        tolerance: float,
        measure: Callable[[Side], Check],
        learn: Callable[[], bool] = lambda: True,
    ) -> Steps:
        """A complete calibration by sides."""
        succeeded = yield from self._each_side(still_s, tolerance, measure)
        self._measuring = False
        command, self._cancelled_by = self._cancelled_by, None
        if command is not None:
            self._host.acknowledge(command, ACCEPTED)
            self._text("[cal] calibration cancelled", CRITICAL)
            self._running = ""
            yield TEXT_INTERVAL_S
        elif succeeded and learn():
            yield TEXT_INTERVAL_S
            self._done(name)
            return
        self._failed(name)

    def _each_side(self, still_s: float, tolerance: float, measure: Callable[[Side], Check]) -> Check:
        done: list[Side] = []
        failures = 0
        while len(done) < len(Side) and self._cancelled_by is None:
            self._measuring = False
            if failures > FAILURES_ALLOWED:
                self._text("[cal] calibration failed: timeout: no motion", CRITICAL)
                return False
            yield TEXT_INTERVAL_S
            self._text("[cal] pending: " + " ".join(side.value for side in Side if side not in done))
            yield TEXT_INTERVAL_S
            self._text(STILL)
            side = yield from self._wait_for_rest(RestDetector(still_s, tolerance))
            if side is None or side in done:
                failures += 1
                self._text(MOTION if side is None else f"[cal] {side.value} side already completed")
                continue
            failures = 0
            for _ in range(2):
                self._text(f"[cal] {side.value} orientation detected")
                yield TEXT_INTERVAL_S
            if not (yield from measure(side)):
                return False
            done.append(side)
            for _ in range(2):
                self._text(f"[cal] {side.value} side done, rotate to a different side")
                yield TEXT_INTERVAL_S
            yield AFTER_A_SIDE_S - TEXT_INTERVAL_S
        return self._cancelled_by is None

    def _wait_for_rest(self, detector: RestDetector) -> Generator[float, None, Side | None]:
        """The side that points down when the vehicle is at rest; None: held at an angle, or not at rest in
        time."""
        simulation = self._host.view.simulation
        begun_s = simulation.time_s
        while simulation.time_s - begun_s < REST_TIMEOUT_S:
            yield 0.0
            x, y, z = self._readings.accel().tolist()
            rest = detector.feed((x, y, z), simulation.dt_s)
            if rest is Rest.BEGAN:
                begun_s = simulation.time_s
                self._text(REST)
            elif rest is Rest.BROKEN:
                self._text(MOTION)
            elif rest is Rest.STILL:
                if detector.side is None:
                    self._text("ERROR: invalid orientation", CRITICAL)
                return detector.side
        self._text("[cal] calibration failed: reading sensor", CRITICAL)
        return None

    # --- without sides --------------------------------------------------------------------------------

    def _baro(self) -> None:
        self._start("baro")
        self._run(self._learn_baro())

    def _learn_baro(self) -> Steps:
        found = yield from self._readings.learn_baro()
        if found:
            self._done("baro")
        else:
            self._failed("GPS required for baro cal")

    def _remote(self) -> None:
        self._running = "rc"
        self._announcer.both(INFO, "Calibration: Disabling RC input", "commander_calib_rc_off")

    def _level(self) -> None:
        self._start("level")
        for step in range(6):
            self._after(TEXT_INTERVAL_S + PROGRESS_S * step, lambda step=step: self._progress(20 * step))
        self._run(self._learn_level())

    def _learn_level(self) -> Steps:
        yield TEXT_INTERVAL_S
        wrong = yield from self._readings.learn_level()
        yield 0.03
        self._progress(100)
        yield TEXT_INTERVAL_S
        if wrong:
            self._failed("level", wrong)
        else:
            self._done("level")

    def _accelerometer_quick(self) -> None:
        self._run(self._learn_quickly())

    def _learn_quickly(self) -> Steps:
        """Calibrates on the assumption that the vehicle is level."""
        mean = yield from self._readings.mean(self._readings.accel, QUICK_SAMPLES)
        self._readings.store("CAL_ACC0_", "OFF", mean + np.array([0.0, 0.0, GRAVITY_M_S2]))

    def _airspeed(self) -> None:
        self._start("airspeed")
        self._after(
            TEXT_INTERVAL_S / 2, lambda: self._text("[cal] Ensure sensor is not measuring wind", CRITICAL)
        )

    # --- ends ------------------------------------------------------------------------------------------

    def _cancel(self, c: Command) -> int | None:
        running = self._running
        if running == "baro":
            return None  # a barometer calibration cannot be cancelled
        if self._measuring:
            self._cancelled_by = c  # handled when the side has been measured
            return TEMPORARILY_REJECTED
        if not running:
            return ACCEPTED
        self._token += 1
        self._running = ""
        if running == "rc":
            self._announcer.both(INFO, "Calibration: Restoring RC input", "commander_calib_rc_on")
            return ACCEPTED
        self._host.acknowledge(c, ACCEPTED)
        self._text("[cal] calibration cancelled", CRITICAL)
        return TEMPORARILY_REJECTED

    def _text(self, text: str, severity: int = INFO) -> None:
        self._announcer.text(severity, text)

    def _progress(self, percent: int) -> None:
        self._text(f"[cal] progress <{percent}>")

    def _after(self, seconds: float, action: Action) -> None:
        token = self._token

        def run() -> None:
            if token == self._token:
                action()

        self._host.after(seconds, run)

    def _run(self, steps: Steps) -> None:
        token = self._token

        def go() -> None:
            if token != self._token:
                return
            wait_s = next(steps, None)
            if wait_s is not None:
                self._host.after(wait_s, go)

        go()
