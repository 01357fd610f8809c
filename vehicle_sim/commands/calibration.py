"""PREFLIGHT_CALIBRATION as PX4 goes through it with a vehicle that lies still: what it says and answers.

The simulated sensors have no error to calibrate away: a finished calibration finds the parameters as they are
and tells them again. One that needs the vehicle turned waits for that until it is cancelled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from vehicle_sim.commands.command import (
    ACCEPTED,
    DENIED,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Command,
    CommandHost,
    Handler,
)

CALIBRATION, FIXED_MAG = 241, 42006
INFO, CRITICAL = 6, 2
"""MAV_SEVERITY."""
ACCELEROMETER_FULL, LEVEL, ACCELEROMETER_QUICK = 1, 2, 4
"""param5."""
PRIORITY = 50
"""Of a calibrated sensor whose priority nobody chose."""
PENDING = "[cal] pending: back front left right up down"
STILL = "[cal] hold vehicle still on a pending side"
REST = "[cal] detected rest position, hold still..."
DOWN = "[cal] down orientation detected"
PROGRESS_S = 0.1
LIST_S = 0.05
BARO_S = 15.0
"""How long the barometer's calibration listens to nobody."""
Action = Callable[[], None]


class CalibrationCommands:
    """Commands 241 and 42006; one calibration at a time.

    Args:
        host: the vehicle.
        tell_parameters: sends these to every ground station, though they are what they were.
    """

    def __init__(self, host: CommandHost, tell_parameters: Callable[[Iterable[str]], None]) -> None:
        self._host = host
        self._tell_parameters = tell_parameters
        self._announcer = host.autopilot.announcer
        self._now = ""
        self._measuring = False
        self._cancelled_by: Command | None = None
        self._token = 0
        """Rises with each calibration: what an ended one still had planned is dropped."""
        self.commands: dict[int, Handler] = {
            CALIBRATION: self.calibrate,
            FIXED_MAG: self.fixed_mag,
        }

    def calibrate(self, c: Command) -> int | None:
        """What the first parameter that is set asks for; all zero cancels."""
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
            self._say("[cal] calibration failed: Disconnect battery and try again", CRITICAL)
            return DENIED
        return None if wanted[0] or wanted[2] else UNSUPPORTED

    def fixed_mag(self, c: Command) -> int:
        """FIXED_MAG_CAL_YAW: the heading is given, the field is known."""
        if self._host.autopilot.commander.armed:
            return TEMPORARILY_REJECTED
        heading_deg = c.p1 if math.isfinite(c.p1) else 0.0
        self._token += 1
        self._say(f"Assuming vehicle is facing heading {heading_deg:.1f} degrees")
        self._at(0.02, lambda: self._tell("CAL_MAG0_"))
        self._at(0.07, lambda: self._say("Mag quick calibration finished"))
        return ACCEPTED

    @property
    def _running(self) -> str:
        return self._now

    @_running.setter
    def _running(self, name: str) -> None:
        self._now = name
        self._host.autopilot.commander.calibrating = bool(name)

    # --- the calibrations ------------------------------------------------------------------------------

    def _begin(self, start: Action) -> int:
        self._token += 1
        start()
        return ACCEPTED

    def _start(self, name: str) -> None:
        self._running = name
        self._say(f"[cal] calibration started: 2 {name}")

    def _done(self, name: str) -> None:
        self._running = ""
        self._say(f"[cal] calibration done: {name}")

    def _gyro(self) -> None:
        self._start("gyro")
        self._at(LIST_S, lambda: self._progress(0))
        for step in range(1, 11):
            self._at(0.02 + PROGRESS_S * step, lambda step=step: self._progress(10 * step))
        self._at(1.04, lambda: self._tell("CAL_GYRO0_"))
        self._at(1.08, lambda: self._done("gyro"))

    def _mag(self) -> None:
        self._start("mag")
        self._sides(1.8, 0.5)
        self._at(2.516, lambda: self._say("[cal] Rotate vehicle"))

    def _accelerometer(self) -> None:
        self._start("accel")
        self._sides(2.4, 1.3)
        self._at(3.876, self._measure_side)
        self._at(6.872, self._down_side)
        self._at(6.918, lambda: self._progress(17))
        for at_s in (6.969, 7.021):
            self._at(at_s, lambda: self._say("[cal] down side done, rotate to a different side"))
        self._at(7.157, self._end_side)

    def _measure_side(self) -> None:
        self._measuring = True
        self._say("[cal] Hold still, measuring down side")

    def _sides(self, rest_s: float, orientation_s: float) -> None:
        self._at(LIST_S, lambda: self._say(PENDING))
        self._at(2 * LIST_S, lambda: self._say(STILL))
        self._at(2 * LIST_S + rest_s, lambda: self._say(REST))
        for n in range(2):
            self._at(2 * LIST_S + rest_s + orientation_s + LIST_S * n, lambda: self._say(DOWN))

    def _down_side(self) -> None:
        view = self._host.view
        x, y, z = view.simulation.sensors.accel_frd_m_s2[view.row].tolist()
        self._say(f"[cal] down side result: [{x:.3f} {y:.3f} {z:.3f}]")

    def _baro(self) -> None:
        self._start("baro")
        self._at(BARO_S, lambda: self._done("baro"))

    def _remote(self) -> None:
        self._running = "rc"
        self._announcer.both(INFO, "Calibration: Disabling RC input", "commander_calib_rc_off")

    def _level(self) -> None:
        self._start("level")
        for step in range(6):
            self._at(LIST_S + PROGRESS_S * step, lambda step=step: self._progress(20 * step))
        self._at(0.57, lambda: self._tell_parameters(("SENS_BOARD_X_OFF", "SENS_BOARD_Y_OFF")))
        self._at(0.585, lambda: self._progress(100))
        self._at(0.63, lambda: self._done("level"))

    def _accelerometer_quick(self) -> None:
        self._at(0.03, lambda: self._tell("CAL_ACC0_"))

    def _airspeed(self) -> None:
        self._start("airspeed")
        self._at(LIST_S / 2, lambda: self._say("[cal] Ensure sensor is not measuring wind", CRITICAL))

    # --- ends ------------------------------------------------------------------------------------------

    def _cancel(self, c: Command) -> int | None:
        running = self._running
        if running == "baro":
            return None  # it hears nothing while it samples
        if self._measuring:
            self._cancelled_by = c  # heard when the side is measured
            return TEMPORARILY_REJECTED
        if not running:
            return ACCEPTED
        self._token += 1
        self._running = ""
        if running == "rc":
            self._announcer.both(INFO, "Calibration: Restoring RC input", "commander_calib_rc_on")
            return ACCEPTED
        self._host.acknowledge(c, ACCEPTED)
        self._say("[cal] calibration cancelled", CRITICAL)
        return TEMPORARILY_REJECTED

    def _end_side(self) -> None:
        self._measuring = False
        command, self._cancelled_by = self._cancelled_by, None
        if command is None:
            return
        self._running = ""
        self._host.acknowledge(command, ACCEPTED)
        self._say("[cal] calibration cancelled", CRITICAL)
        self._at(LIST_S, lambda: self._say("[cal] calibration failed: accel", CRITICAL))

    def _tell(self, prefix: str) -> None:
        store = self._host.view.parameters
        if store.get(f"{prefix}PRIO") < 0:
            store.set(f"{prefix}PRIO", PRIORITY)
        self._tell_parameters([name for name in store.names if name.startswith(prefix)])

    def _say(self, text: str, severity: int = INFO) -> None:
        self._announcer.text(severity, text)

    def _progress(self, percent: int) -> None:
        self._say(f"[cal] progress <{percent}>")

    def _at(self, seconds: float, action: Action) -> None:
        token = self._token

        def run() -> None:
            if token == self._token:
                action()

        self._host.after(seconds, run)
